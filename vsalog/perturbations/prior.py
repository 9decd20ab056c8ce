"""The prior that a recursion begins with: a weaker one.

A recursion begins with coefficients of zero and a covariance, which decides what the log does not show: usually well, for
springs are not far from what the prior expects. But where coefficients have to be large, as those of a set-point whose sign is
not the rig's, the prior biases them though the data determine them better, and residuals hardly show it.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from vsalog.core.finding import Finding
from vsalog.core.precision import ROUNDING
from vsalog.estimators.equation import REPORTED_CHANGE
from vsalog.estimators.tuning import Tuning, usual_regressor
from vsalog.perturbations.trials import Shift, Subject, Trial

# Times by which the prior covariance of a trial is larger [1]; where that leaves too few digits, by the square root at least.
WEAKER = 1e4


class WeakerPrior:
    """Runs a recursion with a weaker prior."""

    name = "prior"
    scale = 1.0
    uniform = False
    own_noise = 1.0
    while_learning = True

    def trials(self, subject: Subject) -> Sequence[Trial] | None:
        """Return one trial, where the method has a prior that is not weak already."""
        tuning = weaker(subject)
        if tuning is None:
            return None
        return (Trial(subject.method.build(subject.device, subject.signals, tuning), subject.signals),)

    def findings(self, subject: Subject, shift: Shift) -> list[Finding]:
        """Return the transmissions whose stiffness the prior biases."""
        return [
            Finding(
                code="prior.holds_back",
                joint=subject.device.joint,
                part=name,
                value=moved,
                limit=REPORTED_CHANGE,
                evidence={"stiffness_change": spread.most, "p0": float(getattr(weaker(subject), "p0", np.nan))},
            )
            for name, spread in shift.spreads.items()
            if name != "total" and (moved := shift.largest(name))
        ]


def weaker(subject: Subject) -> Tuning | None:
    """Return the tuning with a weaker prior; None where there is no prior, or one that is weak already."""
    tuning, derived = subject.tuning, subject.fold.derived
    p0 = derived.get("p0") if hasattr(tuning, "p0") else None
    if p0 is None or not np.isfinite(p0) or not subject.device.transmissions:
        return None
    usual = getattr(tuning, "c", 1.0) * usual_regressor(subject.device, subject.signals) ** 2
    # The recursion needs a prior that weighs more than the rounding of a usual sample.
    larger = float(min(WEAKER * p0, 1.0 / (ROUNDING * usual)))
    if larger < WEAKER**0.5 * p0:
        return None
    return msgspec.structs.replace(tuning, p0=larger, window=derived.get("window", tuning.window))
