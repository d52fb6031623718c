"""An episode driven, one decision after another; training, evaluation and replay consume it."""

from collections.abc import Callable, Iterator

from drl_av.drivers.driver import Driver
from drl_av.env.decision import Decision
from drl_av.env.highway import HighwayEnv, Observation
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult


def rollout(
    env: HighwayEnv, driver: Driver, seed: int, vehicles: int | None = None
) -> Iterator[Decision]:
    """Drive one episode, and yield each decision before the driver takes the next one.

    The caller may therefore learn between two decisions. Without a number of vehicles the config
    determines it. The environment is reset when the first decision is asked for; raises what
    ``HighwayEnv.reset`` and ``HighwayEnv.step`` raise.
    """
    observation = _start(env, driver, seed, vehicles)
    yield from _decisions(env, driver, observation)


def drive(
    env: HighwayEnv,
    driver: Driver,
    name: str,
    seed: int,
    vehicles: int,
    watch: Callable[[HighwayEnv], None] | None = None,
) -> EpisodeResult:
    """Drive one episode to its end; ``watch`` is called after the reset and each decision."""
    metrics = EpisodeMetrics()
    observation = _start(env, driver, seed, vehicles)
    if watch:
        watch(env)
    for decision in _decisions(env, driver, observation):
        metrics.add(decision)
        if watch:
            watch(env)
    return metrics.result(name, env.check_name, vehicles, seed)


def _start(env: HighwayEnv, driver: Driver, seed: int, vehicles: int | None) -> Observation:
    options = None if vehicles is None else {"vehicles": vehicles}
    observation, _ = env.reset(seed=seed, options=options)
    driver.start(seed)
    return observation


def _decisions(env: HighwayEnv, driver: Driver, observation: Observation) -> Iterator[Decision]:
    over = False
    while not over:
        scene, before = env.scene, observation
        action = driver.act(scene, before)
        observation, reward, terminated, truncated, info = env.step(action.number)
        over = terminated or truncated
        yield Decision(
            scene, before, action, reward, env.scene, observation, terminated, truncated, info
        )
