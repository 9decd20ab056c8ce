"""A joint that differs from one log to another of those that are looked at together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.residuals.balance import Equation

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class PerLog:
    """A joint for each log, in their order."""

    joints: tuple[Any, ...]


def any_of(joint: Any) -> Any:
    """Return a joint as it is in one of the logs: for what does not depend on its numbers."""
    return joint.joints[0] if isinstance(joint, PerLog) else joint


def each(joint: Any, change: Callable[[Any], Any]) -> Any:
    """Return a joint changed in every log."""
    return PerLog(tuple(map(change, joint.joints))) if isinstance(joint, PerLog) else change(joint)


def joined(formed: Sequence[Sequence[Equation]], log: Integers) -> list[Equation]:
    """Return equations that were formed once for each log, each sample with those of its own.

    Parameters
    ----------
    formed : of the joint in each log
    log : shape (N,), of each sample
    """
    out = []
    for same in zip(*formed, strict=True):
        residual, shaped = (
            np.choose(log, [np.broadcast_to(getattr(e, name), log.shape) for e in same])
            for name in ("residual", "shaped")
        )
        flat = all(np.ndim(e.shaped) == 0 and e.shaped == 0.0 for e in same)
        out.append(replace(same[0], residual=residual, shaped=0.0 if flat else shaped))
    return out
