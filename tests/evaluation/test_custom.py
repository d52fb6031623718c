"""Each driver under its check; checks, rewards and observations of the user's own, everywhere."""

import csv
import shlex
import shutil
import subprocess
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import onnx
import pytest
from runs import INTERRUPT, Capsys, error_message, interrupted, run_folder
from stable_baselines3 import PPO

import drl_av
from drl_av.cli import main
from drl_av.config import Config
from drl_av.config.functions import import_function
from drl_av.drivers.registry import find_drivers
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene
from drl_av.env.custom import CustomParts
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeResult
from drl_av.env.transition import Transition
from drl_av.errors import ConfigError, DrlAvWarning
from drl_av.safety.check import Rule, Verdict

SHORT = {"simulation": {"decisions_per_episode": 6}}
MODULE = """
import gymnasium
import numpy as np
from pathlib import Path
from drl_av.driving.actions import ACTIONS
from drl_av.safety.check import Rule, Verdict

Path("imported").touch()

def slow(scene, proposed):
    if proposed.number == 3:
        return Verdict(proposed, Rule.IN_LANE)  # names a rule, and changes nothing
    return Verdict(ACTIONS[3], "always slow")

def factory(config):
    assert config.simulation.decisions_per_episode == 6
    return slow

def price(transition):
    return -0.125

class Speed:
    space = gymnasium.spaces.Box(0.0, 1.0, (1,), np.float32)
    def __call__(self, scene):
        return np.array([scene.affordances.ego_speed_m_s / 50], np.float32)

class Brakes:
    def start(self, seed):
        pass
    def act(self, scene, observation):
        return ACTIONS[2 if observation.shape == (1,) else 0]

def brakes(config):
    return Brakes()
"""


@pytest.fixture
def mine(here: Path) -> Iterator[str]:
    """The name of a module in the working directory, which is imported for this test only."""
    (here / "mine_doors.py").write_text(MODULE)
    (here / "short.toml").write_text("[simulation]\ndecisions_per_episode = 6\n")
    yield "mine_doors"
    sys.modules.pop("mine_doors", None)


def checks(rows: list[EpisodeResult]) -> dict[str, str]:
    return {row.driver: row.safety_check for row in rows}


def test_a_factory_may_import_its_neighbour_when_it_is_called(here: Path, mine: str) -> None:
    (here / "neighbour_of_mine.py").write_text("from mine_doors import Brakes\n")
    (here / "late_doors.py").write_text(
        "def late(config):\n    from neighbour_of_mine import Brakes\n    return Brakes()\n"
    )
    rows = drl_av.evaluate(["late_doors:late"], vehicles=3, episodes=1, config=SHORT)
    assert rows[0].driver == "late_doors:late"


def test_a_driver_named_with_its_check_drives_under_it_whoever_is_beside_it() -> None:
    words = ["pretrained@paper", "idm@strict", "idm@permit_all", "gap-mobil"]
    given: dict[str, Any] = {"vehicles": 20, "episodes": 2, "config": SHORT}
    given["safety_check"] = "strict"
    rows = drl_av.evaluate(words, **given)
    under = ("paper", "strict", "permit_all", "strict")
    assert checks(rows) == dict(zip(words, under, strict=True))
    for word in words:
        assert [row for row in rows if row.driver == word] == drl_av.evaluate(word, **given)
    assert [each.over for each in rows.judgements] != []  # idm@strict is rule-based, too
    assert drl_av.evaluate(words, **given, jobs=2) == rows


def test_drivers_of_two_checks_observe_groups_that_can_be_read_once() -> None:
    given: dict[str, Any] = {"vehicles": 1, "episodes": 1, "config": SHORT}
    assert len(drl_av.evaluate(["idm", "idm@strict"], observation=iter(["ego"]), **given)) == 2


def test_a_file_with_an_at_in_its_name_is_itself(tmp_path: Path) -> None:
    run = run_folder(tmp_path / "run@paper")
    [spec] = find_drivers([str(run)])
    assert (spec.name, spec.under) == ("run@paper", None)


def test_who_names_drivers_of_two_checks_is_told(here: Path, capsys: Capsys) -> None:
    with HighwayEnv(config=SHORT) as env:
        PPO("MlpPolicy", env, device="cpu").save("ppo.zip")
    words = ["--vehicles", "1", "--episodes", "1", "-o", "simulation.decisions_per_episode=3"]
    told = (
        "drl-av: All drivers without a named check drive under strict, but ppo.zip by itself "
        "under paper: name one check with --safety-check (safety_check=), or a driver's own, such "
        "as ppo.zip@paper.\n"
    )
    relies = (
        "drl-av: pretrained was trained under strict and relies on it: under paper it proposes "
        "what strict would refuse, and hits vehicles; name --safety-check strict (safety_check=).\n"
    )
    for drivers, said in (
        (["ppo.zip", "idm", "pretrained"], told),
        (["ppo.zip", "idm"], ""),
        (["ppo.zip@paper", "idm", "pretrained"], ""),
        (["ppo.zip", "pretrained", "--safety-check", "paper"], relies),
    ):
        assert main(["evaluate", *drivers, *words]) == 0
        printed = capsys.readouterr()
        assert printed.err == said
        assert printed.out.lstrip().startswith("safety check")
    with pytest.warns(DrlAvWarning, match=r"ppo\.zip by itself under paper"):
        drl_av.evaluate(["ppo.zip", "pretrained"], vehicles=1, episodes=1, config=SHORT)


def test_every_table_says_under_which_check(capsys: Capsys) -> None:
    words = ["--vehicles", "1", "--episodes", "2", "-o", "simulation.decisions_per_episode=3"]
    words += ["--criticality"]
    assert main(["evaluate", "pretrained", "idm", *words]) == 0
    assert capsys.readouterr().out.count("safety check: strict") == 4
    assert main(["evaluate", "pretrained@paper", "idm@strict", *words]) == 0
    title = "safety checks: paper: pretrained@paper; strict: idm@strict"
    assert " ".join(capsys.readouterr().out.split()).count(title) == 4


def test_own_parts_are_named_on_the_command_line(mine: str, here: Path, capsys: Capsys) -> None:
    for check in ("slow", "factory"):
        words = ["evaluate", "idm", f"{mine}:brakes", "--vehicles", "2", "--episodes", "2"]
        words += ["--safety-check", f"{mine}:{check}", "--reward", f"{mine}:price"]
        words += ["--observation", f"{mine}:Speed", "--config", "short.toml"]
        assert main([*words, "--out", f"{check}.csv"]) == 0
        assert f"safety check: {mine}:{check}" in capsys.readouterr().out
        assert main([*words, "--out", f"two_{check}.csv", "--jobs", "2"]) == 0
        assert Path(f"two_{check}.csv").read_text() == Path(f"{check}.csv").read_text()
        rows = list(csv.DictReader(Path(f"{check}.csv").read_text().splitlines()))
        assert {row["safety_check"] for row in rows} == {f"{mine}:{check}"}
        assert {row["mean_reward"] for row in rows} == {"-0.125"}
        assert {row["hard_brakes"] for row in rows} == {"6"}


def test_own_parts_are_objects_of_a_program_also_in_several_processes() -> None:
    lock: list[Any] = []

    def slow(scene: Scene, proposed: Action) -> Verdict:
        return Verdict(ACTIONS[3], Rule.IN_LANE if proposed.number != 3 else Rule.NONE)

    def price(transition: Transition) -> float:
        return -0.5

    class Speed:
        space = gymnasium.spaces.Box(0.0, 1.0, (1,), np.float32)

        def __call__(self, scene: Scene) -> Any:
            return np.array([scene.affordances.ego_speed_m_s / 50], np.float32)

    class Own:
        def start(self, seed: int) -> None:
            lock and lock.append(seed)

        def act(self, scene: Scene, observation: Any) -> Action:
            assert observation.shape == (1,)
            return ACTIONS[0]

    given: dict[str, Any] = {"safety_check": slow, "reward": price, "observation": Speed()}
    given |= {"own": {"mine": Own()}, "vehicles": 2, "episodes": 3, "config": SHORT}
    rows = drl_av.evaluate("idm", **given)
    assert drl_av.evaluate("idm", **given, jobs=2) == rows
    assert checks(rows) == {"idm": "slow", "mine": "slow"}
    plain = given | {"own": {}, "observation": None}
    beside = drl_av.evaluate(["idm", "idm@paper"], **plain)[1::2]
    assert beside == drl_av.evaluate("idm@paper", **plain | {"safety_check": None})
    assert {row.mean_reward for row in rows} == {-0.5}
    lock.append(threading.Lock())
    with pytest.raises(ConfigError, match=r"cannot be copied into another process .* jobs=1"):
        drl_av.evaluate("idm", **given, jobs=2)
    assert len(drl_av.evaluate("idm", **given)) == 6


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--safety-check", "mine_doors:missing"], "safety check 'mine_doors:missing' cannot be"),
        (["--safety-check", "mine_doors:price"], "'mine_doors:price' is -0.125, but must be a fun"),
        (["--reward", "price"], "--reward is 'price', but must have the form module:name"),
        (["--reward", "mine_doors:slow"], "is called with (transition), which slow(scene, pro"),
        (["--observation", "mine_doors:slow"], "names of groups (own_front"),
    ],
)
def test_own_parts_that_are_none_are_one_sentence(
    words: list[str], message: str, mine: str, capsys: Capsys
) -> None:
    assert main(["evaluate", "idm", "--vehicles", "1", "--episodes", "1", *words]) == 1
    assert message in error_message(capsys)


def test_an_own_check_is_filmed_recorded_and_repeated_when_it_is_named(
    mine: str, here: Path, capsys: Capsys
) -> None:
    check = ["--safety-check", f"{mine}:slow"]
    words = ["replay", "--driver", "idm", "--vehicles", "2", "--config", "short.toml"]
    assert main([*words, *check, "--video", "a.gif", "--record", "a.npz"]) == 0
    assert f"idm, check {mine}:slow, 2 vehicles, seed 0: 6 decisions" in capsys.readouterr().out
    assert main(["replay", "a.npz", *check, "--html", "a.html"]) == 0
    assert "exactly as recorded" in capsys.readouterr().out
    assert '"rule":"always slow"' in Path("a.html").read_text()


def test_a_file_that_names_a_function_runs_none_until_the_user_names_it(
    mine: str, here: Path, capsys: Capsys
) -> None:
    check, short = ["--safety-check", f"{mine}:slow"], ["--config", "short.toml"]
    words = ["replay", "--driver", "idm", "--vehicles", "2", *short, *check]
    assert main([*words, "--html", "a.html", "--record", "a.npz"]) == 0
    assert main(["train", "--out", "run", "--episodes", "1", *short, *check]) == 0
    (here / "own.toml").write_text(f'[safety]\ncheck = "{mine}:slow"\n')
    (here / "imported").unlink()
    capsys.readouterr()
    del sys.modules[mine]
    for words in (
        ["replay", "a.npz", "--html", "b.html"],
        ["evaluate", "run", "--vehicles", "1", "--episodes", "1"],
        ["replay", "run", "--html", "b.html"],
        ["train", "--out", "run", "--resume"],
        ["adapt", "run", "--out", "adapted"],
        ["evaluate", "idm", "--config", "own.toml", "--vehicles", "1", "--episodes", "1"],
        ["train", "--out", "other", "--config", "own.toml"],
    ):
        assert main(words) == 1, words
        assert f"name it with --safety-check {mine}:slow" in error_message(capsys)
    assert not (here / "imported").exists()
    assert main(["evaluate", "run", "--vehicles", "1", "--episodes", "1", *check]) == 0


def test_a_training_goes_on_with_the_reward_that_it_began_with(
    mine: str, here: Path, capsys: Capsys
) -> None:
    words = ["train", "--out", "run", "--episodes", "3", "--config", "short.toml"]
    priced = [f"--reward={mine}:price", "--sumo-options=--step-log.period 7"]
    in_the_second = f"at_call(HighwayEnv, 'execute', 9, {INTERRUPT})"
    stopped = interrupted(in_the_second, [*words, *priced, "--tensorboard"])
    assert stopped.returncode == 130
    again = stopped.stderr.partition("continue with: drl-av ")[2].split("\n")[0]
    assert again.startswith("train --out=run --resume --reward=")
    assert again.endswith(" --tensorboard")
    for options, message in {
        (): f"was begun with --reward {mine}:price: give all",
        (priced[0],): "was begun with --sumo-options --step-log.period 7: give all",
    }.items():
        assert main(["train", "--out", "run", "--resume", *options]) == 1
        assert message in error_message(capsys)
    Path(f"{mine}.py").write_text(MODULE + "\n")
    assert main(shlex.split(again)) == 1
    assert f"was begun with --reward {mine}:price: give all parts" in error_message(capsys)
    Path(f"{mine}.py").write_text(MODULE)
    assert main(shlex.split(again)) == 0
    rows = list(csv.DictReader(Path("run/episodes.csv").read_text().splitlines()))
    assert [row["mean_reward"] for row in rows] == ["-0.125"] * 3
    assert main([*words[:2], "plain", *words[3:]]) == 0
    assert main(["train", "--out", "plain", "--resume", priced[0]]) == 1
    assert "plain was begun without --reward: give all" in error_message(capsys)


def test_a_training_under_a_check_of_a_program_is_of_no_other(mine: str) -> None:
    slow = import_function(f"{mine}:slow", "check")
    config = SHORT | {"learning": {"evaluation_episodes": 1}}
    for number, check in enumerate((slow, lambda scene, proposed: slow(scene, proposed))):
        run = drl_av.train(f"slow{number}", config=config, episodes=1, safety_check=check)
        with pytest.raises(ConfigError, match="a function of a user, which no file may run"):
            drl_av.evaluate(run, vehicles=3, episodes=1)
    words = ["train", "--out", "slow0", "--resume", "--safety-check", f"{mine}:slow"]
    assert main(words) == 0


def test_the_reward_of_a_program_is_named_as_another_program_would(mine: str) -> None:
    price, speed = (import_function(f"{mine}:{name}", "part") for name in ("price", "Speed"))
    assert CustomParts(reward=price).words() == {"reward": f"{mine}:price"}
    assert CustomParts(observation=speed()).words() == {"observation": f"{mine}:Speed"}
    options = CustomParts(sumo_options=["--fcd-output", "a b.xml"])
    assert options.words() == {"sumo_options": "--fcd-output 'a b.xml'"}
    program = "import drl_av.env.custom as c\nfor reward in (lambda t: 0, '__main__:mine'):\n"
    program += "    print(c.CustomParts(reward=reward).words())"
    Path("my_program.py").write_text(program)
    run = subprocess.run([sys.executable, "my_program.py"], capture_output=True, text=True)
    assert run.stdout == "{'reward': 'my_program:<lambda>'}\n{'reward': 'my_program:mine'}\n"


@pytest.mark.parametrize(
    "change", ["driver", "its data", "module", "scenario", "reward", "sumo options"]
)
def test_a_table_refuses_rows_of_a_changed_file_or_function(
    change: str, mine: str, here: Path, capsys: Capsys
) -> None:
    assert main(["scenario", "road", "--circumference-m", "400"]) == 0
    assert main(["export", "pretrained-paper", "net.onnx"]) == 0
    words = ["evaluate", "net.onnx", "--driver", f"{mine}:brakes", "--scenario", "road"]
    words += ["--vehicles", "1", "--episodes", "1", "--config", "short.toml", "--out", "t.csv"]
    words += ["--reward", f"{mine}:price", "--sumo-options=--step-log.period 7"]
    Path("net.onnx.data").write_bytes(b"what ONNX stores outside")
    assert main(words) == 0
    before = Path("t.csv").read_bytes()
    assert main(words) == 0
    if change == "driver":
        network = onnx.load("net.onnx")
        network.doc_string = "another file, though the same driver"
        onnx.save(network, "net.onnx")
    elif change == "its data":
        Path("net.onnx.data").write_bytes(b"of another network")
    elif change == "module":
        Path(f"{mine}.py").write_text(MODULE + "\n")
    elif change == "scenario":
        shutil.rmtree("road")
        assert main(["scenario", "road", "--circumference-m", "420"]) == 0
    elif change == "reward":
        words = [*words[:-3], words[-1]]
    else:
        words = words[:-1]
    capsys.readouterr()
    assert main(words) == 1
    assert "t.csv was made with other settings, columns or drivers" in error_message(capsys)
    assert Path("t.csv").read_bytes() == before


def test_the_environment_takes_the_names_too(mine: str) -> None:
    parts = {"safety_check": f"{mine}:slow", "reward": f"{mine}:price"}
    env = gymnasium.make("drl_av/Highway-v0", observation=f"{mine}:Speed", config=SHORT, **parts)
    with closing(env):
        assert env.reset(seed=1)[0].shape == (1,)
        _, reward, *_, info = env.step(0)
        assert (reward, info["rule"]) == (-0.125, "always slow")


def test_a_complete_config_needs_no_warning() -> None:
    config = Config().updated("simulation", decisions_per_episode=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        [row] = drl_av.evaluate("pretrained-paper", vehicles=1, episodes=1, config=config)
    assert row.safety_check == "paper"
