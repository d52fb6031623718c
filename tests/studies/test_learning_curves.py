"""Learning curves and continual adaptation: trained, resumed, summarized and drawn."""

import json
import math
import os
import signal
from collections.abc import Callable
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from runs import TINY, files_of

from drl_av.config import Config
from drl_av.drivers.policy_file import load, load_policy
from drl_av.errors import DrlAvError, RunError
from drl_av.evaluation import engines
from drl_av.evaluation.provenance import checksum
from drl_av.evaluation.table import read_rows
from drl_av.files.table import write_table
from studies import adaptation, learning_curves
from studies import engine as module
from studies.adaptation import ADAPTATION, adaptation_figure, adaptation_table
from studies.engine import Progress, make
from studies.learning_curves import CURVES, converged_at, convergence, curve, smoothed
from studies.options import Options
from studies.trainings import TrainingJob, train_job

LAST = 9
"""Episode at which the longer training is killed once, of 12; its last checkpoint is 8's."""


@pytest.fixture(autouse=True)
def _few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learning_curves, "EPISODES", {"paper": (12, 6)})


def tiny(**learning: int) -> str:
    """The settings of ``TINY`` that are not the defaults, and others of [learning]."""
    config, usual = asdict(TINY.updated("learning", **learning)), asdict(Config())
    sections = ("simulation", "learning")
    return tomli_w.dumps({s: dict(config[s].items() - usual[s].items()) for s in sections})


def options(folder: Path, **changes: Any) -> Options:
    (folder / "settings.toml").write_text(tiny())
    usual = Options(engine="here", runs=folder / "runs", out=folder)
    return usual._replace(config=(str(folder / "settings.toml"),), **changes)


def trained(wanted: Options) -> list[Progress]:
    return list(make(CURVES, wanted))


def doomed(last: int) -> Callable[[TrainingJob], None]:
    """Work that is killed once, after that episode of seed 0, and keeps a log of its episodes."""

    def work(job: TrainingJob) -> None:  # goes to its process by value, with all it names
        from drl_av.learning.run_folder import Run, Training

        mark, log = job.folder.with_suffix(".killed"), job.folder.with_suffix(".log")
        append, run_episode = Run.append, Training.run_episode

        def logged(training: Training) -> Any:
            row = run_episode(training)
            with log.open("a") as file:
                file.write(f"{row.episode}\n")
            return row

        def deadly(run: Run, file: Path, row: Any) -> None:
            append(run, file, row)
            if row.episode == last and job.name == "paper-0" and not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)

        Run.append, Training.run_episode = deadly, logged  # type: ignore[method-assign]
        try:
            train_job(job)
        finally:
            Run.append, Training.run_episode = append, run_episode  # type: ignore[method-assign]

    return work


@pytest.mark.parametrize(
    ("engine", "seeds"), [("loky", 1), pytest.param("ray", 2, marks=pytest.mark.ray)]
)
def test_killed_worker_is_begun_again_at_its_checkpoint_and_nothing_counts_twice(
    engine: str, seeds: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "undisturbed").mkdir()
    trained(options(tmp_path / "undisturbed", most_trainings=seeds))
    monkeypatch.setattr(module, "train_job", doomed(LAST))
    steps = trained(options(tmp_path, engine=engine, most_trainings=seeds))
    assert (tmp_path / "runs" / "paper-0.killed").exists()
    driven = [int(line) for line in (tmp_path / "runs" / "paper-0.log").read_text().split()]
    assert driven == [*range(1, 10), *range(9, 13)]  # 9 was on disk, but in no checkpoint
    found = read_rows(tmp_path / "curves.csv")
    assert found == read_rows(tmp_path / "undisturbed" / "curves.csv")
    assert [(row["seed"], row["episode"]) for row in found] == [
        *(("0", str(episode)) for episode in (3, 6, 9, 12)),
        *(("1", str(episode)) for episode in (3, 6) if seeds == 2),
    ]
    for name in [f"paper-{seed}" for seed in range(seeds)]:
        own, other = (folder / "runs" / name for folder in (tmp_path, tmp_path / "undisturbed"))
        assert files_of(own) == files_of(other)
    wanted = 12 if seeds == 1 else 12 + 6
    assert (steps[-1].done, steps[-1].total) == (wanted, wanted)  # of all trainings
    facts = json.loads((tmp_path / "curves.json").read_text())
    assert facts["engine"] == engine
    assert facts["settings"]["paper"]["learning"]["episodes"] == 12
    assert facts["wall_time_s"].keys() == {f"paper-{seed}" for seed in range(seeds)}
    assert len(read_rows(tmp_path / "convergence.csv")) == seeds


def test_what_the_table_holds_is_not_trained_again_though_the_folders_are_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained(options(tmp_path))
    before, asked = (tmp_path / "curves.csv").read_bytes(), list[tuple[str, int]]()

    def refusing(work: object, jobs: list[TrainingJob], processes: int) -> Any:
        asked.extend((job.name, job.stop) for job in jobs)
        yield []

    monkeypatch.setitem(engines.ENGINES, "here", refusing)
    elsewhere = options(tmp_path, runs=tmp_path / "elsewhere")
    assert trained(elsewhere) == []
    assert not asked
    assert (tmp_path / "curves.csv").read_bytes() == before
    monkeypatch.setattr(learning_curves, "EPISODES", {"paper": (12, 9)})
    with pytest.raises(DrlAvError, match=r"paper-1 lacks rows .* up to episode 9"):
        trained(elsewhere)
    assert asked == [("paper-1", 9)]


def test_rows_of_a_folder_of_other_settings_never_reach_a_table(tmp_path: Path) -> None:
    trained(options(tmp_path))
    other = options(tmp_path)._replace(out=tmp_path / "out")
    text = tiny(batch_size=32)
    (tmp_path / "settings.toml").write_text(text)
    with pytest.raises(RunError, match=r"begun with other settings.*--runs"):
        trained(other)
    assert not (tmp_path / "out" / "curves.csv").exists()


DRAWN = """
variant,seed,episode,mean_reward,training_reward,training_collisions,safety_triggers
""" + "".join(
    f"{variant},{seed},{episode},{base - seed / 10},-0.9,{0.4 + seed / 10},7\n"
    for variant, base in (("paper", -0.1), ("permit_all", -0.5))
    for seed, last in ((0, 500), (1, 300))
    for episode in range(100, last + 1, 100)
)
"""Two seeds to episode 300, the first to 500; no row of the third variant."""
FIGURES = CURVES.figures


def test_check_figure_has_means_over_seeds_and_continues_with_the_longer_one(
    tmp_path: Path,
) -> None:
    (tmp_path / "curves.csv").write_text(DRAWN.lstrip())
    figure = FIGURES["learning_check"](tmp_path)
    reward, exploring, collisions = figure.axes
    mean = reward.lines[0]
    assert mean.get_label() == "two buffers, safety check (2 seeds)"
    assert list(mean.get_xdata()) == [100, 200, 300]
    assert mean.get_ydata() == pytest.approx([-0.15] * 3)
    lone = [line for line in reward.lines if list(line.get_xdata()) == [300, 400, 500]]
    assert [line.get_ydata()[0] for line in lone] == pytest.approx([-0.1, -0.5])
    assert exploring.lines[0].get_ydata() == pytest.approx([-0.9] * 3)
    assert collisions.lines[0].get_ydata() == pytest.approx([0.45] * 3)
    band = reward.collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == pytest.approx((-0.78531, 0.48531))  # t = 12.706


def test_replay_figure_draws_the_variants_there_are(tmp_path: Path) -> None:
    (tmp_path / "curves.csv").write_text(DRAWN.lstrip())
    reward, triggers = FIGURES["learning_replay"](tmp_path).axes
    labels = [line.get_label() for line in reward.lines]
    assert "two buffers, safety check (2 seeds)" in labels
    assert not any("no safety check" in str(label) for label in labels)
    assert triggers.lines[0].get_ydata() == pytest.approx([7] * 3)


REPLAYED = "variant,seed,episode,mean_reward,mean_speed_m_s\n" + "".join(
    f"{variant},{seed},{episode},{reward if episode == 1000 else -9},{24 + seed}\n"
    for variant, rewards in {
        "mixed_paper": (-0.02, -0.03, -0.04, -0.05),
        "mixed_uniform": (-0.01, -0.045, -0.06, -0.07),
        "uniform": (5, 5, 5, 5),
    }.items()
    for seed, reward in enumerate(rewards)
    for episode in range(100, 1001, 100)
)
"""Of the ten evaluations of each seed the last one is the end; calm traffic is a decoy."""


def test_buffers_are_compared_by_the_middle_half_of_the_seeds_and_by_pairs(tmp_path: Path) -> None:
    (tmp_path / "curves.csv").write_text(REPLAYED)
    ours, uniform = (
        [cell.strip() for cell in line.split("|")]
        for line in CURVES.tables["replay"](tmp_path).splitlines()[2:]
    )
    # the middle two of four: -(0.03 + 0.04) / 2 and -(0.045 + 0.06) / 2; speeds (25 + 26) / 2
    assert ours[1:3] == ["`mixed_paper`", "4"]
    assert ours[3].startswith("-0.0350 [")
    assert ours[4].startswith("25.50 [")
    assert ours[5] == "-"
    assert uniform[1:3] == ["`mixed_uniform`", "4"]
    assert uniform[3].startswith("-0.0525 [")
    # of 16 pairs ours wins 0 against -0.01, 3 against -0.045, and all 8 against the other two
    assert uniform[5].startswith("0.69 [")


def test_sumo_lies_within_nine_tenths_of_the_trainings_in_the_twin(tmp_path: Path) -> None:
    trainings = {
        # at each episode the quantiles of the twin's four are -3 + 0.05 * 3 and -3 + 0.95 * 3
        "mixed_paper": [(0, 0), (-1, 0), (-2, 0), (-3, 0)],
        # two of four evaluations lie between them; -2.9 and -0.1 are the decoys of the extremes
        "sumo_paper": [(-2.9, 10), (-0.1, 10), (-2.8, 0), (-0.2, 0)],
        "mixed_permit_all": [(-7, 5)] * 2,
        "sumo_permit_all": [(-7, 5), (-9, 6)],
        "permit_all": [(-99, 10)],
    }
    rows = [
        row(variant, seed, episode, reward, collisions)
        for variant, ends in trainings.items()
        for seed, (reward, collisions) in enumerate(ends)
        for episode in (100, 200)
    ]
    write_table(tmp_path / "curves.csv", rows[0], rows)
    lines = CURVES.tables["worlds"](tmp_path).splitlines()[2:]
    cells = [[cell.strip() for cell in line.split("|")][1:-1] for line in lines]
    assert [line[0] for line in cells] == ["`sumo_paper`"] * 3 + ["`sumo_permit_all`"] * 3
    assert [line[-2] for line in cells] == ["50", "100", "50", "50", "100", "50"]
    # of the four -1 and -2 lie within the others' (-2.9 and -0.2 for the first), 0 and -3 do not
    assert [line[-1] for line in cells] == ["50", "100", "100"] + ["100"] * 3
    # the mean of -2.9, -0.1, -2.8 and -0.2; collisions are a share of ten episodes
    assert [cell[:6] for cell in cells[0][2:4]] == ["-1.500", "-1.500"]
    assert [cells[5][2][:5], cells[5][3]] == ["0.550", "0.500 ± 0.000"]


def test_when_trainings_collide_while_exploring_early_and_for_the_last_time(tmp_path: Path) -> None:
    # collisions in ten greedy episodes; 200 and 700 are the decoys of "from 300 to 600"
    early = {200: (10, 10), 300: (4, 6), 600: (2, 0), 700: (9, 9), 1000: (1, 0), 5000: (0, 0)}
    late = {5100: (0, 0), 9000: (0, 3), 10_000: (0, 0)}
    exploring = {200: (1.0, 0.9), 5000: (0.8, 0.7), 5100: (0.0, 0.0)}
    rows = [
        row(variant, seed, episode, 0.0, counts[seed])
        | {"training_collisions": str(exploring.get(episode, (1.0, 1.0))[seed])}
        for variant in learning_curves.WORLDS
        for episode, counts in (early | late).items()
        for seed in range(2)
    ]
    write_table(tmp_path / "curves.csv", rows[0], rows)
    lines = CURVES.tables["learning_collisions"](tmp_path).splitlines()[2:]
    # (1.9 + 4 * 2 + 1.5) / 12; (2 + 0) / 20 to (4 + 6) / 20; seed 0 ends at 1,000, seed 1 at 9,000
    found = "95.0 | 10 to 50 | 1 of 2 | 9000"
    assert lines == [f"| `{variant}` | {found} |" for variant in learning_curves.WORLDS]
    write_table(tmp_path / "curves.csv", rows[0], [r for r in rows if r["episode"] == "200"])
    assert CURVES.tables["learning_collisions"](tmp_path).count("| - | 2 of 2 | 200 |") == 4


def test_what_trainings_cost_is_the_time_of_all_seeds_of_a_variant(tmp_path: Path) -> None:
    rows = [row("paper", 0, 100, 0, 0), row("paper", 0, 200, 0, 0), row("paper", 1, 100, 0, 0)]
    write_table(tmp_path / "curves.csv", rows[0], rows)
    seconds = {"paper-0": 5400, "paper-1": 1800, "permit_all-0": 9}
    (tmp_path / "curves.json").write_text(json.dumps({"wall_time_s": seconds}))
    [line] = CURVES.tables["cost"](tmp_path).splitlines()[2:]
    assert [cell.strip() for cell in line.split("|")][1:-1] == ["`paper`", "2", "300", "2.0"]


def test_more_than_ten_trainings_are_drawn_as_a_band_of_nine_tenths_of_them(tmp_path: Path) -> None:
    for seeds, lines in ((10, 11), (11, 1)):  # a mean, and a line for each of at most ten
        rows = [row("mixed_paper", seed, 100, -seed, 0) for seed in range(seeds)]
        write_table(tmp_path / "curves.csv", rows[0], rows)
        _, collisions, _ = FIGURES["learning_mixed"](tmp_path).axes
        assert len(collisions.lines) == lines
    reward = FIGURES["learning_mixed"](tmp_path).axes[0]
    [band] = reward.collections
    heights = band.get_paths()[0].vertices[:, 1]
    # 0.05 and 0.95 of the way from the first to the last of -10, ..., 0
    assert (heights.min(), heights.max()) == pytest.approx((-9.5, -0.5))


ADAPTED = """
[simulation]
decisions_per_episode = 15
[learning]
episodes = 5
evaluate_every = 5
evaluation_episodes = 1
collisions_to_start = 0
"""


def test_both_begin_as_the_driver_of_the_curves_and_only_one_of_them_learns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(adaptation, "BLOCK", 2)
    monkeypatch.setattr(adaptation, "SEEDS", 2)
    wanted = options(tmp_path)
    (tmp_path / "settings.toml").write_text(ADAPTED)
    runs = wanted.runs
    list(make(ADAPTATION, wanted))
    rows = read_rows(tmp_path / "adaptation.csv")
    places = [(row["variant"], row["seed"], row["episode"]) for row in rows]
    assert places == [*product(("adaptation", "no_adaptation"), "01", "245")]
    names = ("mixed_paper-1", "mixed_paper-1/adaptation-1", "mixed_paper-1/no_adaptation-1")
    weights, remembered = {}, {}
    for name in names:
        network, _ = load_policy(runs / name / "policy.safetensors")
        tensors, _ = load(runs / name / "checkpoint.safetensors")
        weights[name] = network.flat
        kinds = ("safe", "collision")
        remembered[name] = sum(len(tensors[f"buffer.{kind}.rows"]) for kind in kinds)
    changed = {name: bool((weights[name] != weights[names[0]]).any()) for name in names}
    assert list(changed.values()) == [False, True, False]
    # what is driven since comes on top of the training's own experience
    assert all(remembered[name] > remembered[names[0]] > 15 for name in names[1:])
    policy = checksum(runs / "mixed_paper-1" / "policy.safetensors")
    facts = json.loads((tmp_path / "adaptation.json").read_text())
    assert facts["policies_sha256"]["mixed_paper-1"] == policy
    assert list(make(ADAPTATION, wanted._replace(runs=tmp_path / "elsewhere"))) == []
    assert not (tmp_path / "elsewhere").exists()


def adapted(folder: Path, *lines: str) -> Path:
    names = "variant,seed,episode,training_reward,training_safety_triggers,"
    text = "\n".join([f"{names}training_ego_hits,training_collisions", *lines, ""])
    (folder / "adaptation.csv").write_text(text)
    return folder


def test_adaptation_figure_draws_each_driver_and_the_mean_of_both_variants(tmp_path: Path) -> None:
    lines = [
        f"{variant},{seed},{episode},-0.1,{triggers + 2 * seed},0,0"
        for variant, triggers in (("adaptation", 3), ("no_adaptation", 5))
        for seed in (0, 1)
        for episode in (100, 200)
    ]
    [axes] = adaptation_figure(adapted(tmp_path, *lines)).axes
    drawn = {line.get_label(): list(line.get_ydata()) for line in axes.lines}
    assert drawn["continual adaptation"] == [4, 4]
    assert drawn["no adaptation"] == [6, 6]
    assert sorted(map(list, (line.get_ydata() for line in axes.lines))) == [
        [triggers] * 2 for triggers in (3, 4, 5, 5, 6, 7)
    ]


def test_the_hits_of_a_short_last_block_are_those_of_its_episodes(tmp_path: Path) -> None:
    lines = [
        f"{variant},{seed},{episode},-0.1,{triggers},{hits},{2 * hits}"
        for variant in ("adaptation", "no_adaptation")
        for seed in (0, 1)
        for episode, hits, triggers in ((100, 0.02, 2), (150, 0.04, 5 + 6 * seed))
    ]
    table = adaptation_table(adapted(tmp_path, *lines))
    # of each driver 2 of 100 and 2 of 50 episodes hit something and as many were hit; their
    # triggers are (2 * 100 + 5 * 50) / 150 = 3 and (2 * 100 + 11 * 50) / 150 = 5, whose interval is
    # t(0.975, 1) * sqrt(2) / sqrt(2) = 12.706
    assert [line.split(" | ")[1:] for line in table.splitlines()[2:]] == [
        ["1 to 150", "4.000 ± 12.706", "-0.1000 ± 0.0000", "8", "8 |"]
    ] * 2


EPISODES = list(range(100, 2100, 100))
STEP = [-1.0] * 5 + [0.0] * 15


def test_smoothing_is_centred_and_takes_what_there_is_at_the_ends() -> None:
    assert smoothed([0, 10, 20, 60, 10, 0]) == pytest.approx([10, 22.5, 20, 20, 22.5, 70 / 3])


def test_converged_where_the_smoothed_curve_comes_within_a_tenth_of_the_way_and_stays() -> None:
    # -1 to 0: near is above -0.1. A step at the sixth value reaches the smoothed curve in steps of
    # 0.2 around it: -1, -1, -1, -0.8, -0.6, -0.4, -0.2, 0; the unsmoothed one would say 600.
    assert converged_at(EPISODES, STEP) == 800


def test_a_curve_that_leaves_again_has_not_converged_before_it_comes_back() -> None:
    values = [-1.0] * 5 + [0.0] * 5 + [-1.0] * 3 + [0.0] * 7
    # the first visit, at 800, is the decoy; the last stray window holds the value of 1300
    assert converged_at(EPISODES, values) == 1600


def test_one_outlier_in_a_seed_or_in_the_end_does_not_move_it() -> None:
    assert converged_at(EPISODES, [*STEP[:12], -0.4, *STEP[13:]]) == 800
    assert converged_at(EPISODES, [*STEP[:-1], -0.15]) == 800


def test_a_curve_that_falls_converges_as_one_that_rises() -> None:
    assert converged_at(EPISODES, [0.0] * 5 + [-1.0] * 15) == 800
    assert converged_at(EPISODES, [-0.3] * 20) == 100


def test_near_is_a_share_of_the_way_and_not_of_the_value() -> None:
    # the same shape on top of an offset: within 10 % of the end's value it would be everywhere
    assert converged_at(EPISODES, [value - 100 for value in STEP]) == 800


def row(variant: str, seed: int, episode: int, reward: float, collisions: int) -> dict[str, str]:
    place = {"variant": variant, "seed": seed, "episode": episode}
    found = {"mean_reward": reward, "mean_speed_m_s": 20 + seed, "collisions": collisions}
    usual = {"ego_hits": 0, "evaluation_episodes": 10}
    usual |= {"training_reward": -0.7, "training_collisions": 0.5}
    return {key: str(value) for key, value in (place | found | usual).items()}


def test_ends_are_means_of_seeds_each_over_its_last_tenth() -> None:
    # 20 evaluations: the last two are the end. Seed 0 ends at (-0.1 - 0.3) / 2 = -0.2, seed 1 at 0,
    # and goes on alone for ever worse, which belongs to no mean over seeds but its own.
    rewards = {0: [-1.0] * 18 + [-0.1, -0.3], 1: [-1.0] * 18 + [0.0, 0.0] + [-9.0] * 5}
    rows = [
        row("paper", seed, 100 * (place + 1), reward, 2 if place == 19 else 0)
        for seed, values in rewards.items()
        for place, reward in enumerate(values)
    ]
    found, longest = convergence(rows)
    assert (longest["seeds"], longest["episodes"], longest["reward"]) == ("1", "2500", "-9")
    assert math.isinf(float(longest["reward_ci95"]))
    assert (found["seeds"], found["episodes"]) == ("2", "2000")
    assert float(found["reward"]) == pytest.approx(-0.1)
    # t(0.975, 1) = 12.706; standard error of -0.2 and 0 is 0.1
    assert float(found["reward_ci95"]) == pytest.approx(1.2706, abs=1e-4)
    assert float(found["mean_speed_m_s"]) == 20.5
    # 2 of 10 episodes in one of the two evaluations: 0.1 an episode, the same in both seeds
    assert float(found["collisions_an_episode"]) == pytest.approx(0.1)
    assert float(found["collisions_an_episode_ci95"]) == 0
    assert float(found["training_collisions_an_episode"]) == 0.5
    assert float(found["training_reward"]) == -0.7


def test_a_curve_goes_as_far_as_every_seed() -> None:
    rows = [row("paper", 0, 100, -1, 0), row("paper", 0, 200, 0, 0), row("paper", 1, 100, -3, 0)]
    found = curve([*rows, row("permit_all", 0, 100, -9, 0)], "paper", "mean_reward")
    assert found.episodes == [100]
    assert found.values.tolist() == [[-1.0], [-3.0]]
    assert found.means[0].value == -2


def test_the_trainings_of_the_first_seed_come_first_and_each_traffic_is_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = {"paper": (10_000,), "mixed_permit_all": (10_000, 3000), "mixed_uniform": (500,)}
    monkeypatch.setattr(learning_curves, "EPISODES", wanted)
    rows = learning_curves.curve_plan(Options(runs=tmp_path)).trainings
    jobs = [each.job for each in rows]
    assert [(job.name, job.stop) for job in jobs] == [
        ("paper-0", 10_000),
        ("mixed_permit_all-0", 10_000),
        ("mixed_uniform-0", 500),
        ("mixed_permit_all-1", 3000),
    ]
    configs = [job.config for job in jobs]
    assert [each.simulation.world for each in configs] == ["sumo", "twin", "twin", "twin"]
    assert [each.traffic.level_1_share for each in configs] == [0.0, 0.25, 0.25, 0.25]
    checks = [each.safety.check for each in configs]
    assert checks == ["paper", "permit_all", "paper", "permit_all"]
    assert jobs[2].config.learning.replay == "uniform"
