"""A joint that differs from one log to another of those that are looked at together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.residuals.balance import Equation
from vsalog.residuals.channels import Channels
from vsalog.residuals.memory import remembered

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PerLog:
    """A joint for each log, in their order."""

    joints: tuple[Any, ...]


def any_of(joint: Any) -> Any:
    """Return a joint as it is in one of the logs: for results that do not depend on its numbers."""
    return joint.joints[0] if isinstance(joint, PerLog) else joint


def in_last(joint: Any) -> Any:
    """Return a joint as it is in the last log, which is likely to be nearest to an unknown one."""
    return joint.joints[-1] if isinstance(joint, PerLog) else joint


def each(joint: Any, change: Callable[[Any], Any]) -> Any:
    """Return a joint changed in every log."""
    return PerLog(tuple(map(change, joint.joints))) if isinstance(joint, PerLog) else change(joint)


def formed_in_each(
    joint: PerLog, channels: Channels, form: Callable[[Any, Channels], list[Equation]]
) -> list[Equation]:
    """Form the equations of each log's samples with the joint as it is there; they follow one another as the logs do."""
    out = []
    for same in zip(*map(form, joint.joints, channels.in_logs()), strict=True):
        flat = all(np.ndim(e.shaped) == 0 and e.shaped == 0.0 for e in same)
        shaped = (
            0.0
            if flat
            else remembered(_one_after_another, *(np.broadcast_to(e.shaped, e.residual.shape) for e in same))
        )
        rate = None if same[0].rate is None else remembered(_one_after_another, *(e.rate for e in same))
        residual = remembered(_one_after_another, *(e.residual for e in same))
        out.append(replace(same[0], residual=residual, shaped=shaped, rate=rate))
    return out


def _one_after_another(*parts: Array) -> Array:
    return np.concatenate(parts)
