"""Loads agents of stable-baselines3 and sb3-contrib from zip files; as a rule no code in them runs.

These libraries pickle a part of an agent, and a pickle can run any code. This module unpickles only
the classes of these libraries, torch, numpy and gymnasium that an agent consists of.
"""

import importlib
import json
import pickle
import re
import zipfile
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from drl_av.arrays import Float32Array
from drl_av.config import Config
from drl_av.drivers.checked import PolicyDriver
from drl_av.drivers.driver import Driver
from drl_av.drivers.safe_pickle import Foreign, is_pickled, part_of_agent, unpickled
from drl_av.driving.actions import ACTIONS, Action, action_of
from drl_av.driving.affordances import INDICATORS, ROUTE_INDICATORS, observed_indicators
from drl_av.driving.observation_scale import indicator_bounds
from drl_av.driving.scene import Scene
from drl_av.driving.wide_observation import WIDE_SIZE
from drl_av.errors import CheckpointError, needed_by, warn
from drl_av.safety import action_mask
from drl_av.safety.check import SafetyCheck

MAX_UNPACKED = 500_000_000
"""The largest size, bytes, of all parts of a zip file together, and of the parts of one of them."""
UNPICKLED = (
    "A stable-baselines3 zip file holds pickles: drl-av runs no code in them, except for agents "
    "with classes of their own, before which it warns. Load only files that you trust."
)
"""What every verb that can load such a file says in its help."""
_ON_POLICY = "stable_baselines3.common.policies"
_LIBRARIES = {
    _ON_POLICY: "stable_baselines3",
    "stable_baselines3.dqn.policies": "stable_baselines3",
    "sb3_contrib.qrdqn.policies": "sb3_contrib",
    "sb3_contrib.common.maskable.policies": "sb3_contrib",
}
"""The library of an agent, by the module of the policy class in its zip file."""
INDICATOR_SHAPES = {(len(INDICATORS),), (len(INDICATORS + ROUTE_INDICATORS),)}
"""Those of the indicators, without ``observation.way`` and with it."""
_NOT_NEGATIVE = [row for row, name in enumerate(INDICATORS) if name.endswith("_d_x")]
"""The gaps in an observation."""


class MaskedAgent(Driver):
    """An agent of MaskablePPO: it chooses among the actions that ``check`` permits.

    ``choose`` returns the number of the most probable action for an observation and a mask.
    """

    def __init__(self, choose: Callable[..., Any], check: SafetyCheck) -> None:
        self._choose, self._check = choose, check

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return the agent's most probable action under the mask of the scene."""
        mask = action_mask(self._check, scene)
        return action_of(self._choose(observation, action_masks=mask))


def driver_of_agent(
    path: Path, config: Config, own: Any | None, check: Callable[[], SafetyCheck]
) -> Driver:
    """Load an agent that stable-baselines3 or sb3-contrib saved; the driver acts deterministically.

    If its training normalized observations with VecNormalize, the statistics are read from
    ``vecnormalize.pkl`` beside the file. A DrlAvWarning comes before any code of the file runs.

    Args:
        path: The zip file.
        config: The settings of the environment.
        own: The space of the environment's observations if they are the user's own, else None.
        check: Returns the safety check of the environment, of which MaskablePPO gets the mask.

    Raises:
        CheckpointError: the file holds no such agent or is too large, its library is not installed,
            or the agent was trained with other observations or actions.
    """
    data = _data(path)
    module = _policy_module(path, data)
    library = _library(path, _LIBRARIES[module])
    observes, acts = (_safe(path, data, name) for name in ("observation_space", "action_space"))
    _require_spaces(path, observes, acts, config, own)
    normalize = _normalization(path, data, observes, own)
    policy_class, kwargs = _own_parts(path, data)
    _require_size(path, kwargs, int(np.prod(observes.shape or ())))
    try:
        stored = {name: None for name, value in data.items() if is_pickled(value)}
        _, tensors, _ = library.load_from_zip_file(path, custom_objects=stored, device="cpu")
        policy = policy_class(observes, acts, lambda progress: 0.0, **kwargs)
        policy.load_state_dict(tensors["policy"])
        policy.set_training_mode(False)
    except Exception as error:  # of torch, of the library, or of the file's own classes
        raise CheckpointError(
            f"{path} cannot be loaded as an agent ({_squeezed(error)}): save it again."
        ) from error

    def choose(seen: Any, **mask: Any) -> Any:
        given = seen if normalize is None else normalize(seen)
        return policy.predict(given, deterministic=True, **mask)[0]

    return MaskedAgent(choose, check()) if "maskable" in module else PolicyDriver(choose)


def _squeezed(error: Exception) -> str:
    return " ".join(str(error).split()).rstrip(".")[:200] or type(error).__name__


def _data(path: Path) -> dict[str, Any]:
    """Read the JSON description in an agent's zip file; raise CheckpointError if there is none."""
    try:
        with zipfile.ZipFile(path) as archive:
            _require_unpackable(archive)
            for name in archive.namelist():
                if name.endswith(".pth"):
                    with archive.open(name) as part:
                        if zipfile.is_zipfile(part):
                            _require_unpackable(zipfile.ZipFile(part))
            found = json.loads(archive.read("data"))
        return dict(found)
    except (OSError, zipfile.BadZipFile, LookupError, ValueError, TypeError, RuntimeError) as error:
        raise CheckpointError(
            f"{path} is no agent that stable-baselines3 saved ({_squeezed(error)}): give the file "
            "of its save method."
        ) from error


def _require_unpackable(archive: zipfile.ZipFile) -> None:
    """Raise ValueError if an archive is encrypted, or larger than ``MAX_UNPACKED`` if unpacked."""
    members = archive.infolist()
    if any(member.flag_bits & 1 for member in members):
        raise ValueError("it is encrypted")
    if sum(member.file_size for member in members) > MAX_UNPACKED:
        raise ValueError(f"it unpacks to more than {MAX_UNPACKED // 10**6} MB")


def _policy_module(path: Path, data: Mapping[str, Any]) -> str:
    """Return the module of an agent's policy class; raise CheckpointError if it is not known."""
    described = data.get("policy_class")
    module = described.get("__module__") if isinstance(described, dict) else None
    if module is None:
        raise CheckpointError(
            f"{path} is no agent that stable-baselines3 saved (it names no policy class): give the "
            "file of its save method."
        )
    if module not in _LIBRARIES:
        raise CheckpointError(
            f"{path} holds an agent with a policy of {module}, which is not known here: wrap it "
            "in a factory and give it as module:factory."
        )
    return str(module)


def _library(path: Path, library: str) -> Any:
    """Import an agent's library; return the module of stable-baselines3 that reads zip files."""
    package = library.replace("_", "-")
    with needed_by(path, package, package, CheckpointError):
        importlib.import_module(library)
        return importlib.import_module("stable_baselines3.common.save_util")


def _safe(path: Path, data: Mapping[str, Any], name: str) -> Any:
    """Return a part of an agent of known classes; raise CheckpointError if it has others."""
    try:
        return part_of_agent(data, name, unpickled)
    except Exception as error:  # a damaged pickle raises anything
        raise CheckpointError(
            f"{path} has no readable {name} ({_squeezed(error)}): save the agent again with the "
            "installed stable-baselines3."
        ) from error


def _own_parts(path: Path, data: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Return the class of the policy and its arguments; warn before code of the file can run."""
    names = ("policy_class", "policy_kwargs")
    try:
        policy_class, kwargs = (part_of_agent(data, name, unpickled) for name in names)
    except Foreign as foreign:
        warn(
            f"{path} is loaded by running code that it names ({foreign}): stop here with Ctrl-C "
            "unless you trust the file."
        )
        try:
            policy_class, kwargs = (part_of_agent(data, name, pickle.loads) for name in names)
        except Exception as error:  # the file's own code
            raise CheckpointError(
                f"{path} cannot be loaded ({_squeezed(error)}): put the module with its classes "
                "on PYTHONPATH, or save it again."
            ) from error
    except Exception as error:  # a damaged pickle raises anything
        raise CheckpointError(f"{path} is damaged ({_squeezed(error)}): save it again.") from error
    return policy_class, dict(kwargs or {})


def _require_spaces(path: Path, observes: Any, acts: Any, config: Config, own: Any | None) -> None:
    """Raise CheckpointError unless an agent has the environment's observations and actions."""
    observed = len(observed_indicators(config.observation))
    here = (observed,) if own is None else own.shape
    spaces = observes.shape, getattr(acts, "n", None)
    fits = spaces[0] == here if own is None else _is_alike(observes, own)
    if fits and spaces[1] == len(ACTIONS):
        if own is None and _has_other_bounds(observes, config):
            raise CheckpointError(
                f"{path} was trained on observations with other bounds: repeat the settings of "
                "[observation] or the groups of its training, or give a factory module:function "
                "that does what its wrapper did, such as RescaleObservation."
            )
        return
    remedy = "use PolicyDriver(policy, observe) in Python"
    frames, rest = divmod(int(np.prod(spaces[0] or ())), observed)
    if spaces == ((WIDE_SIZE,), len(ACTIONS)):
        remedy = "drive with --observation wide (observation=), as in its training"
    elif own is None and spaces[0] and frames > 1 and not rest:
        remedy = (
            f"these are {frames} stacked observations, so give a factory module:function whose "
            f"driver stacks the last {frames}"
        )
    elif spaces[1] == len(ACTIONS) and {spaces[0], here} == INDICATOR_SHAPES:
        remedy = f"set observation.way as in its training, or {remedy}"
    elif spaces[1] == len(ACTIONS):
        remedy = "name the observation of its training (evaluate --observation), if any"
    if own is not None and spaces[1] == len(ACTIONS):
        was, now = (" ".join(str(each).split())[:200] for each in (observes, own))
        raise CheckpointError(f"{path} was trained with {was}, but drives with {now}: {remedy}.")
    actions = "actions of another kind" if spaces[1] is None else f"{spaces[1]} actions"
    raise CheckpointError(
        f"{path} was trained with observations of shape {spaces[0] or 'of a dictionary'} and "
        f"{actions}, but drives with {here} and {len(ACTIONS)} here: {remedy}."
    )


def _has_other_bounds(observes: Any, config: Config) -> bool:
    """Whether the finite bounds of an agent's indicators are not those that the settings make.

    The bounds of lateral distances are not compared: they depend on the road.
    """
    bounds = np.ones(observes.shape, np.float32)
    bounds[:27] = indicator_bounds(config.observation, config.ego.max_speed_m_s)
    known = np.isfinite(bounds)
    equal = (np.allclose(end[known], bounds[known]) for end in (-observes.low, observes.high))
    return bool(np.isfinite(observes.high).all()) and not all(equal)


def _is_alike(observes: Any, here: Any) -> bool:
    """Whether an agent of one space can observe another; images may have their channels first.

    The bounds must be the same, too: a wrapper that rescales observations changes them alone.
    """
    from gymnasium.spaces import Box, Dict

    if isinstance(here, Dict):
        return (
            isinstance(observes, Dict)
            and {**observes}.keys() == {**here}.keys()
            and all(_is_alike(observes[key], here[key]) for key in here)
        )
    if isinstance(here, Box):
        if not isinstance(observes, Box):
            return False
        first = np.moveaxis(here.low, -1, 0), np.moveaxis(here.high, -1, 0)
        return any(
            observes.shape == low.shape
            and np.allclose(observes.low, low)
            and np.allclose(observes.high, high)
            for low, high in ((here.low, here.high), first)
        )
    return bool(observes == here)


def _require_size(path: Path, kwargs: Mapping[str, Any], inputs: int) -> None:
    """Raise CheckpointError if the policy asks for layers larger than ``MAX_UNPACKED``."""
    words = re.findall(r"\d+", repr(kwargs.get("net_arch")))
    sizes = [inputs, *map(int, words)]
    if any(4 * a * b > MAX_UNPACKED for a, b in pairwise(sizes)):
        raise CheckpointError(
            f"{path} asks for layers of {', '.join(words)} units, which need more than "
            f"{MAX_UNPACKED // 10**6} MB: give an agent with a smaller network."
        )


def _normalization(
    path: Path, data: Mapping[str, Any], observes: Any, own: Any | None
) -> Callable[[Any], Any] | None:
    """Return the normalization with which an agent was trained by VecNormalize, or None.

    Raises:
        CheckpointError: its statistics are missing or damaged, another wrapper has changed the
            observations of the training, or that cannot be told.
    """
    known = data.get("_last_original_obs") is not None
    by_library = known and "replay_buffer_class" not in data  # algorithms with one always know it
    beside = statistics_file(path)
    if own is not None and not _is_bounded(own):  # all values can be raw ones
        if beside and not by_library:
            raise CheckpointError(
                f"{path} does not tell whether it was trained with VecNormalize, whose statistics "
                f"are in {beside}: move them away if not, or give a factory module:function whose "
                "driver applies them."
            )
        return _vec_normalize(path, observes) if by_library else None
    if known and not by_library and not _are_raw(path, data, "_last_obs", observes, own):
        by_library = True
    last = "_last_original_obs" if by_library else "_last_obs"
    if not _are_raw(path, data, last, observes, own):
        raise CheckpointError(
            f"{path} was trained on observations outside the bounds of this environment, as "
            "gymnasium's NormalizeObservation makes them, and does not hold the statistics: give a "
            "factory module:function whose driver applies the same normalization."
        )
    if by_library:
        return _vec_normalize(path, observes)
    if beside:
        warn(
            f"{path} was not trained with VecNormalize, so it observes raw values; the statistics "
            f"in {beside} are not used."
        )
    return None


def _is_bounded(space: Any) -> bool:
    """Whether an observation is an array with finite bounds."""
    from gymnasium.spaces import Box

    return isinstance(space, Box) and bool(np.isfinite([space.low, space.high]).all())


def _are_raw(
    path: Path, data: Mapping[str, Any], name: str, observes: Any, own: Any | None
) -> bool:
    """Whether the last observations of a training can be ones of the environment.

    Normalized ones often lie within its bounds, but hardly ever without a negative gap.
    """
    if not _is_bounded(observes):
        return False
    seen = None if data.get(name) is None else np.asarray(_safe(path, data, name))
    if seen is None or seen.shape[-len(observes.shape) :] != observes.shape:
        return True
    low = observes.low - 1e-4
    if own is None:
        low[_NOT_NEGATIVE] = -1e-4
    return bool(((seen >= low) & (seen <= observes.high + 1e-4)).all())


def statistics_file(path: Path) -> Path | None:
    """Return the file with the statistics of VecNormalize beside an agent's file, or None."""
    steps = re.fullmatch(r"(.+)_(\d+_steps)", path.stem)  # of a CheckpointCallback
    named = [path.with_name(f"{steps[1]}_vecnormalize_{steps[2]}.pkl")] if steps else []
    places = [*named, path.with_name("vecnormalize.pkl"), path.with_suffix("") / "vecnormalize.pkl"]
    return next((place for place in places if place.is_file()), None)


def _vec_normalize(path: Path, observes: Any) -> Callable[[Any], Any]:
    """Read the statistics of VecNormalize beside an agent's file; return the normalization."""
    from gymnasium.spaces import Dict

    file = statistics_file(path)
    if file is None:
        raise CheckpointError(
            f"{path} was trained with VecNormalize, whose statistics are not in it: put them "
            f"beside it as {path.with_name('vecnormalize.pkl')}, by env.save('vecnormalize.pkl')."
        )
    try:
        if file.stat().st_size > MAX_UNPACKED:
            raise ValueError(f"it is larger than {MAX_UNPACKED // 10**6} MB")
        found = unpickled(file.read_bytes())
        normalize: Callable[[Any], Any] = found.normalize_obs
        made = normalize(observes.sample())
        parts = {**made} if isinstance(observes, Dict) else {"": made}
        spaces = {**observes} if isinstance(observes, Dict) else {"": observes}
        if any(part.shape != spaces[name].shape for name, part in parts.items()):
            raise ValueError(f"it normalizes observations of another shape than {observes}")
        if not all(np.isfinite(part).all() for part in parts.values()):
            raise ValueError("it makes numbers that are not finite")
    except Exception as error:  # a damaged or foreign pickle raises anything
        raise CheckpointError(
            f"{file} holds no statistics of VecNormalize for {path.name} ({_squeezed(error)}): "
            "save them again by env.save('vecnormalize.pkl')."
        ) from error
    return normalize
