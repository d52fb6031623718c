"""The one decorator of compiled functions: compiled at the first call, then read from a cache."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return ``function`` compiled by numba; with NUMBA_DISABLE_JIT=1 it remains plain Python.

    The machine code is kept beside the module, or in the user's cache folder if the installation
    is read-only. Division by zero gives inf or nan, as in numpy and in SUMO.
    """
    made: Function = numba.njit(cache=True, error_model="numpy", nogil=True)(function)
    return made


def parallel(function: Function) -> Function:
    """Return ``function`` compiled so that ``numba.prange`` divides its loop over threads."""
    made: Function = numba.njit(cache=True, error_model="numpy", nogil=True, parallel=True)(function)
    return made
