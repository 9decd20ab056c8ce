"""The data of a report's figures, one joint at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.model import JointModel
from vsalog.rig.schema import Joint

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Deviations = NDArray[np.floating]


@dataclass(frozen=True, slots=True)
class TransmissionEvidence:
    """One transmission over time; every array has shape (N,), NaN where nothing is known.

    Attributes
    ----------
    deflection : φ [rad]
    predicted, predicted_std : the frozen model's flexibility torque [N·m]
    measured : its reference [N·m]; None where there is none
    measured_by : ``sensor``, ``residual`` …, the kind of `measured`
    stiffness, stiffness_std : the frozen model's [N·m/rad]
    true_stiffness : a simulator's; None in a recording of a machine
    inside : inside the region that the model was fitted in
    """

    deflection: Array
    predicted: Array
    predicted_std: Deviations
    measured: Array | None
    measured_by: str
    stiffness: Array
    stiffness_std: Deviations
    true_stiffness: Array | None
    inside: Flags


class Parameter(NamedTuple):
    """An estimate's parameter: its transmission, its name (a term of the basis, or one of the motor's), and its unit."""

    transmission: str
    name: str
    unit: str


@dataclass(frozen=True, slots=True)
class JointEvidence:
    """A joint over time.

    Attributes
    ----------
    joint : name
    time : shape (N,), from the log's start [s]; each of several runs may start again
    setpoint : shape (N,), or None; its unit is ``setpoint_unit``, empty where only that it is SI is known
    transmissions : by name
    model : the frozen model, for its surface; None where an estimate is reported and there is none yet
    convergence : parameter → (N,) columns of an estimate's parameters over time (``estimate --report``), empty for a frozen model
    excited : shape (N,), of an estimate; None for a frozen model
    """

    joint: str
    time: Array
    setpoint: Array | None
    setpoint_unit: str
    transmissions: Mapping[str, TransmissionEvidence]
    model: JointModel | None
    convergence: Mapping[Parameter, Array] = field(default_factory=dict)
    excited: Flags | None = None


# Given the number of a log and one of its joints, or one transmission of it, as soon as there is something to draw.
Draw = Callable[[int, JointEvidence], None]


def setpoint_unit(joint: Joint) -> str:
    """Return the unit of a joint's set-point: m of a lever arm, rad of a motor; not known for runs at fixed set-points."""
    if getattr(joint, "lever", None) is not None:
        return "m"
    return "" if any(run.setpoint is not None for run in getattr(joint, "run", ())) else "rad"
