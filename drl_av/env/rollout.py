"""The rollout of one episode, for training, evaluation and replay."""

from collections.abc import Callable, Iterator

from drl_av.drivers.driver import Driver
from drl_av.drivers.rule_based import SumoDriver
from drl_av.driving.actions import ACTIONS, Action
from drl_av.env.decision import Decision
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.env.route_outcome import front_m
from drl_av.errors import ConfigError


def rollout(
    env: HighwayEnv, driver: Driver, seed: int, vehicles: int | None = None
) -> Iterator[Decision]:
    """Drive one episode, and yield each decision before the driver makes the next.

    The caller may therefore train the driver between two decisions. The episode begins when the
    caller requests the first decision; ``HighwayEnv.reset`` then gets ``seed`` and ``vehicles``.

    Raises:
        DrlAvError: ``HighwayEnv.reset`` or ``HighwayEnv.step`` raises it, or the driver's ``act``
            does not return an ``Action``.
    """
    options = None if vehicles is None else {"vehicles": vehicles}
    observation, _ = env.reset(seed=seed, options=options)
    driver.start(seed)
    if isinstance(driver, SumoDriver):
        env.hand_over(driver.model)
    over = False
    while not over:
        scene, before = env.scene, observation
        number = 0 if isinstance(driver, SumoDriver) else _number(driver.act(scene, before))
        observation, reward, terminated, truncated, info = env.step(number)
        over = terminated or truncated
        proposed = ACTIONS[info["proposed_action"]]
        after = env.scene
        missed_exit = env.road.misses_exit(after.affordances.lane, front_m(after))
        step = proposed, reward, after, observation, terminated, truncated, info
        yield Decision(scene, before, *step, missed_exit)


def _number(action: Action) -> int:
    try:
        return action.number
    except AttributeError as error:
        raise ConfigError(
            f"The driver's act returned {action!r}, but must return an Action, such as "
            "ACTIONS[number] of drl_av.driving.actions."
        ) from error


def drive(
    env: HighwayEnv,
    driver: Driver,
    name: str,
    seed: int,
    vehicles: int,
    make_metrics: Callable[[], EpisodeMetrics] = EpisodeMetrics,
) -> EpisodeResult:
    """Drive one episode to its end and return its metrics; ``name`` is the name of the driver.

    Raises:
        DrlAvError: as ``rollout``.
    """
    metrics = make_metrics()
    for decision in rollout(env, driver, seed, vehicles):
        metrics.add(decision)
    return metrics.result(name, env.check_name, vehicles, seed)
