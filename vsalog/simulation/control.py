"""Controllers: they drive a joint by its sensors' readings, or by an estimator's results; run by `control_loop`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from vsalog.simulation.inputs import Signal, TorqueInput
from vsalog.simulation.scenario_schema import PiControlDrive, StateFeedbackDrive, StiffnessControlDrive


@dataclass(frozen=True, slots=True)
class StateFeedback:
    """A motor that is driven by the joint's whole state, and the torque of the planned motion (De Luca 2007 eq. 13).

    Attributes
    ----------
    reference : planned position of the link, a smooth function of an array of times [s] → [rad]
    frequency : of the slowest eigenvalues of the controlled joint [rad/s]
    damping : of these eigenvalues
    feedback : where the state comes from: ``acceleration-observer``; ``motor``, of which the link is taken to follow as planned;
        or ``truth``
    limit : the largest torque [N·m]
    tune : of the observer, NAME → VALUE
    """

    reference: TorqueInput
    frequency: float
    damping: float = 1.0
    feedback: Literal["acceleration-observer", "motor", "truth"] = "acceleration-observer"
    limit: float = float("inf")
    tune: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PiControl:
    """Two valves that are driven by a proportional and integral controller, apart from a bias (Shin 2021 §IV-C).

    Attributes
    ----------
    reference : of what is controlled, a function of an array of times [s] → [rad] or [N·m]
    of : what is controlled
    feedback : where it comes from: ``pam-ukf`` or ``pam-model``, from the pressures; or the ``sensor``
    proportional, integral : gains [V/rad, V/(rad·s), or of N·m]
    bias : of both valves [V]
    limits : of a valve's voltage [V]
    tune : of the estimator, NAME → VALUE
    """

    reference: TorqueInput
    proportional: float
    integral: float
    bias: float
    of: Literal["link_position", "torque_sensor"] = "link_position"
    feedback: Literal["pam-ukf", "pam-model", "sensor"] = "pam-ukf"
    limits: tuple[float, float] = (0.0, 10.0)
    tune: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class StiffnessControl:
    """Motors that make a joint's position and its stiffness follow references, see `control_stiffness`.

    Attributes
    ----------
    reference : of the device's stiffness, a function of an array of times [s] → [N·m/rad]
    position : of the link, likewise [rad]
    frequency : of the motors' position loops [rad/s]
    bandwidth : of the integral that corrects the stiffness [rad/s]
    feedback : where the stiffness comes from: an estimator's name; ``truth``; or ``none``: the rig's springs alone
    limit : the largest torque of a motor [N·m]
    tune : of the estimator, NAME → VALUE
    """

    reference: TorqueInput
    position: TorqueInput
    frequency: float
    bandwidth: float
    feedback: str = "residual-rls"
    limit: float = float("inf")
    tune: Mapping[str, str] = field(default_factory=dict)


Controller = StateFeedback | PiControl | StiffnessControl


def controller_of(
    drive: StateFeedbackDrive | PiControlDrive | StiffnessControlDrive, references: Mapping[str, Signal]
) -> Controller:
    """Return a scenario's controller, with its references as functions of time, by their keys."""
    if isinstance(drive, StiffnessControlDrive):
        limit = float("inf") if drive.limit is None else drive.limit
        wanted = references["stiffness"], references["position"]
        return StiffnessControl(*wanted, drive.frequency, drive.bandwidth, drive.feedback, limit, drive.tune)
    reference = references["reference"]
    if isinstance(drive, PiControlDrive):
        return PiControl(
            reference, drive.proportional, drive.integral, drive.bias, drive.of, drive.feedback, tune=drive.tune
        )
    limit = float("inf") if drive.limit is None else drive.limit
    return StateFeedback(reference, drive.frequency, drive.damping, drive.feedback, limit, drive.tune)
