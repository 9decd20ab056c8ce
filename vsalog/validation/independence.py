"""Whether a torque channel is a measurement of its own, or was computed from another one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# What float32 rounding leaves of an exact multiple, as a share of the torque's spread.
COMPUTED = 1e-5
# A torque whose every value follows from another one's neighbours this closely is a function of it.
FUNCTION = 1e-5
ENOUGH = 200
LONGEST = 1 << 18
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
    known = predicted[np.isfinite(predicted)]
    if known.size == 0:
        return out
    least = max(STUCK_SHARE * float(np.ptp(known)), STUCK_STEPS * step)
    edges = np.flatnonzero(np.diff(torque) != 0.0) + 1
    begins, ends = np.append(0, edges), np.append(edges, torque.size)
    for i in np.flatnonzero(ends - begins >= STUCK_SAMPLES):
        part = slice(int(begins[i]), int(ends[i]))
        moved = predicted[part][np.isfinite(predicted[part])]
        out[part] = moved.size > 0 and float(np.ptp(moved)) > least
    return out


def computed_from(torque: Array, name: str, x: Array, what: str) -> str | None:
    """Say that a torque channel is a function of another signal; None where nothing speaks for it.

    Parameters
    ----------
    torque : shape (N,), as recorded, not smoothed
    name : of its role
    x : shape (N,), the other signal as recorded
    what : in words, such as "the deflection"
    """
    both = np.isfinite(torque) & np.isfinite(x)
    y, x = torque[both], x[both]
    if y.size < 3 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return None
    a, b = x - x.mean(), y - y.mean()
    factor = float(a @ b / (a @ a))
    if float(np.sqrt(np.mean((b - factor * a) ** 2) / np.mean(b**2))) <= COMPUTED:
        return f"{name} is exactly {factor:.6g} times {what}: it was computed from it, not measured"
    if _is_function(y, x):
        return f"{name} is a function of {what}, without any noise of its own: it was computed from it, not measured"
    return None


def _is_function(y: Array, x: Array) -> bool:
    """Tell whether equal x always have equal y, or each value follows from the neighbours in order of x."""
    step = max(1, y.size // LONGEST)
    order = np.argsort(x[::step], kind="stable")
    xs, ys = x[::step][order], y[::step][order]
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
