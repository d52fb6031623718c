"""The interface of the drivers of the ego, and how they are asked."""

from typing import Protocol

from drl_av.arrays import Float32Array
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene, unwritable
from drl_av.errors import ConfigError


class Driver(Protocol):
    """Proposes one action for each decision of the ego; the safety check examines this action."""

    def start(self, seed: int) -> None:
        """Prepare for a new episode; by default do nothing.

        A driver that needs random numbers draws them from a generator with this seed.
        """
        return None

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return the action to propose in this scene.

        ``observation`` is the environment's observation of this scene. By default it holds the 27
        affordance indicators, scaled to about [-1, 1]. The scene's arrays cannot be written: copy
        what you roll forward.
        """


def ask(driver: Driver, scene: Scene, observation: Float32Array) -> Action:
    """Return what a driver, which may be the user's, proposes; ConfigError if it is no action."""
    with unwritable(driver, scene):
        action = driver.act(scene, observation)
    if isinstance(action, Action) and action in ACTIONS:
        return action
    raise ConfigError(
        f"The driver's act returned {action!r}, but must return an Action, such as "
        "ACTIONS[number] of drl_av.driving.actions."
    )
