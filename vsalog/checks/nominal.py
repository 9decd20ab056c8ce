"""Stiffness and torque beside the rig's own spring: a torque in the wrong unit, or a gear that is counted once too often."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.check import Context, Watch
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device, TransmissionView
from vsalog.mechanics.transmissions import torque_and_stiffness
from vsalog.rig.schema import UnknownTransmission
from vsalog.uncertainty.errors_in_variables import MOST_NOISE

Array = NDArray[np.float64]

# A scale that is wrong by ten is nearer than a spring that is off by this factor, on a logarithmic scale.
LARGEST_RATIO = 10.0**0.5


class NominalSpring:
    """Compares the stiffness with that of the rig, and the motor's torque with what moves the rig's motor and spring.

    Of a motor's torque that is recorded ten times too large the spring's torque seems to be most: the stiffness is too large.
    Of one that is too small the motor's inertia is, and there is no stiffness that could be compared.
    """

    name = "nominal"
    supersedes: Mapping[str, Sequence[str]] = {
        "stiffness.scale": ("motor_torque.scale",),
        "motor_torque.scale": ("stiffness.negative",),
    }

    def start(self, context: Context) -> Watch | None:
        """Begin, where the rig has a spring of known type."""
        views = [v for v in context.device.transmissions if not isinstance(v.nominal, UnknownTransmission)]
        motors = [v.name for v in views if v.motor_torque in context.read and v.motor.inertia is not None]
        return _Ratios(context.device, views, context.signals, motors) if views else None


class _Ratios:
    def __init__(
        self, device: Device, views: Sequence[TransmissionView], signals: JointSignals, motors: Sequence[str]
    ) -> None:
        self.device, self.views, self.signals = device, views, signals
        # Second moments of a motor's torque, recorded and expected: of the expected one, of both, of the recorded one.
        self.torques = {name: np.zeros(3) for name in motors}
        # Of each block, of excited samples and of the others: how many, median of log σ/σ_rig, median of σ_rig.
        self.medians: dict[tuple[str, bool], list[tuple[int, float, float]]] = {}

    def add(self, trace: Trace) -> None:
        """Take a block of the estimates into account."""
        for view in self.views:
            columns = trace.transmissions.get(view.name)
            if columns is None:  # of a method that estimates no stiffness
                continue
            phi, found = (np.asarray(columns[k], dtype=np.float64) for k in ("deflection", "stiffness"))
            c = np.asarray(columns["setpoint"], dtype=np.float64) if "setpoint" in columns else None
            known = np.isfinite(phi) & (np.isfinite(c) if c is not None else not self.device.has_setpoint)
            if not known.any():  # as of a rig's spring that needs a set-point which the method does not read
                continue
            torque, rig = np.full((2, phi.size), np.nan)
            torque[known], rig[known] = torque_and_stiffness(
                view.nominal, phi[known], None if c is None else c[known], trace.time[known]
            )
            if view.name in self.torques:
                fed = np.asarray(columns["flexibility_torque"], dtype=np.float64)
                self._add_torques(view, trace, fed - torque)
            excited = np.asarray(columns["excited"], dtype=np.bool_)
            for sure in (True, False):
                use = known & (found > 0.0) & (excited == sure)
                if not use.any():
                    continue
                ratio = np.log(found[use] / rig[use])
                inside = np.isfinite(ratio)  # none inside a gap
                if inside.any():
                    medians = float(np.median(ratio[inside])), float(np.median(rig[use][inside]))
                    counted = (int(np.count_nonzero(inside)), *medians)
                    self.medians.setdefault((view.name, sure), []).append(counted)

    def _add_torques(self, view: TransmissionView, trace: Trace, more: Array) -> None:
        """Take recorded torques into account, and by how much `more` the rig's motor and spring take."""
        rows = np.searchsorted(self.signals.stamps, trace.stamps)
        recorded = np.asarray(self.signals.roles[view.motor_torque])[rows]
        expected = recorded + more
        both = np.isfinite(expected)
        x, y = expected[both], recorded[both]
        self.torques[view.name] += x @ x, x @ y, y @ y

    def findings(self) -> Iterator[Finding]:
        """Yield the transmissions whose stiffness or torque is another order of magnitude than the rig's.

        Samples that are not excited count where none is. Noise in either torque bends a slope, and the slope the other way
        round to the other side: both have to say it.
        """
        for view in self.views:
            xx, xy, yy = self.torques.get(view.name, np.zeros(3))
            if not xy > 0.0 or xy**2 < MOST_NOISE * xx * yy:
                continue
            if yy / xy < 1.0 / LARGEST_RATIO or xy / xx > LARGEST_RATIO:
                yield Finding(
                    code="motor_torque.scale",
                    joint=self.device.joint,
                    part=view.motor_torque,
                    value=float((yy / xx) ** 0.5),
                    limit=LARGEST_RATIO,
                )
        for name in (view.name for view in self.views):
            medians = self.medians.get((name, True)) or self.medians.get((name, False))
            if not medians:
                continue
            counts, ratios, rigs = (np.array(x) for x in zip(*medians, strict=True))
            ratio = float(np.exp(np.average(ratios, weights=counts)))
            if not 1.0 / LARGEST_RATIO < ratio < LARGEST_RATIO:
                yield Finding(
                    code="stiffness.scale",
                    joint=self.device.joint,
                    part=name,
                    value=ratio,
                    limit=LARGEST_RATIO,
                    evidence={"rig": float(np.average(rigs, weights=counts))},
                )


TEXTS = {
    "motor_torque.scale": Text(
        "{part}: the torque is {value:.3g} times what moves the rig's motor and spring as they moved.",
        "Its unit or scale is wrong, or a gear ratio, or inertia and spring in the rig: check the units under"
        " [joint.{joint}.signals].",
    ),
    "stiffness.scale": Text(
        "transmission {part}: the stiffness is {value:.3g} times that of the rig's spring ({rig:.3g} N·m/rad).",
        "A torque's unit or scale is wrong, or a gear ratio, or the spring in the rig: check the units under"
        " [joint.{joint}.signals].",
    ),
}
add_texts(TEXTS)
