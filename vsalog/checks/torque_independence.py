"""Whether a torque channel is a measurement of its own, or was computed from another one."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.finding import Evidence, Finding

Array = NDArray[np.float64]

# What float32 rounding leaves of an exact multiple, as a share of the torque's spread.
COMPUTED = 1e-5
# A torque whose every value follows from another one's neighbours this closely is a function of it.
FUNCTION = 1e-5
ENOUGH = 200
# Looked at in so many samples or a few more, spread over the log.
LONGEST = 1 << 16
# A torque that was computed and then delayed, averaged or held follows from so many samples before and after, in powers up to
# this one, and from its own last value; what is left is less than this share of its spread. Looked at in so many samples.
BEFORE, AFTER, POWERS, FOLLOWED, ROWS = 12, 2, 5, 1e-5, 4000
# Values are fresh, neither held nor interpolated, where at least this part of them is.
FRESH = 0.7
# Single values may be wild; so many rounds leave out what is off by so many times the median, and this part of all must be told.
ROUNDS, WILD, MOST = 4, 10.0, 0.9
# A median error of this part of the spread is that of a sensor: where values may be wild, and where none may be.
HOPELESS, NOISY = 0.1, 1e-3
# So many samples in a row, none of which may be off.
STRETCH = 10_000
# So many values of x that come up so often each.
LEVELS, REPEATS = 30, 3


# A sensor is stuck that says one and the same for so many samples while the torque changes by this part of its span, and by so
# many of the sensor's steps.
STUCK_SAMPLES, STUCK_SHARE, STUCK_STEPS = 100, 0.1, 5.0


def stuck(torque: Array, predicted: Array, step: float) -> NDArray[np.bool_]:
    """Tell where a torque sensor stays at one value though the torque that is predicted moves on.

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
    low, high = _range(predicted)
    _mark(torque, predicted, max(STUCK_SHARE * (high - low), STUCK_STEPS * step), out)
    return out


@njit(cache=True, nogil=True)
def _range(values: Array) -> tuple[float, float]:
    low, high = np.inf, -np.inf
    for v in values:
        if np.isfinite(v):
            low, high = min(low, v), max(high, v)
    return low, high


@njit(cache=True, nogil=True)
def _mark(torque: Array, predicted: Array, least: float, out: NDArray[np.bool_]) -> None:
    begin = 0
    for k in range(1, torque.size + 1):
        if k < torque.size and torque[k] == torque[begin]:
            continue
        if k - begin >= STUCK_SAMPLES:
            low, high = _range(predicted[begin:k])
            out[begin:k] = high - low > least
        begin = k


def computed_from(torque: Array, joint: str, name: str, x: Array, what: str) -> Finding | None:
    """Find that a torque channel is a function of another signal; None where nothing speaks for it.

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
        return found(code="torque.computed", value=multiple.left, limit=COMPUTED, evidence=evidence)
    y, known = _both(torque, x)
    if not _vary(y, known):
        return None
    if _is_function(y, known):
        return found(code="torque.function", evidence={"source": what})
    if _follows(torque, x):
        return found(code="torque.filtered_function", evidence={"source": what})
    return None


class Multiple(NamedTuple):
    """What a signal is multiplied with to be a torque, and what that leaves, as a share of the torque's spread."""

    factor: float
    left: float


def multiple_of(torque: Array, x: Array) -> Multiple | None:
    """Tell whether a torque is another signal times a number, and a constant; shape (N,) each. None where it is not."""
    y, known = _both(torque, x)
    if not _vary(y, known):
        return None
    a, b = known - known.mean(), y - y.mean()
    factor = float(a @ b / (a @ a))
    left = float(np.sqrt(np.mean((b - factor * a) ** 2) / np.mean(b**2)))
    return Multiple(factor, left) if left <= COMPUTED else None


def _both(torque: Array, x: Array) -> tuple[Array, Array]:
    """Return samples that have both, spread over the log."""
    both = np.flatnonzero(np.isfinite(torque) & np.isfinite(x))
    both = both[:: max(1, both.size // LONGEST)]
    return torque[both], x[both]


def _vary(y: Array, x: Array) -> bool:
    return bool(y.size >= 3 and np.ptp(x) != 0.0 and np.ptp(y) != 0.0)


def _is_function(y: Array, x: Array) -> bool:
    """Tell whether equal x always have equal y, or each value follows from the neighbours in order of x."""
    order = np.argsort(x, kind="stable")
    xs, ys = x[order], y[order]
    # Equal x must have equal y; one of each is kept for what follows.
    first = np.append(True, np.diff(xs) > 0.0)
    groups = np.cumsum(first) - 1
    mean = np.bincount(groups, ys) / np.bincount(groups)
    spread = float(np.std(ys))
    within = float(np.sqrt(np.mean((ys - mean[groups]) ** 2)))
    xs, ys = xs[first], mean
    if within > FUNCTION * spread:
        return False
    if int(np.count_nonzero(np.bincount(groups) >= REPEATS)) >= LEVELS:
        return True  # an encoder's steps: a sensor would see what happens within each
    if xs.size < ENOUGH:
        return False
    middle = ys[:-2] + (ys[2:] - ys[:-2]) * (xs[1:-1] - xs[:-2]) / (xs[2:] - xs[:-2])
    # Most values, not all: where samples are sparse a straight line between neighbours is off.
    return float(np.quantile(np.abs(ys[1:-1] - middle), 0.9)) <= FUNCTION * spread


def _follows(torque: Array, x: Array) -> bool:
    """Tell whether a torque is a smooth function of another signal's samples around it, and of its own value before."""
    rows = np.flatnonzero(np.isfinite(torque))
    if rows.size < 2:
        return False
    changed = np.append(True, np.diff(torque[rows]) != 0.0)
    if changed.mean() < FRESH:
        rows = rows[changed]  # held in between: only fresh values tell
    elif rows.size == torque.size:
        bends = np.abs(np.diff(torque, 2)) > 1e-9 * float(np.ptp(torque))
        if bends.mean() < FRESH:
            rows = np.flatnonzero(bends) + 1  # of a slower topic, and interpolated: only where the lines meet
    rows = rows[(rows >= BEFORE) & (rows < torque.size - AFTER)]
    F, y, _ = _columns(torque, x, rows[:: max(1, rows.size // ROWS)])
    if _is_told(F, y, MOST):
        return True
    # Behind a lag its own last value counts too. That tells a loop as well, except where it jumps: no value may be off.
    first = max(0, (rows.size - STRETCH) // 2)
    F, y, last = _columns(torque, x, rows[first : first + STRETCH])
    return bool(np.isfinite(last).all()) and _is_told(np.column_stack((F, last)), y, 1.0)


def _columns(torque: Array, x: Array, rows: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Return powers of the samples around each row, shape (n, m), the torque there, and its value one sample before."""
    around = np.stack([x[rows - lag] for lag in range(-AFTER, BEFORE + 1)], axis=1)
    good = np.isfinite(around).all(axis=1)
    rows, around = rows[good], around[good]
    scale = float(np.abs(around).max()) if around.size else 0.0
    powers = [around / (scale or 1.0)]
    while len(powers) < POWERS:
        powers.append(powers[-1] * powers[0])
    return np.concatenate([np.ones((rows.size, 1)), *powers], axis=1), torque[rows], torque[rows - 1]


def _is_told(F: Array, y: Array, share: float) -> bool:
    """Tell whether columns tell that share of a signal's values to next to nothing; one half judges what the other has learnt."""
    learn = np.arange(y.size) % 2 == 0
    if np.count_nonzero(learn) < 4 * F.shape[1] or np.ptp(y) == 0.0:
        return False
    size = np.abs(F).max(axis=0)
    F = F / np.where(size > 0.0, size, 1.0)
    # Few logs need it, and importing it takes a while.
    from scipy.linalg import lstsq

    use = learn
    for _ in range(ROUNDS):
        solution = lstsq(F[use], y[use], cond=1e-12, lapack_driver="gelsy", check_finite=False)[0]
        off = np.abs(y - F @ solution)
        middle = float(np.median(off[learn]))
        if middle > (HOPELESS if share < 1.0 else NOISY) * float(np.std(y)):
            return False
        kept = learn & (off <= max(WILD * middle, 1e-12 * float(np.ptp(y))))
        if np.array_equal(kept, use):
            break
        use = kept
    return float(np.quantile(off[~learn], share)) <= FOLLOWED * float(np.std(y))
