"""The preset ``fast`` on several seeds, beside the driver of the paper's whole schedule (ours)."""

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

from drl_av.config import Config
from drl_av.episode import EpisodeResult
from drl_av.presets import preset
from drl_av.studies import DENSITIES
from drl_av.studies.drivers import choose, policy_file
from drl_av.studies.evaluation import Evaluation, Mean, mean_with_interval
from drl_av.studies.files import require_writable
from drl_av.studies.reproduction.curves import variant_config
from drl_av.studies.reproduction.engines import ENGINES
from drl_av.studies.reproduction.legs import Leg, drive_leg, episodes_driven, wall_time_s
from drl_av.studies.reproduction.provenance import (
    checksum,
    provenance,
    read_sidecar,
    sidecar,
    write_sidecar,
)
from drl_av.studies.reproduction.scale import Progress, Scale
from drl_av.studies.reproduction.tables import Row, intact, write_rows

TABLE = "fast.csv"


def fast(scale: Scale) -> Generator[Progress, None, None]:
    """Train both, drive them all through the same traffic, and write ``fast.csv``.

    The long training is that of the learning curves, seed 0, and goes on from there. Nothing is
    driven where the table is there, made of the same policies on as many episodes.

    Raises:
        DrlAvError: as ``Evaluation``; the trainings' folders hold others; or the disk refuses.
        SimulationError: a training cannot go on.
    """
    scale.out.mkdir(parents=True, exist_ok=True)
    scale.runs.mkdir(parents=True, exist_ok=True)
    table = scale.out / TABLE
    require_writable(table, sidecar(table))
    legs = _legs(scale)
    total = sum(leg.stop for leg in legs)
    with closing(ENGINES[scale.engine](drive_leg, legs, scale.jobs)) as engine:
        for _ in engine:
            yield Progress(sum(episodes_driven(leg.folder) for leg in legs), total, "training")
    config = legs[0].config
    seeds = f"0 to {scale.drives - 1}"
    policies = {leg.folder.name: checksum(policy_file(leg.folder)) for leg in legs}
    with intact(table):
        facts = read_sidecar(table)
        if (facts.get("policies_sha256"), facts.get("seeds")) == (policies, seeds):
            return
    choices = choose(str(leg.folder) for leg in legs)
    evaluation = Evaluation(config, choices, DENSITIES, range(scale.drives))
    results: list[EpisodeResult] = []
    with closing(evaluation.rows(scale.jobs)) as found:
        for result in found:
            results.append(result)
            yield Progress(len(results), len(evaluation), "driving")
    own = [[r for r in results if r.driver == choice.name] for choice in choices]
    rows = [summary(leg, driven, own[0]) for leg, driven in zip(legs, own, strict=True)]
    write_rows(table, rows)
    made = provenance(
        config,
        processes=scale.jobs,
        seeds=seeds,
        policies_sha256=policies,
        settings=asdict(config),
    )
    write_sidecar(table, made)


def _legs(scale: Scale) -> list[Leg]:
    """The long training first, then ``fast`` on every seed."""
    long = variant_config(scale.over(Config()), "paper")
    short = scale.over(preset("fast"))
    configs = {"paper-0": long} | {
        f"fast-{seed}": short.updated("learning", seed=seed) for seed in range(scale.seeds)
    }
    return [_leg(scale.runs / name, config) for name, config in configs.items()]


def _leg(folder: Path, config: Config) -> Leg:
    learning, variant = config.learning, folder.name.partition("-")[0]
    episodes, every = learning.episodes, learning.evaluate_every
    return Leg(variant, learning.seed, episodes, config, folder, every)


def summary(leg: Leg, driven: Sequence[EpisodeResult], long: Sequence[EpisodeResult]) -> Row:
    """What a training took and what its driver does, paired with the long training's driver.

    ``driven`` and ``long`` are of the same traffic in the same order.
    """
    seconds = wall_time_s(leg.clock)
    row = {
        "training": leg.variant,
        "seed": str(leg.seed),
        "episodes": str(leg.stop),
        "wall_time_s": "" if seconds is None else f"{seconds:.1f}",
        "drives": str(len(driven)),
        "ego_hits": str(sum(result.ego_hit for result in driven)),
    }
    for name in ("mean_reward", "mean_speed_m_s"):
        here = [getattr(result, name) for result in driven]
        there = [getattr(result, name) for result in long]
        gain = mean_with_interval(a - b for a, b in zip(here, there, strict=True))
        row |= _cells(name, mean_with_interval(here)) | _cells(f"{name}_gain", gain)
    return row


def _cells(name: str, mean: Mean) -> Row:
    return {name: f"{mean.value:.6g}", f"{name}_ci95": f"{mean.half_width:.6g}"}
