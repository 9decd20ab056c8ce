"""A log's filtered signals, and the references for a frozen model's torque in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import PART
from vsalog.core.errors import FilterError
from vsalog.core.model import JointModel
from vsalog.core.recording import Channel
from vsalog.core.signals import LONGER, JointSignals
from vsalog.estimators.device import Device, TransmissionView, deflection_of
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.estimators.known_effects import conditioner_of
from vsalog.estimators.methods.residual_rls import PRINTED
from vsalog.estimators.torque import lag_block
from vsalog.estimators.tuning import Tuning
from vsalog.filters.conditioning import Conditioned
from vsalog.filters.direction import direction_start, loading_block
from vsalog.filters.savitzky_golay import savgol_weights
from vsalog.mechanics.transmissions import torque_and_stiffness
from vsalog.rig.schema import UnknownTransmission

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
# Nobody needs more than seven digits of a standard deviation.
Deviations = NDArray[np.float32]

# Samples of the filter of every signal, forwards and backwards: the filter of `estimate`.
WINDOW = Tuning.default_window
# Bandwidth of the residual [rad/s].
BANDWIDTH = float(PRINTED["bandwidth"])


@dataclass(frozen=True, slots=True)
class Smoothed:
    """A joint's signals through one and the same filter; every array has shape (N,), NaN where the filter has no whole window.

    Attributes
    ----------
    time : from the log's start [s]
    starts : where a run begins
    roles : role → values; also ``velocity:ROLE`` of the motor positions and of what a transmission's damping needs. A motor's
        torque is compensated for its friction and cogging, where the rig gives any; the direction of the
        friction, and its uncertainty, are there too
    """

    time: Array
    stamps: NDArray[np.int64]
    starts: Flags
    roles: Mapping[str, Array]


def tuning_of(signals: JointSignals) -> Tuning:
    """Return the filter that validating uses, as an estimator's tuning."""
    return Tuning(window=(WINDOW - 1) * signals.period)


def smoothed(device: Device, signals: JointSignals, roles: tuple[str, ...]) -> Smoothed:
    """Filter whole signals, with what the rig knows of motors and transmissions in mind.

    Raises
    ------
    FilterError
        No run of the log is as long as the filter's window.
    """
    conditioner = conditioner_of(device, signals, tuning_of(signals), roles, motor=True, present=False)
    if signals.longest_run < WINDOW:
        raise FilterError(
            f"the longest stretch without a gap has {signals.longest_run} samples, but validating filters over {WINDOW}"
            f" ({(WINDOW - 1) * signals.period:.3g} s); {LONGER}"
        )
    state, given = conditioner.start(), 0
    out: dict[str, Array] = {}

    def keep(blocks: list[Conditioned], at: int) -> int:
        for block in blocks:
            for name, values in block.fit.items():
                if name.startswith("acceleration:"):
                    continue
                if name not in out:
                    out[name] = np.full(len(signals), np.nan)
                out[name][at : at + values.size] = values
            at += len(block.rows)
        return at

    for part in signals.blocks(PART):
        state, found = conditioner.step(state, part)
        given = keep(found, given)
    keep(conditioner.finish(state)[1], given)
    return Smoothed(signals.time, signals.stamps, signals.starts, out)


def noise_correlation() -> float:
    """Return the correlation length of white noise after the filter [samples]."""
    return float(1.0 / np.sum(savgol_weights(WINDOW, Tuning().degree)[0] ** 2))


def prediction(
    model: JointModel, view: TransmissionView, s: Smoothed, setpoint: Array | None
) -> tuple[Array, Deviations, Array, Deviations]:
    """Return the frozen model's flexibility torque and stiffness with their standard deviations, shape (N,) each."""
    phi, loading = deflection_of(s.roles, view), None
    if model.basis.branches:
        loading = loading_block(direction_start(), phi, NEGLIGIBLE_SHARE * model.basis.deflection_scale)[1]
    c = setpoint if model.basis.has_setpoint else None
    torque, sigma = np.empty(phi.size), np.empty(phi.size)
    std, sigma_std = np.empty(phi.size, dtype=np.float32), np.empty(phi.size, dtype=np.float32)
    for begin in range(0, phi.size, PART):
        part = slice(begin, begin + PART)
        at, on = (None if c is None else c[part]), (None if loading is None else loading[part])
        found = model.torque_and_stiffness(view.name, phi[part], at, on)
        (torque[part], std[part]), (sigma[part], sigma_std[part]) = found
    return torque, std, sigma, sigma_std


def behind_the_lag(values: Array, period: float) -> Array:
    """Pass a prediction through the residual's own lag, so that both have the same delay."""
    use = np.isfinite(values)
    return lag_block(np.full((2, 1), np.nan), values[:, None].copy(), use, BANDWIDTH, period)[1][:, 0]


def nominal(view: TransmissionView, s: Smoothed, setpoint: Array | None) -> tuple[Array, Array] | None:
    """Return torque and stiffness of the rig's nominal transmission; None where the rig has none."""
    if isinstance(view.nominal, UnknownTransmission):
        return None
    phi = deflection_of(s.roles, view)
    torque, sigma = np.empty(phi.size), np.empty(phi.size)
    for begin in range(0, phi.size, PART):
        part = slice(begin, begin + PART)
        at = None if setpoint is None else setpoint[part]
        torque[part], sigma[part] = torque_and_stiffness(view.nominal, phi[part], at, s.time[part])
    return torque, sigma


def true_stiffness(channels: Mapping[str, Channel], joint: str, suffix: str, s: Smoothed) -> Array | None:
    """Return a simulator's true stiffness where the log has one, at the signals' stamps."""
    for name in (f"/truth/{joint}/stiffness{suffix}.data", f"/truth/stiffness{suffix}.data"):
        channel = channels.get(name)
        if channel is not None and channel.values.size > 1:
            seconds = (channel.stamps - channel.stamps[0]) * 1e-9
            at = (s.stamps - channel.stamps[0]) * 1e-9
            return np.asarray(np.interp(at, seconds, channel.values, left=np.nan, right=np.nan))
    return None


def truth_channels(joint: str) -> tuple[str, ...]:
    """Return the names of the channels of a simulator's truth."""
    suffixes = ("", "_1", "_2", "_total")
    return tuple(f"/truth/{where}stiffness{suffix}.data" for where in ("", f"{joint}/") for suffix in suffixes)


def rate_at(values: Array, rows: NDArray[np.int64], s: Smoothed, period: float) -> Array:
    """Return the derivative of a smoothed signal at some samples; NaN at the ends of runs."""
    rows = np.asarray(rows)
    before, after = np.maximum(rows - 1, 0), np.minimum(rows + 1, values.size - 1)
    amid = (after - before == 2) & ~s.starts[rows] & ~s.starts[after]
    return np.where(amid, (values[after] - values[before]) / (2.0 * period), np.nan)


def runs_of(s: Smoothed) -> list[slice]:
    """Return the slice of each run."""
    edges = [0, *(int(i) for i in np.flatnonzero(s.starts) if i > 0), s.starts.size]
    return [slice(begin, end) for begin, end in pairwise(edges)]
