"""What a log shows before the fit: deflections too small for their encoders, motion that a filter removes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.resolution import step_of
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, TransmissionView, deflection_of, deflection_step, encoder_steps
from vsalog.estimators.equation import REPORTED_CHANGE, power_kept
from vsalog.estimators.tuning import Tuning
from vsalog.estimators.windows import WINDOWS, most_moved, rates_of
from vsalog.filters.savitzky_golay import savgol_weights
from vsalog.uncertainty.errors_in_variables import MOST_NOISE

Array = NDArray[np.float64]

# A deflection that spans fewer of its encoders' steps [1] has no course that a function could be fitted to, unless both positions
# pass this number of steps [1], so that these average out.
FEWEST_STEPS, STEPS_THAT_EVEN_OUT = 4.0, 40.0


@dataclass(frozen=True, slots=True)
class Screening:
    """What was found, and the steps of the sensors that have any [rad]."""

    findings: tuple[Finding, ...] = ()
    steps: Mapping[str, float] = field(default_factory=dict)

    @property
    def blind(self) -> frozenset[str]:
        """The transmissions whose stiffness cannot be estimated, as where a deflection is too small for its encoders."""
        return frozenset(finding.part for finding in self.findings if finding.severity == "invalidates")

    def step(self, views: Sequence[TransmissionView]) -> float:
        """Return the step of deflections [rad], that of both their sensors; 0 where they have none."""
        return deflection_step(self.steps, views)

    def and_also(self, other: Screening) -> Screening:
        """Return what was found in either look."""
        return Screening(self.findings + other.findings, {**self.steps, **other.steps})


NOTHING_FOUND = Screening()


def screened(device: Device, signals: JointSignals, tuning: Tuning) -> Screening:
    """Look at a log as it is bound, with the window that was asked for."""
    spans = {view.name: _span(view, signals) for view in device.transmissions}
    small = [
        Finding(
            code="deflection.too_small",
            joint=device.joint,
            part=name,
            severity="invalidates",
            value=span,
            limit=FEWEST_STEPS,
        )
        for name, span in spans.items()
        if span < FEWEST_STEPS
    ]
    steps = encoder_steps(signals.roles, device.transmissions)
    return Screening((*small, *_smoothed_away(device, signals, tuning)), steps)


def _span(view: TransmissionView, signals: JointSignals) -> float:
    """Return how many steps a deflection spans; infinite where a sensor has none, or steps even out."""
    roles = view.deflection_roles(signals.roles)
    steps = [step_of(signals.roles[role]) for role in roles]
    if any(step is None for step in steps):
        return np.inf
    passed = [_range(signals.roles[role]) / step for role, step in zip(roles, steps, strict=True) if step]
    if len(roles) > 1 and min(passed) > STEPS_THAT_EVEN_OUT:
        return np.inf
    return _range(deflection_of(signals.roles, view)) / float(np.linalg.norm(np.array(steps, dtype=np.float64)))


def _range(x: Array) -> float:
    finite = x[np.isfinite(x)]
    return float(np.ptp(finite)) if finite.size else np.inf


def _smoothed_away(device: Device, signals: JointSignals, tuning: Tuning) -> list[Finding]:
    """Find where a window that was asked for smooths the motion away; nothing of the motion is known where noise is larger."""
    if tuning.window is None or tuning.filter == "kinematic":
        return []
    moved = {role for view in device.transmissions for role in view.deflection_roles(signals.roles)}
    # It then changes an amplitude by as much as is reported.
    least = power_kept(REPORTED_CHANGE)
    asked, part = 2 * round(0.5 * tuning.window / signals.period) + 1, most_moved(signals, moved)
    if asked <= WINDOWS[0] or asked > len(part):
        return []
    before, now = (
        rates_of(device, part, savgol_weights(window, tuning.degree, 1, signals.period))
        for window in (WINDOWS[0], asked)
    )
    return [
        Finding(
            code="filter.smooths_motion",
            joint=device.joint,
            part=view.name,
            value=float(left / rate),
            limit=float((least * (1.0 - (noise / rate) ** 2)) ** 0.5),
            evidence={"window": tuning.window},
        )
        for view, rate, noise, left in zip(device.transmissions, *before, now[0], strict=True)
        if noise < MOST_NOISE * rate and left**2 < least * (rate**2 - noise**2)
    ]
