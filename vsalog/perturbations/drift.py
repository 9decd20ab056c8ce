"""Drift: the second half of a log alone.

A fit assumes the same spring throughout. Of one that softens as it warms up it estimates the average so far, off by half
of the change at the end of the log, and residuals, which are small, hardly show it. The fit to the second half alone is off by
half as much: if the stiffness moves there by more than the noise of the second half allows, the spring has changed (Hausman,
"Specification tests in econometrics", Econometrica 46(6), 1978). With noise that is the same throughout, half of the variance
of a fit to half of the data is that of the difference.
"""

from __future__ import annotations

from collections.abc import Sequence

from vsalog.core.finding import Finding
from vsalog.core.significance import DETECTED
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.estimators.fold import follows_changes
from vsalog.perturbations.trials import Shift, Subject, Trial


class Drift:
    """Runs on the second half.

    Fits lag a linear change by half of the log they have used: that to the second half differs from that to the whole by a
    quarter of the change over the log, and at the end of the log the whole's lags by half of the change.
    """

    name = "drift"
    scale = 2.0
    uniform = True
    own_noise = 0.5
    while_learning = False

    def trials(self, subject: Subject) -> Sequence[Trial] | None:
        """Return one trial, of methods that fit one model to the whole log."""
        half = len(subject.signals) // 2
        fold = subject.fold
        if follows_changes(fold) or not subject.device.transmissions or not fold.model(fold.start()).transmission:
            return None
        return (Trial(fold, subject.signals[half:], slice(half, None)),)

    def findings(self, subject: Subject, shift: Shift) -> list[Finding]:
        """Return the transmissions whose stiffness changes over the log."""
        found = []
        for name, (moved, noise) in shift.overall.items():
            # At the end of the log the estimate is off by half of the change; one of less than that does not matter.
            limit = max(0.5 * NEGLIGIBLE_SHARE, DETECTED * noise)
            if name != "total" and moved > limit:
                joint = subject.device.joint
                found.append(
                    Finding(code="stiffness.drifts", joint=joint, part=name, value=2.0 * moved, limit=2.0 * limit)
                )
        return found
