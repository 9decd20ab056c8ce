"""Effects that are the same physics, or nearly: which other name is right too, and when.

The rule is one for all pairs of the table: the other name is right where the two effects, the other one scaled to fit best,
differ by less than BELOW times the noise in every equation of the nominal machine.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    for k in range(tries):
        shape = one.shape if cause == one.effect.cause else effect.shape(rng, bench.nominal, part, bench.scales)
        if "phase" in shape and k == 0 and part != one.part:
            # What one encoder adds to the deflection the other takes off it.
            shape = shape | {"phase": shape["phase"] + np.pi}
        for sign in (1.0, -1.0) if signed else (1.0,):
            other = Hidden(effect, part, shape, 0.0)
            if not bench.scaled(other, one.size, sign, rounds=4):
                continue
            theirs = bench.left_over([other])
            share, rest = (0.0, float("inf")) if theirs is None else _rest(mine, theirs)
            best = min(best, rest)
            if share > 0.0:
                break
    return best


def _rest(mine: dict[str, LeftOver], theirs: dict[str, LeftOver]) -> tuple[float, float]:
    """Take the best share of what one effect leaves over off what another does; return the share and the rest."""
    a = np.concatenate([part.values / part.noise for part in mine.values()])
    b = np.concatenate([theirs[name].values / part.noise for name, part in mine.items()])
    power = float(b @ b)
    share = max(float(a @ b) / power, 0.0) if power > 0.0 else 0.0
    rest = (mine[n].values - share * theirs[n].values for n in mine)
    return share, max(float(np.sqrt(np.mean(r**2)) / mine[n].noise) for r, n in zip(rest, mine, strict=True))


def fits_equally(one: Hidden, bench: Bench, member: str, rng: np.random.Generator, tries: int = 3) -> bool:
    """Tell whether a cause that is said to be indistinguishable from an effect really fits as well.

    Parameters
    ----------
    one, bench : the effect and its machine
    member : "cause" or "cause@part"
    rng, tries : for shapes of the other
    """
    cause, part = split(member)
    if cause not in EFFECTS:
        return False
    parts = [p for p in EFFECTS[cause].parts(bench.nominal) if p not in bench.missing and part in ("", p)]
    limit = max(1.0, EQUALLY * one.size)
    return any(difference(one, bench, cause, p, rng, tries) < limit for p in parts if (cause, p) != _key(one)) or (
        cause == one.effect.cause and part in ("", one.part)
    )


def split(member: str) -> tuple[str, str]:
    """Split "cause", "cause@part", "cause (part)" or "cause part" into cause and part."""
    words = "".join(" " if c in "@():" else c for c in member).split()
    return (words[0] if words else ""), (words[1] if len(words) > 1 else "")


def _key(one: Hidden) -> tuple[str, str]:
    return one.effect.cause, one.part
