"""Whether a fit's residual has a shape over the deflection, as where its basis cannot follow the spring.

Backlash, a stop or a spring that stiffens suddenly are smoothed by a basis of a few terms: the residual is small, and the
stiffness, which is the torque's slope, is off by a lot. The residual is averaged in bins of the deflection; from bin to bin it
changes by what the stiffness lacks. That is done twice, with every other stretch of the log, and what both have in common is no
noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.check import Context
from vsalog.checks.motor_reference import motor_trace
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device, TransmissionView, deflection_of, has_deflection

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Bins, fewer where one would have less than so many of the encoders' steps, but no fewer than tell a shape.
BINS, STEPS, FEWEST = 40, 2.0, 8
# A deflection that spans fewer of the encoders' steps may hide a gap of two of them from a stiffness.
HIDES = 20.0
# What is beyond these parts of the deflection is too seldom to count.
RANGE = (0.005, 0.995)
# So many stretches of the log, and samples of a bin in either half; so many times more where they are spread evenly.
STRETCHES, SAMPLES, SPREAD = 40, 20, 3
# A stiffness that lacks so much of itself is found, or so many of its deviations where these are more: the fewer, the better both
# halves agree, and none where they agree less. Of 1100 estimates of sound springs, 500 to 36 000 pulses a turn, none is found.
LACKS = 0.05
ALIKE, BEYOND = (0.6, 0.9), (3.0, 0.9)


SHAPES = ("residual.shape_over_deflection", "deflection.hides_shape", "residual.shape_over_position")


@dataclass(slots=True)
class _Bins:
    """Sums per half and bin: how many, of the deflection, of the residual, of the stiffness, of its relative variance."""

    edges: Array
    sums: Array

    @property
    def claimed(self) -> float:
        """The stiffness' deviation as a part of it, root mean square."""
        count, variance = self.sums[..., 0].sum(), self.sums[..., 4].sum()
        return float((variance / count) ** 0.5) if count else np.inf


class ShapeOverDeflection:
    """Looks for a shape of the residual over the deflection."""

    name = "deflection_shape"
    # What follows the motor's motion has a shape over the deflection, too, where both go together; and that over positions. A
    # spring that changes leaves shapes over whatever changes along with it.
    supersedes: Mapping[str, Sequence[str]] = {
        "residual.follows_motion": SHAPES,
        "stiffness.drifts": SHAPES,
        "residual.shape_over_deflection": SHAPES[-1:],
        "deflection.hides_shape": SHAPES[-1:],
    }

    def start(self, context: Context) -> SpringShape:
        """Begin with a log."""
        return SpringShape(context.device, context.look)


class SpringShape:
    """The residual of a joint's torques, over their deflections.

    Parameters
    ----------
    device : of the joint
    look : the signals from which the deflections' ranges are taken
    """

    def __init__(self, device: Device, look: JointSignals) -> None:
        self.device, self.look = device, look
        self.stretch = float(np.ptp(look.time)) / STRETCHES
        self.bins: dict[str, _Bins] = {}
        self.spans: dict[str, float] = {}
        self.excited: set[str] = set()
        self.knows_torque = False
        for view in device.transmissions:
            if not has_deflection(look.roles, view):
                continue
            edges, self.spans[view.name] = _edges(look, view)
            if edges is not None:
                self.bins[view.name] = _Bins(edges, np.zeros((2, edges.size + 1, 5)))

    def add(self, trace: Trace) -> None:
        """Take a block of the estimates into account."""
        self.excited |= {name for name, columns in trace.transmissions.items() if np.any(columns["excited"])}
        half = np.floor(trace.time / self.stretch).astype(np.int64) % 2 if self.stretch > 0.0 else None
        for name, bins in self.bins.items():
            columns = trace.transmissions.get(name)
            if columns is None or half is None:
                continue
            deflection, torque, fit, stiffness, std = (
                np.asarray(columns[c], float)
                for c in ("deflection", "flexibility_torque", "flexibility_torque_fit", "stiffness", "stiffness_std")
            )
            left = torque - fit
            self.knows_torque |= bool(np.isfinite(torque).any())
            use = np.asarray(columns["excited"], bool) & np.isfinite(left + deflection + stiffness)
            if not use.any():
                continue
            halves, places, _ = bins.sums.shape
            cell = half[use] * places + np.searchsorted(bins.edges, deflection[use])
            variance = (std[use] / stiffness[use]) ** 2
            for k, values in enumerate((None, deflection[use], left[use], stiffness[use], variance)):
                bins.sums[..., k] += np.bincount(cell, values, halves * places).reshape(halves, places)

    def findings(self) -> list[Finding]:
        """Return of which transmissions the stiffness lacks something that both halves of the log agree on.

        Of a method that knows no torque beside what it fits, the residual of the motor's side shows in its place what the basis
        cannot follow.
        """
        if self.bins and not self.knows_torque and (trace := motor_trace(self.device, self.look)) is not None:
            self.add(trace)
        shapes = {name: found for name, bins in self.bins.items() if (found := self._of(name, bins)) is not None}
        hidden = (
            Finding(code="deflection.hides_shape", joint=self.device.joint, part=name, value=span, limit=HIDES)
            for name, span in self.spans.items()
            if span < HIDES and name in self.excited and name not in shapes
        )
        return [*shapes.values(), *hidden]

    def _of(self, name: str, bins: _Bins) -> Finding | None:
        found = _lacking(bins)
        if found is None or found.alike < ALIKE[0]:
            return None
        limit = max(LACKS, float(np.interp(found.alike, ALIKE, BEYOND)) * bins.claimed)
        if found.part < limit:
            return None
        k = int(np.argmax(np.abs(found.lacks)))
        return Finding(
            code="residual.shape_over_deflection",
            joint=self.device.joint,
            part=name,
            value=found.part,
            limit=limit,
            evidence={"deflection": float(found.deflection[k]), "stiffness_change": float(found.lacks[k])},
        )


def _edges(look: JointSignals, view: TransmissionView) -> tuple[Array | None, float]:
    """Return the inner edges of the bins of a deflection [rad], None where too little is known for them; and how many steps of
    its encoders it spans.
    """
    deflection = deflection_of(look.roles, view)
    known = deflection[np.isfinite(deflection)]
    if known.size == 0:
        return None, np.inf
    low, high = np.quantile(known, RANGE)
    step = max((look.resolution.get(role, 0.0) for role in view.deflection_roles(look.roles)), default=0.0)
    span = float(high - low) / step if step > 0.0 else np.inf
    count = int(min(BINS, known.size // (2 * SPREAD * SAMPLES), span / STEPS))
    return (np.linspace(low, high, count + 1) if count >= FEWEST else None), span


class _Lacking(NamedTuple):
    """What a stiffness lacks as a part of it, on average; how well both halves agree; per bin; at which deflection [rad]."""

    part: float
    alike: float
    lacks: Array
    deflection: Array


def _lacking(bins: _Bins) -> _Lacking | None:
    """Return what the stiffness lacks; None where too few bins tell."""
    sums = bins.sums[:, 1:-1]
    count = sums[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        deflection, left, stiffness = (sums[..., k] / count for k in (1, 2, 3))
        slope = (left[:, 2:] - left[:, :-2]) / (deflection[:, 2:] - deflection[:, :-2])
        lacks = slope / stiffness.mean(axis=0)[1:-1]
    enough = np.asarray((count >= SAMPLES).all(axis=0))
    good = enough[2:] & enough[1:-1] & enough[:-2] & np.asarray(np.isfinite(lacks).all(axis=0))
    if np.count_nonzero(good) < FEWEST - 2:
        return None
    one, other = lacks[:, good]
    weights = count.sum(axis=0)[1:-1][good]
    both = float(np.average(one * other, weights=weights))
    power = float(np.average(0.5 * (one**2 + other**2), weights=weights))
    alike = both / power if power > 0.0 else 0.0
    return _Lacking(max(both, 0.0) ** 0.5, alike, 0.5 * (one + other), deflection.mean(axis=0)[1:-1][good])
