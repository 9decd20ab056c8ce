"""Whether a fit's residual has a shape over the deflection or over a position.

Backlash, a stop or a spring that stiffens suddenly are smoothed by a basis of a few terms: the residual is small, but the
stiffness, which is the torque's slope, is wrong by much. An eccentric encoder disc, or one with several errors per turn, adds
a function of a position to the deflection; cogging, a cable and gravity add one to the torque. The residual depends on no speed
or acceleration, but repeats at the same place: piecewise linear functions of a deflection or a position, fitted to some blocks
of the log, predict it in others (`core/dependence.py`), beyond what the basis can follow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.check import Context
from vsalog.checks.motor_reference import motor_trace
from vsalog.checks.samples import FEWEST_LEVELS, span
from vsalog.core.basis import PolynomialBasis
from vsalog.core.dependence import Association, association, hats, least_squares
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.resolution import ROUNDED
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device, TransmissionView, deflection_of, has_deflection
from vsalog.estimators.equation import NEGLIGIBLE_SHARE, REPORTED_MISFIT
from vsalog.estimators.folding import BLOCK
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.row_moments import RowMoments, row_moments_block, row_moments_start

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Knots of a function of any shape [1]: more resolve a narrower gap, but then those of one block of the log are in no other, and
# a fit there predicts nothing.
KNOTS = 31
# The encoders' steps between two knots, at least [1]: a gap of that width shows in two.
STEPS_PER_KNOT = 2.0
DEFLECTION = "deflection"


SHAPES = ("residual.shape_over_deflection", "deflection.hides_shape", "residual.shape_over_position")


class ShapeOfResidual:
    """Searches a shape of the residual over the deflection, and over positions where an estimator fits torques."""

    name = "residual_shape"
    # A residual that follows the motor's motion also has a shape over a correlated deflection, and that one over positions. A
    # spring that changes gives shapes over whatever changes along with it.
    supersedes: Mapping[str, Sequence[str]] = {
        "residual.follows_motion": SHAPES,
        "stiffness.drifts": SHAPES,
        "residual.shape_over_deflection": SHAPES[-1:],
        "deflection.hides_shape": SHAPES[-1:],
    }

    def start(self, context: Context) -> ResidualShapes:
        """Begin with a log."""
        fold = context.fold
        return ResidualShapes(context.device, context.look, isinstance(fold, RegressionFold) and fold.fits_torque)


@dataclass(slots=True)
class _Rows:
    """The moments of a transmission's residual, and sums that its size is compared with.

    Attributes
    ----------
    knots : variable → knots of its functions, shape (k,)
    moments : over a constant, the basis' functions, those of the variables, and the residual
    over : shape (k, 2), how often the deflection is near each knot, and the stiffness there
    whole : sums over all samples: how many, torque, its square, stiffness, its relative variance
    """

    knots: dict[str, Array]
    moments: RowMoments
    over: Array
    whole: Array = field(default_factory=lambda: np.zeros(5))

    def columns(self, name: str) -> list[int]:
        """Return the columns of a variable's functions."""
        first = self.moments.row.size - 1 - sum(k.size for k in self.knots.values())
        for other, knots in self.knots.items():
            if other == name:
                return list(range(first, first + knots.size))
            first += knots.size
        raise KeyError(name)


class ResidualShapes:
    """The residual of a joint's torques, over deflections and positions.

    Parameters
    ----------
    device : of the joint
    look : as much of the signals as is in memory: ranges are taken from it, and the positions at a trace's rows
    fits_torque : whether the estimator fits torques; for others no shape over a position is found
    """

    def __init__(self, device: Device, look: JointSignals, fits_torque: bool) -> None:
        self.device, self.look = device, look
        self.rows: dict[str, _Rows] = {}
        self.spans: dict[str, float] = {}
        self.steps: dict[str, float] = {}
        self.excited: set[str] = set()
        self.knows_torque = False
        for view in device.transmissions:
            if has_deflection(look.roles, view):
                self._begin(view, fits_torque)

    def _begin(self, view: TransmissionView, fits_torque: bool) -> None:
        name, look = view.name, self.look
        step = max((look.resolution.get(r, 0.0) for r in view.deflection_roles(look.roles)), default=0.0)
        phi = _knots(deflection_of(look.roles, view), step)
        self.steps[name], self.spans[name] = step, _span(deflection_of(look.roles, view), step)
        knots = {} if phi is None else {DEFLECTION: phi}
        for role in (view.motor_position, "link_position") if fits_torque else ():
            if role in look.roles and (own := _knots(look.roles[role], 0.0)) is not None:
                knots[role] = own
        if knots:
            size = 1 + self.device.basis.size + sum(k.size for k in knots.values()) + 1
            self.rows[name] = _Rows(knots, row_moments_start(size), np.zeros((0 if phi is None else phi.size, 2)))

    def add(self, trace: Trace) -> None:
        """Take a block of the estimates into account."""
        self.excited |= {name for name, columns in trace.transmissions.items() if np.any(columns["excited"])}
        for begin in range(0, len(trace), BLOCK):
            for name in self.rows:
                if name in trace.transmissions:
                    self._add(name, trace, slice(begin, begin + BLOCK))

    def _add(self, name: str, trace: Trace, part: slice) -> None:
        rows, columns = self.rows[name], trace.transmissions[name]
        phi, torque, fit, stiffness, std = (
            np.asarray(columns[c], float)[part]
            for c in ("deflection", "flexibility_torque", "flexibility_torque_fit", "stiffness", "stiffness_std")
        )
        self.knows_torque |= bool(np.isfinite(torque).any())
        use = np.asarray(columns["excited"], bool)[part] & np.isfinite(torque - fit + phi + stiffness)
        values = {DEFLECTION: phi}
        positions = [role for role in rows.knots if role != DEFLECTION]
        if positions:
            stamps = trace.stamps[part]
            place = np.minimum(np.searchsorted(self.look.stamps, stamps), len(self.look) - 1)
            use &= self.look.stamps[place] == stamps
            values |= {role: self.look.roles[role][place] for role in positions}
        for over, knots in rows.knots.items():
            use &= (values[over] >= knots[0]) & (values[over] <= knots[-1])
        if not use.any():
            return
        basis = basis_rows(self.device.basis, columns, part)
        functions = [hats(values[over], knots) for over, knots in rows.knots.items()]
        z = np.column_stack((np.ones(phi.size), basis, *functions, torque - fit))
        rows.moments = row_moments_block(rows.moments, z, use, np.zeros_like(use), 1)
        if DEFLECTION in rows.knots:
            near = functions[0][use]
            rows.over += np.stack((near.sum(axis=0), near.T @ stiffness[use]), axis=1)
        variance = (std[use] / stiffness[use]) ** 2
        summed = np.ones_like(variance), torque[use], torque[use] ** 2, stiffness[use], variance
        rows.whole += np.array([values.sum() for values in summed])

    def findings(self) -> list[Finding]:
        """Return over what the residuals of which transmissions have a shape.

        For a method without a measured torque, the residual of the motor's side shows what the basis cannot follow.
        """
        if self.rows and not self.knows_torque and (trace := motor_trace(self.device, self.look)) is not None:
            self.add(trace)
        lacking = {name: found for name, rows in self.rows.items() if (found := self._lacks(name, rows)) is not None}
        over_positions = (
            []
            if lacking
            else [f for name, rows in self.rows.items() if (f := self._over_position(name, rows)) is not None]
        )
        hidden = (
            Finding(
                code="deflection.hides_shape",
                joint=self.device.joint,
                part=name,
                value=steps,
                limit=float(FEWEST_LEVELS),
            )
            for name, steps in self.spans.items()
            if steps < FEWEST_LEVELS and name in self.excited and name not in lacking
        )
        return [*(lacking.values() or over_positions), *hidden]

    def _depends(self, rows: _Rows, name: str) -> Association | None:
        """Return how the residual depends on a variable beyond the basis; None where it may be chance.

        An offset, which an odd basis cannot follow, is no dependence.
        """
        basis = range(1 + self.device.basis.size)
        tried = sum(len(other.knots) for other in self.rows.values())
        found = association(rows.moments.blocks, rows.columns(name), basis)
        return found if found is not None and found.p_value * tried <= FALSE_ALARM else None

    def _lacks(self, name: str, rows: _Rows) -> Finding | None:
        """Return the stiffness that the fit lacks."""
        if DEFLECTION not in rows.knots or self._depends(rows, DEFLECTION) is None:
            return None
        knots, blocks, own = rows.knots[DEFLECTION], rows.moments.blocks, rows.columns(DEFLECTION)
        count, stiffness = rows.over[1:-1].T
        with np.errstate(divide="ignore", invalid="ignore"):
            # Noise is independent in the two halves.
            one, other = (
                (f[2:] - f[:-2]) / (knots[2:] - knots[:-2]) / (stiffness / count)
                for f in (least_squares(blocks[half::2].sum(axis=0), own) for half in range(2))
            )
        weights = np.where(np.isfinite(one * other), count, 0.0)
        one, other = np.nan_to_num(one), np.nan_to_num(other)
        part = float(np.sqrt(max(weights @ (one * other) / weights.sum(), 0.0)))
        limit = max(REPORTED_MISFIT, float(np.sqrt(rows.whole[4] / rows.whole[0])))
        if part < limit:
            return None
        lacks = 0.5 * (one + other)
        k = int(np.argmax(np.abs(lacks) * np.sqrt(weights)))
        evidence = {"deflection": float(knots[1 + k]), "stiffness_change": float(lacks[k])}
        return Finding(
            code="residual.shape_over_deflection",
            joint=self.device.joint,
            part=name,
            value=part,
            limit=limit,
            evidence=evidence,
        )

    def _over_position(self, name: str, rows: _Rows) -> Finding | None:
        """Return the position over which a residual has the largest shape."""
        samples, torque, squares, stiffness, _ = rows.whole
        best, size = "", 0.0
        for role in (r for r in rows.knots if r != DEFLECTION):
            found = self._depends(rows, role)
            if found is not None and found.share > 0.0:
                own = (found.share * found.power / max(rows.moments.rows, 1)) ** 0.5
                best, size = max((best, size), (role, own), key=lambda x: x[1])
        if not best:
            return None
        spread = float(np.sqrt(squares / samples - (torque / samples) ** 2))
        if size < max(NEGLIGIBLE_SHARE * spread, ROUNDED * self.steps[name] * stiffness / samples):
            return None
        return Finding(
            code="residual.shape_over_position",
            joint=self.device.joint,
            part=name,
            value=size / spread,
            limit=NEGLIGIBLE_SHARE,
            evidence={"position": best},
        )


def basis_rows(basis: PolynomialBasis, columns: Mapping[str, NDArray[np.generic]], part: slice) -> Array:
    """Return a basis' functions at some rows of a trace's columns, shape (N, n)."""
    phi = np.asarray(columns["deflection"], float)[part]
    setpoint = np.asarray(columns["setpoint"], float)[part] if basis.has_setpoint else None
    # Loaded or unloaded: of a basis with a branch for each.
    loading = np.gradient(phi) * phi > 0.0 if basis.branches and phi.size > 1 else None
    return basis.rows(phi, setpoint, 0, loading)[:, 0]


def _span(values: Array, step: float) -> float:
    """Return how many steps of its encoders a deflection spans."""
    low, high = span(values)
    return (high - low) / step if step > 0.0 and np.isfinite(values).any() else np.inf


def _knots(values: Array, step: float) -> Array | None:
    """Return the knots of functions of a deflection or a position [rad]; None where it hardly moves, or is not recorded."""
    low, high = span(values)
    steps = _span(values, step)
    if not high > low or steps < FEWEST_LEVELS:
        return None
    return np.linspace(low, high, int(min(KNOTS, steps / STEPS_PER_KNOT + 1)))


TEXTS = {
    "deflection.hides_shape": Text(
        "transmission {part}: the deflection spans only {value:.0f} of its encoders' steps: the log cannot show whether the"
        " spring has backlash, a stop or a knee within two of them, and the stiffness would then be wrong by more than its"
        " standard deviation.",
        "Move the joint more, or use encoders of finer resolution.",
    ),
    "residual.shape_over_deflection": Text(
        "transmission {part}: the residual depends on the deflection: the stiffness is wrong by at least {value:.0%} on"
        " average, at {deflection:.3g} rad the spring's differs by {stiffness_change:+.0%} from the estimate. The basis"
        " cannot follow the spring, as with backlash, a stop or too few terms.",
        "Add terms to [joint.{joint}.basis] in the rig; 'vsalog diagnose' finds the cause.",
    ),
    "residual.shape_over_position": Text(
        "transmission {part}: the residual depends on {position}, {value:.1%} of the torque: an encoder that is nonlinear"
        " over its turn (eccentric, or with several errors per turn), or a torque that depends on the position"
        " (cogging, gravity, a cable). The stiffness may be wrong by several times as much, and by more than its standard"
        " deviation says.",
        "'vsalog diagnose' finds the cause.",
    ),
}
add_texts(TEXTS)
