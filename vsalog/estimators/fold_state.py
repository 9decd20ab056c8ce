"""What the fold of the least-squares estimators carries from block to block."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.estimators.region import Region
from vsalog.estimators.residual_motion import MotionRows
from vsalog.filters.conditioning import ConditionerState

Array = NDArray[np.float64]


@dataclass(slots=True)
class FoldState:
    """States of the filters, of each equation and its solver, the regions seen so far, the samples seen and doubted, for how many
    samples each stiffness has been excited; the least relative standard deviation of an excited stiffness so far,
    and rows of the residual.
    """

    filters: ConditionerState
    equations: list[Any]
    solvers: list[Any]
    regions: dict[str, Region]
    directions: dict[str, Array]
    learning: bool
    seen: int = 0
    doubted: dict[str, int] = field(default_factory=dict)
    supported: dict[str, int] = field(default_factory=dict)
    claimed: dict[str, float] = field(default_factory=dict)
    residual_rows: dict[tuple[str, ...], MotionRows] = field(default_factory=dict)
