"""Time per sample of the recursive estimators, against the same loops in C and against padasip.

    python -m benchmarks.recursions

Needs a C compiler called `cc`, and padasip (`pip install vsalog[benchmark]`). Exits with 1 where a target is missed.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit

from benchmarks.measure import Time, compiler, machine, side_by_side
from vsalog.estimators.equation import EquationRows
from vsalog.estimators.folding import BLOCK
from vsalog.estimators.qr import QrState, qr_solve, qr_update
from vsalog.estimators.rls import RlsState
from vsalog.estimators.solvers import QrSolver, RlsSolver

SAMPLES = 100_000
PADASIP_SAMPLES = 2_000
ROUNDS = 15
P0 = 1e6
FLAGS = ("-O3", "-march=native", "-fPIC", "-shared")

SLOWER_THAN_C = 2.0
FASTER_THAN_PADASIP = 100.0


@njit
def drive_rls(F, y, c, alpha, P):
    last = F.shape[0] - 1
    g, scratch = P @ F[0], np.empty_like(alpha)
    for k in range(F.shape[0]):
        rls_update(F[k], y[k], c, alpha, P, g, F[min(k + 1, last)], scratch)


@njit
def drive_qr(F, y, forgetting, Rp, row, xi):
    for k in range(F.shape[0]):
        qr_update(F[k], y[k], forgetting, Rp, row)
        qr_solve(Rp, xi)


def drive_solver(solver: RlsSolver | QrSolver, F, y, E, spread) -> None:
    """Go through all samples as `vsalog estimate` does: with functionals, variances and noise, block by block."""
    state = solver.start(F.shape[1])
    for k in range(0, SAMPLES, BLOCK):
        part = slice(k, k + BLOCK)
        use = np.ones(len(y[part]), dtype=bool)
        state, *_ = solver.block(state, EquationRows(F[part], y[part], use, ~use, {}, {}), use, E[part], spread)


def c_library(folder: str) -> ctypes.CDLL:
    """Compile the recursions in C."""
    target = Path(folder) / "recursions.so"
    subprocess.run(["cc", *FLAGS, "-o", target, Path(__file__).with_name("recursions.c"), "-lm"], check=True)
    library = ctypes.CDLL(str(target))
    array = np.ctypeslib.ndpointer(np.float64, flags="C")
    for function in (library.rls_run, library.qr_run):
        function.argtypes = [ctypes.c_ssize_t] * 2 + [array] * 2 + [ctypes.c_double] + [array] * 3
        function.restype = None
    return library


def problem(n: int):
    """Regressors and what they add up to, with noise."""
    rng = np.random.default_rng(n)
    F = rng.normal(size=(SAMPLES, n))
    return F, F @ rng.normal(size=n) + 0.1 * rng.normal(size=SAMPLES)


def functionals(n: int, count: int, spread: tuple[int, ...]):
    """What `vsalog estimate` asks for after each sample: values, and the variance of some of them."""
    E = np.random.default_rng(0).normal(size=(SAMPLES, count, n))
    return E, np.isin(np.arange(count), spread)


def rls(library: ctypes.CDLL, n: int, c: float) -> dict[str, Time]:
    F, y = problem(n)
    E, spread = functionals(n, 5, (1, 4))
    solver = RlsSolver(P0, c)
    ours, theirs, g = RlsState.start(n, P0), RlsState.start(n, P0), np.empty(n)

    def restarted(state: RlsState) -> RlsState:
        state.alpha[:], state.P[:] = 0.0, np.eye(n) * P0
        return state

    def in_python() -> None:
        restarted(ours)
        drive_rls(F, y, c, ours.alpha, ours.P)

    def in_c() -> None:
        restarted(theirs)
        library.rls_run(SAMPLES, n, F, y, c, theirs.alpha, theirs.P, g)

    def whole_block() -> None:
        drive_solver(solver, F, y, E, spread)

    times = side_by_side({"C": in_c, "vsalog": in_python, "block": whole_block} | padasip(F, y, n), ROUNDS)
    np.testing.assert_allclose(ours.alpha, theirs.alpha, rtol=1e-6)
    fewer = per_sample(times, PADASIP_SAMPLES)
    return per_sample(times, SAMPLES) | {name: fewer[name] for name in ("padasip",) if name in fewer}


def padasip(F, y, n: int) -> dict[str, Callable[[], None]]:
    try:
        from padasip.filters import FilterRLS
    except ImportError:
        print("padasip is not installed: no comparison with it", file=sys.stderr)
        return {}

    def adapt() -> None:
        # eps = 1/p0 and mu = 1 make it the same recursion with c = 1.
        filter_ = FilterRLS(n, mu=1.0, eps=1.0 / P0, w="zeros")
        for k in range(PADASIP_SAMPLES):
            filter_.adapt(y[k], F[k])

    return {"padasip": adapt}


def qr(library: ctypes.CDLL, n: int, forgetting: float) -> dict[str, Time]:
    F, y = problem(n)
    E, spread = functionals(n, 8, (1, 4, 6, 7))
    E[:, :5, :3] = 0.0  # stiffness does not depend on the leading three: constant, inertia, damping
    solver = QrSolver(forgetting, 3, P0)
    ours, theirs = QrState.start(n, 0, P0), QrState.start(n, 0, P0)
    row, xi, xi_c = np.empty(n + 1), np.empty(n), np.empty(n)
    begin = ours.Rp.copy()

    def in_python() -> None:
        ours.Rp[:] = begin
        drive_qr(F, y, forgetting, ours.Rp, row, xi)

    def in_c() -> None:
        theirs.Rp[:] = begin
        library.qr_run(SAMPLES, n, F, y, forgetting, theirs.Rp, row, xi_c)

    def whole_block() -> None:
        drive_solver(solver, F, y, E, spread)

    times = side_by_side({"C": in_c, "vsalog": in_python, "block": whole_block}, ROUNDS)
    np.testing.assert_allclose(xi, xi_c, rtol=1e-9)
    return per_sample(times, SAMPLES)


def per_sample(times: dict[str, Time], count: int) -> dict[str, Time]:
    return {name: Time(t.least / count, t.median / count) for name, t in times.items()}


def report(name: str, times: dict[str, Time]) -> bool:
    """Print one line; tell whether the targets are met."""
    to_c = times["vsalog"].median / times["C"].median
    met = to_c <= SLOWER_THAN_C
    cells = [f"{1e6 * t.least:7.3f} {1e6 * t.median:7.3f}" for t in (times["C"], times["vsalog"], times["block"])]
    line = f"{name:32}" + " |".join(cells) + f" | {to_c:5.2f}"
    if "padasip" in times:
        faster = times["padasip"].median / times["vsalog"].median
        met &= faster >= FASTER_THAN_PADASIP
        in_c = times["padasip"].median / times["C"].median
        line += f" | {1e6 * times['padasip'].median:7.2f} | {faster:6.0f} | {in_c:4.0f}"
    print(line + ("" if met else "   TARGET MISSED"))
    return met


def main() -> int:
    print(machine("vsalog", "numba", "llvmlite", "numpy", "padasip"))
    print(f"{compiler()}: cc {' '.join(FLAGS[:2])}")
    print(f"µs per sample, least and median of {ROUNDS} rounds of {SAMPLES} samples\n")
    print(
        f"{'':32}{'C':>15} |{'vsalog, same':>15} |{'block':>15} | {'to C':>5} | {'padasip':>7} | {'faster':>6} | {'C is':>4}"
        f"\n{'':32}{'least   median':>15} |{'least   median':>15} |{'least   median':>15} |"
    )
    with tempfile.TemporaryDirectory() as folder:
        library = c_library(folder)
        runs: list[tuple[str, Callable[[], dict[str, Time]]]] = [
            ("enhanced RLS, 4 unknowns", lambda: rls(library, 4, 1.0)),
            ("enhanced RLS, 18 unknowns", lambda: rls(library, 18, 1.0)),
            ("QR-RLS and solution, 9 unknowns", lambda: qr(library, 9, 1.0)),
            ("  the same, forgetting 0.999", lambda: qr(library, 9, 0.999)),
        ]
        met = [report(name, run()) for name, run in runs]
    print(
        f"\ntargets: at most {SLOWER_THAN_C:g} times C, at least {FASTER_THAN_PADASIP:g} times as fast as padasip:"
        f" {'met' if all(met) else 'MISSED'}"
    )
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
