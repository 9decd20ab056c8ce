"""The torque of a drive that is commanded a position: the output of its loop from the command and the measured position."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsalog.effects.delay import shifted
from vsalog.effects.drive import PositionServo, late_command
from vsalog.mechanics._atoms import planned
from vsalog.residuals.channels import Channels, filtered
from vsalog.residuals.memory import remembered

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def drive_torque(drive: PositionServo, channels: Channels, position: Array) -> Array:
    """Return τ = kp (r − θ) + kd (ṙ − θ̇) + ki ∫(r − θ) dt within ± torque_limit, with its derivatives, shape (3, N).

    The integral begins with each run, so that a constant of it is not known. A second derivative is that of kp (r − θ) alone.

    Parameters
    ----------
    drive : of the joint
    channels : of the log, with what is commanded
    position : true θ with its derivatives, shape (3, N) [rad]
    """
    whole = channels if channels.whole is None else channels.whole
    late = (drive.delay + 0.5 * whole.period) / channels.period
    rates = channels.roles.get("commanded_velocity")
    # A command that is held from sample to sample has no velocity but in its steps.
    rate = np.zeros_like(position) if rates is None else remembered(shifted, rates, -late)
    if drive.plans:
        reference = remembered(
            _planned, _commanded(whole), whole.starts, whole.period, whole.window, channels.every, drive.delay,
            drive.speed_limit, drive.acceleration_limit, drive.period,
        )  # fmt: skip
        rate = reference[1:]
    elif "commanded_position" in channels.roles:
        reference = remembered(shifted, channels.roles["commanded_position"], -late)
    else:
        gone = remembered(_passed, _commanded(whole), whole.starts, whole.period, whole.window, channels.every)
        reference = remembered(shifted, gone, -drive.delay / channels.period)
    limit = np.inf if drive.torque_limit is None else drive.torque_limit
    return remembered(
        _loop, reference, rate, position, channels.starts, channels.period, drive.kp, drive.kd, drive.ki, limit
    )


def _commanded(whole: Channels) -> Array:
    """Return the commanded position, shape (N,); where a velocity is commanded, its integral from where each run begins."""
    if "commanded_position" in whole.raw:
        return whole.raw["commanded_position"]
    encoder = next(role for role in ("motor_position", "link_position") if role in whole.raw)
    return remembered(_gone, whole.raw["commanded_velocity"], whole.raw[encoder], whole.starts, whole.period)


def _gone(velocity: Array, position: Array, starts: Flags, period: float) -> Array:
    known = np.maximum.accumulate(np.where(starts, np.arange(starts.size), 0))
    begin = np.where(np.isfinite(position), position, 0.0)[known]
    # A velocity has moved nothing yet when it is commanded.
    return np.asarray(begin + _integral(velocity, starts, period) - period * np.nan_to_num(velocity))


def _passed(values: Array, starts: Flags, period: float, window: int, every: int) -> Array:
    return filtered(values, starts, period, window)[:, ::every]


def _planned(
    command: Array, starts: Flags, period: float, window: int, every: int, delay: float, speed_limit: float | None,
    acceleration_limit: float | None, look: float,
) -> Array:  # fmt: skip
    """Return the motion that a drive plans to its command, filtered as the channels are, shape (3, N)."""
    out = np.full(command.size, np.nan)
    looks = max(1, round(period / look))
    speed, acceleration = (np.inf if limit is None else limit for limit in (speed_limit, acceleration_limit))
    edges = [0, *(int(k) for k in np.flatnonzero(starts) if k > 0), command.size]
    for first, last in pairwise(edges):
        held = late_command(command[first:last], delay / period, looks)
        out[first:last] = planned(held, period / looks, speed, acceleration)[0][::looks]
    return filtered(out, starts, period, window)[:, ::every]


def _loop(
    reference: Array, rate: Array, position: Array, starts: Flags, period: float, kp: float, kd: float, ki: float, limit: float
) -> Array:  # fmt: skip
    off = reference - position
    torque = kp * off[0] + kd * (rate[0] - position[1])
    if ki:
        torque = torque + ki * _integral(off[0], starts, period)
    slope = kp * off[1] + kd * (rate[1] - position[2]) + ki * off[0]
    within = np.abs(torque) < limit
    return np.stack([np.clip(torque, -limit, limit), np.where(within, slope, 0.0), np.where(within, kp * off[2], 0.0)])


def _integral(values: Array, starts: Flags, period: float) -> Array:
    """Return the running integral of the finite samples, from each run's beginning."""
    total = np.cumsum(np.where(np.isfinite(values), values, 0.0)) * period
    run = np.maximum.accumulate(np.where(starts, np.arange(values.size), 0))
    return np.asarray(total - total[run])
