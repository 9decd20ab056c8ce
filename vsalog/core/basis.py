"""The functions a flexibility torque is fitted with, and their derivatives in the deflection.

Flacco 2012 eq. 25–29 and 35–37: products of powers of the deflection φ and of the set-point (θ_c or r). Powers are taken of
φ / deflection_scale and set-point / setpoint_scale; with both 1 the coefficients are the papers'. A spring with a corner or a
knee is no polynomial: knots add pieces of parabolas, a quadratic spline in the form of truncated powers (Ruppert, Wand, Carroll,
*Semiparametric Regression*, 2003, §3.6), whose stiffness is a line from knot to knot; corners, at which the stiffness jumps,
add ramps. A torque that is no polynomial of the set-point gets quadratic B-splines of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class PolynomialBasis:
    """Products of powers of deflection and set-point, in the order φ-term by φ-term, set-point powers rising within.

    After the powers come the pieces that begin at knots u₀ = 0, 1/K … (K − 1)/K of the deflection scale: (u − u₀)² beyond each
    knot on the positive side, then −(−u − u₀)² on the negative one; after them the ramps that begin at corners, away from zero.
    Last are the powers of the deflection, each times the uniform quadratic B-splines of the set-point (de Boor, *A Practical
    Guide to Splines*, 2001, ch. IX).

    Attributes
    ----------
    powers : exponents of φ / deflection_scale
    setpoint_order : m, number of powers of the set-point (1: none)
    deflection_scale : [rad]
    setpoint_scale : [rad or m]
    branches : the functions exist twice, first for loading, then for unloading
    knots : K, on either side of zero
    setpoint_knots : evenly ascending borders of the B-splines' pieces, two at least [rad or m]; none for no B-splines
    corners : deflections at which the stiffness jumps [rad]
    """

    powers: tuple[int, ...]
    setpoint_order: int = 1
    deflection_scale: float = 1.0
    setpoint_scale: float = 1.0
    branches: bool = False
    knots: int = 0
    setpoint_knots: tuple[float, ...] = ()
    corners: tuple[float, ...] = ()

    @classmethod
    def make(
        cls,
        order: int,
        *,
        odd: bool = True,
        setpoint_order: int = 1,
        deflection_scale: float = 1.0,
        setpoint_scale: float = 1.0,
        branches: bool = False,
        knots: int = 0,
        setpoint_knots: tuple[float, ...] = (),
        corners: tuple[float, ...] = (),
    ) -> PolynomialBasis:
        """Build the odd basis φ, φ³, …, φ^(2n−1) (eq. 26, 35) or the full one φ⁰, …, φ^(n−1) (eq. 29)."""
        powers = tuple(2 * h + 1 if odd else h for h in range(order))
        return cls(powers, setpoint_order, deflection_scale, setpoint_scale, branches, knots, setpoint_knots, corners)

    @property
    def size(self) -> int:
        """Number of functions: `shapes`·m and n times the B-splines, twice that with branches."""
        return (self.shapes * self.setpoint_order + len(self.powers) * self.bumps) * (2 if self.branches else 1)

    @property
    def has_setpoint(self) -> bool:
        """Whether functions depend on the set-point."""
        return self.setpoint_order > 1 or bool(self.setpoint_knots)

    @property
    def bumps(self) -> int:
        """Number of B-splines of the set-point: one more at either end than there are pieces."""
        return len(self.setpoint_knots) + 1 if self.setpoint_knots else 0

    @property
    def shapes(self) -> int:
        """Number of functions of the deflection alone, of one branch: n + 2 K, and one for each corner."""
        return len(self.powers) + 2 * self.knots + len(self.corners)

    @property
    def powers_of_terms(self) -> tuple[int, ...]:
        """The power of the deflection in each function; −1 of a piece that begins at a knot."""
        own = (*self.powers, *[-1] * (2 * self.knots), *[1] * len(self.corners))
        bumps = (i for i in self.powers for _ in range(self.bumps))
        return (*(i for i in own for _ in range(self.setpoint_order)), *bumps) * (2 if self.branches else 1)

    @property
    def pieces(self) -> tuple[bool, ...]:
        """Which functions cover only a part of the deflection's or the set-point's range."""
        powers, bumps = len(self.powers), len(self.powers) * self.bumps
        own = [False] * powers + [True] * (self.shapes - powers)
        return (*(i for i in own for _ in range(self.setpoint_order)), *[True] * bumps) * (2 if self.branches else 1)

    @property
    def terms(self) -> list[str]:
        """Names of the functions, e.g. ``phi^3*c^2``, with ``loading:`` or ``unloading:`` in front where there are branches."""
        at = [f"{side}{i / self.knots:.4g}" for side in "+-" for i in range(self.knots)]
        shapes = [*(f"phi^{i}" if i else "" for i in self.powers), *(f"knot({place})" for place in at)]
        shapes += [f"corner({place:.4g})" for place in self.corners]
        plain = [
            "*".join(part for part in (shape, f"c^{j}" if j else "") if part) or "1"
            for shape in shapes
            for j in range(self.setpoint_order)
        ] + [f"{shape}*b{k}(c)".lstrip("*") for shape in shapes[: len(self.powers)] for k in range(self.bumps)]
        return [f"{b}:{t}" for b in ("loading", "unloading") for t in plain] if self.branches else plain

    def rows(
        self, phi: Array, setpoint: Array | None = None, derivatives: int = 3, loading: Flags | None = None
    ) -> Array:
        """Evaluate the functions and their derivatives in φ.

        Parameters
        ----------
        phi : shape (n,), deflection [rad]
        setpoint : shape (n,), in SI; None where the basis has no set-point
        derivatives : highest derivative
        loading : shape (n,), which branch a sample is on; loading everywhere when absent

        Returns
        -------
        shape (n, derivatives + 1, size): [:, 0] are F, [:, 1] ∂F/∂φ, … (eq. 26–28); all NaN where φ is
        """
        products = self.shapes * self.setpoint_order
        plain = np.empty((phi.shape[0], derivatives + 1, products))
        c = phi if setpoint is None else setpoint
        _rows(
            np.ascontiguousarray(phi),
            np.ascontiguousarray(c),
            np.array(self.powers, dtype=np.int64),
            self.knots,
            np.array(self.corners, dtype=np.float64),
            self.setpoint_order,
            self.deflection_scale,
            self.setpoint_scale,
            plain,
        )
        if self.bumps:
            powers = plain[:, :, : len(self.powers) * self.setpoint_order : self.setpoint_order]
            bumped = powers[..., None] * _b_splines(c, self.setpoint_knots)[:, None, None, :]
            plain = np.concatenate((plain, bumped.reshape(*plain.shape[:2], -1)), axis=2)
        if not self.branches:
            return plain
        on = (np.ones(phi.shape[0], dtype=np.bool_) if loading is None else loading)[:, None, None]
        return np.concatenate((np.where(on, plain, 0.0), np.where(on, 0.0, plain)), axis=2)


def _b_splines(c: Array, borders: tuple[float, ...]) -> Array:
    """Return the uniform quadratic B-splines on evenly ascending borders, shape (n, pieces + 2); NaN where c is."""
    pieces = len(borders) - 1
    place = (c - borders[0]) * (pieces / (borders[-1] - borders[0]))
    off = np.abs(place[:, None] - (np.arange(pieces + 2) - 0.5))
    tails = 0.5 * np.square(np.maximum(1.5 - off, 0.0))
    return np.asarray(np.where(off < 0.5, 0.75 - off**2, tails))


@compiled
def linear(rows: Array, coefficients: Array, covariance: Array) -> tuple[Array, Array]:
    """Return functions × coefficients and its standard deviation, shape (N,) each.

    Parameters
    ----------
    rows : shape (N, n)
    coefficients : shape (n,)
    covariance : of the coefficients, shape (n, n)
    """
    count, n = rows.shape
    value, deviation = np.empty(count), np.empty(count)
    for k in range(count):
        total, variance = 0.0, 0.0
        for i in range(n):
            total += rows[k, i] * coefficients[i]
            row = 0.0
            for j in range(n):
                row += covariance[i, j] * rows[k, j]
            variance += rows[k, i] * row
        value[k], deviation[k] = total, np.sqrt(variance)
    return value, deviation


@compiled
def _rows(
    phi: Array, c: Array, powers: NDArray[np.int64], knots: int, corners: Array, m: int, phi_0: float, c_0: float, out: Array
) -> None:  # fmt: skip
    for k in range(out.shape[0]):
        x, y = phi[k] / phi_0, c[k] / c_0
        for h in range(powers.shape[0]):
            n = powers[h]
            factor, scale = 1.0, 1.0
            for s in range(out.shape[1]):
                power = 1.0
                for _ in range(n - s):
                    power *= x
                value = factor * scale * power if n >= s else 0.0
                if math.isnan(x):
                    value = x  # also where the function, or its derivative, is a constant
                for j in range(m):
                    out[k, s, h * m + j] = value
                    value *= y
                factor *= n - s
                scale /= phi_0
        for h in range(2 * knots):
            side = 1.0 if h < knots else -1.0
            beyond = side * x - (h % knots) / knots
            scale = side
            for s in range(out.shape[1]):
                value = 0.0
                if beyond > 0.0 and s < 3:
                    value = scale * (beyond * beyond if s == 0 else 2.0 * beyond if s == 1 else 2.0)
                if math.isnan(x):
                    value = x
                for j in range(m):
                    out[k, s, (powers.shape[0] + h) * m + j] = value
                    value *= y
                scale *= side / phi_0
        for h in range(corners.shape[0]):
            side = 1.0 if corners[h] >= 0.0 else -1.0
            beyond = (phi[k] - corners[h]) / phi_0
            for s in range(out.shape[1]):
                value = 0.0
                if side * beyond > 0.0 and s < 2:
                    value = beyond if s == 0 else 1.0 / phi_0
                if math.isnan(x):
                    value = x
                for j in range(m):
                    out[k, s, (powers.shape[0] + 2 * knots + h) * m + j] = value
                    value *= y
