"""What a diagnosis draws: the arrays behind its figures, one joint at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SignalEvidence:
    """One signal in the windows of a log; every array has shape (N,), NaN outside the windows.

    Attributes
    ----------
    unit : SI
    measured : as recorded
    before, after : as the rig simulates it, as given and extended; None where it cannot be simulated
    """

    unit: str
    measured: Array
    before: Array | None
    after: Array | None


@dataclass(frozen=True, slots=True)
class EquationEvidence:
    """The residual of one equation, averaged over short bells; arrays have shape (R,), NaN where it does not count.

    Attributes
    ----------
    side, unit : of the equation
    before, after : with the original rig, and extended
    noise : standard deviation that noise gives these averages
    """

    side: str
    unit: str
    before: Array
    after: Array
    noise: float


@dataclass(frozen=True, slots=True)
class CauseEvidence:
    """The view in which a cause shows.

    Attributes
    ----------
    cause, part : which
    equation : in which it shows most, key of the joint's equations
    variable : name of the signal that reveals it, key of the joint's variables
    without : the residual of that equation with all causes but this one, shape (R,)
    shape : effect of this cause on that equation, shape (R,); `without` minus this is the residual with it
    """

    cause: str
    part: str
    equation: str
    variable: str
    without: Array
    shape: Array


@dataclass(frozen=True, slots=True)
class JointEvidence:
    """A joint.

    Attributes
    ----------
    joint : name
    time : shape (N,), of the signals [s]
    signals : role → signal, of the log that the gain was measured on
    signals_log : name of that log
    rows : shape (R,), time of the equations' averages [s]
    equations : name → equation, of the log that was diagnosed
    variables : name → (values of shape (R,), unit), what remainders are drawn over: motor velocity, deflection, time, …
    causes : the views in which the causes show, weightiest first
    """

    joint: str
    time: Array
    signals: Mapping[str, SignalEvidence]
    signals_log: str
    rows: Array
    equations: Mapping[str, EquationEvidence]
    variables: Mapping[str, tuple[Array, str]]
    causes: tuple[CauseEvidence, ...] = field(default=())
