"""Tries mutated inputs: drl-av must accept each one, or refuse it with an error of one sentence.

    python -m verification.fuzz                                   # 20,000 inputs in all
    python -m verification.fuzz --kind "driven config" --inputs 500 --seed 1

An input fails if it leads to a wrong result, a traceback or any other message. The program prints
a line for each failure; the exit status is 1 if there is one.
"""

import contextlib
import math
import random
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from drl_av.config import Config, from_toml, load_config
from drl_av.drivers.policy_file import PRETRAINED, load_policy
from drl_av.env.metrics import EpisodeResult
from drl_av.errors import DrlAvError
from drl_av.evaluation.recording import Recording, load_recording
from drl_av.evaluation.table import Inputs, ResultTable, read_results
from drl_av.files.table import table_bytes
from drl_av.scenarios.folder import (
    find_scenario,
    load_scenario,
    read_description,
    shipped_scenarios,
)
from drl_av.scenarios.imported.description import ImportedDescription
from studies.options import order_by
from verification.fuzz_driving import (
    Attempt,
    apart,
    driven_config,
    driven_scenario,
    original_positions,
    positions,
    route,
)
from verification.fuzz_runs import checkpoint, command_line
from verification.program import Program, run_program

ABSURD = (b"nan", b"inf", b"-1", b"1e400", b"9" * 5000, b"\0", b"\xff\xfe", b"[" * 3000, b"'", b"$")
RESULT = EpisodeResult(
    *("idm", "paper", 5, 0, 200, 20.5, -0.3, -0.5, -0.2, 0.0, False, False, "", 4, 2, 1),
    *(math.inf, 1.5, 0, 0),
)
TABLE = table_bytes(EpisodeResult, [RESULT, replace(RESULT, driver="mine")])
ODD = (b"-1", b"0", b"3.5", b"1e400", b"true", b"'x'", b"[]", b"{a=1}", b"07:32:00", b"9" * 30)
"""TOML values that most settings do not accept."""


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Return the bytes with one to four changes: deletion, bit flip, repetition, absurd value."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        start = rng.randrange(len(found) + 1)
        end = min(len(found), start + rng.choice((0, 1, 4, 40)))
        kind = rng.randrange(4)
        if kind == 0:
            del found[start : end if rng.random() < 0.8 else len(found)]
        elif kind == 1 and start < len(found):
            found[start] ^= 1 << rng.randrange(8)
        elif kind == 2:
            found[start:start] = found[start:end] * rng.choice((1, 2, 100))
        else:
            found[start:end] = rng.choice(ABSURD)
    return bytes(found)


def _config(rng: random.Random, folder: Path) -> None:
    file = folder / "config.toml"
    text = Config().to_toml().encode()
    file.write_bytes(rng.choice((mutated, _odd_setting))(text, rng))
    found = load_config(file)
    assert from_toml(found.to_toml()) == found


def _odd_setting(text: bytes, rng: random.Random) -> bytes:
    """Return the settings with another value, key or section in one line."""
    lines = text.splitlines()
    row = rng.randrange(len(lines))
    key = lines[row].partition(b"=")[0].strip()
    key = rng.choice((key, key, key, b"wings", b'"a\\nb"', b"learning.seed", b"[learning]"))
    lines[row] = key + b" = " + rng.choice(ODD)
    return b"\n".join((*lines, b""))


def _scenario(rng: random.Random, folder: Path) -> None:
    for file in find_scenario().iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    (folder / "SHA256SUMS").unlink()
    file = rng.choice(sorted(folder.iterdir()))
    file.write_bytes(mutated(file.read_bytes(), rng))
    assert np.isfinite(load_scenario(folder).road.lap_m)


def _checked_scenario(rng: random.Random, folder: Path) -> None:
    shipped = sorted(shipped_scenarios().values())
    original, other = rng.choice(shipped), rng.choice(shipped)
    home = Path(shutil.copytree(original, folder / "scenario"))
    file = rng.choice(sorted(home.iterdir()))
    how = rng.choice(("changed", "changed", "another's", "missing"))
    if how == "missing":
        file.unlink()
    elif how == "changed":
        file.write_bytes(mutated(file.read_bytes(), rng))
    elif (other / file.name).exists():
        file.write_bytes((other / file.name).read_bytes())
    load_scenario(home)
    assert positions(home) == original_positions(original)


def _network(rng: random.Random, folder: Path) -> None:
    given = route()
    file = folder / "own.net.xml"
    file.write_bytes(mutated(Path(given["net"]).read_bytes(), rng))
    road = ImportedDescription(**given | {"net": str(file)}).plan().road
    assert 600 <= road.end_m <= 50_000
    assert 2 <= road.lane_width_m <= 10


def _policy(rng: random.Random, folder: Path) -> None:
    file = folder / "policy.safetensors"
    shipped = PRETRAINED / rng.choice(("paper", "level_1", "level_2"))
    file.write_bytes(mutated((shipped / file.name).read_bytes(), rng))
    network, _ = load_policy(file)
    assert np.isfinite(network.flat).all()


def _recording(rng: random.Random, folder: Path) -> None:
    file = folder / "recording.npz"
    states = np.zeros((3, 2, 4))
    actions, rules, ids = np.array([0, 1]), np.array(["", ""]), np.array(["ego", "vehicle1"])
    times = np.arange(len(states), dtype=np.float64)
    decided = actions, actions, rules
    Recording(Config(), "idm", 7, 1, *decided, ids, np.ones((2, 2)), times, states).save(file)
    file.write_bytes(mutated(file.read_bytes(), rng))
    assert np.array_equal(load_recording(file).states, states)


def _table(rng: random.Random, folder: Path) -> None:
    file = folder / "table.csv"
    file.write_bytes(mutated(TABLE, rng))
    for row in read_results(file):
        assert np.isfinite([row.vehicles, row.mean_speed_m_s]).all()


def _description(rng: random.Random, folder: Path) -> None:
    file = folder / "own.toml"
    shipped = rng.choice(("merge", "exit", "ramp_to_ramp", "straight"))
    file.write_bytes(mutated((find_scenario(shipped) / "scenario.toml").read_bytes(), rng))
    found = read_description(file)
    assert 1 <= found.speed_limit_m_s <= 100
    assert 2 <= found.lane_width_m <= 10


def _store(rng: random.Random, folder: Path) -> None:
    store, config = folder / "mine.csv", Config()
    inputs, place = Inputs({"": config}), order_by(seed=int)
    rows = [{"seed": str(seed), "mean_speed_m_s": str(20.5 + seed)} for seed in range(9)]
    whole = ResultTable(store, inputs, place)
    whole.add(*rows)
    whole.save()
    file = rng.choice((store, store.with_suffix(".json")))
    file.write_bytes(mutated(file.read_bytes(), rng))
    before = file.read_bytes()
    found = ResultTable(store, inputs, place)
    assert file.read_bytes() == before
    found.add({"seed": "9", "mean_speed_m_s": "20.5"})
    assert np.isfinite([float(row["mean_speed_m_s"]) for row in found.rows]).all()


KINDS: dict[str, Attempt] = {
    **{"config": _config, "scenario": _scenario, "checked scenario": _checked_scenario},
    **{"network": _network, "description": _description, "policy": _policy},
    **{"checkpoint": checkpoint, "recording": _recording, "table": _table, "store": _store},
    **{"command line": command_line, "driven config": apart(driven_config)},
    "driven scenario": apart(driven_scenario),
}


def fuzz(kind: str, inputs: int, seed: int) -> tuple[int, list[str]]:
    """Try mutated inputs of a kind; return the number of refused ones, and each failure as text.

    An input is refused by an error of one sentence. It fails if it leads to a wrong result, a
    traceback or a bad message; the text names its number, which makes the same input again.
    """
    refused, failures = 0, []
    for number in range(inputs):
        with tempfile.TemporaryDirectory() as home:
            folder = Path(home, "input")
            folder.mkdir()
            try:
                KINDS[kind](random.Random(f"{seed} {kind} {number}"), folder)
            except Exception as error:
                text, is_ours = str(error), isinstance(error, DrlAvError)
                if is_ours and "\n" not in text.strip() and text.endswith("."):
                    refused += 1
                else:
                    shown = " ".join(repr(error).split())
                    failures.append(f"{kind} {number} of seed {seed}: {shown}")
    return refused, failures


def run() -> int:
    """Try inputs of each kind, and print the refusals and failures; return 1 after a failure."""
    parser = Program(__doc__)
    parser.number("--inputs", 20_000, "number of inputs, divided among the kinds")
    parser.some("--kind", KINDS)
    parser.number("--seed", 0, low=0)
    options = parser.parse_args()
    failed = False
    with tempfile.TemporaryDirectory() as home, contextlib.chdir(home):
        for kind in options.kind:
            inputs = -(-options.inputs // len(options.kind))
            refused, failures = fuzz(kind, inputs, options.seed)
            failed |= bool(failures)
            said = f"{kind}: {inputs} inputs, {refused} refused, {len(failures)} failures"
            print(said, *failures, sep="\n  ", flush=True)
    return int(failed)


if __name__ == "__main__":
    run_program(run)
