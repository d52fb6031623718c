"""The programs of ``verification`` that the wheel holds, and the user's parts in them."""

import ast
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from checks_of_study import with_check
from programs import python
from shown import ROOT, read

from drl_av.errors import ConfigError
from verification import crash_rate, falsify
from verification.crash_simulation import SECONDS, drivers, run, settings
from verification.naturalistic import PEOPLE

BUILD = tomllib.loads(read("pyproject.toml"))["tool"]["setuptools"]
PROOFS = [
    f"verification.proofs.{path.stem}" for path in (ROOT / "verification/proofs").glob("*.py")
]
SHIPPED = [*BUILD["py-modules"], *PROOFS]
PARTS = """
from drl_av.driving.actions import ACTIONS
from drl_av.safety.check import Rule, Verdict

made = []


class Counts:
    def __init__(self):
        self.seeds, self.acts = [], 0
        made.append(self)

    def start(self, seed):
        self.seeds.append(seed)

    def act(self, scene, observation):
        self.acts += 1
        return ACTIONS[0]


def driver(config):
    return Counts()


def stops(scene, proposed):
    return Verdict(ACTIONS[3], "stop")


def never_brakes(scene, proposed):
    fastest = ACTIONS[4 * proposed.lateral + 1]
    return Verdict(fastest, Rule.NONE if fastest == proposed else "never brake")
"""


@pytest.fixture
def parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_parts.py").write_text(PARTS, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "own_parts", raising=False)


@pytest.mark.parametrize("module", SHIPPED)
def test_a_shipped_program_imports_only_what_is_shipped(module: str) -> None:
    tree = ast.parse((ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8"))
    names = {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    beside = {name for name in names if name.split(".")[0] in ("verification", "studies", "tools")}
    assert beside <= {*SHIPPED, *BUILD["packages"]}


def test_the_proof_says_which_extra_has_what_it_lacks() -> None:
    without = "import sys; sys.modules['z3'] = None; import verification.prove"
    ended = python("-c", without)
    assert ended.returncode == 1
    assert re.fullmatch(r"prove: .*z3.*: pip install 'drl-av\[verify\]'\.\n", ended.stderr)


@pytest.mark.parametrize("check", ["paper", "strict", "real"])
def test_the_checks_of_the_tests_are_those_of_the_studies(check: str) -> None:
    ours, theirs = settings(check), with_check(settings("paper"), check)
    assert (ours.safety, ours.strict) == (theirs.safety, theirs.strict)


@pytest.mark.usefixtures("parts")
def test_each_test_has_a_driver_of_its_own_that_starts_once() -> None:
    outcome = run(settings("paper"), 3, PEOPLE, 7, driver="own_parts:driver")
    made = sys.modules["own_parts"].made
    assert [each.seeds for each in made] == [[0], [1], [2]]
    assert [each.acts for each in made] == [SECONDS] * 3
    assert not (outcome.ego_hit + outcome.was_hit).any()


@pytest.mark.usefixtures("parts")
def test_the_crash_rate_of_an_own_driver_under_an_own_check(
    capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["--driver", "own_parts:driver", "--safety-check", "paper", "own_parts:stops"]
    monkeypatch.setattr("sys.argv", ["crash_rate.py", "--tests", "8", "--careless", "0.5", *words])
    assert crash_rate.main() == 0
    monkeypatch.setattr("sys.argv", ["crash_rate.py", "--tests", "1"])  # it has no interval
    with pytest.raises(SystemExit, match="2"):
        crash_rate.main()
    printed = capsys.readouterr().out
    found = re.findall(r"driver (\S+)\n(\S+): 8 tests of (0\.\d+) km, \d with", printed)
    assert [(driver, check) for driver, check, _ in found] == [
        ("own_parts:driver", "paper"),
        ("own_parts:driver", "own_parts:stops"),
    ]
    # about 29 m/s for 27 s; or stopped at 4 m/s^2, after at most 30^2 / 8 = 112.5 m
    assert float(found[1][2]) < 0.12 < 0.7 < float(found[0][2])


@pytest.mark.usefixtures("parts")
def test_the_falsifier_breaks_a_check_that_never_brakes(
    capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["--safety-check", "own_parts:never_brakes", "--family", "lead-brakes", "--search"]
    monkeypatch.setattr("sys.argv", ["falsify.py", "--scenes", "100", *words])
    assert falsify.main() == 1
    family, scenes, hits, *_ = capsys.readouterr().out.splitlines()[1].split()
    assert (family, scenes) == ("lead-brakes", "100")
    assert int(hits) > 20


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("pretrained@paper", "--safety-check paper"),
        ("sumo", "SUMO itself drives sumo"),
        ("pretraind", "pretrained"),
    ],
)
def test_a_driver_that_cannot_be_in_the_tests_is_refused(word: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        drivers(word, settings("paper"), 2)


def test_a_check_that_does_not_exist_is_refused_with_a_hint(
    capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["crash_rate.py", "--safety-check", "stric"])
    with pytest.raises(SystemExit):
        crash_rate.main()
    assert "'stric' is no check (did you mean 'strict'?)" in capsys.readouterr().err
