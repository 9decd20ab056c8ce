"""Whether a fit's residual has a shape over a position, as where an encoder reads unevenly round its turn.

A disc that is off its centre, or an encoder with an error that returns several times a turn, makes of the deflection one that is
off by a function of a position; so do cogging, a cable and gravity of a torque. A fit takes for the spring's what it can of that,
and is off. The residual goes with no speed or acceleration, and averages out where the joint turns quickly; but at the same
position it is the same again. It is averaged in bins of each position, twice, with every other stretch of the log, and what both
have in common is no noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.check import Context
from vsalog.checks.motor_reference import motor_trace
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device
from vsalog.estimators.regression import RegressionFold

Array = NDArray[np.float64]

# Bins of a position, and what is beyond these parts of it is too seldom to count.
BINS, RANGE = 40, (0.005, 0.995)
# So many stretches of the log; samples of a bin in either half, and bins that show a shape.
STRETCHES, SAMPLES, FEWEST = 40, 20, 12
# What both halves have in common is found: as a part of the torque, of the residual, and of what either half has alone. Of
# sound logs it is 0.002, 0.06 and 0.3 at most; a link's encoder off by 5 mrad seven times a turn makes it 0.04, 0.6 and 0.8.
PART, EXPLAINED, ALIKE = 0.006, 0.15, 0.45
# What moves the deflection by less than this part of its encoders' steps is what rounding makes.
REACH = 0.3


@dataclass(slots=True)
class _Bins:
    """Sums per half and bin: how many, of the residual; over all of them, of its square and the torque's, of torque and
    stiffness; and the step of the deflection's encoders [rad].
    """

    edges: Array
    sums: Array
    whole: Array
    step: float


class ShapeOverPosition:
    """Looks for a shape of the residual over a position, of estimators that fit torques."""

    name = "position_shape"
    supersedes: Mapping[str, Sequence[str]] = {}

    def start(self, context: Context) -> PositionShape:
        """Begin with a log."""
        fold = context.fold
        return PositionShape(context.device, context.look, isinstance(fold, RegressionFold) and fold.fits_torque)


class PositionShape:
    """The residual of a joint's torques, over its positions.

    Parameters
    ----------
    device : of the joint
    look : as much of the signals as is in memory
    fits_torque : whether the estimator fits torques; of others nothing is found
    """

    def __init__(self, device: Device, look: JointSignals, fits_torque: bool) -> None:
        self.device, self.look = device, look
        self.stretch = float(np.ptp(look.time)) / STRETCHES
        self.bins: dict[tuple[str, str], _Bins] = {}
        self.knows_torque = False
        for view in device.transmissions if fits_torque else ():
            step = max((look.resolution.get(r, 0.0) for r in view.deflection_roles(look.roles)), default=0.0)
            for role in (view.motor_position, "link_position"):
                if (edges := _edges(look.roles.get(role))) is not None:
                    self.bins[view.name, role] = _Bins(edges, np.zeros((2, BINS + 2, 2)), np.zeros(5), step)

    def add(self, trace: Trace) -> None:
        """Take a block of the estimates into account."""
        if self.stretch <= 0.0:
            return
        place = np.minimum(np.searchsorted(self.look.stamps, trace.stamps), len(self.look) - 1)
        here = self.look.stamps[place] == trace.stamps
        half = np.floor(trace.time / self.stretch).astype(np.int64) % 2
        for (name, role), bins in self.bins.items():
            columns = trace.transmissions.get(name)
            if columns is None:
                continue
            torque, fit = (np.asarray(columns[c], float) for c in ("flexibility_torque", "flexibility_torque_fit"))
            position, left = self.look.roles[role][place], torque - fit
            self.knows_torque |= bool(np.isfinite(torque).any())
            use = here & np.asarray(columns["excited"], bool) & np.isfinite(left + position)
            cell = half[use] * (BINS + 2) + np.searchsorted(bins.edges, position[use])
            for k, values in enumerate((None, left[use])):
                bins.sums[..., k] += np.bincount(cell, values, 2 * (BINS + 2)).reshape(2, BINS + 2)
            stiffness = np.asarray(columns["stiffness"], float)[use]
            summed = left[use] ** 2, torque[use] ** 2, torque[use], stiffness
            bins.whole += [np.count_nonzero(use), *(values.sum() for values in summed)]

    def findings(self) -> list[Finding]:
        """Return over which positions of which transmissions both halves of the log have a residual in common."""
        if self.bins and not self.knows_torque and (trace := motor_trace(self.device, self.look)) is not None:
            self.add(trace)
        found: dict[str, tuple[str, float]] = {}
        for (name, role), bins in self.bins.items():
            share = _common(bins)
            if share > found.get(name, ("", 0.0))[1]:
                found[name] = role, share
        return [
            Finding(
                code="residual.shape_over_position",
                joint=self.device.joint,
                part=name,
                value=share,
                limit=PART,
                evidence={"position": role},
            )
            for name, (role, share) in found.items()
        ]


def _edges(position: Array | None) -> Array | None:
    """Return the inner edges of the bins of a position [rad]; None where it is not recorded, or stands."""
    known = np.empty(0) if position is None else position[np.isfinite(position)]
    if known.size < FEWEST * SAMPLES or np.ptp(known) == 0.0:
        return None
    low, high = np.quantile(known, RANGE)
    return np.linspace(low, high, BINS + 1)


def _common(bins: _Bins) -> float:
    """Return what both halves have in common, root mean square, as a part of the torque's; 0 where that is too little."""
    count, left = bins.sums[:, 1:-1, 0], bins.sums[:, 1:-1, 1]
    good = (count >= SAMPLES).all(axis=0)
    samples, squares, torques, torque, stiffness = bins.whole
    if np.count_nonzero(good) < FEWEST:
        return 0.0
    one, other = left[:, good] / count[:, good]
    weights = count.sum(axis=0)[good]
    both = float(np.average(one * other, weights=weights))
    power = float(np.average(0.5 * (one**2 + other**2), weights=weights))
    spread = torques - torque**2 / samples
    rounding = (REACH * bins.step * stiffness / samples) ** 2
    if both <= max(ALIKE * power, EXPLAINED * squares / samples, PART**2 * spread / samples, rounding):
        return 0.0
    return float((both * samples / spread) ** 0.5)
