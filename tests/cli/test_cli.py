"""The command line: its help, and every bad input reported in one sentence without a traceback."""

import csv
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from programs import python
from runs import Capsys, error_message

from drl_av import cli
from drl_av.cli import console, main, tables
from drl_av.compiled import NOTICE
from drl_av.drivers import policy_file
from drl_av.evaluation.statistics import Mean, Summary

VERBS = {
    "scenario": ["metres", "default: 500", "default: 3)", "default: 3.8", "rightmost"],
    "train": ["the preset's, 10000)", "two-buffer", "permit_all", "TOML", "--resume", "200 s"],
    "evaluate": ["default: 1 5 10 15 20 25 30", "default: 50", "default: 0", "default: 1)", "idm"],
    "adapt": ["default: 30000", "default: 1e-05", "0 drives without", "default: the RUN's", "TOML"],
    "replay": ["number, or 15", "multiple of real time (default: 2)", "one per second", "200"],
    "export": ["or a driver that ships", "FILE.onnx"],
    "config": ["simulation, traffic", "default: paper", "default: all"],
    "figures": ["tables of evaluate", "default: ."],
}
PACKAGE = Path(cli.__file__).parent
TINY = "[simulation]\ndecisions_per_episode = 5\n[learning]\nepisodes = 2\n"


def program(prelude: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    code = f"import sys\n{prelude}\nfrom drl_av.cli import main\nsys.exit(main(sys.argv[1:]))"
    return python("-c", code, *arguments, **environment)


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    path = tmp_path / "settings.toml"
    path.write_text(TINY)
    return path


@pytest.mark.parametrize("verb", VERBS)
def test_help_tells_units_and_defaults(verb: str, capsys: Capsys) -> None:
    with pytest.raises(SystemExit, match=r"^0$"):
        main([verb, "--help"])
    text = " ".join(capsys.readouterr().out.split())
    for word in VERBS[verb]:
        assert word in text
    assert "default: None" not in text
    assert "default: []" not in text


def test_help_names_every_verb_and_is_what_the_command_alone_prints(capsys: Capsys) -> None:
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["--help"])
    shown = capsys.readouterr().out
    assert re.findall(r"^    (\w+) ", shown, re.MULTILINE) == list(VERBS)
    assert (main([]), capsys.readouterr().out) == (0, shown)


@pytest.mark.parametrize(
    "words",
    [
        *(["evaluate", "--epi", "3"], ["evaluate", "-o", "traffic.vehicles_max"]),
        *(["evaluate", "--vehicles", "10,-1"], ["evaluate", "--vehicles", "10,"]),
        *(["train"], ["train", "--out", "run", "--episodes", "none"]),
        *(["train", "--out", "run", "--episodes", "0"], ["evaluate", "--vehicles", "-1"]),
        *(["evaluate", "--jobs", "0"], ["replay", "--rate", "0"]),
        *(["replay", "--rate", "nan"], ["replay", "--rate", "1e-320"]),
        ["replay", "--gui", "--video", "drive.mp4"],
    ],
)
def test_bad_usage_exits_with_2(words: list[str], capsys: Capsys) -> None:
    with pytest.raises(SystemExit, match=r"^2$"):
        main(words)
    text = capsys.readouterr().err
    assert text.startswith("usage: drl-av")
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["evaluate", "imd"], r"no driver or run folder 'imd' \(did you mean 'idm'\?\)"),
        (["evaluate", "idm@papr"], r"the safety check 'papr' \(did you mean 'paper'"),
        (["evaluate", "pretrained", "--require-pass"], r"drivers are pretrained: name one of each"),
        (["evaluate", "idm", "sumo", "--require-pass"], r"drivers are idm, sumo: name one of each"),
        (["replay", "--driver", "idm-smuo"], r"did you mean 'idm-sumo'"),
        (["train", "--out", "run", "--preset", "larg"], r"no preset 'larg' \(did you mean 'large'"),
        (["train", "--out", "run", "--replay", "two-bufer"], r"did you mean 'two-buffer'"),
        (["train", "--out", "run", "--safety-check", "papr"], r"did you mean 'paper'"),
        (["evaluate", "idm", "--scenario", "circular_three_lanes"], r"did you mean 'circular_t"),
        (["evaluate", "idm", "--safety-check", ""], r"safety.check is ''"),
        (["evaluate", "idm", "--scenario", ""], r"no scenario ''"),
        (["train", "--out", "run", "--preset", ""], r"no preset ''"),
        (["train", "--out", "run", "--preset", "large", "--reward", "a:b"], r"--reward belongs to"),
        (["adapt", "", "--out", "run"], r"no driver or run folder ''"),
        (["replay", "--driver", "", "--video", "v.gif"], r"no driver or run folder ''"),
        (["replay", "--html", "x.html", "--rate", "3"], r"--rate has no effect on a page"),
        (["replay", "idm", "--record", "a.npz", "--rate", "3"], r"without --video or sumo-gui"),
        (["replay", "a.csv", "--sheet", "w.png", "--rate", "4"], r"--rate has no effect without"),
        (["evaluate", "idm", "--out", "."], r". is a folder: name a file in it"),
        (["evaluate", "idm", "--config", "missing.toml"], r"missing.toml cannot be read"),
        (["evaluate", "idm", "--episodes", "10000000000"], r"or drive fewer episodes"),
        (["evaluate", "idm", "--out", "x", "--json", "./x"], r"cannot hold two files at once"),
        (["replay", "--video", "x.gif", "--record", "x.gif"], r"cannot hold two files at once"),
        (["evaluate", "idm", "--out", "no/such/folder.csv"], r"folder.csv cannot be written"),
        (["evaluate", "idm", "--json", "no/such/folder.json"], r"folder.json cannot be written"),
        (["replay", "missing.npz"], r"no file missing.npz: correct its path"),
        (["evaluate", "idm", "--out", "rows.txt"], r"rows.txt must end with .csv: choose another"),
        (["evaluate", "idm", "--out", "rows"], r"rows must end with .csv: choose another"),
        (["evaluate", "idm", "--json", "rows.csv"], r"rows.csv must end with .json"),
        (["replay", "--html", "x.html", "--record", "x.txt"], r"x.txt must end with .npz"),
        (["replay", "--driver", "idm", "--video", "no/v.mp4"], r"v.mp4 cannot be written"),
        (["scenario", "a,b"], r"a,b, which has a comma in it"),
        (["scenario", "new", "--barricade", "7"], r"barricaded_lanes are \(7,\)"),
        (["figures", "missing.csv"], r"no table missing.csv"),
        (["train", "--out", "run", "--jobs", "2"], r"--jobs 2 needs --seeds"),
        (["train", "--out", "run", "--seeds", "1-2", "--resume"], r"begun in run: leave --resume"),
        (["train", "--out", "agent.zip"], r"a run's folder cannot end in \.zip"),
    ],
)
def test_bad_input_is_reported_in_one_sentence(
    words: list[str], sentence: str, here: Path, capsys: Capsys
) -> None:
    assert main(words) == 1
    assert re.search(sentence, error_message(capsys))
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (f"[learning]\ndiscount = {10**400}", r"learning.discount is inf, but must be a number"),
        ("[simulation]\nstep_length_s = 0.3", r"step_length_s is 0.3, but must divide the 1 s"),
        ("[traffic]\nvehicles_min = 9\nvehicles_max = 3", r"vehicles_min <= vehicles_max"),
        ("[learning", r"is not valid TOML"),
    ],
)
@pytest.mark.parametrize("verb", ["train --out run", "evaluate idm", "replay --driver idm"])
def test_bad_settings_are_reported_with_the_file_and_a_remedy(
    verb: str, text: str, sentence: str, here: Path, capsys: Capsys
) -> None:
    (here / "mine.toml").write_text(text)
    assert main([*verb.split(), "--config", "mine.toml"]) == 1
    message = error_message(capsys)
    assert re.search(sentence, message)
    assert "mine.toml" in message
    assert not (here / "run").exists()


def test_place_that_is_a_file_is_no_run(settings: Path, capsys: Capsys) -> None:
    assert main(["train", "--out", str(settings)]) == 1
    assert "settings.toml is a file: choose a folder with --out" in error_message(capsys)
    assert main(["train", "--out", str(settings / "run"), "--config", str(settings)]) == 1
    assert "run cannot be made (File exists)" in error_message(capsys)
    assert settings.read_text() == TINY


def test_missing_shipped_driver_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setitem(policy_file.SHIPPED, "pretrained", tmp_path / "pretrained")
    for words in (["evaluate"], ["replay", "--video", str(tmp_path / "drive.gif")]):
        assert main(words) == 1
        assert "lacks the driver that ships with drl-av" in error_message(capsys)


def test_missing_system_library_is_named() -> None:
    prelude = """
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "libsumo":
            raise ImportError("libXrender.so.1: cannot open shared object file: No such file")
sys.meta_path.insert(0, Finder())
"""
    ended = program(prelude, "evaluate", "idm", "--episodes", "1")
    assert ended.returncode == 1
    assert ended.stderr.startswith("drl-av: libsumo needs the system library libXrender.so.1, ")
    assert ended.stderr.count("\n") == 1


def test_full_disk_is_reported_and_the_table_of_before_is_kept(
    settings: Path, tmp_path: Path, request: pytest.FixtureRequest, capsys: Capsys
) -> None:
    out = tmp_path / "rows.csv"
    words = ["evaluate", "idm", "--vehicles", "3", "--config", str(settings), "--out", str(out)]
    assert main([*words, "--episodes", "1"]) == 0
    files = sorted(tmp_path.iterdir())
    before = [path.read_bytes() for path in files]
    request.getfixturevalue("full_disk")
    capsys.readouterr()
    assert main([*words, "--episodes", "2"]) == 1
    assert "rows.provenance.json cannot be written (No space left" in error_message(capsys)
    assert sorted(tmp_path.iterdir()) == files
    assert [path.read_bytes() for path in files] == before


def test_output_without_a_terminal_has_no_bar_and_a_table_of_whole_words(
    settings: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    ended = program("", "train", "--out", str(run), "--config", str(settings))
    assert ended.returncode == 0
    first, *last = ended.stdout.splitlines()
    assert re.match(r"episode 2: greedy reward -\d", first)
    trained = f"{run}: 2 episodes; compare it with the driver idm:"
    assert last == [trained, f"drl-av evaluate {run} idm"]
    assert ended.stderr.removeprefix(f"{NOTICE}\n") == ""
    words = ["evaluate", str(run), "idm", "--vehicles", "1", "30", "--episodes", "2"]
    ended = program("", *words, "--json", str(tmp_path / "summary.json"))
    assert ended.returncode == 0
    assert "…" not in ended.stdout
    assert "\x1b" not in ended.stdout
    assert max(map(len, ended.stdout.splitlines())) <= 80
    for word in ("cles", "triggers", "changes", "±", "2 episodes each"):
        assert word in ended.stdout
    assert re.search(r"run +\d+\.\d\d±\S+ +-\d\.\d{3}±\d+\.\d{3} ", ended.stdout)
    line = r"^ +(\d+) +run +idm +-?\d+\.\d\d±\d+\.\d\d *$"
    gains = re.findall(line, ended.stdout, re.MULTILINE)
    assert gains == ["1", "30"]
    assert '"ci95_half_width"' in (tmp_path / "summary.json").read_text()


def test_long_names_fold_and_checks_are_distinguished(capsys: Capsys) -> None:
    mean = Mean(123.456, 10.0)
    long = "runs/" + "x" * 60 + "/end"
    summary = Summary(long, "paper", 30, "sumo", 50, mean, mean, 50, 50, mean, mean)
    tables.print_summaries([summary, summary._replace(safety_check="permit_all")])
    text = capsys.readouterr().out
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= console.WIDTH
    assert "permit_all" in text
    assert "123.46±10.00" in text


@pytest.mark.parametrize(
    ("command", "status", "reported"),
    [
        ("{ sleep 0.1; %s; echo $? >&2; } | true", "1", ""),
        ("%s > /dev/full; echo $? >&2", "1", "The output cannot be written (No space left on"),
        ("%s >&-; echo $? >&2", "0", ""),
    ],
    ids=["no reader", "full", "closed"],
)
def test_output_that_cannot_be_written_is_no_complaint_of_python(
    command: str, status: str, reported: str, tmp_path: Path
) -> None:
    program = f"{sys.executable} -m drl_av scenario loop"
    ended = subprocess.run(
        ["sh", "-c", command % program],
        cwd=tmp_path,
        env={**os.environ, "PYTHONUNBUFFERED": "", "PYTHONPATH": str(PACKAGE.parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    *lines, last = ended.stderr.splitlines()
    assert last == status
    assert len(lines) == bool(reported)
    assert reported in ended.stderr
    assert (tmp_path / "loop").is_dir()


def test_without_a_terminal_the_progress_is_a_line_a_minute(
    monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    times_s = [1000.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: times_s[-1])
    with console.progress_bar("training", 200, 30) as bar:
        for now_s in (1059.0, 1061.0, 1120.0, 1122.0):
            times_s.append(now_s)
            bar.advance("reward -0.5", 305)
    assert capsys.readouterr().err.splitlines() == [
        "training 32 of 200  reward -0.5  10 decisions/s",
        "training 34 of 200  reward -0.5  10 decisions/s",
    ]


def test_a_terminal_without_the_character_shows_its_number(settings: Path) -> None:
    words = ("evaluate", "idm", "--vehicles", "1", "--episodes", "1", "--config", str(settings))
    ended = program("", *words, PYTHONIOENCODING="ascii")
    assert ended.returncode == 0
    assert r"1 episode each, +- half" in ended.stdout
    assert ended.stderr.removeprefix(f"{NOTICE}\n") == ""


@pytest.mark.parametrize(
    "words",
    [
        ["evaluate", "idm", "--config", "{input}", "--out", "{input}"],
        ["evaluate", "idm", "--config", "{input}", "--json", "{link}"],
        ["evaluate", "{input}", "--out", "{input}"],
        ["evaluate", "--driver", "{input}", "--out", "{input}"],
        ["replay", "--config", "{input}", "--record", "{input}"],
        ["replay", "{input}", "--record", "{link}"],
        ["replay", "{input}", "--video", "{input}"],
    ],
)
def test_a_file_that_a_command_reads_is_not_written_over(
    words: list[str], tmp_path: Path, capsys: Capsys
) -> None:
    source, link = tmp_path / "mine.toml", tmp_path / "link.toml"
    source.write_text("[traffic]\nvehicles_max = 3\n")
    link.symlink_to(source)
    assert main([word.format(input=source, link=link) for word in words]) == 1
    assert "is an input of this command: name another file to write." in error_message(capsys)
    assert source.read_text() == "[traffic]\nvehicles_max = 3\n"


def test_the_command_that_opens_a_scenario_is_quoted_for_the_shell(
    tmp_path: Path, capsys: Capsys
) -> None:
    folder = tmp_path / "my 'road; x"
    assert main(["scenario", str(folder)]) == 0
    _, command = capsys.readouterr().out.split(": open it with ")
    assert shlex.split(command) == ["sumo-gui", "-c", str(folder / "highway.sumocfg")]


def test_a_verb_that_is_misspelt_is_corrected(capsys: Capsys) -> None:
    with pytest.raises(SystemExit, match=r"^2$"):
        main(["evalaute", "idm"])
    assert "no verb 'evalaute' (did you mean 'evaluate'?); the verbs are: scen" in (
        " ".join(capsys.readouterr().err.split())
    )


def test_several_files_and_settings_of_the_command_line_are_laid_over_each_other(
    here: Path, capsys: Capsys
) -> None:
    Path("a.toml").write_text(
        "[traffic]\nvehicles_max = 20\nvehicles_min = 2\nheadway_min_s = 1.1\nheadway_max_s = 1.5\n"
    )
    Path("b.toml").write_text("[traffic]\nvehicles_max = 9\nheadway_max_s = 1.9\n")
    both = ["--config", "a.toml", "--config", "b.toml"]
    words = ["config", "traffic", "-o", "traffic.vehicles_max=30"]
    for more, found in (
        (["--config", "a.toml"], (2, 20)),
        (["--config", "a.toml", "-o", "traffic.vehicles_min=3"], (3, 20)),
        (both, (2, 9)),
        (["-o", "traffic.kind=overtaking", "-o", "traffic.headway_min_s=1.25"], (1, 30)),
    ):
        assert main([*words, *more]) == 0
        printed = tomllib.loads(capsys.readouterr().out)["traffic"]
        assert (printed["vehicles_min"], printed["vehicles_max"]) == found
    assert printed["headway_min_s"] == 1.25
    words = ["evaluate", "idm", "--vehicles", "1,2", "3", "--episodes", "1", "--out", "rows.csv"]
    assert main([*words, *both, "-o", "simulation.decisions_per_episode=2"]) == 0
    rows = list(csv.DictReader(Path("rows.csv").read_text().splitlines()))
    assert [(row["vehicles"], row["decisions"]) for row in rows] == [(n, "2") for n in "123"]
    used = json.loads(Path("rows.provenance.json").read_text())["settings"]["traffic"]
    assert (used["headway_min_s"], used["headway_max_s"]) == (1.1, 1.9)
    assert (used["vehicles_min"], used["vehicles_max"]) == (1, 30)  # the rows say how many


@pytest.mark.parametrize(
    ("word", "sentence"),
    [
        ("traffic.vehicles_mx=3", "has no key 'vehicles_mx' (did you mean 'vehicles_max'?)"),
        ("trafic.vehicles_max=3", "has no section [trafic] (did you mean 'traffic'?)"),
        ("traffic.truck_share=many", "traffic.truck_share is 'many', but must be a number from 0"),
        ("safety.check=papr", "safety.check is 'papr' (did you mean 'paper'?)"),
        ("driver.hold_s=-7", "In driver.hold_s=-7: driver.hold_s is -7.0, but must be"),
    ],
)
@pytest.mark.parametrize("verb", ["train --out run", "evaluate idm", "replay --html x.html"])
def test_a_wrong_setting_of_the_command_line_is_one_sentence(
    verb: str, word: str, sentence: str, here: Path, capsys: Capsys
) -> None:
    assert main([*verb.split(), "-o", word]) == 1
    assert sentence in error_message(capsys)
