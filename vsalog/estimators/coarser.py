"""What an encoder's steps do to an estimate, told by making them coarser.

What rounding adds repeats where a motion repeats: it averages out in no time, follows the motion, and is in no left-over. But
positions can be rounded once more, to steps three times as large, the grid of which lies in one of three places. How far an
estimate moves then says how far the steps that are there have moved it: errors of either sign are 8^½ times as large as theirs,
and what bends a fit, which grows with the square, eight times. The former is taken, which is cautious.
(Cook and Stefanski, "Simulation-extrapolation estimation in parametric measurement error models", JASA 89, 1994.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vsalog.core.signals import JointSignals
from vsalog.estimators.by_deflection import ByDeflection, part_moved
from vsalog.estimators.folding import estimated
from vsalog.estimators.resting import Steps

if TYPE_CHECKING:
    from vsalog.estimators.regression import RegressionFold

Array = NDArray[np.float64]

# Times as large, and what of the change the steps themselves have made.
TIMES, PART = 3, 8.0**-0.5
# Where the grids of the sensors lie, in steps; each trial has as many as there are sensors.
PLACES = ((0, 0, 1), (1, 2, 0), (2, 1, 2), (0, 1, 2), (1, 0, 0))
# What moves a stiffness by less is as well told by what the fit leaves over.
LEAST = 0.01
# So many samples are tried.
TRIED = 1 << 15


def moved_by_steps(fold: RegressionFold, signals: JointSignals, steps: Mapping[str, Steps]) -> dict[str, ByDeflection]:
    """Return by which part the steps of positions have moved each stiffness; nothing of those that are not supported, or hardly.

    Parameters
    ----------
    fold : the estimator
    signals : of the joint
    steps : of the sensors that have any
    """
    if not steps:
        return {}
    part = signals[:TRIED]
    before = estimated(fold, part)
    after = [estimated(fold, _coarser(part, steps, places)) for places in PLACES]
    shares: dict[str, ByDeflection] = {}
    for view in fold.device.transmissions:
        columns = before[view.name]
        sigma, sure = np.asarray(columns["stiffness"], float), np.asarray(columns["excited"], dtype=bool)
        with np.errstate(invalid="ignore", divide="ignore"):
            changes = np.array([np.asarray(other[view.name]["stiffness"], float) / sigma - 1.0 for other in after])
        squares = np.nan_to_num((PART * changes) ** 2, nan=np.inf)
        found = part_moved(np.asarray(columns["deflection"], float), sure, squares)
        if found is not None and found.most > LEAST:
            shares[view.name] = found
    return shares


def _coarser(signals: JointSignals, steps: Mapping[str, Steps], places: Sequence[int]) -> JointSignals:
    roles = dict(signals.roles)
    for (role, own), place in zip(sorted(steps.items()), places, strict=False):
        cells = own.cells(roles[role]) - place
        roles[role] = own.level + own.size * (TIMES * np.round(cells / TIMES) + place)
    return replace(signals, roles=roles)
