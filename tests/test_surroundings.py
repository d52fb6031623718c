"""Another SUMO around drl-av: older modules, variables and the language of the process."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from programs import python

from drl_av.cli import main
from drl_av.cli.console import PLAIN

EVALUATE = ("-m", "drl_av", "evaluate", "idm", "--vehicles", "1", "--episodes", "1")


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """Modules of SUMO 1.12 as pip --target installs them, which break libsumo 1.28."""
    for name in ("traci", "sumolib"):
        (tmp_path / "old" / name).mkdir(parents=True)
        (tmp_path / "old" / name / "__init__.py").write_text("old = True\n")
        about = tmp_path / "old" / f"{name}-1.12.0.dist-info"
        about.mkdir()
        about.joinpath("METADATA").write_text(f"Name: {name}\nVersion: 1.12.0\n")
    return tmp_path / "old"


@pytest.fixture
def short(tmp_path: Path) -> tuple[str, ...]:
    (tmp_path / "short.toml").write_text("[simulation]\ndecisions_per_episode = 3\n")
    return *EVALUATE, "--config", str(tmp_path / "short.toml")


def test_older_modules_on_the_path_are_passed_over(old: Path, short: tuple[str, ...]) -> None:
    there = python("-c", "import traci; print(traci.old)", PYTHONPATH=str(old))
    assert there.stdout == "True\n", "the old module is not in the way"
    done = python(*short, PYTHONPATH=str(old))
    assert (done.returncode, done.stderr) == (0, "")


def test_an_older_module_that_is_imported_already_is_named(old: Path) -> None:
    program = (
        "import traci, sys\nfrom drl_av.cli import main\n"
        "sys.exit(main(['evaluate', 'idm', '--episodes', '1']))"
    )
    done = python("-c", program, PYTHONPATH=str(old))
    assert done.returncode == 1
    wanted = f"drl-av: traci 1.12.0 was imported from {old / 'traci'}, but drl-av needs 1.28: "
    assert done.stderr.startswith(wanted)
    assert done.stderr.count("\n") == 1


def test_the_window_is_controlled_by_traci_whatever_the_variable_says() -> None:
    program = (
        "from drl_av.simulation.start_sumo import connection\nimport os\n"
        "print(connection(gui=True).isLibsumo(), os.environ['LIBSUMO_AS_TRACI'])"
    )
    done = python("-c", program, LIBSUMO_AS_TRACI="1")
    assert done.stdout == "False 1\n"
    program = "import traci\n" + program
    done = python("-c", program, LIBSUMO_AS_TRACI="quiet")
    assert done.returncode == 1
    assert "drl_av.errors.SimulationError: The module traci is libsumo in this" in done.stderr


@pytest.fixture(scope="module")
def german(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables by which a process finds a German locale."""
    folder = tmp_path_factory.mktemp("locales")
    program = shutil.which("localedef")
    if program is None:
        pytest.skip("needs localedef")
    words = [program, "-i", "de_DE", "-f", "UTF-8", str(folder / "de_DE.UTF-8")]
    if subprocess.run(words, capture_output=True, check=False).returncode > 1:
        pytest.skip("needs the sources of locales (the package locales)")
    return {"LOCPATH": str(folder)}


def test_sumo_reads_its_numbers_in_a_process_that_writes_commas(german: dict[str, str]) -> None:
    program = (
        "import locale, warnings\nwarnings.simplefilter('always')\n"
        "locale.setlocale(locale.LC_NUMERIC, 'de_DE.UTF-8')\n"
        "from drl_av.env.highway import HighwayEnv\n"
        "env = HighwayEnv()\nenv.reset(seed=1)\n"
        "print(locale.setlocale(locale.LC_NUMERIC))"
    )
    done = python("-c", program, **german)
    assert done.stdout == "C\n", done.stderr
    assert "LC_NUMERIC of this process was de_DE.UTF-8, with which SUMO cannot" in done.stderr


def test_every_verb_that_uses_sumo_works_under_a_foreign_sumo_home(
    short: tuple[str, ...], german: dict[str, str], tmp_path: Path
) -> None:
    around = {"SUMO_HOME": "/nowhere", "LC_ALL": "de_DE.UTF-8", **german}
    done = python(*short, **around)
    assert (done.returncode, done.stderr) == (0, "")
    words = ("scenario", str(tmp_path / "there"), "--kind", "merge")
    done = python("-m", "drl_av", *words, **around)
    assert (done.returncode, done.stderr) == (0, "")
    assert main([*words[:1], str(tmp_path / "here"), *words[2:]]) == 0
    for file in (tmp_path / "here").iterdir():
        assert file.read_bytes() == (tmp_path / "there" / file.name).read_bytes()


def test_a_terminal_of_plain_characters_gets_plain_characters(short: tuple[str, ...]) -> None:
    done = python(*short, LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.isascii()
    assert "\\x" not in done.stdout
    assert "+- half of the 95 % interval" in done.stdout


def test_what_the_command_prints_has_a_plain_form() -> None:
    printed = Path(sys.modules["drl_av.cli"].__file__ or "").parent.glob("*.py")
    found = {each for file in printed for each in re.findall(r"[^\x00-\x7f]", file.read_text())}
    assert found <= {*PLAIN}
