"""What sensors may do otherwise than the rig says: gain, offset, drift, delay, an encoder off its axis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from vsalog.binding.joint import signal_of
from vsalog.diagnosis.causes.base import (
    WAVY,
    Apply,
    Cause,
    Parameter,
    Setting,
    Site,
    is_rigid,
    one_clock,
    suffix_of,
    transmissions_of,
    with_signal,
)
from vsalog.mechanics.links import link_weight
from vsalog.residuals.system import LATEST
from vsalog.rig.schema import Eccentricity

TORQUES = ("torque_sensor", "torque_sensor_1", "torque_sensor_2")
ENCODERS = (
    "motor_position",
    "motor_position_1",
    "motor_position_2",
    "link_position",
    "deflection",
    "deflection_1",
    "deflection_2",
)
CLOCKED = (*ENCODERS, "pressure_1", "pressure_2", "valve_1", "valve_2")


def _changing(role: str, field: str) -> Apply:
    def apply(joint: Any, values: Sequence[float]) -> Any:
        return with_signal(joint, role, **{field: float(values[0])})

    return apply


def _recorded(setting: Setting, roles: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """Yield the roles that are recorded, with their signals."""
    for role in roles:
        spec = getattr(setting.joint.signals, role, None)
        if spec is not None and role in setting.roles and setting.equations:
            signal = signal_of(spec)
            if signal.constant is None:
                yield role, signal


def _has_places(setting: Setting) -> bool:
    """Tell whether a joint is elsewhere another one: a rigid one is where neither weight nor cogging nor a second encoder is."""
    joint = setting.joint
    if not is_rigid(joint) or "encoders" in setting.equations:
        return True
    return bool(joint.motor.cogging) or (joint.link is not None and link_weight(joint.link) != 0.0)


class _OfTorqueSensor(Cause):
    """A cause that is one number of a torque sensor."""

    field: str
    parameter: str

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per torque sensor."""
        for role, signal in _recorded(setting, TORQUES):
            parameter = self.number(setting, role, getattr(signal, self.field))
            yield Site(
                self.name, role, (parameter,), self.changing(setting, role), doubles=tuple(self.doubles(setting, role))
            )

    def changing(self, setting: Setting, role: str) -> Apply:
        """Return what puts a number of the sensor's in."""
        return _changing(role, self.field)

    def doubles(self, setting: Setting, role: str) -> Iterator[str]:
        """Yield the names of causes that would look the same."""
        return iter(())

    def number(self, setting: Setting, role: str, start: float) -> Parameter:
        """Return what is fitted."""
        raise NotImplementedError


class TorqueGain(_OfTorqueSensor):
    """A torque sensor that says too much or too little."""

    name = "sensor.torque_gain"
    title = "The {part} says a multiple of the torque: its calibration is off"
    says = "it is off by one factor against all the other equations"
    confirm = "Hang a known weight on a known lever and read the sensor."
    reference = "Flacco 2012 §6.2, the torque sensor as reference"
    signature = "transmission equation: τ_sensor; motor and link equations agree with each other"
    field = "gain"

    def number(self, setting: Setting, role: str, start: float) -> Parameter:
        """Return what is fitted."""
        return Parameter("gain", "1", start, 0.01, 0.05, 20.0)

    def doubles(self, setting: Setting, role: str) -> Iterator[str]:
        """Yield a computed torque where the deflection that it may have been computed from is not in the log."""
        suffix = suffix_of(role)
        seen = {f"deflection{suffix}", "link_position"} & set(setting.roles)
        if not seen and f"transmission{suffix}" in transmissions_of(setting.joint):
            yield TorqueNotIndependent.name


class TorqueOffset(_OfTorqueSensor):
    """A torque sensor that says something at zero."""

    name = "sensor.torque_offset"
    title = "The {part} says a torque when there is none: it has an offset"
    says = "it is off by a constant"
    confirm = "Read the sensor with the joint unloaded."
    reference = "Flacco 2012 §6.2, the torque sensor as reference"
    signature = "transmission equation: 1"
    field = "offset"

    def number(self, setting: Setting, role: str, start: float) -> Parameter:
        """Return what is fitted."""
        return Parameter("offset", "N*m", start, 1e-3 * setting.torque_size(role))


class TorqueDrift(_OfTorqueSensor):
    """A torque sensor whose zero wanders."""

    name = "sensor.torque_drift"
    title = "The zero of the {part} drifts"
    says = "it is off by an amount that grows with time"
    confirm = "Record the unloaded sensor for as long as the experiment lasts."
    reference = "strain gauges that warm up"
    signature = "transmission equation: t"
    field = "drift"

    def number(self, setting: Setting, role: str, start: float) -> Parameter:
        """Return what is fitted."""
        return Parameter("rate", "N*m/s", start, 1e-3 * setting.torque_size(role) / setting.duration)


class TorqueDelay(_OfTorqueSensor):
    """A torque sensor that is late."""

    name = "sensor.torque_delay"
    title = "The {part} is late against the other channels"
    says = "it is off in proportion to the torque's rate"
    confirm = "Tap the link and see when each channel notices."
    reference = "amplifiers' filters and buses"
    signature = "transmission equation: dτ/dt; motor and link equations agree with each other"
    field = "delay"

    def number(self, setting: Setting, role: str, start: float) -> Parameter:
        """Return what is fitted."""
        return Parameter("delay", "s", start, 0.25 * setting.period, -LATEST, LATEST)


class EncoderOffset(Cause):
    """An encoder whose zero is elsewhere."""

    name = "sensor.encoder_offset"
    title = "The zero of the {part} encoder is not where the rig says"
    says = "the deflection is off by a constant"
    confirm = "Unload the joint completely: motor and link encoder must agree."
    reference = "Flacco 2012 §6.1, alignment of the encoders"
    signature = "all equations with φ: σ(φ)"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per encoder."""
        for role, signal in _recorded(setting, ENCODERS) if _has_places(setting) else ():
            suffix = role[-2:] if role.endswith(("_1", "_2")) else ""
            parameter = Parameter("offset", "rad", signal.offset, 1e-3 * setting.deflection_size(suffix))
            yield Site(self.name, role, (parameter,), _changing(role, "offset"))


class EncoderScale(Cause):
    """An encoder that counts too much or too little."""

    name = "sensor.encoder_scale"
    title = "The {part} encoder counts too much or too little: its pulses per turn, or the gear ratio, are off"
    says = "the deflection is off in proportion to the position"
    confirm = "Turn the joint by a known angle, a whole turn if it can, and read the encoder."
    reference = "Flacco 2012 §6.1"
    signature = "all equations with φ: x σ(φ)"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per encoder."""
        for role, signal in _recorded(setting, ENCODERS) if _has_places(setting) else ():
            parameter = Parameter("gain", "1", signal.gain, 1e-3, 0.2, 5.0)
            yield Site(self.name, role, (parameter,), _changing(role, "gain"))


class EncoderEccentricity(Cause):
    """An encoder's disc off its axis."""

    name = "sensor.encoder_eccentricity"
    exact = WAVY
    title = "The disc of the {part} encoder is off its axis"
    says = "the deflection is off by a sine of the position, once per turn"
    confirm = "Turn the joint slowly through a whole turn, unloaded: motor and link encoder differ by a sine."
    reference = "Hagiwara, Suzuki, Murase (1992), A method of improving the resolution and accuracy of rotary encoders"
    signature = "all equations with φ: sin(x + α) σ(φ)"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per encoder of an angle that turns."""
        for role, signal in _recorded(setting, ENCODERS[:4]):
            disc = signal.eccentricity
            cosine, sine = (
                (disc.amplitude * np.cos(disc.phase), disc.amplitude * np.sin(disc.phase)) if disc else (0.0, 0.0)
            )
            step = 1e-3 * setting.deflection_size("")
            # amplitude · sin(x + phase) = (amplitude cos phase) sin x + (amplitude sin phase) cos x
            parameters = (
                Parameter("sine", "rad", float(cosine), step, -0.3, 0.3, hard=True),
                Parameter("cosine", "rad", float(sine), step, -0.3, 0.3, hard=True),
            )
            yield Site(self.name, role, parameters, _eccentric(role), report=_disc)


def _eccentric(role: str) -> Any:
    def apply(joint: Any, values: Sequence[float]) -> Any:
        told = _disc(values)
        return with_signal(joint, role, eccentricity=Eccentricity(told["amplitude"][0], told["phase"][0]))

    return apply


def _disc(values: Sequence[float]) -> dict[str, tuple[float, str]]:
    sine, cosine = float(values[0]), float(values[1])
    return {"amplitude": (float(np.hypot(sine, cosine)), "rad"), "phase": (float(np.arctan2(cosine, sine)), "rad")}


class ClockSkew(Cause):
    """A channel that is late or early against the others."""

    name = "sensor.clock_skew"
    title = "The {part} channel is late or early against the others"
    says = "what is made of it is off in proportion to its rate"
    confirm = "Tap the joint and see when each channel notices; look at how the channels get their stamps."
    reference = "stamps given on arrival instead of on measurement"
    signature = "all equations with φ: ẋ σ(φ)"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per encoder; where there are muscles, per pressure and valve too."""
        for role, signal in _recorded(setting, CLOCKED):
            one = one_clock(setting)
            # Half a sample either way is what few logs tell of torques that are held.
            blur = setting.period / 12.0**0.5 if one else 0.0
            parameter = Parameter("delay", "s", signal.delay, 0.25 * setting.period, -LATEST, LATEST, blur=blur)
            doubles = ("motor.torque_delay",) if one else ()
            yield Site(self.name, role, (parameter,), _changing(role, "delay"), doubles=doubles)


class TorqueNotIndependent(Cause):
    """A torque channel that was computed, not measured; found before anything is fitted, see `diagnosis.independent`."""

    name = "sensor.torque_not_independent"
    title = "The {part} is no measurement: it was computed from another channel"
    says = "it follows from another channel without any noise of its own"
    confirm = "Push the link with the motor switched off: a sensor notices, a formula of the motor's current does not."
    reference = "see `vsalog validate`, which refuses such a channel as a reference"
    signature = "a function of the deflection or of the motor's torque"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield nothing: it has no parameters to fit."""
        return iter(())
