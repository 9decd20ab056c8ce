"""The torque of a drive that is commanded a position: what its loop makes of the command and of the measured position."""

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
    if drive.plans:
        reference = remembered(
            _planned, whole.raw["commanded_position"], whole.starts, whole.period, whole.window, channels.every, drive.delay,
            drive.speed_limit, drive.acceleration_limit, drive.period,
        )  # fmt: skip
    else:
        late = (drive.delay + 0.5 * whole.period) / channels.period
        reference = remembered(shifted, channels.roles["commanded_position"], -late)
    limit = np.inf if drive.torque_limit is None else drive.torque_limit
    return remembered(
        _loop, reference, position, channels.starts, channels.period, drive.kp, drive.kd, drive.ki, limit, drive.plans
    )


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
    reference: Array, position: Array, starts: Flags, period: float, kp: float, kd: float, ki: float, limit: float, plans: bool
) -> Array:  # fmt: skip
    off = reference - position
    # What is held from sample to sample has no velocity but in its steps.
    rate, curvature = (off[1], off[2]) if plans else (-position[1], -position[2])
    torque = kp * off[0] + kd * rate
    if ki:
        torque = torque + ki * _integral(off[0], starts, period)
    slope = kp * off[1] + kd * curvature + ki * off[0]
    within = np.abs(torque) < limit
    return np.stack([np.clip(torque, -limit, limit), np.where(within, slope, 0.0), np.where(within, kp * off[2], 0.0)])


def _integral(values: Array, starts: Flags, period: float) -> Array:
    """Return the running integral of what is a number, from each run's beginning."""
    total = np.cumsum(np.where(np.isfinite(values), values, 0.0)) * period
    run = np.maximum.accumulate(np.where(starts, np.arange(values.size), 0))
    return np.asarray(total - total[run])
