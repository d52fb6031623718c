"""The rollout of one episode, for training, evaluation and replay."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from drl_av.drivers.driver import Driver, ask
from drl_av.drivers.rule_based import SumoDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.env.transition import Transition
from drl_av.errors import warn

Watcher = Callable[[Transition], None]
"""A function that gets each decision of an episode."""


def rollout(
    env: HighwayEnv, driver: Driver, seed: int, vehicles: int | None = None
) -> Iterator[Transition]:
    """Drive one episode, and yield each decision before the driver makes the next.

    The caller may therefore train the driver between two decisions. The episode begins when the
    caller requests the first decision; ``HighwayEnv.reset`` then gets ``seed`` and ``vehicles``. If
    ``strict`` cannot protect the ego from this start, a DrlAvWarning says so.

    Raises:
        DrlAvError: ``HighwayEnv.reset`` or ``HighwayEnv.execute`` raises it, or the driver's
            ``act`` does not return an ``Action``.
    """
    options = None if vehicles is None else {"vehicles": vehicles}
    _, info = env.reset(seed=seed, options=options)
    if info["unsafe_start"]:
        warn(
            "An episode begins where strict cannot protect the ego (info['unsafe_start']): place "
            "the vehicles farther apart."
        )
    driver.start(seed)
    if isinstance(driver, SumoDriver):
        env.hand_over(driver.model)
    over = False
    while not over:
        number = 0
        if not isinstance(driver, SumoDriver):
            number = ask(driver, env.scene, env.observation).number
        decision = env.execute(number)
        over = decision.terminated or decision.truncated
        yield decision


def drive(
    env: HighwayEnv,
    driver: Driver,
    name: str,
    seed: int,
    vehicles: int,
    make_metrics: Callable[[], EpisodeMetrics] = EpisodeMetrics,
    watchers: Iterable[Watcher] = (),
) -> EpisodeResult:
    """Drive one episode to its end and return its metrics; ``name`` is the name of the driver.

    Each watcher gets each decision.

    Raises:
        DrlAvError: as ``rollout``.
    """
    metrics = make_metrics()
    for decision in rollout(env, driver, seed, vehicles):
        for watch in (metrics.add, *watchers):
            watch(decision)
    result = metrics.result(name, env.check_name, vehicles, seed)
    return replace(result, world=env.config.simulation.world)
