"""Drivers by name, and learned drivers from a run, a policy file or this package."""

from collections.abc import Callable
from pathlib import Path

from drl_av.config import Config, nearest_name
from drl_av.driving.drivers import Driver
from drl_av.driving.drivers.rules import IdmDriver, IdmSumoDriver, RandomDriver
from drl_av.errors import ConfigError, RunError

PRETRAINED = Path(__file__).parent.parent / "pretrained"
"""Folder of the driver that ships with the package; laid out as a run's."""

RULE_DRIVERS: dict[str, Callable[[Config], Driver]] = {
    "idm": lambda config: IdmDriver(config.safety),
    "idm-sumo": lambda config: IdmSumoDriver(config.safety),
    "random": lambda config: RandomDriver(),
}


def rule_driver(name: str, config: Config) -> Driver:
    """The driver of that name; raises ConfigError with the nearest one."""
    if name not in RULE_DRIVERS:
        near = nearest_name(name, (*RULE_DRIVERS, "pretrained"))
        hint = f" (did you mean {near!r}?)" if near else ""
        raise ConfigError(
            f"There is no driver {name!r}{hint}; "
            f"the drivers are: {', '.join((*RULE_DRIVERS, 'pretrained'))}."
        )
    return RULE_DRIVERS[name](config)


def learned_driver(path: Path) -> tuple[Driver, Config]:
    """The driver of a run's folder or of a policy file, and the config that built it.

    Raises:
        RunError: there is no such run, or it has saved no policy yet.
        CheckpointError: the policy file is damaged.
    """
    from drl_av.learning.checkpoint import load_policy
    from drl_av.learning.training import GreedyDriver

    file = path / "policy.safetensors" if path.is_dir() else path
    if not file.is_file():
        raise RunError(
            f"{path} holds no trained driver: give a run's folder that has a policy.safetensors, "
            "or leave the run out for the driver that ships with drl-av."
        )
    network, config = load_policy(file)
    return GreedyDriver(network), config
