"""An experiment from outside the package is made, resumed, drawn and refused like the others."""

from pathlib import Path

import pytest
from runs import files_of

from drl_av.cli import main
from drl_av.config import Config
from drl_av.errors import DrlAvError
from drl_av.evaluation.figure_style import one_panel
from drl_av.files import Row
from studies import store
from studies.cells import Drives, driven_with
from studies.experiment import Experiment, ResultsFolder, reproduce
from studies.markdown import by_density, mean_speed
from studies.options import ReproduceOptions
from studies.plan import Plan, by
from studies.registry import EXPERIMENTS
from studies.store import MadeWith

DRIVERS = ("idm", "random")


def plan(options: ReproduceOptions) -> Plan:
    config = options.with_files(Config())
    cells = [Drives(config, DRIVERS, vehicles, options.drives) for vehicles in (1, 3)]
    return Plan(driven_with(config, DRIVERS), [cells], by(vehicles=int, seed=int, driver=DRIVERS))


def fastest(rows: list[Row]) -> list[Row]:
    return [max(rows, key=lambda row: float(row["mean_speed_m_s"]))]


def speeds(results: ResultsFolder) -> str:
    return by_density(results.rows("sober.csv"), "driver", mean_speed)


def histogram(rows: list[Row]):  # type: ignore[no-untyped-def]
    figure, axes = one_panel("mean speed, m/s", "episodes")
    axes.hist([float(row["mean_speed_m_s"]) for row in rows])
    return figure


SOBER = Experiment(
    name="sober",
    meaning="a sober driver beside a random one",
    row="an episode",
    plan=plan,
    derived={"fastest.csv": fastest},
    summaries={"sober": speeds},
    figures={"speeds": histogram},
)


@pytest.fixture
def options(short: ReproduceOptions) -> ReproduceOptions:
    return short._replace(out=short.out / "out")


@pytest.fixture
def made(options: ReproduceOptions) -> ReproduceOptions:
    list(reproduce(SOBER, options))
    return options


def driven(options: ReproduceOptions) -> list[int]:
    """Make it again; the number of episodes after each that was driven."""
    return [step.done for step in reproduce(SOBER, options) if step.label]


def content(options: ReproduceOptions) -> dict[str, bytes]:
    return files_of(options.out)


def test_it_has_a_row_for_each_driver_on_each_seed_and_says_what_made_them(
    made: ReproduceOptions,
) -> None:
    rows = ResultsFolder(made.out).rows("sober.csv")
    assert [(row["vehicles"], row["seed"], row["driver"]) for row in rows] == [
        (vehicles, seed, driver) for vehicles in "13" for seed in "01" for driver in DRIVERS
    ]
    facts = ResultsFolder(made.out).made_by("sober.csv")
    assert facts["settings"]["simulation"]["decisions_per_episode"] == 5
    assert (facts["seeds"], facts["processes"], facts["step_length_s"]) == ("0 to 1", 1, 0.5)
    assert ResultsFolder(made.out).rows("fastest.csv") == fastest(rows)
    table = speeds(ResultsFolder(made.out)).splitlines()
    assert table[0] == "| vehicles | 1 | 3 |"
    assert [line.split(" | ")[0] for line in table[2:]] == ["| `idm`", "| `random`"]
    assert (made.out / "speeds.png").stat().st_size > 1000


def test_nothing_is_driven_twice(made: ReproduceOptions) -> None:
    before = content(made)
    assert driven(made) == []
    assert content(made) == before
    assert driven(made._replace(drives=1)) == []
    more = made._replace(drives=3)
    assert driven(more) == [1, 2, 3, 4]  # the third seed of two drivers in two cells
    rows = ResultsFolder(made.out).rows("sober.csv")
    assert [row["seed"] for row in rows] == ["0", "0", "1", "1", "2", "2"] * 2
    assert driven(more) == []


def test_an_interrupted_one_continues_after_its_last_whole_cell(
    options: ReproduceOptions,
) -> None:
    steps = reproduce(SOBER, options)
    assert [next(steps).done for _ in range(5)] == [1, 2, 3, 4, 5]
    steps.close()
    assert len(ResultsFolder(options.out).rows("sober.csv")) == 4
    assert driven(options) == [1, 2, 3, 4]


def test_cells_of_several_configs_continue_too(options: ReproduceOptions) -> None:
    def two_checks(options: ReproduceOptions) -> Plan:
        short = options.with_files(Config())
        configs = {check: short.updated("safety", check=check) for check in ("paper", "strict")}
        cells = [
            Drives(config, ("idm",), 2, options.drives, named=(("check", check),))
            for check, config in configs.items()
        ]
        return Plan(MadeWith(configs), [cells], by(check=configs, seed=int))

    checks = Experiment(name="checks", meaning="two checks", row="an episode", plan=two_checks)
    assert [progress.done for progress in reproduce(checks, options)] == [1, 2, 3, 4]
    more = options._replace(drives=3)
    assert [progress.done for progress in reproduce(checks, more)] == [1, 2]


def test_a_full_disk_leaves_what_the_next_attempt_continues(
    options: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, columns: object, rows: object) -> None:
        raise DrlAvError(f"{path} cannot be written (No space left on device).")

    with monkeypatch.context() as patch:
        patch.setattr(store, "write_table", full)
        with pytest.raises(DrlAvError, match="No space left"):
            driven(options)
    assert driven(options) == [1, 2, 3, 4, 5, 6, 7, 8]


def test_lost_figures_and_derived_tables_are_made_again(made: ReproduceOptions) -> None:
    before = content(made)
    for name in ("fastest.csv", "speeds.png"):
        (made.out / name).unlink()
    assert driven(made) == []
    assert content(made) == before


def test_episodes_of_other_settings_are_not_mixed(made: ReproduceOptions, tmp_path: Path) -> None:
    before = content(made)
    (tmp_path / "short.toml").write_text("[simulation]\ndecisions_per_episode = 6\n")
    with pytest.raises(DrlAvError, match=r"made with other settings .*--out.*sober\.json away"):
        driven(made._replace(drives=3))
    assert content(made) == before


def test_a_table_without_its_sidecar_is_left_alone(made: ReproduceOptions) -> None:
    (made.out / "sober.json").unlink()
    before = content(made)
    with pytest.raises(DrlAvError, match=r"sober\.csv has no sober\.json beside it"):
        driven(made._replace(drives=3))
    assert content(made) == before


def test_a_table_of_other_columns_is_left_alone(made: ReproduceOptions) -> None:
    table, text = made.out / "sober.csv", (made.out / "sober.csv").read_text()
    table.write_text("".join(line.rpartition(",")[0] + "\n" for line in text.splitlines()))
    before = content(made)
    with pytest.raises(DrlAvError, match=r"sober\.csv was made with other settings"):
        driven(made._replace(drives=3))
    assert content(made) == before


def test_one_line_in_the_registry_gives_it_to_the_command_line(
    options: ReproduceOptions,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(EXPERIMENTS, SOBER.name, SOBER)
    with pytest.raises(SystemExit):
        main(["reproduce", "--help"])
    assert "sober: a sober driver beside a random one" in " ".join(capsys.readouterr().out.split())
    words = ["reproduce", "sober", "--drives", "1", "--jobs", "1", "--out", str(options.out)]
    assert main([*words, "--config", *options.config]) == 0
    assert capsys.readouterr().out == f"{options.out / 'speeds.png'}\n"
    assert len(ResultsFolder(options.out).rows("sober.csv")) == 4
    assert main(["figures", str(options.out), "--out", str(options.out / "figures")]) == 0
    assert (options.out / "figures" / "speeds.png").exists()
