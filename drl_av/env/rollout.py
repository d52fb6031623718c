"""An episode driven, one decision after another; training, evaluation and replay consume it."""

from collections.abc import Iterator

from drl_av.drivers.driver import Driver
from drl_av.drivers.sumo import SumoDriver
from drl_av.env.decision import Decision
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult


def rollout(
    env: HighwayEnv, driver: Driver, seed: int, vehicles: int | None = None
) -> Iterator[Decision]:
    """Drive one episode, and yield each decision before the driver takes the next one.

    The caller may therefore learn between two decisions. The seed and the number of vehicles mean
    what they mean to ``HighwayEnv.reset``, which is called when the first decision is asked for.

    Raises:
        DrlAvError: as ``HighwayEnv.reset`` and ``HighwayEnv.step``.
    """
    options = None if vehicles is None else {"vehicles": vehicles}
    observation, _ = env.reset(seed=seed, options=options)
    driver.start(seed)
    if isinstance(driver, SumoDriver):
        env.hand_over(driver.model)
    over = False
    while not over:
        scene, before = env.scene, observation
        action = driver.act(scene, before)
        observation, reward, terminated, truncated, info = env.step(action.number)
        over = terminated or truncated
        yield Decision(
            scene, before, action, reward, env.scene, observation, terminated, truncated, info
        )


def drive(env: HighwayEnv, driver: Driver, name: str, seed: int, vehicles: int) -> EpisodeResult:
    """Drive one episode to its end; ``name`` stands for the driver in the row."""
    metrics = EpisodeMetrics()
    for decision in rollout(env, driver, seed, vehicles):
        metrics.add(decision)
    return metrics.result(name, env.check_name, vehicles, seed)
