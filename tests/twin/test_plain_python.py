"""The compiled functions are the same functions in plain Python."""

from programs import python

PROGRAM = """
import hashlib, numpy as np
from drl_av.env.vector import TwinVectorEnv
env = TwinVectorEnv(2)
seen, _ = env.reset(seed=2_000_001, options={"vehicles": 8})
for number in range(25):
    seen, *_ = env.step(np.array([number % 12, 1]))
print(hashlib.sha256(env.worlds.x[:, :, :9].tobytes() + seen.tobytes()).hexdigest())
"""


def test_without_compilation_the_results_are_the_same_to_the_bit() -> None:
    compiled = python("-c", PROGRAM)
    plain = python("-c", PROGRAM, NUMBA_DISABLE_JIT="1")
    assert compiled.stdout == plain.stdout != ""
