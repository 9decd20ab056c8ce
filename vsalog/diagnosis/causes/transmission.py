"""What a transmission may have other than the rig says: its spring, damping, hysteresis, gap, drift."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from vsalog.diagnosis.causes.base import (
    CORNERED,
    Cause,
    Parameter,
    Remainder,
    Setting,
    Site,
    one_field,
    suffix_of,
    transmissions_of,
    with_part,
)
from vsalog.diagnosis.causes.motor_friction import NARROW
from vsalog.rig.schema import (
    AwasTransmission,
    BoucWen,
    CubicTransmission,
    PolynomialTransmission,
    SlipElement,
)

# Widths of loops and gaps to begin with, as parts of the deflection.
WIDTHS, GAPS = (5e-4, 4e-3, 0.02, 0.06, 0.2, 0.5), (0.02, 0.1, 0.3)


def scaled(transmission: Any, factor: float) -> Any:
    """Return a transmission with its whole nominal spring so many times as stiff."""
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
    title = "The spring of the {part} is stiffer or softer than the rig says, by one factor at every deflection"
    says = "the torque it transmits is off by one factor"
    confirm = "Clamp the link and load the joint slowly with known torques: compare the slope with the rig's."
    reference = "Flacco 2012 eq. 47, 49"
    signature = "transmission equation: τ_e(φ)"
    order = -1

    def site(self, setting: Setting, name: str, transmission: Any) -> Site:
        """Return the cause in one transmission."""
        parameter = Parameter("factor", "1", 1.0, 0.01, 0.05, 20.0)

        def apply(joint: Any, values: Sequence[float]) -> Any:
            return replace(joint, **{name: scaled(getattr(joint, name), float(values[0]))})

        return Site(self.name, name, (parameter,), apply)


class TransmissionNonlinearity(_OfTransmission):
    """A spring of another shape."""

    name = "transmission.nonlinearity"
    title = "The spring of the {part} hardens or softens with its deflection otherwise than the rig says"
    says = "the torque it transmits is off by the cube of the deflection"
    confirm = "Clamp the link and load the joint slowly up to the largest deflection: the curve bends."
    reference = "Flacco 2012 eq. 25: higher powers of φ"
    signature = "transmission equation: φ³"

    def site(self, setting: Setting, name: str, transmission: Any) -> Site:
        """Return the cause in one transmission."""
        suffix = suffix_of(name)
        scale = setting.torque_size() / setting.deflection_size(suffix) ** 3
        parameter = Parameter("cubic", "N*m/rad^3", transmission.added_cubic, 1e-3 * scale)
        return one_field(self.name, name, parameter, "added_cubic")


class TransmissionAsymmetry(_OfTransmission):
    """A spring that is stiffer one way than the other."""

    name = "transmission.asymmetry"
    title = "The spring of the {part} is stiffer one way than the other, and the rig has it alike"
    says = "the torque it transmits is off by opposite factors at positive and negative deflection"
    confirm = "Clamp the link and load the joint slowly both ways: compare the two slopes."
    reference = "Flacco 2014 eq. 7: even powers of φ"
    signature = "transmission equation: |τ_e(φ)|"

    def site(self, setting: Setting, name: str, transmission: Any) -> Site:
        """Return the cause in one transmission."""
        parameter = Parameter("asymmetry", "1", transmission.asymmetry, 1e-3, -0.95, 0.95)
        return one_field(self.name, name, parameter, "asymmetry")


class TransmissionDamping(_OfTransmission):
    """A transmission that damps."""

    name = "transmission.damping"
    title = "The {part} damps its deflection otherwise than the rig says"
    says = "the torque it transmits is off in proportion to the deflection's rate"
    confirm = "Clamp the motor, deflect the link and let go: see how fast the ringing fades, with the link's own friction known."
    reference = "De Luca 2007 eq. 1, D"
    signature = "transmission equation: φ̇"

    def site(self, setting: Setting, name: str, transmission: Any) -> Site:
        """Return the cause in one transmission."""
        suffix = suffix_of(name)
        stiffness = setting.torque_size() / setting.deflection_size(suffix)
        parameter = Parameter("damping", "N*m*s/rad", transmission.damping, 1e-4 * stiffness, 0.0)
        return one_field(self.name, name, parameter, "damping")


class TransmissionHysteresis(_OfTransmission):
    """A loop between loading and unloading."""

    name = "transmission.hysteresis"
    exact = CORNERED
    title = (
        "The {part} transmits more torque as it is loaded than as it is unloaded (hysteresis): the rig does not have it"
    )
    says = "the torque it transmits is off by a loop over the deflection"
    confirm = "Load and unload the joint very slowly with the link clamped: the loop stays as wide however slow."
    reference = "Ikhouane and Rodellar (2007), Systems with Hysteresis: the normalised Bouc–Wen model"
    signature = "transmission equation: z(φ)"

    def site(self, setting: Setting, name: str, transmission: Any) -> Site:
        """Return the cause in one transmission."""
        phi, torque = setting.deflection_size(suffix_of(name)), setting.torque_size()
        loop = transmission.bouc_wen
        height, width = (loop.torque, loop.width) if loop is not None else (0.0, 0.1 * phi)
        # A loop may be as narrow as dry friction is.
        low, high = float(np.log(NARROW * phi)), float(np.log(2.0 * phi))
        parameters = (
            Parameter("torque", "N*m", height, 1e-3 * torque, 0.0),
            Parameter("width", "1", float(np.log(width)), 0.02, low, high, 1.0, shape=True),
        )

        def starts(_: Remainder) -> list[tuple[float, ...]]:
            return [(max(height, 0.01 * torque), float(np.log(share * phi))) for share in WIDTHS]

        def apply(joint: Any, values: Sequence[float]) -> Any:
            exponent, shape = (loop.exponent, loop.shape) if loop is not None else (1.0, 1.0)
            torque, width = max(float(values[0]), 0.0), float(np.exp(values[1]))
            return with_part(joint, name, bouc_wen=BoucWen(torque=torque, width=width, exponent=exponent, shape=shape))

        def report(values: Sequence[float]) -> dict[str, tuple[float, str]]:
            return {"torque": (float(values[0]), "N*m"), "width": (float(np.exp(values[1])), "rad")}

        return Site(self.name, name, parameters, apply, starts, report)

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per transmission; of a bench, whose equations have no other friction, one with dry friction, too."""
        for site in super().sites(setting):
            yield site
            if all(e.startswith("transmission") for e in setting.equations):
                yield _beside_friction(site, setting)


def _beside_friction(loop: Site, setting: Setting) -> Site:
    """Return hysteresis with a slip element that gives way at once beside its loop."""
    name, phi, own = loop.part, setting.deflection_size(suffix_of(loop.part)), len(loop.parameters)
    step = loop.parameters[0].step
    low, high = float(np.log(NARROW * phi)), float(np.log(WIDTHS[1] * phi))
    travel = Parameter("slip_travel", "1", 0.5 * (low + high), 0.02, low, high, 1.0, shape=True)

    def starts(left: Remainder) -> list[tuple[float, ...]]:
        begun = loop.starts(left) if loop.starts is not None else []
        return [(*s, 10.0 * step, float(np.log(WIDTHS[0] * phi))) for s in begun if np.exp(s[1]) > WIDTHS[1] * phi]

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

    parameters = (*loop.parameters, Parameter("slip_limit", "N*m", 0.0, step, 0.0), travel)
    return Site(loop.cause, name, parameters, apply, starts, report)


class TransmissionBacklash(_OfTransmission):
    """A gap in which nothing is transmitted."""

    name = "transmission.backlash"
    exact = CORNERED
    title = "The {part} has a gap in which it transmits nothing (backlash), and the rig does not have it"
    says = "it transmits nothing at small deflections, and less than the rig says at all others"
    confirm = "Hold the motor and move the link to and fro by hand: between the two stops it goes freely."
    reference = "Nordin and Gutman (2002), Controlling mechanical systems with backlash, Automatica 38(10)"
    signature = "transmission equation: τ_e(φ) less the gap"

    def site(self, setting: Setting, name: str, transmission: Any) -> Site:
        """Return the cause in one transmission."""
        phi = setting.deflection_size(suffix_of(name))
        parameter = Parameter("gap", "rad", transmission.backlash, 2e-3 * phi, 0.0, 1.5 * phi, 0.3 * phi)

        def starts(_: Remainder) -> list[tuple[float, ...]]:
            return [(share * phi,) for share in GAPS]

        return one_field(self.name, name, parameter, "backlash", starts=starts)


class TransmissionStiffnessDrift(_OfTransmission):
    """A spring that becomes stiffer or softer in the course of the log."""

    name = "transmission.stiffness_drift"
    title = "The spring of the {part} becomes stiffer or softer in the course of the log, and the rig has it constant"
    says = "the torque it transmits is off by a factor that grows with time"
    confirm = "Repeat the same slow loading in the beginning and at the end: compare the slopes."
    reference = "creep and warming of elastomers"
    signature = "transmission equation: t τ_e(φ)"

    def site(self, setting: Setting, name: str, transmission: Any) -> Site:
        """Return the cause in one transmission."""
        most = 0.9 / setting.duration
        parameter = Parameter("rate", "1/s", transmission.drift, 0.01 * most, -most, 10.0 * most)
        return one_field(self.name, name, parameter, "drift")
