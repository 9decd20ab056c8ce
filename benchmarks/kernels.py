"""Time per sample of the filters and the other compiled loops.

python -m benchmarks.kernels
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.measure import machine, side_by_side
from vsalog.core.basis import PolynomialBasis
from vsalog.estimators.torque import integral_block, lag_block, residual_block
from vsalog.filters.kinematic import KinematicSettings, kinematic_filter
from vsalog.filters.savitzky_golay import savgol_filter, savgol_weights

SAMPLES = 20_000
PERIOD = 1e-3


def main() -> int:
    rng = np.random.default_rng(0)
    x = np.sin(np.arange(SAMPLES) * PERIOD) + 1e-3 * rng.normal(size=SAMPLES)
    y = 0.1 * rng.normal(size=SAMPLES)
    columns, use = rng.normal(size=(SAMPLES, 9)), np.ones(SAMPLES, dtype=bool)
    settings = KinematicSettings.for_resolution(2.0 * np.pi / 4096, PERIOD)
    weights = savgol_weights(1001, 20, 2, PERIOD)
    odd, with_setpoint = PolynomialBasis.make(4), PolynomialBasis.make(3, setpoint_order=6)
    calls = {
        "kinematic Kalman filter": lambda: kinematic_filter(x, PERIOD, settings),
        "Savitzky-Golay, window 1001, value": lambda: savgol_filter(x, weights[:1]),
        "Savitzky-Golay, window 1001, value, 1st and 2nd": lambda: savgol_filter(x, weights),
        "residual": lambda: residual_block(np.full(3, np.nan), x, y, y, use, 0.1, 0.1, 300.0, PERIOD),
        "lag of 9 columns": lambda: lag_block(np.full((2, 9), np.nan), columns, use, 300.0, PERIOD),
        "integrals of 9 columns": lambda: integral_block(np.full((2, 9), np.nan), columns, use, PERIOD),
        "basis of 4, with 3 derivatives": lambda: odd.rows(x),
        "basis of 18, with 3 derivatives": lambda: with_setpoint.rows(x, y),
    }
    times = side_by_side(calls, 9)
    print(machine("vsalog", "numba", "numpy"))
    print(f"\nµs per sample{'':39}{'least':>7} {'median':>7}")
    for name, t in times.items():
        print(f"{name:52}{1e6 * t.least / SAMPLES:7.3f} {1e6 * t.median / SAMPLES:7.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
