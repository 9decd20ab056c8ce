"""How loops over samples are compiled: one decorator, so that all have the same rules of arithmetic and compile as fast.

Division by zero gives infinity or NaN, as in NumPy. What no loop here needs costs a third of the time to compile: a wrapper for
calls from C, and rewriting of array expressions, which are better written as loops.
"""

from __future__ import annotations

from numba import njit

compiled = njit(cache=True, error_model="numpy", nogil=True, no_cfunc_wrapper=True, no_rewrites=True)

# For what only compiled functions call.
inlined = njit(error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, no_rewrites=True)
