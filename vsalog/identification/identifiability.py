"""How far a log determines each number: alone, in combination with others only, or not at all.

A log determines a number where it contains at least as much information on it as a rig: the variance is half of that of the rig's
tolerance, or of the default one of its kind.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vsalog.core.significance import SIGNIFICANCE
from vsalog.identification.document import Determined
from vsalog.identification.fit import Fit

Array = NDArray[np.float64]


def determined(fit: Fit) -> list[Determined]:
    """Return for each number of a fit how far the log determines it."""
    usual = _usual(fit) ** 2
    posterior, alone = halved(np.diag(fit.covariance) / usual), halved(1.0 / (1.0 + np.diag(fit.information)) / usual)
    return ["alone" if m else "in combination" if a else "not" for m, a in zip(posterior, alone, strict=True)]


def halved(variance: Array) -> NDArray[np.bool_]:
    """Return whether a log determines as much as is usual, by posterior variances in units of what is usual for their kinds."""
    return np.asarray(variance <= 1.0 / 2.0)


def _usual(fit: Fit) -> Array:
    return np.array([u.usual(float(v)) for u, v in zip(fit.unknowns, fit.values, strict=True)])


def correlations(fit: Fit) -> Array:
    """Return the correlations of the estimates, shape (p, p)."""
    scale = np.sqrt(np.diag(fit.covariance))
    return np.asarray(fit.covariance / np.outer(scale, scale))


def combinations(fit: Fit) -> Iterator[tuple[tuple[int, ...], tuple[float, ...]]]:
    """Yield indices of numbers that change together without effect, and by how many per cent where the first changes by one.

    Per cent are of a number's own value; of its half-width where it is at an end of its range, as a delay of zero.
    """
    usual = _usual(fit)
    values, vectors = np.linalg.eigh(fit.covariance / np.outer(usual, usual))
    kinds = determined(fit)
    for k in np.flatnonzero(~halved(values)):
        v = vectors[:, k]
        order = np.argsort(-(v**2))
        count = int(np.searchsorted(np.cumsum(v[order] ** 2), 1.0 - SIGNIFICANCE)) + 1
        members = [int(i) for i in order[:count] if kinds[i] == "in combination"]
        if len(members) < 2:
            continue
        unknowns = [fit.unknowns[i] for i in members]
        at = fit.values[members]
        now = np.array([u.value(x) for u, x in zip(unknowns, at.tolist(), strict=True)])
        slopes = np.array([u.slope(x) for u, x in zip(unknowns, at.tolist(), strict=True)])
        ends = [np.isclose(x, u.bounds).any() for u, x in zip(unknowns, at.tolist(), strict=True)]
        relative = slopes * v[members] * usual[members] / np.where(ends, slopes * fit.half_widths[members], now)
        yield tuple(members), tuple((relative / relative[0]).tolist())
