"""How a joint's spring changes its stiffness with time, from the joint's equations.

The stiffness is a line over time in each of as many pieces as the Bayesian information criterion has (Schwarz 1978), and may
jump between two. Pieces are divided one after another, where that explains most, and then all ends are searched again
(Bai 1997).

Schwarz, "Estimating the dimension of a model", Ann. Statist. 6, 1978. Bai, "Estimating multiple breaks one at a time",
Econometric Theory 13, 1997.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from vsalog.checks.fault import FREE, RULE, Fault
from vsalog.checks.undone_channels import Channels, Faults

Changes = tuple[float, ...]


def changing_stiffness(channels: Channels, undone: Faults, wrong: set[str]) -> Iterator[Fault]:
    """Yield of each transmission that its stiffness changes, if equations with its spring are wrong."""
    for role in channels.springs(wrong):
        one = Fault("stiffness", (role,))
        if one.kind not in (other.kind for other in undone if other.roles == one.roles):
            yield _divided(channels, undone, one)


def _divided(channels: Channels, undone: Faults, one: Fault) -> Fault:
    """Return the changes of a stiffness that explain the channels best."""
    touched, now = channels.touched(one, undone), channels.trial(undone)
    edges: list[float] = np.quantile(channels.time, np.arange(1, RULE.blocks) / RULE.blocks).tolist()
    apart = float(channels.time[-1] - channels.time[0]) / RULE.blocks
    # Between two rows nothing shows when it changes.
    finest = float(np.diff(channels.time).min())

    def left(changes: Changes) -> float:
        inside = (float(channels.time[0]), *changes, float(channels.time[-1]))
        if min(b - a for a, b in pairwise(inside)) < 0.5 * apart:
            return math.inf
        return -channels.trial((*undone, replace(one, changes=changes)), touched).better(now)

    best: Changes = ()
    while len(best) < RULE.changes and not _explained(channels, (*undone, replace(one, changes=best)), touched):
        tried = min((tuple(sorted((*best, edge))) for edge in edges if edge not in best), key=left)
        for k in range(len(tried)):
            tried = _moved(left, tried, k, apart, finest)
        # The rows are as many samples at most: neighbours pass through one filter.
        if left(best) - left(tried) < FREE[one.kind] * math.log(channels.time.size) / channels.time.size:
            break
        best = tried
    return replace(one, changes=best)


def _explained(channels: Channels, undone: Faults, equations: set[str]) -> bool:
    """Return whether no equation has a residual beyond its noise floor; by little, more pieces still explain more."""
    trial = channels.trial(undone, equations)
    return all(trial.left(e) <= float(channels.noise(e, undone).sum()) for e in equations)


def _moved(left: Callable[[Changes], float], changes: Changes, k: int, step: float, finest: float) -> Changes:
    """Return changes with one of them where it explains most, by halving the step."""
    while step > finest:
        step *= 0.5
        others = ((*changes[:k], changes[k] + by, *changes[k + 1 :]) for by in (0.0, -step, step))
        changes = min(others, key=left)
    return changes
