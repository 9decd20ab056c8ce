"""CPU time per sample of the recursive estimators and the smoother, next to hand-tuned C of the recursion alone, and padasip.

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
from typing import Any

import numpy as np

from benchmarks.measure import Time, compiler, machine, side_by_side
from vsalog.estimators.equation import EquationRows
from vsalog.estimators.folding import BLOCK
from vsalog.estimators.qr import QrState, qr_block
from vsalog.estimators.rls import RlsState, rls_block
from vsalog.estimators.solvers import QrSolver, RlsSolver
from vsalog.filters.square_root_smoother import Smoothed, smooth
from vsalog.uncertainty.errors_in_variables import DeflectionNoise, RegressorNoise

SAMPLES = 100_000
PADASIP_SAMPLES = 2_000
INSTANTS = 10_000
ROUNDS = 15
P0 = 1e6
FLAGS = ("-O3", "-march=native", "-fPIC", "-shared")

SLOWER_THAN_C = 2.0
FASTER_THAN_PADASIP = 100.0


def blocks():
    """Yield the blocks that a log comes in."""
    for k in range(0, SAMPLES, BLOCK):
        yield slice(k, min(k + BLOCK, SAMPLES))


def drive_solver(solver: RlsSolver | QrSolver, F, y, E, spread) -> None:
    """Go through all samples as `vsalog estimate` does: recursion, functionals, noise and uncertainty, block by block."""
    state = solver.start(F.shape[1])
    noise = RegressorNoise((DeflectionNoise(1e-6, 1e-6),))
    for part in blocks():
        use = np.ones(len(y[part]), dtype=bool)
        state, *_ = solver.block(
            state, EquationRows(F[part], y[part], use, ~use, {}, {}, noise=noise), use, E[part], spread
        )


ARRAY = np.ctypeslib.ndpointer(np.float64, flags="C")
RECURSION = (ctypes.c_ssize_t, ARRAY, ARRAY, ctypes.c_double, ARRAY, ARRAY)


def c_function(folder: str, name: str, n: int, argument_types: tuple[Any, ...] = RECURSION) -> Callable[..., None]:
    """Compile a recursion in C, for so many unknowns."""
    target = Path(folder) / f"{name}{n}.so"
    source = Path(__file__).with_name("recursions.c")
    subprocess.run(["cc", *FLAGS, f"-DN={n}", "-o", target, source, "-lm"], check=True)
    function = getattr(ctypes.CDLL(str(target)), name)
    function.argtypes = argument_types
    function.restype = None
    return function


def problem(n: int):
    """Regressors and what they add up to, with noise."""
    rng = np.random.default_rng(n)
    F = rng.normal(size=(SAMPLES, n))
    return F, F @ rng.normal(size=n) + 0.1 * rng.normal(size=SAMPLES)


def functionals(n: int, count: int, spread: tuple[int, ...]):
    """What `vsalog estimate` asks for after each sample: values, and the variance of some of them."""
    E = np.random.default_rng(0).normal(size=(SAMPLES, count, n))
    return E, np.isin(np.arange(count), spread)


def rls(folder: str, n: int, c: float) -> dict[str, Time]:
    F, y = problem(n)
    E, spread = functionals(n, 4, (1,))  # of a transmission: torque, stiffness and its two derivatives
    solver, in_c = RlsSolver(P0, c), c_function(folder, "rls_run", n)
    none, theirs = np.empty((SAMPLES, 0, n)), RlsState.start(n, P0)
    ours = theirs.copy()

    def hand_tuned() -> None:
        theirs.alpha[:], theirs.P[:] = 0.0, np.eye(n) * P0
        in_c(SAMPLES, F, y, c, theirs.alpha, theirs.P)

    def recursion() -> None:
        nonlocal ours
        ours = RlsState.start(n, P0)
        for part in blocks():
            use = np.ones(len(y[part]), dtype=bool)
            ours, *_ = rls_block(ours, F[part], y[part], use, none[part], np.empty(0, dtype=bool), c, P0)

    def step() -> None:
        drive_solver(solver, F, y, E, spread)

    times = side_by_side({"C": hand_tuned, "recursion": recursion, "step": step} | padasip(F, y, n), ROUNDS)
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


def qr(folder: str, n: int, forgetting: float) -> dict[str, Time]:
    F, y = problem(n)
    E, spread = functionals(n, 7, (1, 5, 6))  # also the motor's torque, inertia and damping
    E[:, :4, :3] = 0.0  # stiffness does not depend on the leading three: constant, inertia, damping
    solver, in_c = QrSolver(forgetting, 3, P0, integral=True), c_function(folder, "qr_run", n)
    theirs, xi = QrState.start(n, 0, P0), np.empty(n)
    none, ours, begin = np.empty((SAMPLES, 0, n)), theirs, theirs.Rp.copy()

    def hand_tuned() -> None:
        theirs.Rp[:] = begin
        in_c(SAMPLES, F, y, forgetting, theirs.Rp, xi)

    def recursion() -> None:
        nonlocal ours
        ours = QrState.start(n, 0, P0)
        for part in blocks():
            use = np.ones(len(y[part]), dtype=bool)
            ours, *_ = qr_block(
                ours, F[part], y[part], use, ~use, none[part], np.empty(0, dtype=bool), forgetting, 0, P0
            )

    def step() -> None:
        drive_solver(solver, F, y, E, spread)

    times = side_by_side({"C": hand_tuned, "recursion": recursion, "step": step}, ROUNDS)
    np.testing.assert_allclose(ours.solve(), xi, rtol=1e-9)
    return per_sample(times, SAMPLES)


def smoother(folder: str, n: int) -> dict[str, Time]:
    """Filter and smooth a random walk; an instant has a triangle of rows, as an interval of a log has."""
    rng = np.random.default_rng(n)
    rows = np.triu(rng.normal(size=(INSTANTS, n + 1, n + 1)))
    steps = 1e-3 * rng.normal(size=(INSTANTS - 1, 1, n))
    in_c = c_function(folder, "smoother_run", n, (ctypes.c_ssize_t, *(ARRAY,) * 7))
    mean, root = np.empty((INSTANTS, n)), np.empty((INSTANTS, n, n))
    theirs = Smoothed(mean.copy(), root.copy(), mean, root, np.empty_like(root), 0.0)
    ours = smooth(rows, steps, np.zeros(n), np.eye(n))

    def hand_tuned() -> None:
        in_c(INSTANTS, rows, steps, mean, root, theirs.before, theirs.mean, theirs.root)

    def recursion() -> None:
        nonlocal ours
        ours = smooth(rows, steps, np.zeros(n), np.eye(n))

    times = side_by_side({"C": hand_tuned, "recursion": recursion}, ROUNDS)
    np.testing.assert_allclose(ours.mean, theirs.mean, rtol=1e-6, atol=1e-9)
    found = per_sample(times, INSTANTS)
    return found | {"step": found["recursion"]}


def per_sample(times: dict[str, Time], count: int) -> dict[str, Time]:
    return {name: Time(t.least / count, t.median / count) for name, t in times.items()}


def report(name: str, times: dict[str, Time]) -> bool:
    """Print one line; tell whether the targets are met."""
    to_c = [times[part].least / times["C"].least for part in ("recursion", "step")]
    met = to_c[1] <= SLOWER_THAN_C
    cells = [f"{1e6 * t.least:7.3f} {1e6 * t.median:7.3f}" for t in (times["C"], times["recursion"], times["step"])]
    line = f"{name:32}" + " |".join(cells) + " |" + "".join(f"{x:6.2f}" for x in to_c)
    if "padasip" in times:
        faster = times["padasip"].least / times["recursion"].least
        met &= faster >= FASTER_THAN_PADASIP
        in_c = times["padasip"].least / times["C"].least
        line += f" | {1e6 * times['padasip'].least:7.2f} | {faster:6.0f} | {in_c:4.0f}"
    print(line + ("" if met else "   TARGET MISSED"))
    return met


def main() -> int:
    print(machine("vsalog", "numba", "llvmlite", "numpy", "padasip"))
    print(f"{compiler()}: cc {' '.join(FLAGS[:2])}")
    print(
        f"µs of CPU time (user and system) per sample, least and median of {ROUNDS} rounds of {SAMPLES} samples;"
        f" of the smoother per instant, of {INSTANTS}\n"
    )
    print(
        f"{'':32}{'C, by hand':>15} |{'recursion':>15} |{'estimate':>15} | {'each to C':>10} | {'padasip':>7} | {'faster':>6} |"
        f" {'C is':>4}\n{'':32}{'least   median':>15} |{'least   median':>15} |{'least   median':>15} |"
    )
    with tempfile.TemporaryDirectory() as folder:
        runs: list[tuple[str, Callable[[], dict[str, Time]]]] = [
            ("enhanced RLS, 4 unknowns", lambda: rls(folder, 4, 1.0)),
            ("enhanced RLS, 18 unknowns", lambda: rls(folder, 18, 1.0)),
            ("QR-RLS and solution, 9 unknowns", lambda: qr(folder, 9, 1.0)),
            ("  the same, forgetting 0.999", lambda: qr(folder, 9, 0.999)),
            ("square-root smoother, 4 states", lambda: smoother(folder, 4)),
            ("square-root smoother, 18 states", lambda: smoother(folder, 18)),
        ]
        met = [report(name, run()) for name, run in runs]
    print(
        f"\ntargets: the step of an estimate at most {SLOWER_THAN_C:g} times C, the recursion at least"
        f" {FASTER_THAN_PADASIP:g} times as fast as padasip: {'met' if all(met) else 'MISSED'}"
    )
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
