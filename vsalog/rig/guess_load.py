"""What a motor's torque moves, from a log alone: the motor's inertia, damping and dry friction, and its spring."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.core.dependence import LEAST_BLOCKS, block_moments
from vsalog.core.precision import ROUNDING
from vsalog.core.recording import Channel
from vsalog.core.resolution import ENOUGH, STRETCHES
from vsalog.core.significance import SIGNIFICANCE
from vsalog.rig.guess_data import CORRELATED, si_of
from vsalog.rig.guess_types import Load, RoleGuess

Array = NDArray[np.float64]
Sum = Sequence[tuple[Channel, float]]
"""Channels whose sum is a quantity, and their factors to SI on the joint's side."""


class Averaging(NamedTuple):
    """How the motor's equation is averaged.

    Attributes
    ----------
    bell : over which [s]: the noise of accelerations averages out, and motions of 10 Hz are left
    """

    bell: float = 0.1


AVERAGING = Averaging()


def factor_of(channel: Channel, guess: RoleGuess, gear: float | None, like: str = "rad") -> float | None:
    """Return the factor from a guessed channel to SI on the joint's side; None where its scale is not known.

    Parameters
    ----------
    channel, guess : of one role
    gear : ratio; None for an unknown one
    like : the role's unit
    """
    if guess.counts_per_turn is not None:
        size: float | None = 2.0 * math.pi / guess.counts_per_turn
    else:
        size = si_of(channel, guess.unit, like)
    if size is None or (guess.side == "rotor" and gear is None):
        return None
    by = 1.0 if guess.side == "joint" or gear is None else gear if like == "N*m" else 1.0 / gear
    return guess.sign * size * by


def motor_load(
    roles: Mapping[str, RoleGuess],
    channels: Mapping[str, Channel],
    gear: float | None,
    spring: str,
    constant: float = 1.0,
) -> Load | None:
    """Return the load of a joint's motor, by its guessed roles; None where the scale of an angle is not known.

    Parameters
    ----------
    roles : by name
    channels : role → channel
    gear : ratio; None for an unknown one
    spring : "deflection", or "torque_sensor"
    constant : of the torque [N·m/A]
    """

    def factor(role: str, like: str = "rad") -> float | None:
        return factor_of(channels[role], roles[role], gear, like)

    def sum_of(*parts: tuple[str, float]) -> list[tuple[Channel, float]] | None:
        found = [(channels[role], sign * size) for role, sign in parts if role in roles and (size := factor(role))]
        return found if len(found) == len(parts) else None

    if "motor_torque" not in roles:
        return None
    is_current = roles["motor_torque"].is_current
    torque = factor("motor_torque", "A" if is_current else "N*m")
    motor = sum_of(("motor_position", 1.0)) or sum_of(("link_position", 1.0), ("deflection", -1.0))
    difference = sum_of(("motor_position", 1.0), ("link_position", -1.0)) or sum_of(("deflection", -1.0))
    if spring == "torque_sensor":
        felt = factor(spring, "N*m") if spring in roles else None
        difference = None if felt is None else [(channels[spring], -felt)]
    if torque is None or motor is None or difference is None:
        return None
    return load_of(
        channels["motor_torque"], torque * (constant * (gear or 1.0) if is_current else 1.0), motor, difference
    )


def load_of(torque: Channel, factor: float, motor: Sum, spring: Sum) -> Load | None:
    """Return the load of a motor's torque; None where its equation cannot be formed, or explains little of the torque.

    The equation is averaged over a bell, which takes its derivatives (the weak form). Its interval is a jackknife over blocks
    of time, of least squares in the torque and in the spring's signal: noise of the one makes a coefficient too small, of the
    other too large (Frisch, "Statistical Confluence Analysis by Means of Complete Regression Systems", 1934).

    Parameters
    ----------
    torque, factor : of the motor, and to SI
    motor : its angle θ
    spring : θ − q, or the torque that the spring takes from the motor
    """
    rows = np.concatenate([np.empty((0, 5)), *_rows(torque, factor, motor, spring)])
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) < LEAST_BLOCKS * rows.shape[1]:
        return None
    rows = rows - rows.mean(axis=0)
    size = np.sqrt(np.mean(rows**2, axis=0))
    if not size.all() or not np.isfinite(size).all():
        return None
    moments = block_moments(rows / size, np.arange(len(rows)) * LEAST_BLOCKS // len(rows)) / len(rows)
    whole = moments.sum(axis=0)
    found = _solved(whole)
    if whole[0, 1:] @ found < CORRELATED**2:
        return None
    spread = np.std([_solved(whole - one)[-1] for one in moments]) * np.sqrt(LEAST_BLOCKS - 1)
    reach = float(special.stdtrit(LEAST_BLOCKS - 1, 1.0 - 0.5 * SIGNIFICANCE) * spread * size[0] / size[-1])
    inertia, damping, friction, k = (found * size[0] / size[1:]).tolist()
    other = float(size[0] / size[-1] / _solved(whole[::-1, ::-1])[-1])
    return Load(inertia, damping, friction, k, min(k, other) - reach, max(k, other) + reach)


def _solved(moments: Array) -> Array:
    """Return the coefficients of the first column on the others, by moments of shape (K, K) of columns of size 1."""
    return np.asarray(np.linalg.solve(moments[1:, 1:] + ROUNDING * np.eye(len(moments) - 1), moments[1:, 0]))


def _rows(torque: Channel, factor: float, motor: Sum, spring: Sum) -> Iterator[Array]:
    """Yield averages of the torque, θ̈, θ̇, sign θ̇ and the spring, shape (R, 5), of stretches of the log."""
    stamps = torque.stamps
    if stamps.size < 2 or not (period := float(np.median(np.diff(stamps)))) > 0.0:
        return
    length = max(5, round(AVERAGING.bell * 1e9 / period))
    phase = 2.0 * np.pi * (np.arange(length) + 0.5) / length
    bell = (1.0 - np.cos(phase)) / length
    rate = 2.0 * np.pi / (length * period * 1e-9)
    first_rate, second_rate = -rate * np.sin(phase) / length, rate**2 * np.cos(phase) / length
    count = STRETCHES if stamps.size > ENOUGH else 1
    most = min(stamps.size, ENOUGH) // count
    for first in np.linspace(0, stamps.size - most, count).astype(int):
        at = stamps[first] + period * np.arange(int((stamps[first + most - 1] - stamps[first]) / period) + 1)
        if at.size < 2 * length or at.size > 2 * most:
            continue
        widest = 0.5 * length * period
        recorded = factor * _at(torque, at, widest)
        theta, x = (np.sum([size * _at(c, at, widest) for c, size in some], axis=0) for some in (motor, spring))
        direction = np.full(at.size, np.nan)
        direction[length // 2 : length // 2 + at.size - length + 1] = np.sign(_averaged(theta, first_rate))
        columns = ((recorded, bell), (theta, second_rate), (theta, first_rate), (direction, bell), (x, bell))
        yield np.stack([_averaged(values, weights)[:: length // 2] for values, weights in columns], axis=-1)


def _averaged(values: Array, weights: Array) -> Array:
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, weights.size) @ weights)


def _at(channel: Channel, at: Array, widest: float) -> Array:
    """Return a channel's values at some instants [ns], NaN in gaps that are wider than that [ns]."""
    known = np.isfinite(channel.values)
    stamps, values = (channel.stamps[known] - at[0]).astype(np.float64), channel.values[known]
    if stamps.size < 2:
        return np.full(at.size, np.nan)
    at = at - at[0]
    after = np.clip(np.searchsorted(stamps, at), 1, stamps.size - 1)
    far = stamps[after] - stamps[after - 1] > widest
    return np.where(far, np.nan, np.interp(at, stamps, values, left=np.nan, right=np.nan))
