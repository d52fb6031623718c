"""The safety checks by the name that a config gives them."""

from functools import partial

from drl_av.config import Config
from drl_av.driving.safety import SafetyCheck, paper, permit_all
from drl_av.driving.strict import Strict


def named_check(config: Config) -> SafetyCheck:
    """The check that a config names."""
    if config.safety.check == "strict":
        return Strict(config.strict, config.ego, config.simulation)
    if config.safety.check == "paper":
        return partial(paper, config=config.safety)
    return permit_all
