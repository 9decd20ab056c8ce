"""What muscles, valves and their friction may have other than the rig says (Shin, Ibayashi, Kogiso 2021)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from vsalog.binding.joint import signal_of
from vsalog.diagnosis.causes.base import Cause, Parameter, Setting, Site, one_field, with_part, with_signal
from vsalog.effects.base import CORNERED
from vsalog.rig.schema import PneumaticJoint, PressureFriction, SimpleFriction, TonduFriction

TWINS = ("_1", "_2")
PRESSURES = ("pressure_1", "pressure_2")


class _OfMuscles(Cause):
    """A cause that sits at each of the two muscles."""

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per muscle that has the equations for it."""
        if isinstance(setting.joint, PneumaticJoint):
            for twin in TWINS:
                yield from self.of_muscle(setting, twin)

    def of_muscle(self, setting: Setting, twin: str) -> Iterator[Site]:
        """Yield the cause at one muscle."""
        raise NotImplementedError


def _pulls(setting: Setting, *equations: str) -> bool:
    """Tell whether one of the equations that hold the muscles' torque is there, or told an angle or a pressure to the others."""
    pulled = PRESSURES if setting.joint.seesaw.held_at is not None else ("link_position", *PRESSURES)
    told = "" in setting.torques and bool(setting.equations) and any(role not in setting.roles for role in pulled)
    return told or bool(set(equations) & set(setting.equations))


def _filled(setting: Setting, twin: str) -> bool:
    return f"pressure{twin}" in setting.equations


class PneumaticLeak(_OfMuscles):
    """A hole in a muscle."""

    name = "pneumatic.leak"
    title = "Air leaks out of {part}, and the rig has it tight"
    says = "its pressure falls faster than the rig says, the more so the higher it is, whatever the valve does"
    confirm = "Fill the muscle, shut its valve or pinch the hose, and see how fast the pressure falls; listen, or use soap water."
    reference = "Shin 2021 eq. 4 and 5, with one more orifice to the outside"
    signature = "pressure equation: the flow of an orifice to the outside, over V"

    def of_muscle(self, setting: Setting, twin: str) -> Iterator[Site]:
        """Yield the cause at one muscle."""
        if not _filled(setting, twin):
            return
        name, valve = f"muscle{twin}", getattr(setting.joint, f"valve{twin}")
        most = max(valve.inflow_area, valve.outflow_area) * valve.area_scale or 1e-8
        start = getattr(setting.joint, name).leak_area
        parameter = Parameter("area", "m^2", start, 1e-4 * most, 0.0, 100.0 * most, key="leak_area", scale=most)
        yield one_field(self.name, name, parameter, "leak_area")


class PneumaticOrificeArea(_OfMuscles):
    """A valve whose orifices are wider or narrower."""

    name = "pneumatic.orifice_area"
    title = "The orifices of {part} let more or less air through than the rig says, by one factor in and out"
    says = "its muscle's pressure changes faster or more slowly than the rig says, by one factor"
    confirm = "Step the valve's voltage with the joint clamped: the pressure ends where it should, but sooner or later."
    reference = "Shin 2021 §II-B2, A₁ and A₂"
    signature = "pressure equation: the valve's flow, over V"

    def of_muscle(self, setting: Setting, twin: str) -> Iterator[Site]:
        """Yield the cause at one muscle."""
        if not _filled(setting, twin):
            return
        name = f"valve{twin}"
        parameter = Parameter("scale", "1", getattr(setting.joint, name).area_scale, 1e-3, 0.02, 50.0, key="area_scale")
        yield one_field(self.name, name, parameter, "area_scale")


class PneumaticValveOffset(_OfMuscles):
    """A valve whose middle is at another voltage."""

    name = "pneumatic.valve_offset"
    title = "The middle of {part} is at another voltage than the rig says"
    says = "its muscle's pressure is off as if another voltage had been commanded"
    confirm = "Hold the voltage at which the valve should be half open, and see which pressure its muscle ends at."
    reference = "Shin 2021 §II-B2, Fig. 5c: the map κ"
    signature = "pressure equation: the flow's change with the voltage, over V"

    def of_muscle(self, setting: Setting, twin: str) -> Iterator[Site]:
        """Yield the cause at one muscle."""
        if not _filled(setting, twin):
            return
        name = f"valve{twin}"
        valve = getattr(setting.joint, name)
        span = valve.voltage[-1] - valve.voltage[0]
        # The map has corners: a step no longer than the distance between them.
        parameter = Parameter("offset", "V", valve.offset, 1e-4 * span, -span, span, 0.1 * span, scale=span)
        yield one_field(self.name, name, parameter, "offset")


class PneumaticPressureOffset(_OfMuscles):
    """A pressure sensor whose zero is elsewhere."""

    name = "pneumatic.pressure_offset"
    title = (
        "The {part} sensor says too much or too little by a constant: its zero is off, or it is no absolute pressure"
    )
    says = "the muscle's pull and its flow are those of another pressure, by the same amount at every moment"
    confirm = "Open the muscle to the outside and compare what the sensor says with a barometer."
    reference = "Shin 2021 eq. 4 and 6: pressures are absolute"
    signature = "torque equations: ∂τ/∂P; pressure equation: the flow's change with the pressure"

    def of_muscle(self, setting: Setting, twin: str) -> Iterator[Site]:
        """Yield the cause at one muscle."""
        role = f"pressure{twin}"
        spec = getattr(setting.joint.signals, role)
        if spec is None or role not in setting.roles or not setting.equations:
            return
        signal = signal_of(spec)
        if signal.constant is not None:
            return
        air = setting.joint.air
        most = 0.5 * (air.supply_pressure - air.outside_pressure)
        # A pressure that becomes less than nothing is none.
        least = float(np.nanmin(setting.roles[role][0])) - 0.2 * air.outside_pressure
        highest = max(min(most, least), 1e-3 * most)
        parameter = Parameter("offset", "Pa", signal.offset, 1e-4 * most, -most, highest, scale=most)

        def apply(joint: Any, values: Sequence[float]) -> Any:
            return with_signal(joint, role, offset=float(values[0]))

        yield Site(self.name, role, (parameter,), apply)


class PneumaticForceGain(_OfMuscles):
    """A muscle that pulls more or less strongly."""

    name = "pneumatic.force_gain"
    title = "{part} pulls more or less strongly than the rig says, by one factor"
    says = "the joint's torque is off in proportion to that muscle's pull"
    confirm = "Hang a known weight on that muscle alone and see which pressure holds it at a given length."
    reference = "Shin 2021 eq. 6 and 7: v and w are fitted, and rubber ages"
    signature = "torque equations: r cos ψ F of that muscle"

    def of_muscle(self, setting: Setting, twin: str) -> Iterator[Site]:
        """Yield the cause at one muscle."""
        if not _pulls(setting, "seesaw", "transmission"):
            return
        name = f"muscle{twin}"
        parameter = Parameter("gain", "1", getattr(setting.joint, name).force_gain, 1e-3, 0.05, 20.0, key="force_gain")
        yield one_field(self.name, name, parameter, "force_gain")


class PneumaticMuscleFriction(Cause):
    """Dry friction of tubes and meshes."""

    name = "pneumatic.muscle_friction"
    exact = CORNERED
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
        if "seesaw" not in setting.equations and ("torque_sensor" in setting.roles or not _pulls(setting)):
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
