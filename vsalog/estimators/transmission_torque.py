"""The torque Σ of a transmission from the signals measured next to it: a sum of derivatives, and so is its rate.

A torque sensor between transmission and link measures Σ itself. Else it follows from the equation of motion of the body on either
side: of the motor, B θ̈ + D θ̇ − Σ = τ, or of the link, I q̈ + N q̇ + g(q) + Σ = τ_ext (Serio 2011 eq. 1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, TransmissionView, deflection_of
from vsalog.estimators.torque_rates import RateNoise
from vsalog.filters.derivatives import Differentiated
from vsalog.mechanics.links import link_inertia, link_weight
from vsalog.rig.schema import Link, UnknownTransmission
from vsalog.uncertainty.sensor_error import ENOUGH, sensor_error

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Weight:
    """A link's weight: torque · sin(q − angle) [N·m]."""

    torque: float
    angle: float

    def of(self, q: Array) -> Array:
        """Return it at positions q, shape (N,) [rad]."""
        return np.asarray(self.torque * np.sin(q - self.angle))

    def rate(self, q: Array, q_dot: Array) -> Array:
        """Return its rate [N·m/s], at positions and velocities of shape (N,)."""
        return np.asarray(self.torque * np.cos(q - self.angle) * q_dot)


@dataclass(frozen=True, slots=True)
class LoadFriction:
    """Dry friction of a motor that grows with the torque Σ: load · |Σ| · way.

    Attributes
    ----------
    way, doubt : roles of which way friction acts, −1 to 1, and of by how much the whole friction may be off [N·m]
    load : share, below 1
    limit : doubt that is tolerated [N·m]
    """

    way: str
    doubt: str
    load: float
    limit: float


@dataclass(frozen=True, slots=True)
class TransmissionTorque:
    """Σ of one transmission.

    Attributes
    ----------
    view : the transmission
    terms : role → coefficients of its value, its rate, its acceleration in Σ
    measured : whether Σ is one recorded signal, whose rate neighbouring samples give without any filter
    weight : of the link, to subtract
    friction : of the motor; the part independent of Σ is subtracted from its torque beforehand
    """

    view: TransmissionView
    terms: Mapping[str, tuple[float, ...]]
    measured: bool = False
    weight: Weight | None = None
    friction: LoadFriction | None = None

    def orders(self, offered: Mapping[str, Array]) -> dict[str, int]:
        """Return which derivatives Σ̇ and φ̇ need, by role."""
        orders = dict.fromkeys(self.view.deflection_roles(offered), 1)
        for role, coefficients in self.terms.items():
            orders[role] = max(orders.get(role, 0), len(coefficients))
        if self.friction is not None:
            orders |= {self.friction.way: 0, self.friction.doubt: 0}
        return orders

    def torque(self, of: Mapping[str, Array]) -> Array:
        """Return Σ, shape (N,) [N·m], from derivatives by role, each of shape (order + 1, N)."""
        found = self._sum(of, 0)
        if self.weight is not None:
            found = found - self.weight.of(of["link_position"][0])
        return found * self._carried(found, of)

    def rate(self, of: Mapping[str, Array]) -> Array:
        """Return Σ̇, shape (N,) [N·m/s]."""
        found = self._sum(of, 1)
        if self.weight is not None:
            found = found - self.weight.rate(of["link_position"][0], of["link_position"][1])
        if self.friction is None:
            return found
        known = np.abs(of[self.friction.doubt][0]) <= self.friction.limit
        return np.where(known, found * self._carried(self._sum(of, 0), of), np.nan)

    def samples(self, part: Differentiated) -> tuple[Array, Array]:
        """Return Σ [N·m] and φ [rad] whose differences from one sample to the next are rates, shape (N,) each.

        A recorded Σ is taken as it was recorded. Accelerations are not recorded: a Σ of those is filtered, and so φ is.
        """
        if self.measured:
            (role,) = self.terms
            return part.rows.roles[role], deflection_of(part.rows.roles, self.view)
        return self.torque(part.of), self.deflection(part.of, 0)

    def deflection(self, of: Mapping[str, Array], order: int) -> Array:
        """Return φ [rad], or a derivative of it, shape (N,)."""
        return deflection_of({role: values[order] for role, values in of.items() if order < len(values)}, self.view)

    def rate_noise(self, signals: JointSignals, weights: Array, difference: float | None) -> RateNoise:
        """Return the noise of Σ̇ and φ̇ from the sensors.

        Parameters
        ----------
        signals : of the log
        weights : of the filter, shape (order + 1, window)
        difference : T [s] where rates are differences of neighbouring samples; None where the filter gives them
        """
        moving = self.view.deflection_roles(signals.roles)
        torque = deflection = shared = 0.0
        for role in dict.fromkeys((*self.terms, *moving)):
            error = sensor_error(signals.roles[role][:ENOUGH], weights.shape[1])
            a = _rate_weights(self.terms.get(role, ()), weights, difference, self.measured)
            b = _rate_weights((1.0,) if role in moving else (), weights, difference, self.measured)
            b = -b if role == self.view.motor_position else b
            torque += error.product(a, a)
            deflection += error.product(b, b)
            shared += error.product(a, b)
        return RateNoise(torque, deflection, shared)

    def _sum(self, of: Mapping[str, Array], more: int) -> Array:
        return np.asarray(
            sum(c * of[role][n + more] for role, terms in self.terms.items() for n, c in enumerate(terms) if c != 0.0)
        )

    def _carried(self, known: Array, of: Mapping[str, Array]) -> Array | float:
        """Return Σ / known where Σ = known + load · |Σ| · way, which has the one solution known / (1 ∓ load · way)."""
        if self.friction is None or self.friction.load == 0.0:
            return 1.0
        return np.asarray(1.0 / (1.0 - self.friction.load * of[self.friction.way][0] * np.sign(known)))


def _rate_weights(terms: tuple[float, ...], weights: Array, difference: float | None, bare: bool) -> Array:
    """Return the weights of a sum of derivatives' rate: filtered, or a difference of what is filtered, or of bare samples."""
    if difference is None:
        return np.asarray(sum((c * weights[n + 1] for n, c in enumerate(terms)), np.zeros(weights.shape[1])))
    if bare:
        value = np.array([terms[0] if terms else 0.0])
    else:
        value = sum((c * weights[n] for n, c in enumerate(terms)), np.zeros(weights.shape[1]))
    return np.asarray((np.append(value, 0.0) - np.append(0.0, value)) / difference)


def carried_by(link: Link) -> tuple[float, Weight | None]:
    """Return the inertia of a link and its payload [kg·m²], and the weight of both; None in a horizontal plane."""
    torque = link_weight(link)
    return link_inertia(link), Weight(torque, link.gravity_angle) if torque else None


def effects_left_in(name: str, device: Device) -> list[Finding]:
    """Find transmissions with damping or hysteresis in the rig, which a method that follows rates does not subtract."""
    return [
        Finding(code="transmission.effects_left_in", joint=device.joint, part=v.name, evidence={"estimator": name})
        for v in device.transmissions
        if not isinstance(v.nominal, UnknownTransmission)
        and (v.nominal.damping or v.nominal.bouc_wen or v.nominal.slip)
    ]
