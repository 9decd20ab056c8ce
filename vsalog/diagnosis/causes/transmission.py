"""What a transmission may have unlike the rig: its spring, damping, hysteresis, gap, drift."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from vsalog.diagnosis.causes.base import (
    Cause,
    Parameter,
    Remainder,
    Setting,
    Site,
    starts_of,
    suffix_of,
    transmissions_of,
    with_part,
)
from vsalog.diagnosis.causes.motor_friction import LEAST_TRAVEL
from vsalog.effects.base import Exactness
from vsalog.rig.schema import (
    AwasTransmission,
    BoucWen,
    CubicTransmission,
    PolynomialTransmission,
    SlipElement,
)


def scaled(transmission: Any, factor: float) -> Any:
    """Return a transmission with the stiffness of its whole nominal spring multiplied by a factor."""
    if isinstance(transmission, PolynomialTransmission):
        return replace(transmission, coefficients=tuple(factor * c for c in transmission.coefficients))
    if isinstance(transmission, AwasTransmission):
        return replace(transmission, spring_stiffness=factor * transmission.spring_stiffness)
    if isinstance(transmission, CubicTransmission):
        return replace(transmission, stiffness=factor * transmission.stiffness, cubic=factor * transmission.cubic)
    return replace(transmission, stiffness=factor * transmission.stiffness)


class _OfTransmission(Cause):
    """A cause that sits in each transmission."""

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per transmission."""
        for name in transmissions_of(setting.joint):
            if suffix_of(name) in setting.deflections:
                yield self.site(setting, name, getattr(setting.joint, name))

    def site(self, setting: Setting, name: str, transmission: Any) -> Site:
        """Return the cause in one transmission."""
        raise NotImplementedError


class TransmissionStiffness(_OfTransmission):
    """A spring of the right shape and another stiffness."""

    name = "transmission.stiffness"
    title = "The spring of the {part} is stiffer or softer than in the rig, by one factor at every deflection"
    says = "the torque it transmits is off by one factor"
    confirm = "Clamp the link and load the joint slowly with known torques: compare the slope with the rig's."
    reference = "Flacco 2012 eq. 47, 49"
    signature = "transmission equation: τ_e(φ)"
    order = -1

    def site(self, setting: Setting, name: str, transmission: Any) -> Site:
        """Return the cause in one transmission."""
        parameter = Parameter("factor", "1", 1.0, 0.01, 0.05, 20.0, key="stiffness")

        def apply(joint: Any, values: Sequence[float]) -> Any:
            return replace(joint, **{name: scaled(getattr(joint, name), float(values[0]))})

        return Site(self.name, name, (parameter,), apply)


class TransmissionHysteresis(_OfTransmission):
    """A loop between loading and unloading."""

    name = "transmission.hysteresis"
    exact = Exactness.CORNERED
    title = "The {part} transmits more torque as it is loaded than as it is unloaded (hysteresis), unlike in the rig"
    says = "the torque it transmits is off by a loop over the deflection"
    confirm = "Load and unload the joint very slowly with the link clamped: the loop stays as wide however slow."
    reference = "Ikhouane and Rodellar (2007), Systems with Hysteresis: the normalised Bouc–Wen model"
    signature = "transmission equation: z(φ)"

    def site(self, setting: Setting, name: str, transmission: Any) -> Site:
        """Return the cause in one transmission."""
        phi, torque = setting.deflection_size(suffix_of(name)), setting.torque_size()
        loop = transmission.bouc_wen
        height, width = (loop.torque, loop.width) if loop is not None else (0.0, 0.1 * phi)
        # A loop may be as narrow as that of dry friction.
        low, high = float(np.log(LEAST_TRAVEL * phi)), float(np.log(2.0 * phi))
        begun = tuple(float(np.log(share * phi)) for share in (5e-4, 4e-3, 0.02, 0.06, 0.2, 0.5))
        parameters = (
            Parameter(
                "torque",
                "N*m",
                height,
                1e-3 * torque,
                0.0,
                starts=(max(height, 0.01 * torque),),
                key="bouc_wen.torque",
                scale=torque,
            ),
            Parameter("width", "1", float(np.log(width)), 0.02, low, high, 1.0, shape=True, starts=begun),
        )

        def apply(joint: Any, values: Sequence[float]) -> Any:
            exponent, shape = (loop.exponent, loop.shape) if loop is not None else (1.0, 1.0)
            torque, width = max(float(values[0]), 0.0), float(np.exp(values[1]))
            return with_part(joint, name, bouc_wen=BoucWen(torque=torque, width=width, exponent=exponent, shape=shape))

        def report(values: Sequence[float]) -> dict[str, tuple[float, str]]:
            return {"torque": (float(values[0]), "N*m"), "width": (float(np.exp(values[1])), "rad")}

        return Site(self.name, name, parameters, apply, starts_of(parameters), report)

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per transmission; of a bench, whose equations have no other friction, one with dry friction, too."""
        for site in super().sites(setting):
            yield site
            if all(e.startswith("transmission") for e in setting.equations):
                yield _beside_friction(site, setting)


def _beside_friction(loop: Site, setting: Setting) -> Site:
    """Return hysteresis with a slip element that slips at once in addition to its loop."""
    name, phi, own = loop.part, setting.deflection_size(suffix_of(loop.part)), len(loop.parameters)
    step = loop.parameters[0].step
    narrowest, narrow = loop.parameters[1].starts[:2]
    low = float(np.log(LEAST_TRAVEL * phi))
    travel = Parameter("slip_travel", "1", 0.5 * (low + narrow), 0.02, low, narrow, 1.0, shape=True)

    def starts(left: Remainder) -> list[tuple[float, ...]]:
        begun = loop.starts(left) if loop.starts is not None else []
        return [(*s, 10.0 * step, narrowest) for s in begun if s[1] > narrow]

    def apply(joint: Any, values: Sequence[float]) -> Any:
        changed = loop.apply(joint, values[:own])
        limit = max(float(values[own]), 0.0)
        if limit == 0.0:
            return changed
        element = SlipElement(stiffness=limit / float(np.exp(values[own + 1])), limit=limit)
        return with_part(changed, name, slip=(*getattr(changed, name).slip, element))

    def report(values: Sequence[float]) -> dict[str, tuple[float, str]]:
        limit, travel = float(values[own]), float(np.exp(values[own + 1]))
        return loop.reported(values[:own]) | {"slip_limit": (limit, "N*m"), "slip_travel": (travel, "rad")}

    parameters = (
        *loop.parameters,
        Parameter("slip_limit", "N*m", 0.0, step, 0.0, key="slip.limit", scale=loop.parameters[0].scale),
        travel,
    )
    return Site(loop.cause, name, parameters, apply, starts, report)
