"""Encoder resolution: positions rounded once more, to coarser steps.

The rounding error repeats where a motion repeats, and while a joint rests it does not change at all: it averages out in no time,
follows the motion, and shows in no residual. But positions can be rounded to steps three times as large, with the grid at
one of three places. Errors of either sign are then 8^½ times as large as those of the steps that are there, and the bias, which
grows with the square, eight times. The former is taken, which is cautious.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.significance import INTERVAL, SIGNIFICANCE
from vsalog.estimators.device import deflection_of, deflection_step, encoder_steps, has_deflection
from vsalog.perturbations.trials import Shift, Subject, Trial

# How many times coarser the steps of a trial are [1].
COARSER = 3
# A deflection that spans more steps is not tried: rests anywhere within a step at either end change the stiffness of a
# linear spring by 1/(√6 · 300) = 0.14 % (one standard deviation).
FINE_STEPS = 300.0


class Quantisation:
    """Rounds positions to coarser steps.

    A few trials estimate a spread badly: a band of Student's t with as many degrees of freedom is wider than a normal one.

    Attributes
    ----------
    grids : places of the sensors' grids in each trial [steps]: each sensor's everywhere, and no two sensors' always alike
    """

    grids = ((0, 0, 1), (1, 2, 0), (2, 1, 2), (0, 1, 2))
    name = "quantisation"
    scale = float(stdtrit(len(grids), 1.0 - 0.5 * SIGNIFICANCE) / INTERVAL * (COARSER**2 - 1.0) ** -0.5)
    uniform = False
    own_noise = 0.0
    while_learning = False

    def trials(self, subject: Subject) -> Iterator[Trial] | None:
        """Return a trial per grid, where some deflection spans few steps."""
        signals = subject.signals
        views = [view for view in subject.device.transmissions if has_deflection(signals.roles, view)]
        steps = encoder_steps(signals.roles, views)
        spans = [
            float(np.ptp(phi[np.isfinite(phi)])) / step
            for view in views
            if (step := deflection_step(steps, [view])) > 0.0
            and np.isfinite(phi := deflection_of(signals.roles, view)).any()
        ]
        if not spans or min(spans) > FINE_STEPS:
            return None
        return (Trial(subject.fold, _coarser(signals, steps, places)) for places in self.grids)

    def findings(self, subject: Subject, shift: Shift) -> list[Finding]:
        """Return nothing: the resolution of a rig's encoders is no fault."""
        return []


def _coarser(signals: JointSignals, steps: Mapping[str, float], places: Sequence[int]) -> JointSignals:
    """Return signals with the positions of each sensor on the coarser grid of its place."""
    roles = dict(signals.roles)
    for (role, step), place in zip(sorted(steps.items()), places, strict=False):
        level = roles[role][np.argmax(np.isfinite(roles[role]))]
        cells = np.round((roles[role] - level) / step) - place
        roles[role] = level + step * (COARSER * np.round(cells / COARSER) + place)
    return replace(signals, roles=roles)
