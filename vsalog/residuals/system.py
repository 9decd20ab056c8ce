"""The stacked residual system: every equation of a joint, averaged, decimated, and divided by its noise.

Equations hold at every sample, but a second derivative of an encoder's steps is mostly noise. So each equation is averaged
over a short bell (the weak form: by parts, the derivatives act on the bell), at every half of its width. The noise of
an average is measured, not derived: channels with noise like their own go through the same equations, and the covariance
of the results whitens the equations together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.significance import DETECTED
from vsalog.effects.delay import LATEST
from vsalog.residuals.balance import Equation
from vsalog.residuals.channels import Channels
from vsalog.residuals.memory import remembered
from vsalog.residuals.per_log import PerLog, any_of, each, formed_in_each
from vsalog.residuals.sensing import earlier, read_earlier, true_roles, whole_delays

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

BELL = 0.05
"""Seconds of the bell that equations are averaged over: its whole width."""
ENOUGH = 0.9
"""Part of its weight that an average needs."""
EXACT = 1e-3
"""Part of the torques they pass to which filters are exact."""

Balance = Callable[[Any, Mapping[str, Array], Array, Mapping[str, float]], list[Equation]]


@dataclass(frozen=True, slots=True)
class System:
    """The equations of one joint of one log, ready to be formed for any rig.

    Attributes
    ----------
    channels : filtered
    balance : forms the equations
    names, sides, units : of the equations, m of them
    bell : weights, shape (L,), sum 1
    wide : the bell after the channels' filter, for signals that have yet to pass it
    centres : shape (R,), sample at the middle of each row
    usable : shape (m, N), samples that count
    weights : shape (R, m), share of a row's weight that counts; 0 where the row is not used
    whiteners : pattern of used equations → shape (m, m), the matrix that makes their noise white and of variance 1
    pattern : shape (R,)
    covariance : shape (m, m), of the noise of the equations' rows
    hold : how long after its stamp a motor torque acts on average [s]
    exact : shape (m, m), the part of the covariance that filters leave, whatever the noise
    copies : channels that carry noise once more
    early : samples by which all channels are read earlier than the joint has them
    """

    channels: Channels
    balance: Balance
    names: tuple[str, ...]
    sides: tuple[str, ...]
    units: tuple[str, ...]
    bell: Array
    wide: Array
    centres: Integers
    usable: Flags
    weights: Array
    whiteners: Mapping[int, Array]
    pattern: Integers
    covariance: Array
    hold: float = 0.0
    exact: Array = field(default_factory=lambda: np.zeros((0, 0)))
    copies: tuple[Channels, ...] = ()
    early: float = 0.0

    @property
    def time(self) -> Array:
        """Time of the rows [s]."""
        return self.channels.time[self.centres]

    @property
    def deviation(self) -> Array:
        """Noise of each equation's averages, in its unit, shape (m,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def count(self) -> int:
        """Number of averages that count."""
        return int(np.count_nonzero(self.weights))

    def on_rows_of(self, other: System) -> System:
        """Return the system with the rows that another one uses, so that the two can be compared."""
        return replace(self, usable=other.usable, weights=other.weights, pattern=other.pattern,
                       whiteners={p: whitener(self.covariance, p) for p in other.whiteners})  # fmt: skip

    @property
    def noisy(self) -> tuple[System, ...]:
        """Return the system on each of the copies that carry noise once more."""
        return tuple(replace(self, channels=copy) for copy in self.copies)

    def whole_delays(self, joint: Any) -> dict[str, int]:
        """Return the whole samples by which a joint's channels are late, see `sensing.whole_delays`."""
        return whole_delays(any_of(self._read(joint)), self.channels.period)

    def equations(self, joint: Any) -> list[Equation]:
        """Form the equations of a joint at every sample."""
        return formed(self.balance, self._read(joint), self.channels, self.hold)

    def _read(self, joint: Any) -> Any:
        return each(joint, lambda one: read_earlier(one, self.early, self.channels.period)) if self.early else joint

    def averaged(self, joint: Any) -> Array:
        """Return the averaged equations, shape (R, m), in their units; 0 where they are not used."""
        return self.rows(self.equations(joint))

    def whitened(self, joint: Any) -> Array:
        """Return the averaged equations divided by their noise, shape (R, m); 0 where they are not used."""
        return self.white(self.averaged(joint))

    def white(self, rows: Array) -> Array:
        """Divide averaged equations by their noise."""
        out = np.zeros_like(rows)
        for pattern, whitener in self.whiteners.items():
            own = self.pattern == pattern
            out[own] = rows[own] @ whitener.T
        return out

    def average(self, values: Array) -> Array:
        """Average any signal as the equations are, shape (R,)."""
        out = np.empty(self.centres.size)
        _average(np.ascontiguousarray(values), np.isfinite(values), self.bell, self.centres, out)
        return out

    def rows(self, equations: list[Equation]) -> Array:
        """Average equations, shape (R, m); 0 where they are not used."""
        out = np.zeros((self.centres.size, len(self.names)))
        for equation in equations:
            if equation.name not in self.names:
                continue
            i = self.names.index(equation.name)
            column = remembered(_averages, equation.residual, self.usable, i, self.bell, self.centres)
            if np.ndim(equation.shaped):
                more = remembered(_averages, equation.shaped, self.usable, i, self.wide, self.centres)
                column = column + np.where(np.isnan(more), 0.0, more)
            out[:, i] = np.where(self.weights[:, i] > 0.0, column, 0.0)
        # A row of a rig that is far off must not stop the search.
        return out if np.isfinite(out).all() else np.nan_to_num(out, nan=1e6, posinf=1e6, neginf=-1e6)


def build_system(
    joint: Any, channels: Channels, balance: Balance, hold: float = 0.0, copies: tuple[Channels, ...] = ()
) -> System:
    """Lay out the equations of a joint and measure their noise.

    Parameters
    ----------
    joint : of the rig, as given
    channels : filtered
    balance : forms the equations
    hold : see `System`
    copies : channels that carry noise once more, where they are known
    """
    copies = copies or tuple(channels.with_noise(seed) for seed in (1, 2))
    equations = formed(balance, joint, channels, hold)
    again = [formed(balance, joint, copy, hold) for copy in copies]
    bell = _bell(channels.period)
    wide = np.convolve(bell, channels.taps)
    margin = round(LATEST / channels.period) + 2
    n, half = len(channels), wide.size // 2
    centres = np.arange(half, n - half, max(1, bell.size // 2), dtype=np.int64)
    usable = np.array([_usable(e, [a[i] for a in again], margin) for i, e in enumerate(equations)]).reshape(
        len(equations), n
    )
    weights = np.zeros((centres.size, len(equations)))
    share = np.empty(centres.size)
    for i in range(len(equations)):
        _average(usable[i].astype(np.float64), np.ones(n, dtype=np.bool_), bell, centres, share)
        weights[:, i] = np.where(share >= ENOUGH, share, 0.0)
    names = tuple(e.name for e in equations)
    bits = (weights > 0.0).astype(np.int64) @ (1 << np.arange(len(equations), dtype=np.int64))
    system = System(
        channels, balance, names, tuple(e.side for e in equations), tuple(e.unit for e in equations), bell, wide, centres,
        usable, weights, {}, bits, np.eye(len(equations)), hold,
    )  # fmt: skip
    # Noise is drawn without the whole samples of delays, see `linear.formed_of`.
    whole = whole_delays(any_of(joint), channels.period)
    near = each(joint, lambda one: earlier(one, whole, channels.period))
    if whole:
        equations, again = (formed(balance, near, channels, hold), [formed(balance, near, c, hold) for c in copies])
    plain = system.rows(equations)
    noise = np.concatenate([system.rows(a) - plain for a in again])
    scale = np.array([_size(e, channels) for e in equations])
    used = np.concatenate([weights > 0.0] * len(again))
    exact = np.diag((EXACT * scale) ** 2)
    covariance = _covariance(noise, used) + exact
    whiteners = {int(p): whitener(covariance, int(p)) for p in np.unique(bits) if p}
    return replace(system, whiteners=whiteners, covariance=covariance, exact=exact, copies=copies)


def formed(balance: Balance, joint: Any, channels: Channels, hold: float) -> list[Equation]:
    """Form the equations of a joint at every sample."""
    if hold and len(set(channels.held)) > 1 and not isinstance(joint, PerLog):
        joint = PerLog((joint,) * len(channels.held))  # each log's drive held its torques as long as that log's samples
    if isinstance(joint, PerLog):
        return formed_in_each(joint, channels, lambda one, part: formed(balance, one, part, hold))
    return balance(joint, true_roles(joint, channels, hold), channels.time, channels.spread)


def _bell(period: float) -> Array:
    # With fewer samples it has no shape.
    length = max(5, round(BELL / period) | 1)
    bell = np.hanning(length + 2)[1:-1]
    return np.asarray(bell / bell.sum())


def _usable(equation: Equation, again: list[Equation], margin: int) -> Flags:
    """Return where an equation counts: where it is a number and the direction of the motion is known."""
    # Channels may turn out to be late: a shifted window must not reach over a run's end.
    usable = np.convolve(~np.isfinite(equation.whole), np.ones(2 * margin + 1), mode="same") < 0.5
    usable[:margin] = usable[-margin:] = False
    if equation.rate is not None:
        noise = np.concatenate([e.rate - equation.rate for e in again if e.rate is not None])
        spread = float(np.nanstd(noise)) if noise.size else 0.0
        usable &= np.abs(equation.rate) > DETECTED * spread
    return usable


def _size(equation: Equation, channels: Channels) -> float:
    """Return the size of the terms of an equation, in its unit, from the roles of that unit."""
    if equation.unit == "Pa/s":
        return max(
            (float(np.nanstd(v[1])) for role, v in channels.roles.items() if role.startswith("pressure")), default=0.0
        )
    if equation.unit != "N*m":
        return 0.0
    # The motor that sets a stiffness is far smaller than the joint.
    small = equation.name == "secondary_motor"
    torques = [v[0] for r, v in channels.roles.items() if "torque" in r and (r == "secondary_torque") == small]
    return max((float(np.nanstd(t)) for t in torques), default=0.0)


def _covariance(noise: Array, used: Flags) -> Array:
    """Return the covariance of the columns over the rows that use both."""
    m = noise.shape[1]
    out = np.zeros((m, m))
    for i in range(m):
        for j in range(i + 1):
            both = used[:, i] & used[:, j]
            if both.any():
                out[i, j] = out[j, i] = float(np.mean(noise[both, i] * noise[both, j]))
    return out


def whitener(covariance: Array, pattern: int) -> Array:
    """Return the matrix that makes the noise of a pattern's equations white and of variance 1, shape (m, m)."""
    m = covariance.shape[0]
    own = [i for i in range(m) if pattern >> i & 1]
    out = np.zeros((m, m))
    part = covariance[np.ix_(own, own)]
    scale = np.sqrt(np.maximum(np.diag(part), 1e-300))
    correlation = part / np.outer(scale, scale)
    # Measured over the rows that each pair has, a correlation may have directions of negative variance.
    values, vectors = np.linalg.eigh(correlation)
    if values.min() < 0.0:
        correlation = (vectors * np.maximum(values, 0.0)) @ vectors.T
    # Equations that share all their noise are distinguished no better than to a part in a thousand.
    lower = np.linalg.cholesky(correlation + 1e-6 * np.eye(len(own)))
    out[np.ix_(own, own)] = np.linalg.solve(lower, np.diag(1.0 / scale))
    return out


def _averages(values: Array, usable: Flags, row: int, bell: Array, centres: Integers) -> Array:
    out = np.empty(centres.size)
    _average(np.ascontiguousarray(values), usable[row], bell, centres, out)
    return out


@njit(cache=True)
def _average(values: Array, usable: Flags, bell: Array, centres: Integers, out: Array) -> None:
    half = bell.shape[0] // 2
    for r in range(centres.shape[0]):
        total, weight = 0.0, 0.0
        first = centres[r] - half
        for j in range(bell.shape[0]):
            if usable[first + j]:
                total += bell[j] * values[first + j]
                weight += bell[j]
        out[r] = total / weight if weight > 0.0 else np.nan
