"""How long the window of an exact filter must be: by the error that a least-squares fit behind it is expected to have.

Behind a filter of `derivative_weights` a linear equation stays true whatever the window is. A short one leaves encoder noise in
the regressors, which biases the fit; one that is long for the motion leaves little to fit.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, TransmissionView, deflection_of
from vsalog.estimators.tuning import Tuning
from vsalog.estimators.windows import PART_OF_RUN, SHORTER, WIDER, WINDOWS, most_moved, rms, with_window
from vsalog.filters.derivative_weights import derivative_weights
from vsalog.filters.savitzky_golay import samples_of, savgol_filter, savgol_weights
from vsalog.uncertainty.errors_in_variables import MOST_NOISE
from vsalog.uncertainty.sensor_error import sensor_error, without_missing

Array = NDArray[np.float64]
T = TypeVar("T", bound=Tuning)


class Choosing(NamedTuple):
    """How windows are chosen.

    Attributes
    ----------
    as_good : a window is as good as the best one up to this multiple of its square error [1]: such a bias is no more than the
        standard error, which a longer window would not lower
    """

    as_good: float = 2.0


CHOOSING = Choosing()


class Driven(NamedTuple):
    """A torque on what a transmission moves, or a torque sensor's.

    Attributes
    ----------
    torque, position : roles of the torque, and of the position that moves; None for a sensor's
    inertia, damping : of what moves [kg·m², N·m·s/rad]; both are unknown where the inertia is None
    transmitted : role of the sensor of the transmission's torque, where there is one: then the inertia alone is in question
    """

    torque: str
    position: str | None = None
    inertia: float | None = 0.0
    damping: float = 0.0
    transmitted: str | None = None


def exact_window(
    device: Device, signals: JointSignals, tuning: T, equations: Callable[[TransmissionView], Collection[Driven]]
) -> T:
    """Return the tuning with a window for a filter of `derivative_weights`.

    It is the first, of those from the usual length on and then of shorter ones, that is as good as the best. Where a window is
    given, or another filter, nothing is changed.

    Parameters
    ----------
    device, signals, tuning : of the joint
    equations : those of a transmission; the worst counts
    """
    if tuning.window is not None or tuning.filter == "kinematic":
        return tuning
    part = most_moved(signals, [r for view in device.transmissions for r in view.deflection_roles(signals.roles)])
    # A long window has more missing samples than a short one.
    part = replace(part, roles={role: without_missing(values) for role, values in part.roles.items()})
    widened = [round(WIDER * window) | 1 for window in (*WINDOWS, *SHORTER[::-1])]
    # The bell of the weights, and the derivatives of a polynomial, need samples.
    tried = [window for window in widened if window > tuning.degree + 2]
    tried = [window for window in tried if window <= PART_OF_RUN * signals.longest_run] or tried[:1]
    errors = {
        window: max(
            _square_error(view, part, derivative_weights(window, tuning.degree, 2, signals.period), len(signals), own)
            for view in device.transmissions
            for own in equations(view)
        )
        for window in tried
    }
    least = min(errors.values())
    # Of a motion that is noise for all of them the longest shows most.
    found = next(w for w in tried if errors[w] <= CHOOSING.as_good * least) if np.isfinite(least) else max(tried)
    return with_window(tuning, signals, found)


def reading_window(device: Device, signals: JointSignals, tuning: Tuning) -> float:
    """Return the window of a Savitzky–Golay filter for the deflection at which a stiffness is read [s].

    It has the least mean square error, which the difference between filtered and recorded values shows without knowing the motion
    (Stein's unbiased risk estimate; Stein, Ann. Statist. 9(6), 1981). It is no longer than the usual one, or the tuning's.
    """
    part = most_moved(signals, [r for view in device.transmissions for r in view.deflection_roles(signals.roles)])
    longest = WINDOWS[0] if tuning.window is None else samples_of(tuning.window, signals.period, tuning.degree)
    tried = [w for w in (*SHORTER, WINDOWS[0]) if tuning.degree < w <= longest] or [longest]
    errors = {
        window: sum(_risk(view, part, window, tuning.degree) for view in device.transmissions) for window in tried
    }
    return (min(tried, key=errors.__getitem__) - 1) * signals.period


def _risk(view: TransmissionView, signals: JointSignals, window: int, degree: int) -> float:
    """Return the mean square error of a deflection behind a filter, over its mean square."""
    phi, half = deflection_of(signals.roles, view), window // 2
    both = np.stack((np.zeros(window), savgol_weights(window, degree)[0]))
    both[0, half] = 1.0
    filtered = savgol_filter(without_missing(phi), both[1:])[0]
    # What is missing has no error that would show.
    risk, size = rms(filtered - phi[half : half + filtered.size]) ** 2, rms(phi) ** 2
    for role in view.deflection_roles(signals.roles):
        products = sensor_error(signals.roles[role], window).products(both)
        risk += float(2.0 * products[0, 1] - products[0, 0])
    return risk / size if size else 0.0


def _square_error(view: TransmissionView, signals: JointSignals, weights: Array, samples: int, driven: Driven) -> float:
    """Return the expected square error of a stiffness, or an inertia, by least squares behind a filter, over its square.

    The bias is that of errors in variables: without it what noise adds to AᵀA and Aᵀy is subtracted (Söderström 2007). Infinite
    where noise is most of what tells columns apart.

    Parameters
    ----------
    weights : of the value and two derivatives, shape (3, window)
    samples : of the whole log, of which `signals` are a part
    """
    roles, behind = signals.roles, [driven.torque]
    size = rms(phi := deflection_of(roles, view))
    if not size or (driven.transmitted is not None and driven.inertia is not None):
        return 0.0 if size else np.inf
    y = savgol_filter(roles[driven.torque], weights[:1])[0]
    columns, passed, moved = [np.ones_like(y)], [np.zeros(3)], [np.zeros(3)]
    asked: tuple[float, ...]
    if driven.transmitted is None:
        # The torque as a function of the deflection over its size: its slope there, and its curvature. `passed` is what noise of
        # the deflection adds to each column, as multiples of its value and derivatives; `moved`, that of the position that moves.
        columns = [*(savgol_filter((phi / size) ** power, weights[:1])[0] for power in (1, 3)), *columns]
        passed = [*(np.array([power / size, 0.0, 0.0]) for power in (1.0, 3.0)), *passed]
        moved, asked = moved * 3, (1.0, 3.0)
    else:
        y, asked = y + savgol_filter(roles[driven.transmitted], weights[:1])[0], (0.0, 1.0)
        behind.append(driven.transmitted)
    known = np.zeros(3)
    if driven.position is not None:
        _, velocity, acceleration = savgol_filter(roles[driven.position], weights)
        if driven.inertia is None:
            columns += [acceleration, velocity]
            passed, moved = [*passed, np.zeros(3), np.zeros(3)], [*moved, np.eye(3)[2], np.eye(3)[1]]
        else:
            known = -np.array([0.0, driven.damping, driven.inertia])
            y = y + known[1] * velocity + known[2] * acceleration
        columns, passed, moved = [*columns, np.sign(velocity)], [*passed, np.zeros(3)], [*moved, np.zeros(3)]
    A = np.column_stack(columns)
    whole = np.isfinite(A).all(axis=1) & np.isfinite(y)
    A, y = A[whole], y[whole]
    if len(A) <= A.shape[1]:
        return np.inf
    information, product = A.T @ A / len(A), A.T @ y / len(A)
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    x = inverse @ product
    # A torque's noise, and what noise adds to AᵀA, Aᵀy and to a row.
    noise = sum(sensor_error(roles[role], weights.shape[1]).rms(weights[0]) ** 2 for role in behind)
    added, right = np.zeros_like(information), product
    signs = {role: -1.0 if role == view.motor_position else 1.0 for role in view.deflection_roles(roles)}
    for role in dict.fromkeys([*signs, *([driven.position] if driven.position else [])]):
        moves, products = role == driven.position, sensor_error(roles[role], weights.shape[1]).products(weights)
        rows = signs.get(role, 0.0) * np.array(passed) + moves * np.array(moved)
        added, right = added + rows @ products @ rows.T, right - rows @ products @ (moves * known)
        left = moves * known - x @ rows
        noise += float(left @ products @ left)
    if np.linalg.eigvals(inverse @ added).real.max() > MOST_NOISE:
        return np.inf
    unbiased, E = np.linalg.lstsq(information - added, right, rcond=None)[0], np.zeros(len(x))
    E[: len(asked)] = asked
    # A filter leaves as many independent values of white noise as the sum of its squares, for each sample.
    variance = noise * float(E @ inverse @ E) / (samples * float(weights[0] @ weights[0]))
    return float((E @ (x - unbiased)) ** 2 + variance) / float(E @ unbiased) ** 2
