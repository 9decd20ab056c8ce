"""When a joint's spring changes its stiffness, from the joint's equations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from vsalog.checks.fault import RULE, Fault
from vsalog.checks.undone_channels import Channels, Faults, Trial


def changed_stiffness(channels: Channels, undone: Faults, wrong: set[str]) -> Iterator[Fault]:
    """Yield of each transmission that its spring is another one from some time on, if equations with its spring are wrong."""
    for name in sorted(channels.elastic & wrong):
        suffix = name.split(" ")[1]
        role = next(r for r in (f"deflection{suffix}", f"motor_position{suffix}") if r in channels.read[name])
        one = Fault("stiffness", (role,))
        touched, now = channels.touched(one, undone), channels.trial(undone)

        def left(since: float, one: Fault = one, touched: set[str] = touched, now: Trial = now) -> float:
            return -channels.trial((*undone, replace(one, since=since)), touched).better(now)

        edges = np.quantile(channels.time, np.arange(1, RULE.blocks) / RULE.blocks).tolist()
        values = {since: left(since) for since in edges}
        best = min(values, key=values.__getitem__)
        step = float(channels.time[-1] - channels.time[0]) / RULE.blocks
        while step > channels.signals.period:
            step *= 0.5
            values |= {since: left(since) for since in (best - step, best + step)}
            best = min(values, key=values.__getitem__)
        yield replace(one, since=best)
