"""Compiled atoms of the physics, on plain numbers: springs, dry friction, hysteresis.

The rest of `mechanics` and the simulation call them. A transmission is a row of numbers, laid out by `transmissions.coded`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled, inlined
from vsalog.core.source_stamp import source_stamp
from vsalog.effects import backlash, drive, effects, friction, gravity, hysteresis, quantisation
from vsalog.effects import spring as shape
from vsalog.effects.body_torque import BodyTorque

Array = NDArray[np.float64]


class Law(IntEnum):
    """Laws of springs."""

    LINEAR, CUBIC, POLYNOMIAL, EXPONENTIAL, VSA2, AWAS = range(6)


class Element(IntEnum):
    """Layout of a transmission's row; its spring's own parameters come last, as many as it has."""

    LAW, ADDED_CUBIC, ASYMMETRY, HALF_GAP, DRIFT, DAMPING = range(6)
    LOOP_TORQUE, LOOP_WIDTH, LOOP_EXPONENT, LOOP_SHAPE, SPRING = range(6, 11)


class Friction(IntEnum):
    """Layout of a row that describes friction."""

    VISCOUS, COULOMB, STATIC, STRIBECK, LOAD, BRISTLE, BRISTLE_DAMPING = range(7)


# Formulas of effects, which are plain functions in `vsalog.effects`.
TORQUES = tuple(key.table for effect in effects().values() for key in effect.keys if issubclass(key.table, BodyTorque))
# Only what calls them is compiled again where they change.
STAMP_OF_TORQUES = source_stamp(*dict.fromkeys(sys.modules[table.formula.__module__] for table in TORQUES))
STAMP = source_stamp(sys.modules[__name__], backlash, friction, gravity, hysteresis, quantisation, shape)
stribeck = inlined(friction.stribeck)
bristle_rate = inlined(friction.bristle_rate)
bristles_after = inlined(friction.bristles_after)
loop_slope = inlined(hysteresis.loop_slope)
slipped = inlined(hysteresis.slipped)
stiffened = inlined(shape.stiffened)
beyond_gap = inlined(backlash.beyond_gap)
rounded = inlined(quantisation.rounded)
holding_torque = inlined(gravity.holding_torque)
planned = compiled(drive.planned)


def _of_kind(kind: int, formula: Callable[..., float], others: Callable[..., float]) -> Callable[..., float]:
    """Return code that calls a formula where its number is given, and others elsewhere."""

    @inlined
    def torque(which: int, x: float, v: float, t: float, p: Array, at: int) -> float:
        if which == kind:
            return formula(x, v, t, p, at)
        return others(which, x, v, t, p, at)

    return torque


@inlined
def body_torque(which: int, x: float, v: float, t: float, p: Array, at: int) -> float:
    """Return the torque of the effect whose table has that number in `TORQUES`; its numbers begin in `p` at `at`."""
    return 0.0


for _kind, _table in enumerate(TORQUES):
    body_torque = _of_kind(_kind, inlined(_table.formula), body_torque)


@inlined
def four_bar(phi: float, c: float) -> tuple[float, float, float]:
    """Return β, ∂β/∂φ and ∂²β/∂φ² of the VSA-II's mechanism (Flacco 2012 eq. 48), NaN from its singularity on.

    With s = sin(φ/2) and D = 1 − C²s²:  β = asin(C s) − φ/2,  β′ = C cos(φ/2) / (2√D) − 1/2,
    β″ = C (C² − 1) s / (4 D^{3/2}), since C²cos²(φ/2) − D = C² − 1.
    """
    half = 0.5 * phi
    s = math.sin(half)
    # |φ| ≥ π is beyond the singularity too, though the sine comes back below 1/C there.
    if not (abs(c * s) < 1.0 and abs(phi) < math.pi):
        return math.nan, math.nan, math.nan
    d = 1.0 - (c * s) ** 2
    root = math.sqrt(d)
    return (
        math.asin(c * s) - half,
        0.5 * (c * math.cos(half) / root - 1.0),
        0.25 * c * (c * c - 1.0) * s / (d * root),
    )


@inlined
def nominal_spring(numbers: Array, at: int, width: int, u: float, arm: float) -> tuple[float, float, float]:
    """Return energy U [J], torque ∂U/∂u [N·m] and stiffness ∂²U/∂u² [N·m/rad] of the bare spring at deflection `u`."""
    code = int(numbers[at + Element.LAW])
    p, s = numbers[at + Element.SPRING], numbers[at + Element.SPRING + 1]
    if code == Law.LINEAR:
        return 0.5 * p * u * u, p * u, p
    if code == Law.CUBIC:
        return (0.5 * p + 0.25 * s * u * u) * u * u, (p + s * u * u) * u, p + 3.0 * s * u * u
    if code == Law.VSA2:
        beta, slope, curvature = four_bar(u, s)
        return p * beta * beta, 2.0 * p * beta * slope, 2.0 * p * (slope * slope + beta * curvature)
    if code == Law.AWAS:
        k = p * arm * arm
        sine = math.sin(u)
        return k * sine * sine, k * math.sin(2.0 * u), 2.0 * k * math.cos(2.0 * u)
    if code == Law.EXPONENTIAL:
        x = u / s
        return p * s * s * (math.cosh(x) - 1.0), p * s * math.sinh(x), p * math.cosh(x)
    # The polynomial's scale comes first, then its coefficients c₁, c₂, …
    x = u / p
    energy, torque, stiffness, power = 0.0, 0.0, 0.0, 1.0
    for order in range(1, width - Element.SPRING):
        c = numbers[at + Element.SPRING + order]
        stiffness += c * order * power / p
        power *= x
        torque += c * power
        energy += c * power * u / (order + 1)
    return energy, torque, stiffness


@inlined
def spring(
    numbers: Array, at: int, width: int, u: float, side: float, arm: float, t: float
) -> tuple[float, float, float]:
    """Return energy, torque and stiffness with the added cubic, the asymmetry and the drift.

    Parameters
    ----------
    numbers, at, width : where the transmission's row is, and its length
    u : deflection less the gap [rad]
    side : +1 or −1, whose half of an asymmetric spring is meant
    arm : lever arm [m]
    t : time from the start [s]
    """
    energy, torque, stiffness = nominal_spring(numbers, at, width, u, arm)
    cubic = numbers[at + Element.ADDED_CUBIC]
    factor = stiffened(numbers[at + Element.DRIFT], t, side, numbers[at + Element.ASYMMETRY])
    squared = u * u
    return (
        factor * (energy + 0.25 * cubic * squared * squared),
        factor * (torque + cubic * squared * u),
        factor * (stiffness + 3.0 * cubic * squared),
    )


@inlined
def friction_level(numbers: Array, at: int, v: float, load: float) -> float:
    """Return the level of dry friction at velocity `v` [rad/s] under the transmitted torque `load` [N·m]."""
    coulomb, static = numbers[at + Friction.COULOMB], numbers[at + Friction.STATIC]
    level: float = coulomb + numbers[at + Friction.LOAD] * abs(load)
    if static > coulomb:
        level += stribeck(static - coulomb, numbers[at + Friction.STRIBECK], v)
    return level


@inlined
def loop_rate(numbers: Array, at: int, z: float, rate: float, speed: float) -> float:
    """Return ż of the Bouc–Wen loop (normalised, Ikhouane and Rodellar 2007). `speed` is |rate|."""
    slope = loop_slope(z, rate, speed, numbers[at + Element.LOOP_EXPONENT], numbers[at + Element.LOOP_SHAPE])
    change: float = slope / numbers[at + Element.LOOP_WIDTH]
    return change


@inlined
def loop_after(z: float, du: float, width: float, exponent: float, shape: float) -> float:
    """Return a loop's state z, in [−1, 1], after a change of the deflection.

    The normalised Bouc–Wen loop over the deflection (Ikhouane and Rodellar 2007), by classical Runge–Kutta in parts of a tenth of
    its width, which is right to 1e-6; a hundred widths saturate any loop.
    """
    parts = min(1 + int(abs(du) / (0.1 * width)), 1000)
    h = du / parts / width
    for _ in range(parts):
        a = loop_slope(z, h, abs(h), exponent, shape)
        b = loop_slope(z + 0.5 * a, h, abs(h), exponent, shape)
        c = loop_slope(z + 0.5 * b, h, abs(h), exponent, shape)
        d = loop_slope(z + c, h, abs(h), exponent, shape)
        z = min(max(z + (a + 2.0 * b + 2.0 * c + d) / 6.0, -1.0), 1.0)
    return z


def _compiled_springs(stamp: str) -> Callable[..., Any]:
    """Compile it again where a formula that it calls has changed, which numba's cache does not see."""

    @compiled
    def springs(row: Array, phi: Array, arm: Array, t: Array, out: Array) -> None:
        """Fill `out`, shape (3, N), with energy, torque and stiffness for arrays of shape (N,)."""
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        for k in range(phi.shape[0]):
            u, side = beyond_gap(phi[k], row[Element.HALF_GAP])
            energy, torque, stiffness = spring(row, 0, row.shape[0], u, side, arm[k], t[k])
            out[0, k], out[1, k], out[2, k] = energy, torque, stiffness
            if side == 0.0 and u == 0.0:
                out[2, k] = 0.0

    return springs


springs = _compiled_springs(STAMP)
