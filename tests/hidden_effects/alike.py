"""Effects that are the same physics, or nearly: which other name is right too, and when.

The rule is one for all pairs of the table: the other name is right where the two effects, the other one scaled to fit best,
differ by less than BELOW times the noise in every equation of the nominal machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .bench import Bench, Hidden
from .effects import EFFECTS
from .equations import LeftOver

BELOW = 0.5
# Two effects fit a log equally well where they differ by less than the noise, or by less than this share of their size.
EQUALLY = 0.1


@dataclass(frozen=True)
class Alike:
    """Two effects that may be alike.

    Attributes
    ----------
    truth, named : what is hidden, and the other name for it
    elsewhere : whether the other is at another part of the joint; at the same if not
    reason : why
    """

    truth: str
    named: str
    elsewhere: bool
    reason: str


_TWO_ENCODERS = "both encoders enter the deflection; which one is off shows in the inertial and gravity torques only"
ALIKE = (
    Alike(
        "motor.stribeck_friction",
        "motor.coulomb_friction",
        False,
        "where the rise towards rest is below the noise, what is left is Coulomb friction",
    ),
    Alike("link.payload", "link.gravity", False, "a payload near the axis has next to no inertia"),
    Alike("link.payload", "link.inertia", False, "where the link hardly leaves its rest, its gravity does not show"),
    Alike("sensor.encoder_offset", "sensor.encoder_offset", True, _TWO_ENCODERS),
    Alike("sensor.encoder_scale", "sensor.encoder_scale", True, _TWO_ENCODERS),
    Alike("sensor.encoder_eccentricity", "sensor.encoder_eccentricity", True, _TWO_ENCODERS),
    Alike("sensor.clock_skew", "sensor.clock_skew", True, _TWO_ENCODERS),
)


# What is one and the same in devices that record less: any name of a row is right for each other of it.
_TORQUE_OR_ANGLE = (
    "transmission.stiffness@transmission",
    "sensor.torque_gain@torque_sensor",
    "sensor.encoder_scale@deflection",
)
_WEIGHT = (
    "link.gravity@link",
    "link.payload@link",
    "sensor.torque_offset@torque_sensor",
    "transmission.asymmetry@transmission",
)
SAME = {
    "rigid": (
        ("motor.inertia@motor", "link.inertia@link"),
        ("motor.viscous_friction@motor", "link.viscous_friction@link"),
        ("motor.coulomb_friction@motor", "link.coulomb_friction@link"),
        ("motor.torque_delay@motor", "sensor.clock_skew@motor_position", "sensor.clock_skew@link_position"),
    ),
    "bench": (
        _TORQUE_OR_ANGLE,
        ("link.coulomb_friction@link", "motor.coulomb_friction@motor", "transmission.hysteresis@transmission"),
        ("sensor.torque_offset@torque_sensor", "sensor.encoder_offset@deflection"),
    ),
}  # fmt: skip
# A weight that turns by little is an offset, a slope and a bend.
_BEND = ("sensor.encoder_offset@deflection", "transmission.nonlinearity@transmission")
BENT = {"bench": {"link.gravity": (*_WEIGHT, *_TORQUE_OR_ANGLE, *_BEND)}}

# What an effect brings along at its own part, of which the catalogue has the nearest only: its name is neither right nor false.
# The walls of a gap are damped in proportion to their torque (Hunt, Crossley 1975).
BROUGHT = {"transmission.backlash": ("transmission.damping",)}


def same_physics(cause: str, machine: Any) -> list[str]:
    """Return what else a cause may be called in a device, "cause@part"."""
    rows = [row for row in SAME.get(machine.device, ()) if any(m.split("@")[0] == cause for m in row)]
    return [m for row in rows for m in row] + list(BENT.get(machine.device, {}).get(cause, ()))


def told_apart(one: Hidden, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Return by how many times the noise an effect differs from those it may be alike: "cause@part" → difference."""
    out = {}
    for pair in ALIKE:
        if pair.truth != one.effect.cause:
            continue
        other = EFFECTS[pair.named]
        parts = [p for p in other.parts(bench.nominal) if (p != one.part) == pair.elsewhere and p not in bench.missing]
        for part in parts:
            out[f"{pair.named}@{part}"] = difference(one, bench, pair.named, part, rng)
    return out


def difference(one: Hidden, bench: Bench, cause: str, part: str, rng: np.random.Generator, tries: int = 1) -> float:
    """Return what is left of an effect, in multiples of the noise, after the best of another cause is taken off it.

    Parameters
    ----------
    one : the effect
    bench : of the machine
    cause, part : the other
    rng : for the other's shape; an effect of the same cause takes the first one's
    tries : how many shapes are tried
    """
    mine = bench.left_over([one])
    if mine is None:
        return float("inf")
    effect, best = EFFECTS[cause], float("inf")
    signed = effect.bounds(bench.nominal, part, bench.scales)[0] < 0.0
    for _ in range(tries):
        shape = one.shape if cause == one.effect.cause else effect.shape(rng, bench.nominal, part, bench.scales)
        for sign in (1.0, -1.0) if signed else (1.0,):
            other = Hidden(effect, part, shape, 0.0)
            if not bench.scaled(other, one.size, sign, rounds=4):
                continue
            theirs = [bench.left_over([other])]
            if "phase" in shape:
                # A wave of any phase is a sum of two.
                turned = Hidden(effect, part, shape | {"phase": shape["phase"] + 0.5 * np.pi}, other.strength)
                theirs.append(bench.left_over([turned]))
            found = [t for t in theirs if t is not None]
            if len(found) < len(theirs):
                continue
            share, rest = _rest(mine, found)
            best = min(best, rest)
            if share > 0.0:
                break
    return best


def _rest(mine: dict[str, LeftOver], theirs: list[dict[str, LeftOver]]) -> tuple[float, float]:
    """Take the best shares of what other effects leave over off what one does; return the first share and the rest."""
    a = np.concatenate([part.values / part.noise for part in mine.values()])
    columns = [np.concatenate([t[name].values / part.noise for name, part in mine.items()]) for t in theirs]
    shares = np.linalg.lstsq(np.stack(columns, axis=1), a, rcond=None)[0]
    if len(theirs) == 1:
        shares = np.maximum(shares, 0.0)
    worst = 0.0
    for name, part in mine.items():
        rest = part.values - sum(share * t[name].values for share, t in zip(shares, theirs, strict=True))
        worst = max(worst, float(np.sqrt(np.mean(rest**2)) / part.noise))
    return (1.0 if len(theirs) > 1 else float(shares[0])), worst


def fits_equally(one: Hidden, bench: Bench, member: str, rng: np.random.Generator, tries: int = 3) -> bool | None:
    """Tell whether a cause that is reported to be indistinguishable from an effect really fits as well.

    Parameters
    ----------
    one, bench : the effect and its machine
    member : "cause" or "cause@part"
    rng, tries : for shapes of the other

    Returns
    -------
    none where the cause cannot be hidden in this machine, so that it cannot be reported
    """
    cause, part = split(member)
    if cause == one.effect.cause and part in ("", one.part):
        return True
    if cause not in EFFECTS:
        return None
    parts = [p for p in EFFECTS[cause].parts(bench.nominal) if p not in bench.missing and part in ("", p)]
    if not parts:
        return None
    limit = max(1.0, EQUALLY * one.size)
    return any(difference(one, bench, cause, p, rng, tries) < limit for p in parts)


def split(member: str) -> tuple[str, str]:
    """Split "cause", "cause@part", "cause (part)" or "cause part" into cause and part."""
    words = "".join(" " if c in "@():" else c for c in member).split()
    return (words[0] if words else ""), (words[1] if len(words) > 1 else "")
