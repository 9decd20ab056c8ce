"""Dry friction: Coulomb, Stribeck, in proportion to the load, and bristles that give way before it slides.

What computes it from a motion is `mechanics.friction`; what looks for it is `diagnosis.causes.motor_friction`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from msgspec.structs import replace

from vsalog.core.quantities import Base, Damping, Share, Speed, Stiffness, TorqueLevel
from vsalog.effects.base import Default, Effect
from vsalog.effects.counterpart import BODIES, Counterpart, Lack, Term


class Friction(Base, frozen=True):
    """Dry friction, added to the viscous one of `damping`: level = coulomb + (static − coulomb) exp(−(v/v_s)²) + load |τ_e|.

    Attributes
    ----------
    coulomb : level that opposes any motion [N·m]
    static : break-away level, at least `coulomb` and equal to it when absent [N·m]; needs `stribeck_velocity`
    stribeck_velocity : v_s, over which the level falls from `static` to `coulomb` [rad/s]
    load : part of the transmitted torque's size that is added to the level
    presliding_stiffness : σ₀ of the bristles that give way before sliding (LuGre; Dahl without `static` and
        `presliding_damping`) [N·m/rad]; ideal stick and slip when absent
    presliding_damping : σ₁ of the bristles [N·m·s/rad]
    """

    coulomb: TorqueLevel = 0.0
    static: TorqueLevel | None = None
    stribeck_velocity: Speed | None = None
    load: Share = 0.0
    presliding_stiffness: Stiffness | None = None
    presliding_damping: Damping = 0.0

    @property
    def breakaway(self) -> float:
        """Level at rest, load aside [N·m]."""
        return self.coulomb if self.static is None else self.static

    def geared(self, ratio: float) -> Friction:
        """Return rotor-side friction as the joint feels it through a gear of that ratio."""
        speed, stiffness = self.stribeck_velocity, self.presliding_stiffness
        return replace(
            self,
            coulomb=self.coulomb * ratio,
            static=None if self.static is None else self.static * ratio,
            stribeck_velocity=None if speed is None else speed / ratio,
            presliding_stiffness=None if stiffness is None else stiffness * ratio**2,
            presliding_damping=self.presliding_damping * ratio**2,
        )

    @property
    def rubs(self) -> bool:
        """Whether there is any."""
        return self.breakaway > 0.0 or self.load > 0.0

    def along_with(self, other: Friction) -> Friction:
        """Return this and another dry friction at one shaft; of two Stribeck speeds or bristles it has the first one's."""
        if other == Friction():
            return self
        if self == Friction():
            return other
        falls = self.static is not None or other.static is not None
        bristled = self if self.presliding_stiffness is not None else other
        return Friction(
            coulomb=self.coulomb + other.coulomb,
            static=self.breakaway + other.breakaway if falls else None,
            stribeck_velocity=self.stribeck_velocity if self.stribeck_velocity is not None else other.stribeck_velocity,
            load=self.load + other.load,
            presliding_stiffness=bristled.presliding_stiffness,
            presliding_damping=bristled.presliding_damping,
        )


def stribeck(excess: float, speed: float, v: Any) -> Any:
    """Return by how much the level exceeds Coulomb's [N·m]: excess · exp(−(v/v_s)²).

    `v` [rad/s] is a number or an array, and what is returned has its shape.
    """
    ratio = v / speed
    return excess * np.exp(-ratio * ratio)


def bristle_rate(stiffness: float, z: float, v: float, speed: float, level: float) -> float:
    """Return ż of the LuGre model: v − σ₀ |v| z / level. `speed` is |v|."""
    return v - stiffness * speed * z / level


def bristles_after(z: float, dx: float, end: float, stiffness: float, level: float) -> float:
    """Return what a displacement makes of bristles: ż = v − σ₀ |v| z / level, solved exactly for a constant level.

    Parameters
    ----------
    z : deflection [rad] or torque [N·m] of the bristles
    dx : displacement [rad]
    end : size of `z` while they slide, in its unit
    stiffness : σ₀ [N·m/rad]
    level : at which they slide [N·m]
    """
    towards = end if dx > 0.0 else -end
    after: float = towards + (z - towards) * np.exp(-stiffness * abs(dx) / level)
    return after


def _mjcf(part: Any) -> Iterator[Term | Lack]:
    """Yield ideal friction as frictionloss, and bristles as the LuGre friction of a passive motor."""
    own: Friction = part.friction
    if own.load:
        yield Lack("friction.load", "frictionloss does not depend on the load")
    if own.presliding_stiffness is not None:
        numbers = (
            own.presliding_stiffness,
            own.presliding_damping,
            own.coulomb,
            own.breakaway,
            own.stribeck_velocity or 1.0,
        )
        yield Term("dcmotor", {"lugre": numbers})
        return
    if own.static is not None and own.static > own.coulomb:
        yield Lack(
            "friction.static", "frictionloss has one level; with a presliding_stiffness it becomes LuGre friction"
        )
    yield Term("joint", {"frictionloss": own.coulomb})


def _urdf(part: Any) -> Iterator[Term | Lack]:
    own: Friction = part.friction
    for key in ("static", "load", "presliding_stiffness"):
        if getattr(own, key):
            yield Lack(f"friction.{key}", "the friction of a URDF joint is one level")
    yield Term("dynamics", {"friction": own.coulomb})


EFFECT = Effect(
    counterparts=tuple(Counterpart(part, ("friction",), _mjcf, _urdf) for part in BODIES),
    tolerances=(
        Default(
            ("coulomb", "static", "kinetic", "level", "friction.muscle"),
            "temperature, load and wear change dry friction by half; a gear loses 10 % unless more is known",
            share=0.5,
            share_of_scale=0.1,
        ),
        Default(
            ("stribeck_velocity", "friction.speed", "presliding_stiffness", "bouc_wen.width"),
            "a factor of 3 upwards: seldom measured",
            share=2.0,
        ),
        Default(("load", "shaft_coefficient"), "a gear's efficiency is known to 5 points", share=0.5, least="0.05"),
    ),
)
