"""Shared parts of methods that follow a state instead of fitting a model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.model import JointModel, basis_spec
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device
from vsalog.estimators.equation import SUPPORTED_SHARE
from vsalog.estimators.tuning import Tuning

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Unfiltered:
    """Replaces a conditioner: nothing is filtered before, and every sample counts."""

    window = 1

    def check_length(self, longest: int) -> None:
        """Any stretch is long enough."""


class UnfilteredTuning(Tuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of a method that filters itself: what the filters of others have is refused."""

    def __post_init__(self) -> None:
        plain = dict(zip(Tuning.__struct_fields__, Tuning.__struct_defaults__, strict=True))
        for name, default in plain.items():
            if getattr(self, name) != default:
                own = ", ".join(name for name in self.__struct_fields__ if name not in plain)
                raise ValueError(f"'{name}' is of a filter before the estimator, which has none; there are {own}")


class StateObserver:
    """A fold that holds nothing back, and fits nothing; it goes through the signals once, unless stated otherwise.

    Attributes
    ----------
    name, modality : of the method
    device : of the joint
    """

    passes = 1
    name: str
    modality: str
    device: Device

    def start(self) -> Any:
        """Return the state before the first sample."""
        raise NotImplementedError

    def freeze(self, state: Any) -> Any:
        """Go back to the first sample."""
        return self.start()

    def finish(self, state: Any) -> tuple[Any, list[Trace]]:
        """Nothing is held back."""
        return state, []

    def model(self, state: Any) -> JointModel:
        """Return a model without transmissions: the estimate is a state, based on the rig."""
        return JointModel(
            estimator=self.name, modality=self.modality, basis=basis_spec(self.device.basis), transmission=(), motor={}
        )


def state_columns(phi: Array, torque: Array, stiffness: Array, std: Array, excited: Flags) -> Columns:
    """Return the columns of a trace whose stiffness was followed, shape (N,) each: nothing is fitted over φ.

    Parameters
    ----------
    phi, torque : φ [rad] and Σ [N·m]
    stiffness, std : and its standard deviation [N·m/rad]
    excited : where the observer has enough data; where the deviation is too large the estimate does not count either
    """
    nothing = np.full(phi.shape, np.nan)
    with np.errstate(invalid="ignore"):
        excited = excited & (std < SUPPORTED_SHARE * stiffness)
    return {
        "deflection": phi,
        "flexibility_torque": torque,
        "flexibility_torque_fit": nothing,
        "stiffness": stiffness,
        "stiffness_std": std,
        "excited": excited,
        "stiffness_derivative": nothing,
        "stiffness_second_derivative": nothing,
    }
