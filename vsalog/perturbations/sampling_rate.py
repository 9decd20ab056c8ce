"""Sampling rate: every second sample alone.

A motion that is hardly resolved, as of jerks at 50 Hz or of a torque that is switched between two samples, biases what is
estimated from it: torques jump, derivatives lose fast motion. That repeats with the motion and shows in no residual. But every
second sample alone is a recording at half the rate, in which the error is twice to eight times as large. How far the estimate
moves then, beyond what its band there allows, is no less than its error (after Richardson's deferred approach to the
limit).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from vsalog.core.errors import VsalogError
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.estimators.equation import REPORTED_CHANGE
from vsalog.estimators.fold import follows_changes
from vsalog.perturbations.trials import Shift, Subject, Trial


class SamplingRate:
    """Takes every second sample, once the odd ones and once the even ones."""

    name = "sampling_rate"
    scale = 1.0
    uniform = False
    own_noise = 1.0
    while_learning = False

    def trials(self, subject: Subject) -> Iterator[Trial] | None:
        """Return a trial per half; none of a half that the method refuses, nor of muscles, whose state is filtered."""
        return None if subject.device.pneumatic is not None else self._halves(subject)

    def _halves(self, subject: Subject) -> Iterator[Trial]:
        for first in (0, 1):
            half = every_second(subject.signals, first)
            try:
                fold = (
                    subject.fold.rebuilt(half)
                    if follows_changes(subject.fold)
                    else subject.method.build(subject.device, half, subject.tuning)
                )
                fold.conditioner.check_length(half.longest_run)
            except VsalogError:
                continue  # there is nothing to compare with
            yield Trial(fold, half, slice(first, None, 2))

    def findings(self, subject: Subject, shift: Shift) -> list[Finding]:
        """Return for which stiffness samples are too few, or that this cannot be tested."""
        joint = subject.device.joint
        if not shift.supported:
            return [Finding(code="sampling.untried", joint=joint)]
        found: list[Finding] = []
        for name, spread in shift.spreads.items():
            if not (moved := shift.largest(name)) or (name == "total" and len(subject.device.transmissions) < 2):
                continue
            of = partial(
                Finding, joint=joint, value=moved, limit=REPORTED_CHANGE, evidence={"stiffness_change": spread.most}
            )
            if name == "total":
                found.append(of(code="sampling.too_slow_for_total"))
            else:
                found.append(of(code="sampling.too_slow", part=name))
        return found


def every_second(signals: JointSignals, first: int) -> JointSignals:
    """Return every second sample, of those from the `first` on, as a log of half the rate."""
    part = signals[first::2]
    starts = np.zeros(len(part), dtype=np.bool_)
    begins = (np.flatnonzero(signals.starts) - first + 1) // 2
    starts[begins[(begins >= 0) & (begins < len(part))]] = True
    starts[:1] = True
    return replace(part, period=2.0 * signals.period, starts=starts)
