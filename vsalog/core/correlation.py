"""The effective number of independent samples of a correlated signal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from vsalog.core.resolution import spread_over

Array = NDArray[np.float64]

CORRELATION_TIMES = 4.0
"""Correlation times [1] after which a signal counts as independent: the correlation is e⁻⁴, less than 2 %."""


def effective_samples(e: Array) -> float:
    """Return the effective number of independent samples of an error signal: N over twice its correlation time.

    The correlation time is summed up to the first pair of autocorrelations whose sum is not positive (Geyer 1992), of e² where
    that is longer than of e.
    """
    n = e.size
    some = spread_over(e)
    time = max(correlation_time(x - x.mean()) for x in (some, some**2))
    return float(np.clip(some.size / time if some.size < n else n / time, 1.0, n))


def correlation_time(x: Array) -> float:
    """Return how many samples of a signal that should be zero, shape (N,), count as one: 1 + 2 Σ ρ_k."""
    power = float(x @ x)
    if power <= 0.0:
        return 1.0
    size = fft.next_fast_len(x.size + x.size // 2, real=True)  # wide enough for lags up to half the length
    spectrum = np.abs(fft.rfft(x, size)) ** 2
    rho = fft.irfft(spectrum, size)[: x.size // 4] / power
    pairs = rho[1 : 1 + 2 * ((rho.size - 1) // 2)].reshape(-1, 2).sum(axis=1)
    ends = np.flatnonzero(pairs <= 0.0)
    return 1.0 + 2.0 * float(pairs[: ends[0] if ends.size else pairs.size].sum())
