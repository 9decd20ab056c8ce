"""The noise an estimator observes in what its fit leaves over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def noise_variance(sums: NDArray[np.float64], unknowns: int) -> tuple[float, float]:
    """Read the running sums the recursions keep.

    Parameters
    ----------
    sums : shape (5,): weight, Σ e², Σ e(k) e(k−1), last e, number of samples
    unknowns : number of parameters fitted

    Returns
    -------
    variance : of a single left-over e
    inflation : (1 + r)/(1 − r) with r the correlation of neighbours: how many correlated samples count as one
    """
    if sums[0] <= 1.0 or sums[4] <= unknowns + 1.0:
        return float("nan"), float("nan")
    r = min(max(sums[2] / sums[1], 0.0), 0.9999) if sums[1] > 0.0 else 0.0
    variance = sums[1] / sums[0] * sums[4] / (sums[4] - unknowns)
    return float(variance), float((1.0 + r) / (1.0 - r))
