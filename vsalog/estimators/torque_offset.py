"""An offset of the motor's torque, a ramp in an integrated equation that is none of its regressors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.significance import DETECTED_OF_MANY
from vsalog.estimators.device import PLACES, Device, deflection_of
from vsalog.estimators.equation import REPORTED_CHANGE
from vsalog.estimators.equations import IntegratedMotorEquation
from vsalog.estimators.screening import Screening
from vsalog.filters.conditioning import Conditioned, Conditioner
from vsalog.uncertainty.long_run import ENOUGH_BATCHES
from vsalog.uncertainty.sensor_error import ENOUGH

Array = NDArray[np.float64]

# A constant torque is itself a ramp, once it is integrated, which needs no motor and no spring: the residual of a ramp
# alone has to be larger than that of all together by this factor [1], or an offset cannot be identified.
RESIDUAL_OF_RAMP_ALONE = 30.0


def torque_offsets(
    device: Device, signals: JointSignals, conditioner: Conditioner, equations: Sequence[IntegratedMotorEquation]
) -> Screening:
    """Fit the equations once with a ramp and once without; find where it matters.

    Where the basis has a constant term the ramp is among the regressors, and nothing is looked for.
    """
    if 0 in device.basis.powers:
        return Screening()
    findings = []
    _, blocks = conditioner.step(conditioner.start(), signals[:ENOUGH])
    for equation in equations:
        parts, slopes, inner = [], [], equation.start()
        for block in blocks:
            if len(block.rows):
                inner, rows = equation.rows(inner, block)
                parts.append(rows)
                slopes.append(_slopes(device, equation, block))
        if not parts:
            continue
        F, y, use, fresh = (np.concatenate([getattr(p, n) for p in parts]) for n in ("F", "y", "use", "fresh"))
        chosen = _longest(use, fresh)
        offset = _offset(F[chosen], y[chosen], np.concatenate(slopes)[chosen], chosen, equation)
        if offset is not None:
            findings.append(
                Finding(
                    code="torque.offset_as_ramp",
                    joint=device.joint,
                    part=equation.view.name,
                    severity="invalidates",
                    value=offset,
                    unit="N*m",
                )
            )
    return Screening(tuple(findings))


def _slopes(device: Device, equation: IntegratedMotorEquation, block: Conditioned) -> Array:
    """Return ∂f/∂φ, shape (N, functions)."""
    phi = deflection_of(block.fit, equation.view)
    c = block.fit.get("setpoint") if device.basis.has_setpoint else None
    return device.basis.rows(phi, c, 1, block.loading_fit.get(equation.view.name))[:, 1]


def _longest(use: NDArray[np.bool_], fresh: NDArray[np.bool_]) -> NDArray[Any]:
    """Return the numbers of the rows of the longest stretch that is integrated without a break."""
    stretch, numbers = np.cumsum(fresh)[use], np.flatnonzero(use)
    if not stretch.size:
        return numbers
    values, counts = np.unique(stretch, return_counts=True)
    chosen: NDArray[Any] = numbers[stretch == values[np.argmax(counts)]]
    return chosen


def _offset(
    F: Array, y: Array, slopes: Array, numbers: NDArray[Any], equation: IntegratedMotorEquation
) -> float | None:
    """Return the torque's offset [N·m], None where there is none that matters."""
    if len(y) < 4 * F.shape[1]:
        return None
    ramp = (numbers - numbers.mean()) * equation.period
    size = np.linalg.norm(F, axis=0)
    size[size == 0.0] = 1.0
    plain = F / size
    both = np.column_stack((plain, ramp / np.linalg.norm(ramp)))
    steps = equation.torque_noise * equation.period * np.random.default_rng(0).standard_normal((len(y), ENOUGH_BATCHES))
    wanted = np.column_stack((y, np.cumsum(steps, axis=0)))
    without, found = (np.linalg.lstsq(A, wanted, rcond=1e-10)[0] for A in (plain, both))
    left = [float(np.linalg.norm(y - A @ x[:, 0])) for A, x in ((plain, without), (both, found))]
    # It exceeds the torque's noise, and it changes the residual.
    if abs(found[-1, 0]) <= DETECTED_OF_MANY * np.std(found[-1, 1:]) or left[1] > (1.0 - REPORTED_CHANGE) * left[0]:
        return None
    trivial = both[:, [0, -1]]
    if np.linalg.norm(y - trivial @ np.linalg.lstsq(trivial, y, rcond=None)[0]) < RESIDUAL_OF_RAMP_ALONE * left[1]:
        return None
    some = slopes[:: max(1, len(slopes) // PLACES)]
    springs = slice(equation.leading, F.shape[1])
    before, after = (some @ (x[springs, 0] / size[springs]) for x in (without, found))
    if np.median(np.abs(before - after)) <= REPORTED_CHANGE * np.median(np.abs(after)):
        return None
    return float(found[-1, 0] / np.linalg.norm(ramp))
