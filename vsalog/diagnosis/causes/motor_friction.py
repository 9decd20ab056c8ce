"""Friction at the motor: viscous, Coulomb, Stribeck, and with the load."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace as replaced
from typing import Any

import numpy as np
from msgspec.structs import replace

from vsalog.diagnosis.causes.base import (
    Apply,
    Cause,
    Parameter,
    Remainder,
    Setting,
    Site,
    angle_of,
    is_rigid,
    moved_motors,
    position_of,
    scale_of,
    size,
    starts_of,
    with_part,
)
from vsalog.effects.base import Exactness
from vsalog.mechanics.links import link_weight

DRY = frozenset({"motor.coulomb_friction", "motor.stribeck_friction"})
# Dry friction gives way over no less than this part of what moves [1]: below it is a jump to any filter.
LEAST_TRAVEL = 1e-5


def with_bristles(plain: Site, setting: Setting) -> Iterator[Site]:
    """Yield a friction as it is, and with bristles that give way before it slides, which shows after each reversal."""
    own, rig = len(plain.parameters), getattr(setting.joint, plain.part).friction

    def level(values: Sequence[float]) -> float:
        return float(getattr(plain.apply(setting.joint, values[:own]), plain.part).friction.breakaway)

    def giving_way(joint: Any, values: Sequence[float], way: float) -> Any:
        joint = plain.apply(joint, values[:own])
        friction = getattr(joint, plain.part).friction
        if friction.breakaway == 0.0:
            return joint  # bristles without a level are nothing, and no rig may have them
        return with_part(joint, plain.part, friction=replace(friction, presliding_stiffness=friction.breakaway / way))

    if rig.presliding_stiffness is not None:
        # Stronger friction is that of stiffer bristles: they give way over what they did.
        way = rig.breakaway / rig.presliding_stiffness
        yield replaced(plain, apply=lambda joint, values: giving_way(joint, values, way)) if way else plain
        return
    yield plain
    role = position_of(setting, plain.part)
    if role not in setting.roles:
        return
    travel = size(angle_of(setting.joint, setting.roles[role], plain.part))
    if travel == 0.0:
        return  # what does not move shows no displacement before it slides
    torque = setting.torque_size() if plain.part == "link" else scale_of(setting, plain.part)[0]

    # What never slides is a spring to the ground, not friction.
    low, high = np.log(LEAST_TRAVEL * travel), np.log(0.3 * travel)
    begun = tuple(float(np.log(share * travel)) for share in (3e-4, 3e-3, 3e-2))
    way = Parameter("way", "1", 0.5 * (low + high), 0.05, float(low), float(high), 1.5, shape=True, starts=begun)

    def apply(joint: Any, values: Sequence[float]) -> Any:
        return giving_way(joint, values, float(np.exp(values[own])))

    def starts(left: Remainder) -> list[tuple[float, ...]]:
        first = plain.starts(left) if plain.starts is not None else [plain.start]
        least = 0.03 * torque if plain.parameters[0].unit == "N*m" else 0.03
        return [(max(s[0], least), *s[1:], displacement) for s in first[:2] for displacement in way.starts]

    def report(values: Sequence[float]) -> dict[str, tuple[float, str]]:
        stiffness = level(values) / float(np.exp(values[own]))
        return plain.reported(values[:own]) | {"presliding_stiffness": (stiffness, "N*m/rad")}

    yield Site(plain.cause, plain.part, (*plain.parameters, way), apply, starts, report, plain.excludes)


def carries(setting: Setting) -> bool:
    """Return whether the gear of a rigid joint transmits a known torque: its sensor measures it, or the link has a weight."""
    link = setting.joint.link
    return bool(setting.torques) or (link is not None and link_weight(link) != 0.0)


class MotorCoulombFriction(Cause):
    """Dry friction of one level."""

    name = "motor.coulomb_friction"
    exact = Exactness.CORNERED
    title = "Dry friction of the {part} is missing in the rig, or has another level"
    says = "its motor equation is off by a level that has the sign of the motor's velocity"
    confirm = (
        "Raise the motor's torque slowly from zero until it moves, both ways: half the difference is the friction."
    )
    reference = "Armstrong-Hélouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), §2"
    signature = "motor equation: sgn θ̇"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per motor."""
        for name in moved_motors(setting):
            torque, _ = scale_of(setting, name)
            start = getattr(setting.joint, name).friction.coulomb
            parameter = Parameter("torque", "N*m", start, 1e-3 * torque, 0.0, key="friction.coulomb", scale=torque)
            yield from with_bristles(Site(self.name, name, (parameter,), with_level(name), excludes=DRY), setting)


def with_level(name: str) -> Apply:
    """Return what puts a level of dry friction into a part of a joint."""

    def apply(joint: Any, values: Sequence[float]) -> Any:
        friction = getattr(joint, name).friction
        level = max(float(values[0]), 0.0)
        static = None if friction.static is None else max(friction.static, level)
        return with_part(joint, name, friction=replace(friction, coulomb=level, static=static))

    return apply


class MotorStribeckFriction(Cause):
    """Dry friction that is larger at rest than in motion."""

    name = "motor.stribeck_friction"
    exact = Exactness.CORNERED
    title = "Dry friction of the {part} falls as it begins to move (Stribeck), unlike in the rig"
    says = "its motor equation is off by a level that has the sign of the motor's velocity and is larger at slow motion"
    confirm = (
        "Let the motor turn at many constant speeds, the slowest below {velocity}: the torque first falls, then rises."
    )
    reference = "Armstrong-Hélouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), §2.2"
    signature = "motor equation: sgn θ̇ (1 + a exp(−θ̇²/v_s²))"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per motor."""
        for name in moved_motors(setting):
            torque, speed = scale_of(setting, name)
            friction = getattr(setting.joint, name).friction
            falling = friction.stribeck_velocity or 0.1 * speed
            # Friction rises towards rest within a filter's length: up to a tenth of the rise is averaged away.
            rounded = 0.1
            parameters = (
                Parameter("torque", "N*m", friction.coulomb, 1e-3 * torque, 0.0, key="friction.coulomb", scale=torque),
                Parameter(
                    "excess",
                    "N*m",
                    friction.breakaway - friction.coulomb,
                    1e-3 * torque,
                    0.0,
                    rounded=rounded,
                    starts=(0.01 * torque,),
                    key="friction.static",
                    scale=torque,
                ),
                Parameter(
                    "velocity",
                    "rad/s",
                    falling,
                    1e-3 * speed,
                    1e-3 * speed,
                    3.0 * speed,
                    0.3 * speed,
                    rounded=rounded,
                    shape=True,
                    starts=tuple(share * speed for share in (0.03, 0.1, 0.3, 0.8)),
                ),
            )
            starts = starts_of(parameters)
            plain = Site(self.name, name, parameters, _stribeck(name), starts, _stribeck_report, excludes=DRY)
            yield from with_bristles(plain, setting)


def _stribeck(name: str) -> Apply:
    def apply(joint: Any, values: Sequence[float]) -> Any:
        level, excess, velocity = (max(float(v), 0.0) for v in values)
        friction = replace(
            getattr(joint, name).friction, coulomb=level, static=level + excess, stribeck_velocity=velocity
        )
        return with_part(joint, name, friction=friction)

    return apply


def _stribeck_report(values: Sequence[float]) -> dict[str, tuple[float, str]]:
    level, excess, velocity = (float(v) for v in values)
    return {"torque": (level, "N*m"), "static": (level + excess, "N*m"), "velocity": (velocity, "rad/s")}


class MotorLoadDependentFriction(Cause):
    """Dry friction that grows with the torque that is transmitted."""

    name = "motor.load_dependent_friction"
    exact = Exactness.CORNERED
    title = "The gear of the {part} has friction in proportion to the torque it transmits, unlike in the rig"
    says = "its motor equation is off by a part of the transmitted torque's size, with the sign of the motor's velocity"
    confirm = "Measure the friction under several loads: it grows with them, in a straight line."
    reference = (
        "Hamon, Gautier, Garrec (2010), Dynamic identification of robots with a dry friction model depending on load"
    )
    signature = "motor equation: |τ_T| sgn θ̇"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per motor."""
        for name in moved_motors(setting):
            if is_rigid(setting.joint) and not carries(setting):
                continue
            start = getattr(setting.joint, name).friction.load
            parameter = Parameter("share", "1", start, 1e-3, 0.0, 0.9, key="friction.load")

            def apply(joint: Any, values: Sequence[float], name: str = name) -> Any:
                friction = replace(getattr(joint, name).friction, load=max(float(values[0]), 0.0))
                return with_part(joint, name, friction=friction)

            yield from with_bristles(Site(self.name, name, (parameter,), apply), setting)
