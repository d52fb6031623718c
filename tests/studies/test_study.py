"""A study in a TOML file is driven, resumed, trained for, shown and refused as it says."""

import json
import re
import shutil
from itertools import product
from pathlib import Path

import pytest
from checks_of_study import with_check
from runs import Capsys, files_of

from drl_av import train
from drl_av.config import Config, StrictConfig, TrafficConfig
from drl_av.drivers.registry import find_drivers
from drl_av.errors import ConfigError, DrlAvError
from drl_av.evaluation import engines
from drl_av.evaluation.engines import cluster, on_ray
from drl_av.evaluation.table import read_rows
from drl_av.scenarios.folder import ScenarioDescription, write_scenario
from drl_av.scenarios.highways import StraightDescription
from drl_av.simulation.inflow import vehicles_of_flow
from studies.__main__ import main
from studies.engine import draw, make, require_shared
from studies.options import FOLDER, QUICK, Options
from studies.pivot import markdown
from studies.registry import PROGRAMS, STUDIES
from studies.study import FileStudy

MINE = """
meaning = "two drivers with two values of T_min"
columns = ["t_min_s", "vehicles", "driver", "seed", "mean_speed_m_s", "ego_hit", "collided"]
order = ["t_min_s", "vehicles", "seed", "driver"]

[rows]
drivers = ["idm", "random"]
vehicles = [1, 3]
seeds = { first = 7, count = 2 }

[variants.long]
columns = { t_min_s = "3" }
[variants.short]
columns = { t_min_s = "1.5" }
drivers = ["idm"]
settings.safety.minimum_ttc_s = 1.5

[tables.mine]
rows = ["t_min_s", "label"]
columns = "vehicles"
value = { mean = "mean_speed_m_s" }
measures = [{ head = "hits", text = "{ego_hit} of {episodes}" }]

[figures.mine]
x = "vehicles"
value = { interval = "mean_speed_m_s" }
labels = ["vehicles", "m/s"]
"""


@pytest.fixture
def mine(tmp_path: Path) -> FileStudy:
    (tmp_path / "mine.toml").write_text(MINE)
    return FileStudy(tmp_path / "mine.toml")


def test_each_variant_drives_its_drivers_in_the_order_that_the_file_gives(
    mine: FileStudy, short: Options, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def counting(work, jobs, processes):  # type: ignore[no-untyped-def]
        asked.append(len(jobs))
        return engines.ENGINES["here"](work, jobs, processes)

    monkeypatch.setitem(engines.ENGINES, "ray", counting)
    steps = list(make(mine, short._replace(engine="ray")))
    assert asked == [12]
    assert [step.done for step in steps] == [*range(1, 13)]
    rows = read_rows(short.out / "mine.csv")
    assert list(rows[0]) == mine.file["columns"]
    assert [(r["t_min_s"], r["vehicles"], r["seed"], r["driver"]) for r in rows] == [
        (t_min, vehicles, seed, driver)
        for t_min, drivers in (("3", ("idm", "random")), ("1.5", ("idm",)))
        for vehicles in "13"
        for seed in "78"
        for driver in drivers
    ]
    facts = json.loads((short.out / "mine.json").read_text())
    assert (facts["engine"], facts["processes"], facts["seeds"]) == ("ray", 1, "7 to 8")
    found = {name: own["safety"]["minimum_ttc_s"] for name, own in facts["settings"].items()}
    assert found == {"long": 3.0, "short": 1.5}
    [figure] = draw(mine, short.out)
    assert figure.stat().st_size > 1000


def test_what_was_interrupted_continues_and_ends_in_the_same_bytes(
    mine: FileStudy, short: Options, tmp_path: Path
) -> None:
    whole = short._replace(out=tmp_path / "whole")
    list(make(mine, whole))
    steps = make(mine, short)
    assert [next(steps).done for _ in range(5)] == [1, 2, 3, 4, 5]
    steps.close()
    assert len(read_rows(short.out / "mine.csv")) == 5
    assert [step.total for step in make(mine, short)] == [7] * 7
    assert (short.out / "mine.csv").read_bytes() == (whole.out / "mine.csv").read_bytes()
    before = files_of(short.out)
    assert list(make(mine, short)) == []
    assert list(make(mine, short._replace(most_episodes=1))) == []  # fewer than there are
    assert files_of(short.out) == before


def test_rows_of_other_settings_are_refused_and_nothing_changes(
    mine: FileStudy, short: Options, tmp_path: Path
) -> None:
    list(make(mine, short._replace(most_episodes=1)))
    before = files_of(short.out)
    (tmp_path / "short.toml").write_text("[simulation]\ndecisions_per_episode = 6\n")
    with pytest.raises(DrlAvError, match=r"mine\.csv was made with other.*mine\.json away"):
        list(make(mine, short))
    assert files_of(short.out) == before


@pytest.mark.parametrize(
    ("text", "wrong", "sentence"),
    [
        ("vehicles = [1, 3]", "vehicels = [1, 3]", r"unknown key 'vehicels' \(did you mean 'vehic"),
        ("first = 7", "frist = 7", r"unknown key 'frist' \(did you mean 'first'"),
        ('columns = "vehicles"\n', "", "with one of value and columns, which belong together"),
        ("first = 7", "first = 999_999", "has the seeds from 999999 to 1000000: .* of 0 to 999"),
        ("count = 2", "count = -2", "name one or more of 0 to 999999"),
        ("count = 2", "count = true", "count is True, but must be a whole number"),
        ("drivers = [", "drivers = [5, ", "drivers is 5, but must be a text"),
        ("[tables.", "[trainings]\na = 5\n[tables.", "has 5 among its trainings: write a table"),
        (", count = 2", "", "count is missing, but must be a whole number"),
        ("seeds = {", "seeds = 3 # {", "seeds is 3, but must be a table"),
        ("vehicles = [1, 3]", "vehicles = 5", "vehicles is 5, but must be a list"),
        ("vehicles = [1, 3]", "vehicles = [1, '3']", "vehicles is '3', but must be a whole number"),
        ('"vehicles", "seed", "driver"]', '"sed"]', "order has 'sed', but must be of driver, "),
        ('order = ["t_min_s", ', "order = [", "order does not tell apart: add vehicles, seed, dri"),
        ('"vehicles", "seed", "driver"]', '"vehicles", "driver"]', "order does not tell apart: "),
        ('columns = ["t_min_s", ', "columns = [", "order has 't_min_s', which columns lacks: add"),
        ('"mean_speed_m_s", "e', '"mean_sped", "e', "lacks the column 'mean_sped' .did you m"),
        ('columns = { t_min_s = "1.5" }\n', "", "an episode lacks the column 't_min_s'"),
        ('drivers = ["idm"]\ns', "episodes = 0\ns", "has the seeds from 7 to 6: name one or more"),
        ("vehicles = [1, 3]", "", "mine.toml drives nothing: name drivers and vehicles"),
        ("meaning", 'metrics = "fast"\nmeaning', "metrics must be one of episode, c"),
        ("[tables.", '[trainings.a-]\nbase = "large"\n[tables.', "trains by PPO, but a study by"),
        (
            *("[tables.", '[trainings.a-]\nbase="paper"\nseeds={count=2}\n[tables.'),
            "a- names several trainings a-: write {seed} or {traffic} into its name",
        ),
        (
            *("[tables.", '[trainings."a-{sed}"]\nbase = "paper"\n[tables.'),
            "'a-{sed}' may have {seed}, {traffic} in braces, but nothing else",
        ),
        ('labels = ["ve', 'titel = "M"\nlabels = ["ve', "unknown key 'titel' .did you mean 't"),
        ('text = "{ego', 'txt = "{ego', "unknown key 'txt'"),
        (', text = "{ego_hit} of {episodes}"', "", r"has the measure \{'head': 'hits'\}: it must"),
        ('columns = "vehicles"\nvalue', 'colums = "vehicles"\nvalue', "unknown key 'colums'"),
        (
            *("[tables.", '[trainings."a-{seed}"]\nbase="paper"\nseeds={count=0}\n[tables.'),
            "has a training with 0 seeds",
        ),
        ('text = "{ego', 'gain = "{ego', "it must name with over .or of. what the rows are comp"),
        ("{ head = ", "{ digits = 1, hed = ", "unknown key 'hed'"),
        ('{ head = "hits", ', "{ ", "has the measure .*: give it a head"),
        ("meaning =", "meaning = =", "mine.toml is not valid TOML"),
        ("[rows]", "[rows_]", r"rows is missing, but must be a table"),
    ],
)
def test_a_file_that_is_no_study_is_one_sentence(
    text: str, wrong: str, sentence: str, tmp_path: Path
) -> None:
    (tmp_path / "mine.toml").write_text(MINE.replace(text, wrong))
    with pytest.raises(ConfigError, match=sentence) as error:
        FileStudy(tmp_path / "mine.toml").plan(Options())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "wrong", "sentence"),
    [
        ('rows = ["t_min_s", "label"]', 'rows = ["t_min"]', "table mine .*names 't_min', which"),
        ('mean = "mean_speed_m_s"', 'mean = "mean_sped"', "table mine cannot .*'mean_sped'"),
        ("{ego_hit} of", "{ego_hits} of", "table mine .*names 'ego_hits', which"),
        ('interval = "mean_sp', 'interval = "mean_sd', "figure mine .*'mean_sdeed_m_s'"),
        ('x = "vehicles"', 'x = "vehicle"', "figure mine .*names 'vehicle', which"),
    ],
)
def test_a_wrong_table_or_figure_is_one_sentence_and_the_rows_stay(
    text: str, wrong: str, sentence: str, short: Options, tmp_path: Path
) -> None:
    (tmp_path / "mine.toml").write_text(MINE.replace(text, wrong))
    study = FileStudy(tmp_path / "mine.toml")
    list(make(study, short._replace(most_episodes=1)))
    with pytest.raises(ConfigError, match=sentence) as error:
        _ = study.tables["mine"](short.out), *draw(study, short.out)
    assert re.search(r"correct it there; the rows in .*mine\.csv are kept\.$", str(error.value))
    assert len(read_rows(short.out / "mine.csv")) == 6


def test_a_study_on_a_road_of_the_user_stands_beside_no_rows_of_another_road(
    short: Options, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_scenario("road", ScenarioDescription(circumference_m=800.0))
    text = 'meaning = "mine"\nsettings.simulation.scenario = "road"\n[rows]\ndrivers = ["idm"]\n'
    Path("own.toml").write_text(text + "vehicles = [2]\nseeds = { count = 1 }\n")
    list(make(FileStudy(Path("own.toml")), short))
    shutil.rmtree("road")
    write_scenario("road", ScenarioDescription(circumference_m=900.0))
    with pytest.raises(DrlAvError, match=r"own\.csv was made with other .*\(scenario .*road\)"):
        list(make(FileStudy(Path("own.toml")), short._replace(most_episodes=2)))


def test_a_variant_is_one_more_row_without_an_order_and_its_settings_are_compared(
    short: Options, tmp_path: Path
) -> None:
    text = 'meaning = "mine"\n[rows]\ndrivers = ["idm"]\ntraffic = ["calm", "paper"]\n'
    text += "vehicles = [2]\nseeds = { count = 1 }\n[variants.a]\n[variants.b]\n"
    (file := tmp_path / "own.toml").write_text(text + "settings.safety.minimum_ttc_s = 1.5\n")
    list(make(FileStudy(file), short))
    rows = read_rows(short.out / "own.csv")
    both = [*product(("calm", "paper"), ("a", "b"))]
    assert [(row["traffic"], row["variant"]) for row in rows] == both
    file.write_text(text + "settings.safety.minimum_ttc_s = 2.5\n")
    with pytest.raises(DrlAvError, match=r"other settings.*\(safety\.minimum_ttc_s\)"):
        list(make(FileStudy(file), short))


def test_a_study_drives_with_the_settings_of_the_first_driver_that_was_trained(
    short: Options, tmp_path: Path
) -> None:
    three = {"simulation": {"decisions_per_episode": 3}, "learning": {"evaluation_episodes": 1}}
    run = train(tmp_path / "run", config=three, episodes=1)
    text = f'meaning = "mine"\n[rows]\ndrivers = ["idm", "{run}"]\nvehicles = [2]\n'
    (tmp_path / "own.toml").write_text(text + "seeds = { count = 1 }\n")
    list(make(FileStudy(tmp_path / "own.toml"), short._replace(config=())))
    assert [row["decisions"] for row in read_rows(short.out / "own.csv")] == ["3", "3"]


def with_settings(*settings: str) -> Options:
    return Options(config=settings)


def test_a_quick_form_replaces_what_a_study_sets() -> None:
    quick = Options(config=(str(QUICK),))
    made = quick.settings(Config(), {"simulation": {"decisions_per_episode": 30}})
    assert made.simulation.decisions_per_episode == 20
    cells = STUDIES["opponents"].plan(quick._replace(most_vehicles=2)).cells
    assert {cell.vehicles for cell in cells if "planner" in cell.drivers} == {5, 25}
    assert {cell.vehicles for cell in cells} == {5, 25}  # in which all drivers are compared


def test_settings_of_the_user_reach_all_drivers_of_every_kind_of_traffic() -> None:
    headways = "traffic.headway_min_s=1.3", "traffic.headway_max_s=1.4"
    given = with_settings(*headways, "simulation.decisions_per_episode=9")
    for name in ("opponents", "straight", "strict", "own_traffic", "whole_schedule"):
        plan = STUDIES[name].plan(given)
        configs = [cell.config for cell in plan.cells]
        configs += [cell.training.config for cell in plan.cells if cell.training is not None]
        assert {each.traffic.headway_min_s for each in configs} == {1.3}, name
        assert {each.simulation.decisions_per_episode for each in configs} == {9}
        known = plan.inputs.settings.values()
        assert {each.traffic.headway_min_s for each in known} == {1.3}


@pytest.mark.parametrize(
    ("name", "setting"),
    [
        *(("check", 'safety.check="strict"'), ("curves", 'safety.check="strict"')),
        *(("curves", 'learning.replay="uniform"'), ("curves", "learning.seed=7")),
        ("straight", 'simulation.scenario="merge"'),
        *(("opponents", 'traffic.kind="calm"'), ("own_traffic", 'traffic.kind="calm"')),
        *(("adaptation", 'traffic.kind="calm"'), ("barricade", 'safety.check="strict"')),
    ],
)
def test_a_setting_that_a_study_sets_itself_is_refused(name: str, setting: str) -> None:
    key = setting.partition("=")[0]
    with pytest.raises(ConfigError, match=rf"^{key} is what the study itself sets: leave it out"):
        STUDIES[name].plan(with_settings(setting))


TRAINED = """
meaning = "trained drivers beside idm"
columns = ["driver", "traffic", "vehicles", "seed", "safety_check", "mean_speed_m_s"]
order = ["driver", "traffic", "vehicles", "seed"]
settings.safety.check = "strict"

[rows]
drivers = ["idm"]
traffic = ["calm", "overtaking"]
vehicles = [2]
seeds = { count = 1 }

[trainings."paper-{seed}"]
name = "seed {seed}"
label = "{count} trainings"
base = "paper"
seeds = { first = 4, count = 2 }

[tables.trained]
rows = ["label"]
columns = "traffic"
value = { gain = "mean_speed_m_s", over = { driver = "idm" } }
without = { driver = ["idm"] }
units = "driver"
"""


@pytest.fixture
def trained(tmp_path: Path) -> FileStudy:
    (tmp_path / "trained.toml").write_text(TRAINED)
    return FileStudy(tmp_path / "trained.toml")


def test_drivers_are_trained_once_and_drive_with_the_settings_of_the_study(
    trained: FileStudy, short: Options
) -> None:
    list(make(trained, short))
    rows = read_rows(short.out / "trained.csv")
    names = ["idm", "seed 4", "seed 5"]
    driven = [(row["driver"], row["traffic"]) for row in rows]
    assert driven == [*product(names, ("calm", "overtaking"))]
    assert {row["safety_check"] for row in rows} == {"strict"}
    facts = json.loads((short.out / "trained.json").read_text())
    assert facts["settings"]["seed 5"]["learning"]["seed"] == 5
    assert facts["settings"]["seed 5"]["safety"]["check"] == "paper"  # while it learned
    assert facts["settings"]["seed 5, calm"]["safety"]["check"] == "strict"
    assert facts["episodes"] == {"seed 4": 2, "seed 5": 2}
    assert {"paper-4", "paper-5"} < facts["wall_time_s"].keys()
    speed = {(row["driver"], row["traffic"]): float(row["mean_speed_m_s"]) for row in rows}
    [line] = trained.tables["trained"](short.out).splitlines()[2:]
    assert line.startswith("| 2 trainings | ")
    gains = [speed[f"seed {n}", "calm"] - speed["idm", "calm"] for n in (4, 5)]
    assert f"| {sum(gains) / 2:.2f} " in line
    made = {path: path.stat().st_mtime_ns for path in short.runs.rglob("*.safetensors")}
    (short.out / "trained.csv").unlink()
    (short.out / "trained.json").unlink()
    list(make(trained, short))
    assert read_rows(short.out / "trained.csv") == rows
    assert made == {path: path.stat().st_mtime_ns for path in made}


def test_another_policy_under_the_name_of_a_training_is_refused(
    trained: FileStudy, short: Options
) -> None:
    list(make(trained, short))
    beside = short.out / "trained.json"
    facts = json.loads(beside.read_text())
    facts["policies_sha256"]["paper-4"] = "that of another"
    beside.write_text(json.dumps(facts))
    table = short.out / "trained.csv"
    table.write_bytes(b"".join(table.read_bytes().splitlines(keepends=True)[:2]))
    with pytest.raises(DrlAvError, match=r"trained\.csv was made with other .*drivers"):
        list(make(trained, short))


def test_the_command_line_runs_a_file_of_ones_own_in_a_quick_form(
    mine: FileStudy, short: Options, here: Path, capsys: Capsys
) -> None:
    words = [str(mine.path), "--quick", "--jobs", "1", "--config", *short.config]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "12 episodes more" in printed
    assert "| t_min_s | label | 1 | 3 | hits |" in printed
    [folder] = here.glob("quick-results-*")
    assert {"mine.csv", "mine.json", "mine.png"} == {path.name for path in folder.iterdir()}
    assert main([*words, "--out", str(folder)]) == 0
    assert "mine.csv is complete: nothing was driven\n" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["opponent"])
    assert "there is no study 'opponent' (did you mean 'opponents'?)" in capsys.readouterr().err


@pytest.mark.parametrize("name", sorted(STUDIES.keys() - PROGRAMS.keys()))
def test_every_study_names_drivers_vehicles_and_settings_that_exist(name: str) -> None:
    study = STUDIES[name]
    assert isinstance(study, FileStudy)
    assert len(find_drivers(study.drivers)) == len(study.drivers)
    plan = study.plan(Options())
    assert plan.cells
    keys = (cell.row(name, s) for cell in plan.cells for name in cell.drivers for s in cell.seeds)
    places = [plan.place(key) for key in keys]
    assert len(set(places)) == len(places)


def test_the_vehicles_of_a_flow_are_those_that_the_inflow_sustains() -> None:
    study = FileStudy(FOLDER / "straight.toml")
    for variant in study.variants:
        flow = float(variant.columns["flow_per_h"])
        start = StraightDescription(flow_per_h=flow).plan().start
        assert variant.vehicles == (vehicles_of_flow(start, TrafficConfig()),)


def test_the_settings_under_a_check_are_those_of_the_study_strict() -> None:
    base = Config().updated("strict", clearance_m=0.7)
    assert with_check(base, "paper") == base.updated("safety", check="paper")
    strict = with_check(base, "strict")
    assert strict.strict == base.strict
    assert strict.safety.check == "strict"
    real = with_check(base, "real").strict
    assert (real.braking_m_s2, real.lateral_speed_m_s, real.clearance_m) == (9.0, 2.1, 0.7)
    assert real.braking_m_s2 > StrictConfig().braking_m_s2


def test_a_table_of_a_missing_result_is_one_sentence(mine: FileStudy, tmp_path: Path) -> None:
    with pytest.raises(DrlAvError, match=r"mine\.csv does not exist: python -m studies"):
        markdown(mine, mine.file["tables"]["mine"], tmp_path)


def test_the_example_of_the_documentation_is_driven_and_compared_in_pairs(
    short: Options, capsys: Capsys
) -> None:
    example = Path(__file__).parents[2] / "examples" / "own_study.toml"
    words = ["--episodes", "2", "--jobs", "1", "--out", str(short.out), "--config", *short.config]
    assert main([str(example), *words]) == 0
    printed = capsys.readouterr().out
    assert "own_study.csv: 8 episodes more" in printed
    assert "| T_min, s | 10 | 20 | gain, m/s | ego hit something |" in printed
    assert "| 3.0 | " in printed
    seeds = {row["seed"] for row in read_rows(short.out / "own_study.csv")}
    assert seeds == {"800000", "800001"}
    assert (short.out / "t_min.png").exists()


@pytest.mark.ray
def test_evaluations_on_ray_make_the_same_rows(
    mine: FileStudy, short: Options, tmp_path: Path
) -> None:
    here = short._replace(out=tmp_path / "here")
    list(make(mine, here))
    list(make(mine, short._replace(engine="ray", jobs=2)))
    assert (short.out / "mine.csv").read_bytes() == (here.out / "mine.csv").read_bytes()


@pytest.mark.ray
def test_a_folder_that_a_machine_of_the_cluster_cannot_see_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with cluster(1):
        monkeypatch.setenv("RAY_ADDRESS", "auto")
        require_shared(tmp_path)
        assert not list(tmp_path.iterdir())
        monkeypatch.setattr(Path, "touch", lambda path: None)  # as where another disk is mounted
        with pytest.raises(DrlAvError, match=r"cannot see the files in .*give --runs a folder"):
            require_shared(tmp_path)
        with pytest.raises(ZeroDivisionError) as of_job:
            list(on_ray(lambda job: 1 / job, [0], 1))
        assert "test_study.py" in str(of_job.value.__cause__)  # where the worker raised it
