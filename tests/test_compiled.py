"""Compiled functions: announced once, cached anywhere, renewed if needed, plain on demand."""

import hashlib
import pickle
from contextlib import closing
from pathlib import Path

import numpy as np
from programs import python

from drl_av.compiled import NOTICE, compiled, squared
from drl_av.config import Config
from drl_av.env.highway import HighwayEnv

LANE = "from drl_av.road.road import lane_of; print(lane_of(4.0, 3.8))"
INNER = "from drl_av.compiled import compiled\n\n@compiled\ndef inner(x):\n    return x + {}\n"
OUTER = """
from drl_av.compiled import compiled
from inner import inner

@compiled
def outer(x):
    return 10.0 * inner(x)

print(outer(1.0))
"""


def test_the_first_use_says_in_one_line_that_it_compiles_and_the_second_uses_the_cache(
    tmp_path: Path,
) -> None:
    first, second = (python("-c", LANE, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2))
    assert (first.stdout, first.stderr) == ("1\n", f"{NOTICE}\n")
    assert (second.stdout, second.stderr) == ("1\n", "")


def test_without_any_folder_for_the_machine_code_the_way_out_is_named() -> None:
    nowhere = "from numba.core import caching; caching.CacheImpl._locator_classes = []; "
    done = python("-c", nowhere + LANE)
    assert done.returncode == 1
    assert "let the environment variable NUMBA_CACHE_DIR name a folder" in done.stderr


def written(folder: Path, added: float) -> None:
    (folder / "inner.py").write_text(INNER.format(added))
    (folder / "outer.py").write_text(OUTER)


def of_outer(folder: Path, **environment: str) -> float:
    done = python(str(folder / "outer.py"), **environment)
    assert done.returncode == 0, done.stderr
    return float(done.stdout)


def test_a_function_is_compiled_again_when_one_that_it_calls_has_changed(tmp_path: Path) -> None:
    written(tmp_path, 1.0)
    assert of_outer(tmp_path) == of_outer(tmp_path) == 20.0
    written(tmp_path, 2.0)
    assert of_outer(tmp_path) == 30.0


def test_a_function_is_compiled_again_when_the_decorator_of_one_that_it_calls_has_changed(
    tmp_path: Path,
) -> None:
    written(tmp_path, 1.0)
    of_outer(tmp_path)
    [index] = tmp_path.rglob("outer.outer*.nbi")
    before = index.read_bytes()
    of_outer(tmp_path)
    assert index.read_bytes() == before
    inner = (tmp_path / "inner.py").read_text()
    inner = inner.replace("@compiled", "@inlined").replace("import compiled", "import inlined")
    (tmp_path / "inner.py").write_text(inner)
    of_outer(tmp_path)
    assert index.read_bytes() != before


def test_a_damaged_cache_is_no_error(tmp_path: Path) -> None:
    written(tmp_path, 1.0)
    assert of_outer(tmp_path) == 20.0
    found = [*(tmp_path / "__pycache__").glob("*.nb?")]
    assert len(found) >= 2
    for path in found:
        path.write_bytes(path.read_bytes()[:-20])
    assert of_outer(tmp_path) == 20.0


def test_a_cache_that_cannot_be_written_is_said_and_no_error(tmp_path: Path) -> None:
    full = (
        "import numba.core.caching as c; c.IndexDataCacheFile.save = lambda *_: open('/no/file'); "
    )
    done = python("-c", full + LANE, NUMBA_CACHE_DIR=str(tmp_path))
    assert done.stdout == "1\n"
    assert f"Compiled functions cannot be kept in {tmp_path}" in done.stderr


def test_where_the_module_s_folder_cannot_be_written_the_cache_is_the_user_s(
    tmp_path: Path,
) -> None:
    folder, home = tmp_path / "installed", tmp_path / "home"
    folder.mkdir()
    home.mkdir()
    written(folder, 1.0)
    (folder / "__pycache__").write_text("no folder, not even root's")
    place = {"HOME": str(home), "XDG_CACHE_HOME": str(home)}
    assert of_outer(folder, **place) == 20.0
    assert [*home.rglob("*outer*.nbi")]


DRIVE = """
import sys
sys.path.insert(0, "tests")
from test_compiled import driven
print(driven("strict"))
"""


def driven(check: str) -> str:
    """The hash of what an environment returns in a short episode among drivers of all kinds."""
    config = {"traffic": {"kind": "paper"}, "safety": {"check": check}}
    seen = hashlib.sha256()
    with closing(HighwayEnv(config=config, action_mask=True)) as env:
        env.reset(seed=1_000_003, options={"vehicles": 12})
        for action in (1, 9, 8, 0, 5, 6, 1):
            observation, reward, *_, info = env.step(action)
            for found in (observation, info["indicators"], info["action_mask"]):
                seen.update(found.tobytes())
            seen.update(repr((reward, info["rule"], info["rewards"])).encode())
    return seen.hexdigest()


def test_without_compilation_the_same_code_gives_the_same_numbers() -> None:
    root = Path(__file__).parents[1]
    plain = python("-c", DRIVE, cwd=root, NUMBA_DISABLE_JIT="1")
    assert plain.returncode == 0, plain.stderr
    assert plain.stdout.split()[-1] == driven("strict")


def test_a_square_is_that_of_python_to_the_last_bit() -> None:
    drawn = np.random.default_rng(0).normal(0, 30, 100_000).tolist()
    assert any(x**2 != x * x for x in drawn)  # why it matters
    assert all(squared(x) == x**2 for x in drawn)
    square = compiled(squared)
    assert all(square(x) == x**2 for x in drawn)


def test_settings_become_numbers_by_their_names() -> None:
    safety = Config().updated("safety", minimum_gap_m=7, printed_idm=True).safety
    found = safety.numbers
    assert found.minimum_gap_m == 7.0
    assert found.printed_idm is True
    assert not hasattr(found, "check")
    assert pickle.loads(pickle.dumps(found)) == found
    assert Config().reward.numbers.desired_is_fixed is False
