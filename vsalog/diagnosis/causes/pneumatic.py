"""What muscles, valves and their friction may have unlike the rig (Shin, Ibayashi, Kogiso 2021)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from vsalog.binding.joint import signal_of
from vsalog.diagnosis.causes.base import Cause, Parameter, Setting, Site, with_part, with_signal
from vsalog.effects.base import Exactness
from vsalog.rig.schema import PneumaticJoint, PressureFriction, SimpleFriction, TonduFriction

TWINS = ("_1", "_2")
PRESSURES = ("pressure_1", "pressure_2")


def pulls(setting: Setting, *equations: str) -> bool:
    """Return whether an equation with the muscles' torque is there, or gave the others an angle or a pressure."""
    pulled = PRESSURES if setting.joint.seesaw.held_at is not None else ("link_position", *PRESSURES)
    gave = "" in setting.torques and bool(setting.equations) and any(role not in setting.roles for role in pulled)
    return gave or bool(set(equations) & set(setting.equations))


def filled(setting: Setting, twin: str) -> bool:
    """Return whether the equation of a muscle's pressure is there."""
    return f"pressure{twin}" in setting.equations


class PneumaticPressureOffset(Cause):
    """A pressure sensor whose zero is elsewhere."""

    name = "pneumatic.pressure_offset"
    title = (
        "The {part} sensor reads too much or too little by a constant: its zero is off, or it is no absolute pressure"
    )
    says = "the muscle's pull and its flow are those of another pressure, by the same amount at every moment"
    confirm = "Open the muscle to the outside and compare the sensor's reading with a barometer."
    reference = "Shin 2021 eq. 4 and 6: pressures are absolute"
    signature = "torque equations: ∂τ/∂P; pressure equation: the flow's change with the pressure"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per pressure that is recorded."""
        for role in PRESSURES if isinstance(setting.joint, PneumaticJoint) else ():
            yield from self._of(setting, role)

    def _of(self, setting: Setting, role: str) -> Iterator[Site]:
        spec = getattr(setting.joint.signals, role)
        if spec is None or role not in setting.roles or not setting.equations:
            return
        signal = signal_of(spec)
        if signal.constant is not None:
            return
        air = setting.joint.air
        most = 0.5 * (air.supply_pressure - air.outside_pressure)
        # A pressure below zero is none.
        least = float(np.nanmin(setting.roles[role][0])) - 0.2 * air.outside_pressure
        highest = max(min(most, least), 1e-3 * most)
        parameter = Parameter("offset", "Pa", signal.offset, 1e-4 * most, -most, highest, scale=most)

        def apply(joint: Any, values: Sequence[float]) -> Any:
            return with_signal(joint, role, offset=float(values[0]))

        yield Site(self.name, role, (parameter,), apply)


class PneumaticMuscleFriction(Cause):
    """Dry friction of tubes and meshes."""

    name = "pneumatic.muscle_friction"
    exact = Exactness.CORNERED
    title = "Dry friction of the muscles is missing in the rig, or has another level"
    says = "the joint's torque is off by a level that has the sign of its velocity"
    confirm = (
        "Let the pressures rise and fall very slowly to and fro: the angle comes back on another branch, and the torque"
        " between the two is twice the friction."
    )
    reference = "Shin 2021 eq. 10 and §II-B4, T_p; §IV-B for the other laws"
    signature = "seesaw equation: sgn ψ̇, with 1/(P − P_out)² where the friction is that of the paper"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one where the seesaw's equation can be formed."""
        if not isinstance(setting.joint, PneumaticJoint) or setting.joint.seesaw.held_at is not None:
            return
        if "seesaw" not in setting.equations and ("torque_sensor" in setting.roles or not pulls(setting)):
            return
        friction = setting.joint.friction
        torque = setting.torque_size()
        if isinstance(friction, PressureFriction):
            # Of two muscles at half of what the supply gives.
            tube = 2.0 * (0.5 * (setting.joint.air.supply_pressure - setting.joint.air.outside_pressure)) ** -2.0
            parameter = Parameter(
                "muscle",
                "N*m*Pa^2",
                friction.muscle,
                1e-3 * torque / tube,
                0.0,
                key="friction.muscle",
                scale=torque / tube,
            )
        else:
            level = friction.kinetic if isinstance(friction, TonduFriction) else friction.level if friction else 0.0
            parameter = Parameter("torque", "N*m", level, 1e-3 * torque, 0.0, key="coulomb", scale=torque)
        yield Site(self.name, "friction", (parameter,), _rubbed)


def _rubbed(joint: Any, values: Sequence[float]) -> Any:
    level = max(float(values[0]), 0.0)
    match joint.friction:
        case PressureFriction():
            return with_part(joint, "friction", muscle=level)
        case TonduFriction() as friction:
            # What it takes to break away beyond that stays as it is.
            return with_part(joint, "friction", kinetic=level, static=level + friction.static - friction.kinetic)
        case _:
            return replace(joint, friction=SimpleFriction(level=level))
