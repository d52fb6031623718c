"""Unpickles the parts of stable-baselines3 agents without running code of their own (ours)."""

import base64
import importlib
import io
import pickle
import re
from collections.abc import Callable, Mapping
from typing import Any

CLASSES = re.compile(
    r"gymnasium\.spaces\.\w+:(Box|Discrete|Dict|MultiDiscrete|MultiBinary)"
    r"|torch\.nn\.modules\.activation:\w+|torch\.optim\.\w+:(Adam|AdamW|RMSprop|SGD)"
    r"|stable_baselines3\.(common|dqn)\.policies:\w+"
    r"|stable_baselines3\.common\.torch_layers:\w+"
    r"|stable_baselines3\.common\.sb2_compat\.rmsprop_tf_like:RMSpropTFLike"
    r"|stable_baselines3\.common\.vec_env\.vec_normalize:VecNormalize"
    r"|stable_baselines3\.common\.running_mean_std:RunningMeanStd"
    r"|sb3_contrib\.(qrdqn|common\.maskable)\.policies:\w+"
    r"|numpy:(dtype|ndarray)|numpy\.random\._pcg64:PCG64|collections:OrderedDict"
    r"|numpy\.random\.bit_generator:SeedSequence"
)
FUNCTIONS = re.compile(
    r"numpy\.(_core|core)\.(multiarray:(_reconstruct|scalar)|numeric:_frombuffer)"
    r"|numpy\.random\._pickle:(__generator_ctor|__bit_generator_ctor)"
    r"|numpy\.random\.bit_generator:__pyx_unpickle_SeedSequence"
)
"""What a pickle may name, as ``module:name``: these classes, and these functions of numpy."""


class Foreign(pickle.UnpicklingError):
    """A pickle names something that no agent of these libraries needs."""


class Unpickler(pickle.Unpickler):
    """Unpickles the classes and functions that an agent consists of, and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """Return the class or function of this name; raise Foreign if it is not a known one."""
        word = f"{module}:{name}"
        if CLASSES.fullmatch(word) or FUNCTIONS.fullmatch(word):
            found = getattr(importlib.import_module(module), name)
            if isinstance(found, type) or FUNCTIONS.fullmatch(word):
                return found
        raise Foreign(f"it needs {module}.{name}")


def is_pickled(value: object) -> bool:
    return isinstance(value, dict) and ":serialized:" in value


def part_of_agent(data: Mapping[str, Any], name: str, loads: Callable[[bytes], Any]) -> Any:
    """Return a part of an agent, unpickled by ``loads`` if it is pickled."""
    value = data[name]
    return loads(base64.b64decode(value[":serialized:"])) if is_pickled(value) else value


def unpickled(pickled: bytes) -> Any:
    return Unpickler(io.BytesIO(pickled)).load()
