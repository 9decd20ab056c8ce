"""Springs as sums of polynomials of third order outside of dead bands, the form of MuJoCo's tendons.

A law that is no such polynomial becomes a cubic spline: with knots d_j its torque is a u + b u² + c u³ + Σ c_j max(0, u − d_j)³,
and each term is a tendon.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from vsalog.mechanics.transmissions import flexibility_torque, stiffness
from vsalog.rig.schema import (
    AwasTransmission,
    CubicTransmission,
    ExponentialTransmission,
    KnownTransmission,
    LinearTransmission,
    PolynomialTransmission,
    Vsa2Transmission,
)

Array = NDArray[np.float64]
Half = list[tuple[float, float, float, float]]
"""One direction of a spring: where each polynomial begins [rad], and a, b, c of it."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A polynomial outside of a dead band.

    Attributes
    ----------
    coefficients : a, b, c of a x + b x² + c x³, with x how far the deflection is outside
    low, high : the band [rad]
    """

    coefficients: tuple[float, float, float]
    low: float
    high: float


def pieces(
    transmission: KnownTransmission, arm: float | None, cubic: float, asymmetry: float, gap: float
) -> tuple[list[Piece], float]:
    """Return the terms of a spring, and up to which deflection beyond the gap they hold [rad].

    Parameters
    ----------
    transmission : whose law it is
    arm : lever arm [m] of one that has a lever
    cubic, asymmetry, gap : what effects add: [N·m/rad³], [1], [rad]
    """
    law = _polynomial(transmission)
    if law is not None:
        forward: Half = [(0.0, law[0], law[1], law[2] + cubic)]
        backward: Half = [(0.0, law[0], -law[1], law[2] + cubic)]
        reach = np.inf
    else:
        forward, backward, reach = _splines(transmission, arm, cubic)
    # One tendon has both directions where no sign of the deflection matters, or where it is the polynomial's own.
    if not asymmetry and (law is not None or forward == backward):
        return [Piece((a, b, c), -0.5 * gap - d, 0.5 * gap + d) for d, a, b, c in forward], reach
    far = 2.0 * np.pi * 1e3  # the far end of a one-sided dead band: no joint winds up so far
    up, down = 1.0 + asymmetry, 1.0 - asymmetry
    one_way = [Piece((up * a, up * b, up * c), -far, 0.5 * gap + d) for d, a, b, c in forward]
    other_way = [Piece((down * a, -down * b, down * c), -0.5 * gap - d, far) for d, a, b, c in backward]
    return one_way + other_way, reach


def _polynomial(transmission: KnownTransmission) -> tuple[float, float, float] | None:
    """Return the coefficients of a law that is a polynomial of third order."""
    match transmission:
        case LinearTransmission(stiffness=k):
            return k, 0.0, 0.0
        case CubicTransmission(stiffness=k1, cubic=k3):
            return k1, 0.0, k3
        case PolynomialTransmission(coefficients=c, scale=s) if len(c) <= 3:
            a, b, cubed = (*c, 0.0, 0.0)[:3]
            return a / s, b / s**2, cubed / s**3
    return None


def _reach(transmission: KnownTransmission) -> float:
    """Return the deflection up to which a law is followed [rad]."""
    match transmission:
        case Vsa2Transmission(geometry=c):
            return float(0.9 * 2.0 * np.arcsin(1.0 / c))  # its torque grows without bound towards the singularity
        case AwasTransmission():
            return 0.25 * np.pi  # beyond it the torque falls
        case ExponentialTransmission(scale=s):
            return 5.0 * s  # where it is 74 times as stiff as at rest
        case PolynomialTransmission(scale=s):
            return 2.0 * s
    raise AssertionError("a law of third order needs no spline")


def _splines(transmission: KnownTransmission, arm: float | None, cubic: float) -> tuple[Half, Half, float]:
    bare = replace(transmission, added_cubic=cubic, asymmetry=0.0, backlash=0.0, drift=0.0)
    reach = _reach(bare)

    def forward(u: Array) -> Array:
        return flexibility_torque(bare, u, arm)

    def backward(u: Array) -> Array:
        return -flexibility_torque(bare, -u, arm)

    ends = [(float(stiffness(bare, side * 0.0, arm)), float(stiffness(bare, side * reach, arm))) for side in (1, -1)]
    grid = np.linspace(0.0, reach, 50)
    odd = bool(np.allclose(forward(grid), backward(grid), rtol=1e-9))
    ahead = _half(forward, ends[0], reach, odd)
    return ahead, ahead if odd else _half(backward, ends[1], reach, odd), reach


def _half(torque: Callable[[Array], Array], slopes: tuple[float, float], reach: float, odd: bool) -> Half:
    """Return a spline that is within a thousandth of the torque, or has 64 parts."""
    checked = np.linspace(0.0, reach, 1001)
    wanted = torque(checked)
    # The error of a cubic over a part goes with the fourth derivative and the part's length to the fourth.
    derivative = wanted
    for _ in range(4):
        derivative = np.gradient(derivative, checked)
    density = np.abs(derivative) ** 0.25
    passed = np.cumsum(density + 1e-3 * np.max(density))
    for parts in range(2, 65):
        knots = np.interp(np.linspace(passed[0], passed[-1], parts + 1), passed, checked)
        ends: Any = ((2, 0.0) if odd else (1, slopes[0]), (1, slopes[1]))
        spline = CubicSpline(knots, torque(knots), bc_type=ends)
        if np.all(np.abs(spline(checked) - wanted) <= 1e-3 * np.abs(wanted)):
            break
    c, b, a, _ = spline.c
    first = (0.0, float(a[0]), 0.0 if odd else float(b[0]), float(c[0]))
    return [first, *((float(d), 0.0, 0.0, float(step)) for d, step in zip(knots[1:-1], np.diff(c), strict=True))]
