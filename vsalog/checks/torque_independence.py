"""Whether a torque channel is a measurement of its own, or was computed from another one."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.samples import FEWEST_LEVELS, MOVED_SHARE, SAME_MOTION, moved, runs, unlikely_run
from vsalog.core.finding import Evidence, Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.precision import ROUNDING
from vsalog.core.resolution import spread_over

Array = NDArray[np.float64]

COMPUTED_RESIDUAL = 1e-5
"""Residual of a torque as a function of another signal, relative to its standard deviation: float32 rounding is a hundredth
of this, a sensor's noise a hundred times as much."""
LAGS = 12
"""Samples before and after that determine a delayed or averaged torque."""
JUDGED_SAMPLES = 2**13
"""Consecutive samples for the test of a torque's dependence on another signal: some swings, at whose ends a loop jumps."""
POWERS = 5
"""Highest power of these samples: springs harden by the third, and the lever arms of a mechanism add one or two."""


def stuck(torque: Array, predicted: Array, step: float) -> NDArray[np.bool_]:
    """Return where a torque sensor stays at one value though the predicted torque changes.

    Parameters
    ----------
    torque : shape (N,), as recorded
    predicted : shape (N,), NaN where nothing is
    step : of the sensor, 0 where it has none

    Returns
    -------
    Shape (N,)
    """
    out = np.zeros(torque.size, dtype=np.bool_)
    if not np.isfinite(predicted).any():
        return out
    same = np.diff(torque, prepend=np.nan) == 0.0
    first, after = runs(same)
    long = after - first >= unlikely_run(float(same.mean()), same.size)
    stretches = [slice(begin - 1, end) for begin, end in zip(first[long].tolist(), after[long].tolist(), strict=True)]
    enough = max(FEWEST_LEVELS * step, MOVED_SHARE * float(np.nanmax(predicted) - np.nanmin(predicted)))
    for stretch, _ in moved(stretches, predicted, enough):
        out[stretch] = True
    return out


def computed_from(torque: Array, joint: str, name: str, x: Array, what: str) -> Finding | None:
    """Find that a torque channel is a function of another signal; None without evidence for it.

    Parameters
    ----------
    torque : shape (N,), as recorded, not smoothed
    joint, name : of the joint, and of the torque's role
    x : shape (N,), the other signal as recorded
    what : it is, such as "the deflection"
    """
    found = partial(Finding, joint=joint, part=name, severity="invalidates")
    if (multiple := multiple_of(torque, x)) is not None:
        evidence: Evidence = {"factor": multiple.factor, "source": what}
        return found(code="torque.computed", value=multiple.left, limit=COMPUTED_RESIDUAL, evidence=evidence)
    y, known = _both(torque, x)
    if not _vary(y, known):
        return None
    if _is_function(y, known):
        return found(code="torque.function", evidence={"source": what})
    if _follows(torque, x):
        return found(code="torque.filtered_function", evidence={"source": what})
    return None


class Multiple(NamedTuple):
    """The factor from a signal to a torque, and the residual relative to the torque's standard deviation."""

    factor: float
    left: float


def multiple_of(torque: Array, x: Array) -> Multiple | None:
    """Return the fit of a torque by another signal times a number, and a constant; shape (N,) each. None if it is none."""
    y, known = _both(torque, x)
    if not _vary(y, known):
        return None
    a, b = known - known.mean(), y - y.mean()
    factor = float(a @ b / (a @ a))
    left = float(np.sqrt(np.mean((b - factor * a) ** 2) / np.mean(b**2)))
    return Multiple(factor, left) if left <= COMPUTED_RESIDUAL else None


def _both(torque: Array, x: Array) -> tuple[Array, Array]:
    """Return samples that have both, spread over the log."""
    both = spread_over(np.flatnonzero(np.isfinite(torque) & np.isfinite(x)))
    return torque[both], x[both]


def _vary(y: Array, x: Array) -> bool:
    return bool(y.size >= 3 and np.ptp(x) != 0.0 and np.ptp(y) != 0.0)


def _is_function(y: Array, x: Array) -> bool:
    """Return whether equal x always have equal y, or each value follows from the neighbours in order of x."""
    order = np.argsort(x, kind="stable")
    xs, ys = x[order], y[order]
    # Equal x must have equal y; one of each is kept for what follows.
    first = np.append(True, np.diff(xs) > 0.0)
    groups = np.cumsum(first) - 1
    mean = np.bincount(groups, ys) / np.bincount(groups)
    spread = float(np.std(ys))
    within = float(np.sqrt(np.mean((ys - mean[groups]) ** 2)))
    xs, ys = xs[first], mean
    if within > COMPUTED_RESIDUAL * spread:
        return False
    if int(np.count_nonzero(np.bincount(groups) > 1)) >= FEWEST_LEVELS:
        return True  # an encoder's steps: a sensor would see what happens within each
    if xs.size < FEWEST_LEVELS:
        return False
    middle = ys[:-2] + (ys[2:] - ys[:-2]) * (xs[1:-1] - xs[:-2]) / (xs[2:] - xs[:-2])
    # Most values, not all: where samples are sparse a straight line between neighbours is off.
    return float(np.quantile(np.abs(ys[1:-1] - middle), SAME_MOTION)) <= COMPUTED_RESIDUAL * spread


def _follows(torque: Array, x: Array) -> bool:
    """Return whether a torque is a smooth function of another signal's samples around it, and of its own value before."""
    before, here, after = (np.roll(torque, shift)[LAGS:-LAGS] for shift in (1, 0, -1))
    # Not where it is held or interpolated: only fresh values count, those of a slower topic where its lines meet.
    on_a_line = np.abs(before - 2.0 * here + after) <= ROUNDING * float(np.nanmax(torque) - np.nanmin(torque))
    rows = LAGS + np.flatnonzero(np.isfinite(here) & (here != before) & ~on_a_line)
    first = max(0, (rows.size - JUDGED_SAMPLES) // 2)
    F, y, last = _columns(torque, x, rows[first : first + JUDGED_SAMPLES])
    if _is_told(F, y, SAME_MOTION):
        return True
    # Behind a lag its own last value counts too. That shows a loop as well, except where it jumps: no value may deviate.
    return bool(np.isfinite(last).all()) and _is_told(np.column_stack((F, last)), y, 1.0)


def _columns(torque: Array, x: Array, rows: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Return powers of the samples around each row, shape (n, m), the torque there, and its value one sample before."""
    around = np.stack([x[rows - lag] for lag in range(-LAGS, LAGS + 1)], axis=1)
    good = np.isfinite(around).all(axis=1)
    rows, around = rows[good], around[good]
    scale = float(np.abs(around).max()) if around.size else 0.0
    powers = [around / (scale or 1.0)]
    while len(powers) < POWERS:
        powers.append(powers[-1] * powers[0])
    return np.concatenate([np.ones((rows.size, 1)), *powers], axis=1), torque[rows], torque[rows - 1]


def _is_told(F: Array, y: Array, share: float) -> bool:
    """Return whether columns predict that share of a signal's values almost exactly; one half tests the fit to the other.

    In the fitted half the rest may be outliers: trimmed least squares, whose sum of the smallest squares falls with every fit to
    those samples (Rousseeuw, Van Driessen, "Computing LTS regression for large data sets", Data Min. Knowl. Discov. 12, 2006).
    """
    learn, judge = F[::2], F[1::2]
    if len(learn) < 4 * F.shape[1] or np.ptp(y) == 0.0:
        return False
    # Few logs need it, and importing it takes a while.
    from scipy.linalg import lstsq

    size = np.abs(F).max(axis=0)
    size[size == 0.0] = 1.0
    learn, judge, kept, least = learn / size, judge / size, np.ones(len(learn), dtype=np.bool_), np.inf
    while True:
        solution = lstsq(learn[kept], y[::2][kept], cond=1e-12, lapack_driver="gelsy", check_finite=False)[0]
        off = np.abs(y[::2] - learn @ solution)
        kept = off <= np.quantile(off, share)
        if not (squares := float(np.sum(off[kept] ** 2))) < least:
            break
        least = squares
    return float(np.quantile(np.abs(y[1::2] - judge @ solution), share)) <= COMPUTED_RESIDUAL * float(np.std(y))


TEXTS = {
    "torque.function": Text(
        "{part} is a function of {source}, without any noise of its own: it was computed from it, not measured.",
        "It validates nothing: a model that agrees with such a channel agrees with whoever computed it.",
    ),
    "torque.filtered_function": Text(
        "{part} follows from {source} and its neighbours in time, late, averaged or held, without any noise of its own: it was"
        " computed from it, not measured.",
        "It validates nothing: a model that agrees with such a channel agrees with whoever computed it.",
    ),
}
add_texts(TEXTS)
