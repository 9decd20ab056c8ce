"""Experiments that might be proposed: a small family of scenarios within what a log has shown to be safe."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi, sqrt
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.diagnosis.experiment_design import DESIGN
from vsalog.diagnosis.suggest_range import Range, Seen
from vsalog.mechanics import stiffness
from vsalog.rig.schema import (
    AntagonisticJoint,
    Payload,
    PneumaticJoint,
    RigFile,
    RigidJoint,
    SerialJoint,
    UnknownTransmission,
)
from vsalog.simulation.machine import drive_of
from vsalog.simulation.scenario_generic import generic, servos
from vsalog.simulation.scenario_schema import Constant, Drives, Parts, ScenarioFile, ServoDrive, Sine, Steps, Trapezoid

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Room:
    """What a driven quantity may do: swing about its middle by so much, so fast, and change its rate so sharply."""

    middle: float
    half: float
    rate: float
    curvature: float = np.inf

    def sine(self, frequency: float, share: float) -> float:
        """Return the amplitude of a sine that takes a share of the room, of the swing as of the speed."""
        return share * min(self.half, self.rate / (2.0 * pi * frequency))

    def step(self, rise: float) -> float:
        """Return how far half a cosine may go in that time."""
        return min(2.0 * self.half, self.rate * rise / (0.5 * pi), self.curvature * rise**2 / (0.5 * pi**2))

    def part(self, share: float) -> Room:
        """Return a part of the room."""
        return Room(self.middle, share * self.half, share * self.rate, share * self.curvature)


Wave = Callable[[Room, float], Parts]


def _ramps(room: Room, _: float) -> Parts:
    period = 1.0 / DESIGN.slowest
    swing = min(room.half, 0.25 * room.rate * period)
    ramp = Trapezoid(amplitude=2.0 * swing, rise=0.5 * period, hold=0.0, period=period, start=0.25 * period)
    return (Trapezoid(amplitude=-swing, rise=0.25 * period, hold=DESIGN.duration), ramp)


def _speeds(room: Room, _: float) -> Parts:
    swing = min(room.half, 0.5 * room.rate)
    parts, start = [Trapezoid(amplitude=-swing, rise=1.0, hold=DESIGN.duration)], 1.0
    for rise in (1.0, 2.0, 4.0):
        parts.append(Trapezoid(amplitude=2.0 * swing, rise=rise, hold=0.0, start=start))
        start += 2.0 * rise
    return tuple(parts)


def _swings(room: Room, _: float) -> Parts:
    swing, parts, start, side = 0.5 * room.step(1.0), list[Any](), 0.0, 1.0
    for rise in (1.0, 1.0, 1.0, 2.0, 2.0, 4.0, 4.0):
        # The first goes from the middle to one side, each other from side to side.
        change = side * swing if not parts else 2.0 * side * swing
        parts.append(Steps(times=(start,), values=(change,), rise=rise))
        start, side = start + rise, -side
    return tuple(parts)


def _sines(count: int, top: float) -> Wave:
    def wave(room: Room, fastest: float) -> Parts:
        highest = max(top * fastest, 2.0 * DESIGN.slowest)
        frequencies = np.geomspace(DESIGN.slowest, highest, count)
        return tuple(
            Sine(amplitude=room.sine(float(f), 1.0 / count), frequency=float(f), phase=0.5 * pi) for f in frequencies
        )

    return wave


def _fast(room: Room, fastest: float) -> Parts:
    slow, quick = room.sine(DESIGN.slowest, 0.4), room.sine(0.8 * fastest, 0.6)
    high = Sine(amplitude=quick, frequency=0.8 * fastest, phase=0.5 * pi)
    return Sine(amplitude=slow, frequency=DESIGN.slowest, phase=0.5 * pi), high


def _steps(room: Room, fastest: float) -> Parts:
    levels = [1.0, 0.3, -0.5, -1.0, -0.3, 0.6, 0.0]
    largest = max(abs(b - a) for a, b in zip([0.0, *levels], levels, strict=False))
    rise = next((r for r in np.linspace(0.5 / fastest, 1.8, 20) if room.step(r) >= largest * room.half), 1.8)
    swing = min(room.half, room.step(rise) / largest)
    times = tuple(0.5 + 2.1 * i for i in range(len(levels)))
    return (Steps(times=times, values=tuple(swing * v for v in levels), rise=float(rise)),)


# Words → wave.
WAVES: Mapping[str, Wave] = {
    "ramps at three speeds": _speeds,
    "a few sines from slow to the joint's resonance": _sines(5, 1.0),
    "levels that are held": _steps,
    "slow ramps with reversals": _ramps,
    "a slow and a faster sine": _sines(2, 0.4),
    "a slow sine with a fast one on top": _fast,
    "three sines from slow to the joint's resonance": _sines(3, 1.0),
    "smooth swings at three speeds": _swings,
}


@dataclass(frozen=True, slots=True)
class Candidate:
    """An experiment that might be proposed.

    Attributes
    ----------
    words : what is done
    joint : name of the joint that is driven
    file : as `vsalog simulate --scenario` runs it
    again : makes it with another share of what was seen
    share : of what was seen that it takes
    """

    words: str
    file: ScenarioFile
    again: Callable[[float], ScenarioFile]
    share: float = 1.0

    def with_share(self, share: float) -> Candidate:
        """Return it with another share of what was seen."""
        return dataclasses.replace(self, file=self.again(share), share=share)


@dataclass(frozen=True, slots=True)
class Trial:
    """A candidate as it was simulated.

    Attributes
    ----------
    candidate : with the share of what was seen that stays within it
    separations : D of each question, shape (Q,)
    payload : that has to be put on the link; none where the link stays as it is
    """

    candidate: Candidate
    separations: Array
    payload: Payload | None = None


def candidates(name: str, joint: Any, rig: RigFile, seen: Seen, period: float) -> list[Candidate]:
    """Return scenarios to choose from.

    Parameters
    ----------
    name, joint : of the extended rig
    rig : the rig with that joint in it
    seen : what the log shows the joint to bear
    period : sample time of the log [s]
    """
    second = _second(joint, seen)
    waves = list(WAVES.items())
    both = [(w, f, s) for w, f in waves[: DESIGN.with_second] for s in ("", second)]
    kinds = both if second else [(w, f, "") for w, f in waves]
    out = []
    for words, wave, also in kinds:

        def make(share: float, wave: Wave = wave, also: str = also) -> ScenarioFile:
            return _scenario(name, joint, rig, seen, period, wave, bool(also), share)

        out.append(Candidate(f"{words}{also}", make(1.0), make))
    return out


def _second(joint: Any, seen: Seen) -> str:
    """Return the words for a second movement that the joint can make; none where it cannot, or was not seen to."""
    lever = seen.driven.get("secondary_servo")
    if isinstance(joint, SerialJoint) and lever is not None and lever.half > 0.0 and lever.rate > 0.0:
        return ", while the set-point moves to and fro"
    if isinstance(joint, AntagonisticJoint):
        return ", while the motors draw apart and together again"
    if isinstance(joint, PneumaticJoint):
        return ", while both muscles stiffen and relax"
    return ""


def _scenario(
    name: str, joint: Any, rig: RigFile, seen: Seen, period: float, wave: Wave, second: bool, share: float
) -> ScenarioFile:
    """Return a scenario: one joint driven, the others of the rig held."""
    plain = generic("servo", rig, period)
    joints = {other: _held(drives, rig.joint[other]) for other, drives in plain.joint.items() if other != name}
    top = fastest(joint)
    own = dict(servos(name, joint, rig, 0, period)) if isinstance(joint, RigidJoint) else {}
    drives = dict[str, Any]()
    for key, one in seen.driven.items():
        if key == "motor_servo" and drive_of(joint) is not None:
            # Its drive has a loop of its own.
            drives["commanded_position"] = _reference(key, one, joint, wave, second, share, top)
            continue
        base = own.get(key) or getattr(plain.joint[name], key)
        if isinstance(joint, PneumaticJoint):
            drives[key] = _valve(key, one, wave, second, share, top)
            continue
        parts = _reference(key, one, joint, wave, second, share, top)
        limit = seen.torques.get(key.replace("servo", "torque"))
        drives[key] = replace(base, reference=parts, limit=_round(limit, down=True) if limit else None)
    joints = {n: (Drives(**drives) if n == name else joints[n]) for n in dict.fromkeys((*plain.joint, name))}
    return ScenarioFile(
        name="next", description="proposed by vsalog", duration=DESIGN.duration, period=period, joint=joints
    )


def _reference(key: str, seen: Range, joint: Any, wave: Wave, second: bool, share: float, top: float) -> Parts:
    """Return what a motor's servo follows."""
    room, first = _room(seen, share), _rest(seen, joint)
    moving = room.part(1.0 - DESIGN.second_share) if second and key[-2:] in ("_1", "_2") else room
    if key == "secondary_servo":
        if not second:
            return (Constant(value=_round(room.middle)),)
        slow = room.sine(DESIGN.second_frequency, 1.0)
        return (Constant(value=_round(room.middle)), Sine(amplitude=_round(slow), frequency=DESIGN.second_frequency))
    if first is None:
        parts: list[Any] = [Constant(value=room.middle)] if room.middle else []
    else:
        # It begins where the link hangs, and goes to the middle of what was seen without haste.
        way, most = room.middle - first, room.rate * DESIGN.longest_approach / (0.5 * pi)
        if abs(way) > most:
            way = float(np.copysign(most, way))
            middle = first + way
            left = max(min(seen.high - middle, middle - seen.low) * DESIGN.share * share, 0.0)
            moving = dataclasses.replace(moving, half=min(left, moving.half))
        # Sines begin at their peaks, where they are at rest.
        begun = sum(p.amplitude for p in wave(moving, top) if isinstance(p, Sine))
        way += begun
        rise = max(DESIGN.approach, 0.5 * pi * abs(way) / room.rate) if room.rate else DESIGN.approach
        parts = [Constant(value=first - begun)] if first - begun else []
        parts += [Steps(times=(0.0,), values=(way,), rise=rise)] if way else []
    if second and key[-2:] in ("_1", "_2"):
        side = -1.0 if key.endswith("_2") else 1.0
        slow = room.part(DESIGN.second_share).sine(DESIGN.second_frequency, 1.0)
        # From together to apart and back: the two begin where they are.
        parts += [
            Constant(value=side * slow),
            Sine(amplitude=-side * slow, frequency=DESIGN.second_frequency, phase=0.5 * pi),
        ]
    return tuple(map(_rounded, (*parts, *wave(moving, top))))


def _room(seen: Range, share: float) -> Room:
    part = share * DESIGN.share
    return Room(0.5 * (seen.low + seen.high), part * seen.half, part * seen.rate, part * seen.curvature)


def _rest(seen: Range, joint: Any) -> float | None:
    """Return where the joint begins: where its link hangs, or the nearest position that was seen; anywhere without gravity."""
    link = joint.link
    if link is None or not link.gravity_torque:
        return None
    return float(np.clip(link.gravity_angle, seen.low, seen.high))


def _valve(key: str, seen: Range, wave: Wave, second: bool, share: float, top: float) -> Parts:
    """Return a valve's voltage: the muscles take turns, and stiffen together as the second movement."""
    middle, half = 0.5 * (seen.low + seen.high), share * DESIGN.share * seen.half
    room = Room(middle, half, 2.0 * pi * half * top)
    parts: list[Any] = [Constant(value=middle)]
    if second:
        parts.append(Sine(amplitude=DESIGN.second_share * half, frequency=DESIGN.second_frequency))
        room = room.part(1.0 - DESIGN.second_share)
    side = -1.0 if key.endswith("_2") else 1.0
    return tuple(map(_rounded, (*parts, *(_turned(p, side) for p in wave(room, top)))))


def _turned(part: Any, side: float) -> Any:
    if isinstance(part, Steps):
        return replace(part, values=tuple(side * v for v in part.values))
    return replace(part, amplitude=side * part.amplitude)


def _held(drives: Drives, joint: Any) -> Drives:
    """Return what holds a joint of the rig that is not in question at its place."""
    out = dict[str, Any]()
    for key in Drives.__struct_fields__:
        drive = getattr(drives, key)
        if isinstance(drive, ServoDrive):
            start = joint.link.gravity_angle if joint.link is not None else 0.0
            at = 0.0 if key == "secondary_servo" else start
            out[key] = replace(drive, reference=(Constant(value=at),))
        elif drive and not isinstance(joint, RigidJoint):
            out[key] = tuple(p for p in drive if isinstance(p, Constant)) or (Constant(value=0.0),)
    return Drives(**out)


def fastest(joint: Any) -> float:
    """Return the highest frequency of an experiment: that of the link on its springs, but no higher than a loop follows [Hz]."""
    if isinstance(joint, PneumaticJoint):
        return 1.0
    springs = [getattr(joint, n) for n in ("transmission", "transmission_1", "transmission_2") if hasattr(joint, n)]
    known = [s for s in springs if not isinstance(s, UnknownTransmission)]
    if joint.link is None or not known or joint.link.inertia <= 0.0:
        return 2.0
    arm = joint.lever.start if isinstance(joint, SerialJoint) and joint.lever is not None else None
    stiff = sum(float(stiffness(s, 0.5 * s.backlash + 1e-4, arm)) for s in known)
    load = joint.link.payload
    inertia = joint.link.inertia + (load.mass * load.distance**2 if load is not None else 0.0)
    return float(np.clip(sqrt(max(stiff, 0.0) / inertia) / (2.0 * pi), 0.5, DESIGN.fastest))


def _rounded(part: Any) -> Any:
    """Return a part with numbers that people can read."""
    changed = dict[str, Any]()
    for name in part.__struct_fields__:
        value = getattr(part, name)
        if isinstance(value, float):
            changed[name] = _round(value)
        elif isinstance(value, tuple):
            changed[name] = tuple(_round(v) for v in value)
    return replace(part, **changed)


def _round(value: float, down: bool = False) -> float:
    """Round to four digits; a limit never upwards."""
    if value == 0.0 or not np.isfinite(value):
        return float(value)
    rounded = float(f"{value:.4g}")
    return float(f"{value * (1.0 - 5e-4):.4g}") if down and rounded > value else rounded
