"""The one decorator of compiled functions: compiled at the first call, then read from a cache."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return ``function`` compiled by numba; with NUMBA_DISABLE_JIT=1 it remains plain Python.

    Division by zero gives inf or nan, as in numpy and in SUMO.
    """
    made: Function = numba.njit(error_model="numpy", nogil=True)(function)
    return made
