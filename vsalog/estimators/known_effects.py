"""Known effects of a joint other than its springs, for the equations: friction, cogging, damping, hysteresis."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import EstimatorError
from vsalog.core.signals import JointSignals
from vsalog.effects.backlash import engaged
from vsalog.estimators.device import Device, TransmissionView, deflection_of, spread
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.estimators.friction_compensation import FrictionCompensation, doubt_role, extended, way_role
from vsalog.estimators.tuning import Tuning
from vsalog.filters.conditioning import Conditioned, Conditioner
from vsalog.mechanics.hysteresis import loop_block, loop_level, loop_start
from vsalog.rig.schema import UnknownTransmission

Array = NDArray[np.float64]

# Doubt is tolerated up to this share of friction's level [1], since it comes and goes with every turn of the motion.
DOUBT_OF_FRICTION = 0.1
# Three standard deviations of the deflection's noise, in those of the sensors' rounding: a Savitzky–Golay filter leaves a third
# of it, the MKKF at speed nearly all.
SLACK = {"savitzky-golay": 1.0, "pair": 1.0, "kinematic": 3.0}


@dataclass(frozen=True, slots=True)
class KnownEffects:
    """What is known of one transmission, and of its motor where the torque comes from the motor's side.

    Attributes
    ----------
    view : the transmission
    damping : of the transmission [N·m·s/rad]
    gap : inside which it does not damp [rad]
    loops : whether it has hysteresis
    slack : how far noise may move the deflection [rad]
    rubs : whether the motor has dry friction
    load : friction as a part of the transmitted torque's size
    friction_limit, loop_limit : doubt that is tolerated [N·m]
    """

    view: TransmissionView
    damping: float
    gap: float
    loops: bool
    slack: float
    rubs: bool
    load: float
    friction_limit: float
    loop_limit: float

    @property
    def doubtful(self) -> bool:
        """Whether anything here may be in doubt."""
        return self.rubs or self.loops

    def start(self) -> Array:
        """Return the state before the first sample."""
        return loop_start(self.view.nominal)

    def block(self, state: Array, block: Conditioned) -> tuple[Array, Array, Array]:
        """Return the state, the torque transmitted in addition to the spring's [N·m], and the doubt in that and in the friction.

        Both have shape (N,), NaN where the deflection or its velocity is not known. The doubt is a share of what is tolerated.
        """
        other, doubt = np.zeros(len(block.rows)), np.zeros(len(block.rows))
        phi = deflection_of(block.fit, self.view)
        if self.damping > 0.0:
            other += engaged(phi, self.gap, self.damping * _rate(block, self.view))
        if self.loops:
            begun = loop_start(self.view.nominal) if block.rows.starts[0] else state
            state, torque, uncertain = loop_block(begun, self.view.nominal, phi, self.slack)
            other += torque
            doubt += uncertain / self.loop_limit
        if self.rubs:
            doubt += np.abs(block.fit[doubt_role(self.view)]) / self.friction_limit
        return state, other, doubt

    def way(self, block: Conditioned) -> Array:
        """Return which way friction acts, shape (N,), −1 to 1."""
        return block.fit[way_role(self.view)]


def _rate(block: Conditioned, view: TransmissionView) -> Array:
    measured = block.fit.get(f"velocity:{view.deflection}")
    if measured is not None:
        return measured
    return block.fit["velocity:link_position"] - block.fit[f"velocity:{view.motor_position}"]


def known_of(
    device: Device, view: TransmissionView, signals: JointSignals, tuning: Tuning, torque: str, *, motor: bool
) -> KnownEffects | None:
    """Return the known effects of a transmission other than its spring; None where there are none.

    Parameters
    ----------
    device, view : of the joint
    signals : a block or the whole, for how large its torques are, and its noise
    tuning : for the filter
    torque : role of the torque that the doubt is compared with
    motor : whether the torque comes from the motor's side, so that the motor's effects matter too

    Raises
    ------
    EstimatorError
        Friction grows as fast as the torque it is computed from.
    """
    t, friction = view.nominal, view.motor.reflected.friction
    rubbing, loops = motor and friction.rubs, loop_level(t)
    if rubbing and friction.load >= 1.0:
        raise EstimatorError(
            f"joint '{device.joint}': with a motor's friction.load of {friction.load:g} friction grows as fast as the transmitted"
            " torque, and cannot be determined; use a torque sensor (--tune modality=SENSOR, or --estimator direct)"
        )
    damping, gap = (0.0, 0.0) if isinstance(t, UnknownTransmission) else (t.damping, t.backlash)
    if not (rubbing or damping or loops):
        return None
    size, load = spread(signals.roles[torque]), friction.load if rubbing else 0.0
    level = load * size + (friction.breakaway if rubbing else 0.0)
    # Below a small part of the torque that is fitted, it does no harm. That in a loop stays until the deflection moves on.
    least = NEGLIGIBLE_SHARE * size
    limits = max(DOUBT_OF_FRICTION * level, least), max(NEGLIGIBLE_SHARE * loops, least)
    return KnownEffects(view, damping, gap, loops > 0.0, slack_of(view, signals, tuning), rubbing, load, *limits)


def slack_of(view: TransmissionView, signals: JointSignals, tuning: Tuning) -> float:
    """Return by how much noise may move a transmission's deflection behind the filters [rad]."""
    steps = [signals.resolution.get(role, 0.0) for role in view.deflection_roles(signals.roles)]
    return float(SLACK[tuning.filter] * np.linalg.norm(steps) / 12.0**0.5)


def conditioner_of(
    device: Device,
    signals: JointSignals,
    tuning: Tuning,
    roles: tuple[str, ...],
    *,
    motor: bool,
    present: bool = True,
    rates: tuple[str, ...] = (),
    exact: bool = False,
    near: float | None = None,
) -> Conditioner:
    """Return the filters for a method that reads `roles`, with the rig's known effects of motors and transmissions.

    Without a motor's position and torque among the roles there is nothing to subtract friction from. `present`, `exact`,
    `near`, and `rates` with what damping needs, as for a `Conditioner`.
    """
    driven = (v for v in device.transmissions if {v.motor_position, v.motor_torque} <= set(roles))
    views = tuple(v for v in driven if motor and extended(v.motor))
    before = FrictionCompensation(views, signals, tuning.filter, tuning.shape) if views else None
    return tuning.conditioner(roles, signals, (*_rates(device, roles), *rates), before, present, exact, near)


def _rates(device: Device, roles: Collection[str]) -> tuple[str, ...]:
    """Return the positions whose velocity the transmissions' damping needs."""
    damped = [
        v for v in device.transmissions if not isinstance(v.nominal, UnknownTransmission) and v.nominal.damping > 0.0
    ]
    return tuple(dict.fromkeys(role for v in damped for role in v.deflection_roles(roles)))
