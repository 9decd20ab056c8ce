"""Families of cases: what is hidden in each, how strong, and how it is driven and recorded.

A family hides effects whose strengths are those of real machines, however visible that makes them; the truth says how visible
each is alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .bench import Bench, Hidden
from .effects import EFFECTS, main_motors, motor_of, springs

MECHANICAL = ("elastic", "serial", "antagonistic")
Random = np.random.Generator
# What simulates, and which devices it can.
ENGINES = {"own": (*MECHANICAL, "rigid", "bench"), "mujoco": ("elastic", "rigid")}


@dataclass(frozen=True)
class Common:
    """Something that is wrong with a machine, as often and as strongly as in real ones.

    Attributes
    ----------
    cause : name of the effect
    draw : random generator → number that says how wrong
    weight : how often it is chosen, relative to the others
    excludes : causes that are not hidden along with it
    shared : probability that both like parts of an antagonistic joint are as wrong
    strength : that number, bench, part → strength of the effect
    """

    cause: str
    draw: Callable[[Random], float]
    weight: float = 1.0
    excludes: tuple[str, ...] = ()
    shared: float = 0.0
    strength: Callable[[float, Bench, str], float] = lambda number, *_: number


def signed(low: float, high: float) -> Callable[[Random], float]:
    """Return what draws a number of either sign."""
    return lambda rng: float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


def positive(low: float, high: float) -> Callable[[Random], float]:
    """Return what draws a positive number."""
    return lambda rng: float(rng.uniform(low, high))


def damping_times(factor: float, bench: Bench, part: str) -> float:
    """Return the strength that multiplies a damping by a factor."""
    row = bench.nominal.link[0] if part == "link" else motor_of(bench.nominal, part)
    return (factor - 1.0) * float(row["damping"]) * bench.scales.speed[part] / bench.scales.torque[part]


def of_first(share: float, bench: Bench, part: str) -> float:
    """Return the strength that gives every motor a torque of that share of the first one's scale."""
    own = main_motors(bench.nominal)
    return share * (bench.scales.torque[own[0]] / bench.scales.torque[part] if part in own else 1.0)


# What is commonly wrong, in the order in which the effects are laid upon one another.
COMMON = (
    Common("motor.inertia", signed(0.05, 0.15), shared=0.3),
    Common("motor.viscous_friction", positive(1.4, 2.2), shared=0.3, strength=damping_times),
    Common("motor.torque_constant", signed(0.03, 0.08), shared=0.3),
    Common("motor.coulomb_friction", positive(0.02, 0.06), shared=0.3, strength=of_first),
    Common("motor.torque_offset", signed(0.01, 0.04), 0.7),
    Common("motor.cogging", positive(0.01, 0.04), 0.3),
    Common("transmission.stiffness", signed(0.04, 0.10), 1.3, shared=0.5),
    Common("transmission.backlash", positive(0.01, 0.05), 0.2, ("transmission.hysteresis",)),
    Common("transmission.hysteresis", positive(0.01, 0.05), 0.25, ("transmission.backlash",)),
    Common("link.inertia", signed(0.05, 0.15)),
    Common("link.viscous_friction", positive(1.4, 2.2), strength=damping_times),
    Common("link.coulomb_friction", positive(0.01, 0.04), 0.3),
    Common("link.gravity", signed(0.04, 0.12), 0.4, ("link.payload",)),
    Common("link.payload", positive(0.05, 0.2), 0.3, ("link.gravity",)),
    Common("sensor.torque_gain", signed(0.02, 0.06), 0.8),
    Common("sensor.torque_offset", signed(0.01, 0.05), 0.8),
    Common("sensor.encoder_offset", signed(0.01, 0.06), 0.8),
    Common("sensor.clock_skew", signed(0.001, 0.003), 0.8),
)


def hide_common(bench: Bench, rng: Random, count: int, choice: tuple[Common, ...] = COMMON) -> list[Hidden]:
    """Choose things that are wrong and where; what both parts of a joint share counts once."""
    chosen: list[Common] = []
    possible = [c for c in choice if _parts(c, bench)]
    while possible and len(chosen) < count:
        weights = np.array([c.weight for c in possible])
        one = possible[int(rng.choice(len(possible), p=weights / weights.sum()))]
        chosen.append(one)
        possible = [c for c in possible if c is not one and c.cause not in one.excludes]
    chosen.sort(key=choice.index)
    return [hidden for one in chosen for hidden in _hide(one, bench, rng)]


def _parts(one: Common, bench: Bench) -> list[str]:
    return [p for p in EFFECTS[one.cause].parts(bench.nominal) if p not in bench.missing]


def _hide(one: Common, bench: Bench, rng: Random) -> list[Hidden]:
    effect, parts = EFFECTS[one.cause], _parts(one, bench)
    first = parts[int(rng.integers(len(parts)))]
    if "secondary_motor" in parts and rng.random() < 0.5:
        first = "motor"
    number, both = one.draw(rng), [first]
    alike = [group for group in (main_motors(bench.nominal), springs(bench.nominal)) if first in group]
    if alike and rng.random() < one.shared:
        both = alike[0]
    shared = len(both) > 1
    shape = effect.shape(rng, bench.nominal, first, bench.scales)
    return [Hidden(effect, part, shape, one.strength(number, bench, part), shared=shared) for part in both]


@dataclass(frozen=True)
class Family:
    """A family of cases.

    Attributes
    ----------
    name : of the family, and of its cases
    about : what it stands for
    hide : bench, random generator → what is hidden; none where that bench will not do
    devices : that are taken in turn
    """

    name: str
    about: str
    hide: Callable[[Bench, Random], list[Hidden] | None]
    devices: tuple[str, ...] = MECHANICAL


def _messy(bench: Bench, rng: Random) -> list[Hidden]:
    return hide_common(bench, rng, int(rng.integers(3, 9)))


FAMILIES = {
    family.name: family
    for family in (Family("messy", "three to eight things wrong at once, with the strengths of real machines", _messy),)
}
