"""Compilation of loops over samples: one decorator, so that all have the same arithmetic and compile fast.

Division by zero gives infinity or NaN, as in NumPy. Unneeded steps would add a third to the compile time: a wrapper for
calls from C, and rewriting of array expressions, which are better written as loops.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])
_LEAN: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_rewrites": True}


def compiled(function: F) -> F:
    """Compile a function that Python calls."""
    loop: F = njit(cache=True, nogil=True, **_LEAN)(function)
    return loop


def inlined(function: F) -> F:
    """Inline a function into its callers; Python cannot call it."""
    loop: F = njit(forceinline=True, **{"no_cpython_wrapper": True, **_LEAN})(function)
    return loop
