"""Stiffness and torque compared with the rig's own spring: a torque in the wrong unit, or a gear ratio counted twice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.check import Context, Watch
from vsalog.checks.cross_check import sensed_by_run
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device, TransmissionView
from vsalog.mechanics.transmissions import torque_and_stiffness
from vsalog.rig.schema import UnknownTransmission
from vsalog.uncertainty.errors_in_variables import MOST_NOISE

Array = NDArray[np.float64]

# Beyond this factor, on a logarithmic scale, a wrong decimal prefix is nearer than a wrong spring.
LARGEST_RATIO = 10.0**0.5


class NominalSpring:
    """Compares the stiffness with the rig's spring, and the motor torque with what the rig's inertia and spring need.

    Where the motor torque is recorded ten times too large, it dominates the residual, and the stiffness is too large. Where it is
    recorded too small, the motor's inertia dominates, and no stiffness is excited that could be compared.
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
        return _Ratios(context.device, views, context.look, motors) if views else None


class _Ratios:
    def __init__(
        self, device: Device, views: Sequence[TransmissionView], signals: JointSignals, motors: Sequence[str]
    ) -> None:
        self.device, self.views = device, views
        self.recorded = {
            v.name: sensed_by_run(
                signals.stamps, signals.run, np.asarray(signals.roles[v.motor_torque]), signals.period
            )
            for v in views
            if v.name in motors
        }
        # Sums of products of 1, the expected and the recorded torque, shape (3, 3).
        self.moments = {name: np.zeros((3, 3)) for name in motors}
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
            if view.name in self.recorded:
                fed = np.asarray(columns["flexibility_torque"], dtype=np.float64)
                self._add_torques(view.name, trace, fed - torque)
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

    def _add_torques(self, name: str, trace: Trace, missing: Array) -> None:
        """Take recorded motor torques into account, and what is `missing` of the torque that the rig needs [N·m]."""
        for run, recorded in self.recorded[name].items():
            rows = trace.run == run
            y = recorded.at(trace.stamps[rows])
            x = y + missing[rows]
            known = np.isfinite(x)
            columns = np.stack([np.ones(int(known.sum())), x[known], y[known]])
            self.moments[name] += columns @ columns.T

    def findings(self) -> Iterator[Finding]:
        """Yield the transmissions whose stiffness or torque is another order of magnitude than the rig's.

        Samples that are not excited count where none is. Of two torques the changes are compared, since an offset is no scale.
        Noise of one biases its slope over the other; both slopes have to agree.
        """
        for view in self.views:
            if view.name not in self.moments or not (count := self.moments[view.name][0, 0]) > 1.0:
                continue
            sums = self.moments[view.name]
            (xx, xy), (_, yy) = (sums[1:, 1:] - np.outer(sums[0, 1:], sums[0, 1:]) / count) / count
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
        "{part}: its changes are {value:.3g} times those that the rig's inertia and spring need for this motion.",
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
