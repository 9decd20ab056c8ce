"""The reference torques for a frozen model, less the rig's known terms other than the springs, as in the estimators."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, TransmissionView
from vsalog.estimators.friction_compensation import way_role
from vsalog.estimators.known_effects import KnownEffects, known_of
from vsalog.estimators.needs import sensor_role
from vsalog.estimators.torque import lag_block, residual_block
from vsalog.filters.conditioning import Conditioned
from vsalog.validation.references import BANDWIDTH, Smoothed, runs_of, tuning_of

Array = NDArray[np.float64]


def residual(device: Device, view: TransmissionView, s: Smoothed, signals: JointSignals) -> Array | None:
    """Return the residual of the motor equation (Flacco 2012 eq. 17), less the rig's terms that are not in that equation.

    Parameters
    ----------
    device, view : of the joint
    s, signals : smoothed and as bound, N samples

    Returns
    -------
    Shape (N,) [N·m], NaN where it is unknown or too uncertain; None where a role or the motor's inertia is missing, or
    friction grows as fast as the torque that it would be separated from.
    """
    inertia, needed = view.motor.reflected_inertia, (view.motor_position, view.motor_torque)
    if inertia is None or not set(needed) <= set(s.roles):
        return None
    friction = view.motor.reflected.friction
    if friction.rubs and friction.load >= 1.0:
        return None
    theta, rate, tau = s.roles[needed[0]], s.roles[f"velocity:{needed[0]}"], s.roles[needed[1]]
    use = np.isfinite(theta) & np.isfinite(rate) & np.isfinite(tau)
    begin, motor = np.full(3, np.nan), (inertia, view.motor.reflected_damping)
    known = known_of(device, view, signals, tuning_of(signals), needed[1], motor=True)
    if known is None:
        return residual_block(begin, theta, rate, tau, use, *motor, BANDWIDTH, signals.period)[1]
    additional, doubt = _additional(known, s, signals)
    use &= np.isfinite(additional) & np.isfinite(doubt)
    loaded = (known.load, additional, s.roles[way_role(view)]) if known.load > 0.0 else ()
    _, found = residual_block(begin, theta, rate, tau + additional, use, *motor, BANDWIDTH, signals.period, *loaded)
    # An uncertain residual stays uncertain for the duration of its lag.
    late = lag_block(np.full((2, 1), np.nan), doubt[:, None].copy(), use, BANDWIDTH, signals.period)[1][:, 0]
    return np.where(late > 1.0, np.nan, found)


def sensor_of(device: Device, view: TransmissionView, s: Smoothed) -> str | None:
    """Return the role of the sensor that measures this transmission alone; None where there is none."""
    role = sensor_role(view, s.roles)
    if role not in s.roles or (len(device.transmissions) > 1 and role == "torque_sensor"):
        return None
    return role


def felt(
    device: Device, views: tuple[TransmissionView, ...], role: str | None, s: Smoothed, signals: JointSignals
) -> Array | None:
    """Return the springs' torque by a sensor: its torque less the known damping and hysteresis of its transmissions.

    Parameters
    ----------
    device : of the joint
    views : the transmissions that the sensor measures
    role : of the sensor; None where there is none
    s, signals : smoothed and as bound, N samples

    Returns
    -------
    Shape (N,) [N·m], NaN where it is unknown or too uncertain; None without a sensor
    """
    if role is None or role not in s.roles:
        return None
    torque = s.roles[role]
    for view in views:
        known = known_of(device, view, signals, tuning_of(signals), role, motor=False)
        if known is not None:
            additional, doubt = _additional(known, s, signals)
            torque = np.where(doubt > 1.0, np.nan, torque - additional)
    return torque


def _additional(known: KnownEffects, s: Smoothed, signals: JointSignals) -> tuple[Array, Array]:
    """Return the torque transmitted in addition to the spring's [N·m] and its relative uncertainty, shape (N,) each."""
    torque, doubt, state = np.empty(s.time.size), np.empty(s.time.size), known.start()
    for run in runs_of(s):
        fit = {name: values[run] for name, values in s.roles.items()}
        block = Conditioned(signals[run], fit, {}, np.ones(run.stop - run.start, dtype=np.bool_))
        state, torque[run], doubt[run] = known.block(state, block)
    return torque, doubt
