"""Drift: the second half of a log alone.

A fit takes a spring for the same throughout. Of one that softens as it warms up it has the average so far, which is off by half
of the change at the end of the log, and residuals, which are small, hardly show it. The fit to the second half alone is off by
half as much: if the stiffness moves there by more than the noise of the second half allows, the spring has changed (Hausman,
"Specification tests in econometrics", Econometrica 46(6), 1978). With noise that is the same throughout, half of the variance
of a fit to half of the data is that of the difference.
"""

from __future__ import annotations

from collections.abc import Sequence

from vsalog.core.finding import Finding
from vsalog.perturbations.trials import Shift, Subject, Trial

# A change over the log that is reported, as a part of the stiffness: what 70 K do to a steel spring, whose shear modulus falls by
# 0.03 % per kelvin. In how many deviations (p = 0.3 %).
REPORTED_CHANGE, REPORTED_DEVIATIONS = 0.02, 3.0
# What the stiffness changes over the log, in differences of both fits: these lag a linear change by half of what they have seen.
CHANGE_PER_SHIFT = 4.0


class Drift:
    """Runs on the second half."""

    name = "drift"
    # At the end of the log the fit lags by half of the change.
    scale = 0.5 * CHANGE_PER_SHIFT
    uniform = True
    own_noise = 0.5
    while_learning = False

    def trials(self, subject: Subject) -> Sequence[Trial] | None:
        """Return one trial, of methods that fit a model to the whole log."""
        half = len(subject.signals) // 2
        fold = subject.fold
        if not subject.device.transmissions or not fold.model(fold.start()).transmission:
            return None
        return (Trial(fold, subject.signals[half:], slice(half, None)),)

    def findings(self, subject: Subject, shift: Shift) -> list[Finding]:
        """Return the transmissions whose stiffness changes over the log."""
        found = []
        for name, (moved, noise) in shift.overall.items():
            change = moved / self.scale * CHANGE_PER_SHIFT
            if name != "total" and change > REPORTED_CHANGE and moved > REPORTED_DEVIATIONS * noise:
                found.append(
                    Finding(
                        code="stiffness.drifts",
                        joint=subject.device.joint,
                        part=name,
                        value=change,
                        limit=max(REPORTED_CHANGE, REPORTED_DEVIATIONS * noise / self.scale * CHANGE_PER_SHIFT),
                    )
                )
        return found
