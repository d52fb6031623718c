"""The errors raised on purpose; each message is one sentence: what, where, what to do."""


class DrlAvError(Exception):
    """Base of every error a user can mend; the command line prints it and exits with status 1."""


class ConfigError(DrlAvError):
    """A setting is unknown, of the wrong type, or outside its bounds."""


class ScenarioError(DrlAvError):
    """A scenario folder is missing, incomplete, or not a closed loop."""


class SimulationError(DrlAvError):
    """SUMO could not be started, or ended on its own."""


class DisplayError(SimulationError):
    """sumo-gui was asked for and there is no screen to open it on."""


class CheckpointError(DrlAvError):
    """A checkpoint or policy file is cut short, damaged, or belongs to another configuration."""


class RunError(DrlAvError):
    """A run folder cannot be used as asked: it exists already, or is not a run."""


class RecordingError(DrlAvError):
    """A recorded episode is damaged, or its replay did not follow it."""
