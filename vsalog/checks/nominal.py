"""The stiffness beside the rig's own spring: a torque in the wrong unit, or a gear that is counted once too often."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.check import Context, Watch
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device, TransmissionView
from vsalog.mechanics.transmissions import stiffness
from vsalog.rig.schema import UnknownTransmission

Array = NDArray[np.float64]

# A scale that is wrong by ten is nearer than a spring that is off by this factor, on a logarithmic scale.
LARGEST_RATIO = 10.0**0.5


class NominalSpring:
    """Compares the stiffness with that of the rig."""

    name = "nominal"
    supersedes: Mapping[str, Sequence[str]] = {}

    def start(self, context: Context) -> Watch | None:
        """Begin, where the rig has a spring of known type."""
        views = [v for v in context.device.transmissions if not isinstance(v.nominal, UnknownTransmission)]
        return _Ratios(context.device, views) if views else None


class _Ratios:
    def __init__(self, device: Device, views: Sequence[TransmissionView]) -> None:
        self.device, self.views = device, views
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
            known = (
                np.isfinite(phi) & (found > 0.0) & (np.isfinite(c) if c is not None else not self.device.has_setpoint)
            )
            excited = np.asarray(columns["excited"], dtype=np.bool_)
            for sure in (True, False):
                use = known & (excited == sure)
                if not use.any():  # as of a rig's spring that needs a set-point which the method does not read
                    continue
                rig = stiffness(view.nominal, phi[use], None if c is None else c[use], trace.time[use])
                ratio = np.log(found[use] / rig)
                inside = np.isfinite(ratio)  # none inside a gap
                if inside.any():
                    medians = float(np.median(ratio[inside])), float(np.median(rig[inside]))
                    counted = (int(np.count_nonzero(inside)), *medians)
                    self.medians.setdefault((view.name, sure), []).append(counted)

    def findings(self) -> Iterator[Finding]:
        """Yield the transmissions whose stiffness is another order of magnitude than the rig's.

        Samples that are not excited count where none is.
        """
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
    "stiffness.scale": Text(
        "transmission {part}: the stiffness is {value:.3g} times that of the rig's spring ({rig:.3g} N·m/rad).",
        "A torque's unit or scale is wrong, or a gear ratio, or the spring in the rig: check the units under"
        " [joint.{joint}.signals].",
    ),
}
add_texts(TEXTS)
