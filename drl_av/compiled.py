"""Functions that numba compiles at their first call (ours).

``compiled`` marks such a function. It may call any other function of this package by its name,
which numba then compiles too. An equation can thus be a plain function, which takes the settings of
a ``Config`` in Python, and a named tuple of the same numbers (``numbers``) in a compiled function.

Nothing imports numba before the first call. The machine code is cached beside the module, or in the
user's cache folder where the module's folder is read-only. With the environment variable
``NUMBA_DISABLE_JIT=1`` the functions run as plain Python, with the same results to the bit.
"""

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache, cached_property, update_wrapper
from pathlib import Path
from types import FunctionType
from typing import Any, Generic, ParamSpec, TypeVar, get_args

from drl_av.errors import DrlAvError, warn

P = ParamSpec("P")
R = TypeVar("R")
NUMBERS = frozenset((float, int, bool, None))
NOTICE = (
    "drl-av compiles functions that are used for the first time on this machine, for a minute "
    "or two, and keeps them."
)


class Compiled(Generic[P, R]):
    """A function that numba compiles at its first call, without fastmath and without the GIL.

    It takes numbers, contiguous arrays, and plain or named tuples of these. Division by zero gives
    inf or nan, as in numpy.
    """

    def __init__(
        self, function: Callable[P, R], counts: bool = True, is_inlined: bool = False
    ) -> None:
        update_wrapper(self, function)
        self.python = function
        """The function as plain Python."""
        self.options = {"_nrt": counts, "forceinline": is_inlined}

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        return self.dispatcher(*args, **kwargs)

    @cached_property
    def dispatcher(self) -> Callable[P, R]:
        """The function as numba has compiled it; the plain function without compilation."""
        numba = _numba()
        options = {"cache": True, "nogil": True, "error_model": "numpy"}
        try:
            dispatcher: Any = numba.njit(**options, **self.options)(self.python)
        except RuntimeError as error:  # numba finds no folder for its cache
            raise DrlAvError(
                f"Compiled functions can be kept neither in {Path(__file__).parent} nor in your "
                "cache folder: let the environment variable NUMBA_CACHE_DIR name a folder in which "
                "you may write."
            ) from error
        if dispatcher is not self.python:
            _depends_on(dispatcher, _sources(self, set()))
        result: Callable[P, R] = dispatcher
        return result

    @cached_property
    def fast(self) -> Callable[..., R]:
        """The function without a look at the types of its arguments, a third of a short call.

        The first call fixes the types. All later calls must have the same: numbers are converted,
        but a strided array would be read as if it were contiguous (``Snapshot.arrays``).
        """

        def first(*args: Any) -> R:
            dispatcher: Any = self.dispatcher
            if hasattr(dispatcher, "compile"):
                self.__dict__["fast"] = dispatcher.compile(tuple(map(_numba().typeof, args)))
            else:  # compilation is switched off
                self.__dict__["fast"] = self.python
            return self.fast(*args)

        return first


def compiled(function: Callable[P, R]) -> Compiled[P, R]:
    """Return the function, which numba compiles at its first call."""
    return Compiled(function)


def borrowing(function: Callable[P, R]) -> Compiled[P, R]:
    """Return the function as ``compiled`` does, without counting references to arrays.

    The function must not make an array, nor return a view of one. Counting takes half of the time
    of a short function with a tuple of arrays.
    """
    return Compiled(function, counts=False)


def inlined(function: Callable[P, R]) -> Compiled[P, R]:
    """Return the function as ``borrowing`` does, for a copy of its code in each compiled caller.

    A call that passes a tuple of arrays takes as long as the arithmetic of a short function.
    """
    return Compiled(function, counts=False, is_inlined=True)


@cache
def _plain(function: Callable[P, R]) -> Compiled[P, R]:
    """Return a function without a decorator as its compiled callers call it.

    It counts references to arrays, as ``compiled`` does, unless it returns numbers only.
    """
    returned = function.__annotations__["return"]
    counts = not NUMBERS.issuperset(get_args(returned) or (returned,))
    return Compiled(function, counts, is_inlined=True)


def squared(x: float) -> float:
    """Return x to the power 2 as Python computes it, for a finite number.

    LLVM replaces the power by x * x, which differs in the last bit once in a thousand times. It
    does not know that this exponent is always 2.
    """
    square: float = x ** (2.0 + 0.0 * x)
    return square


@cache
def _numba() -> Any:
    """Import numba and tell it how compiled functions call each other."""
    import numba
    from numba.core import event, types
    from numba.extending import typeof_impl

    @typeof_impl.register(Compiled)
    def _(value: Compiled[..., Any], context: Any) -> Any:
        return types.Dispatcher(value.dispatcher)

    @typeof_impl.register(FunctionType)
    def _(value: Any, context: Any) -> Any:
        return types.Dispatcher(_plain(value).dispatcher) if _is_ours(value) else None

    class Notice(event.Listener):
        """Says in one line on stderr that a function of ours is compiled, once in a process."""

        said = False

        def on_start(self, event: Any) -> None:
            if not self.said and _is_ours(event.data["dispatcher"].py_func):
                self.said = True
                print(NOTICE, file=sys.stderr)

        def on_end(self, event: Any) -> None:
            return None

    event.register("numba:compile", Notice())  # type: ignore[no-untyped-call]
    return numba


def _is_ours(function: Any) -> bool:
    return str(function.__module__).split(".")[0] == __package__


def _sources(function: Compiled[..., Any], known: set[int]) -> list[tuple[str, Any]]:
    """Return the code and the constants that a function and the functions it calls consist of."""
    if id(function) in known:
        return []
    known.add(id(function))
    code, names = function.python.__code__, function.python.__globals__
    found: list[tuple[str, Any]] = [
        (code.co_name, (code.co_code, code.co_consts, function.options))
    ]
    for name in code.co_names:
        value = names.get(name)
        if isinstance(value, FunctionType) and _is_ours(value):
            value = _plain(value)
        if isinstance(value, Compiled):
            found += _sources(value, known)
        elif isinstance(value, int | float | str | tuple):
            found.append((name, value))
    return found


def _depends_on(dispatcher: Any, sources: list[tuple[str, Any]]) -> None:
    """Make the cached code of a function invalid when a function that it calls has changed.

    Numba itself compares only the file of the function. It also fails where the cache is damaged,
    names a class that has moved, or cannot be written; then the function is compiled again.
    """
    from numba.core import caching

    base: Any = caching.IndexDataCacheFile
    kept: Any = dispatcher._cache

    class CacheFile(base):  # type: ignore[misc]
        def load(self, key: Any) -> Any:
            with suppress(Exception):
                return super().load(key)
            return None

        def save(self, key: Any, data: Any) -> None:
            try:
                super().save(key, data)
            except OSError as error:
                warn(
                    f"Compiled functions cannot be kept in {kept._cache_path} ({error.strerror}), "
                    "so each process compiles them anew: let the environment variable "
                    "NUMBA_CACHE_DIR name another folder."
                )

        def _load_index(self) -> Any:
            with suppress(Exception):
                return super()._load_index()
            return {}

    kept._cache_file = CacheFile(kept._cache_path, kept._impl.filename_base, repr(sources))
