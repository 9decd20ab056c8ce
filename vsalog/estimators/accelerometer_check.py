"""Whether accelerometers measure the accelerations that the motors' motion and gravity make at their places.

An accelerometer that is upside down, turned, or in g instead of m/s² gives an observer a wrong torque with a narrow band. But the
links follow their motors but for the springs' swinging, so that slow accelerations, and gravity above all, are known without it.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.significance import DETECTED_OF_MANY
from vsalog.estimators.acceleration_group import Axis, Group
from vsalog.estimators.device import PLACES
from vsalog.estimators.friction_compensation import CUBIC
from vsalog.filters.acceleration_arm import Arm, axis_rows
from vsalog.filters.savitzky_golay import savgol_filter, savgol_weights
from vsalog.uncertainty.sensor_error import ENOUGH

Array = NDArray[np.float64]

# Oscillations faster than this are smoothed away [s]: those of springs are.
SWING = 0.25
# An axis that differs by this part of what its link's axes should measure is a finding [1], with a factor where one leaves less:
# place and orientation of a sensor are known better.
DIFFERENT_SHARE = 0.3


def accelerometer_findings(arm: Arm, group: Group, signals: JointSignals) -> tuple[Finding, ...]:
    """Return which axes measure something else, and by which factor where one explains it.

    Parameters
    ----------
    arm : the kinematics of `group`
    signals : with the roles of `group`
    """
    window = 2 * max(round(0.5 * SWING / signals.period), CUBIC) + 1
    theta = [signals.roles[m.view.motor_position][:ENOUGH] for m in group.members]
    measured = [signals.roles[axis.role][:ENOUGH] for axis in group.axes]
    if len(theta[0]) < 2 * window:
        return ()
    weights = savgol_weights(window, CUBIC, 2, signals.period)
    motion = np.array([savgol_filter(x, weights) for x in theta])
    slow = np.array([savgol_filter(x, weights[:1])[0] for x in measured])
    whole = _without_gaps(signals.starts[:ENOUGH], window) & np.isfinite(motion).all(axis=(0, 1))
    places = np.flatnonzero(whole)
    if not places.size:
        return ()
    places = places[np.linspace(0, places.size - 1, min(PLACES, places.size)).astype(np.int64)]
    expected, carried = np.empty((len(measured), places.size)), np.zeros(len(measured))
    for k, place in enumerate(places):
        q, dq, ddq = motion[:, :, place].T
        T, W = axis_rows(arm, q, dq)
        expected[:, k] = T @ ddq + W
        carried = np.maximum(carried, np.abs(T).sum(axis=1))
    steps = max(signals.resolution.get(m.view.motor_position, 0.0) for m in group.members)
    noise = np.hypot(arm.row_noise * np.linalg.norm(weights[0]), carried * steps * np.linalg.norm(weights[2]))
    found = slow[:, places]
    size = _rms(expected) ** 2
    links = np.array([axis.place for axis in group.axes])
    whole_size = np.sqrt([size[links == link].sum() for link in links])
    off = _rms(found - expected)
    limit = np.maximum(DIFFERENT_SHARE * whole_size, DETECTED_OF_MANY * noise)
    return tuple(
        _finding(group, axis, float(off[i]), float(limit[i]), float(whole_size[i]), _factor(found[i], expected[i]))
        for i, axis in enumerate(group.axes)
        if off[i] > limit[i]
    )


def _without_gaps(starts: NDArray[np.bool_], window: int) -> NDArray[np.bool_]:
    """Return the whole windows, by number, within which no run begins."""
    runs = np.cumsum(starts)
    return np.asarray(runs[window - 1 :] == runs[: runs.size - window + 1])


def _rms(x: Array) -> Array:
    """Return the root mean square of each row's finite values; 0 where there is none."""
    known = np.isfinite(x)
    squares = np.where(known, x, 0.0) ** 2
    return np.asarray(np.sqrt(squares.sum(axis=1) / np.maximum(known.sum(axis=1), 1)))


def _factor(found: Array, expected: Array) -> float | None:
    """Return the factor from the expected to the measured values; None where no factor fits."""
    known = np.isfinite(found)
    found, expected = found[known], expected[known]
    if not expected.any() or not found.any():
        return None
    factor = float(found @ expected / (expected @ expected))
    return factor if np.linalg.norm(found - factor * expected) < DIFFERENT_SHARE * np.linalg.norm(found) else None


def _finding(group: Group, axis: Axis, off: float, limit: float, size: float, factor: float | None) -> Finding:
    found = partial(
        Finding,
        joint=group.members[group.place].joint,
        part=axis.role,
        value=off,
        limit=limit,
        unit="rad/s^2" if axis.direct else "m/s^2",
    )
    if factor is None:
        return found(code="accelerometer.off", evidence={"expected": size})
    return found(code="accelerometer.scale", evidence={"expected": size, "factor": factor})
