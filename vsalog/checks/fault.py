"""A fault of a recording: what changed channels between a sensor and the log, and when it is reported."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from vsalog.checks.joint_equations import SHAPE

FREE: Mapping[str, int] = {
    "scale": 1,
    "gain": 1,
    "late": 1,
    "drift": 2,
    "gravity": 2,
    "stiffness": 5,
    "loop": 2 * SHAPE.slips,
}
"""Numbers that are fitted when a fault is undone, of those kinds that have any."""

Kind = Literal[
    "sign", "unit", "scale", "late", "drift", "exchanged", "unsigned", "gravity", "gain", "stiffness", "loop"
]
OF_SPRING: tuple[Kind, ...] = ("stiffness", "loop")
"""What a spring may do: it changes, or it has hysteresis."""
OF_JOINT: tuple[Kind, ...] = ("gain", *OF_SPRING)
"""What else may explain channels: a sensor's gain, and what a spring does, are no faults of a recording."""


class Rule(NamedTuple):
    """When a fault is reported, and the range of the search.

    Attributes
    ----------
    left : largest ratio of an equation's squared residual with the fault undone to that as recorded: it was most of the error
    holds : largest ratio of this equation's squared residual then to its target's squares: one that does not hold shows nothing
    blocks : of time, whose likelihoods are compared: the widest filter reaches into the next by a twentieth
    quiet : part of a mean block's squares below which a block is ignored
    gain : of log-likelihood per independent sample below which a delay or a factor is not refined: it would not be reported
    changes : of a spring's stiffness that are searched, at most: more pieces of a log than these resemble noise of any kind
    most : faults of one joint that are searched, one after another
    longest_delay : that is searched [s]: a few packets of the slowest bus; a later channel is on another clock
    fastest : rate of a clock against another, at most [s/s]: an oscillator without a crystal is right to a hundredth
    finest : part of a sample to which delays are found [1]: a tenth, as a power of two that halving the step comes to
    delays : steps of the grid on either side of 0 on which delays are searched
    scale : factor beyond which one torque is out of proportion to another: gears lose less than half of a torque
    drive_delay : of a drive behind its command, at most [s]: two cycles of commands at 20 Hz
    drive_delays : steps of these that are tried
    kept : part of a joint's samples that its commands and velocities cover at least, to be compared with the others
    unit_tolerance : largest relative difference of a factor from a unit's, as filters and quantisation make it
    """

    left: float = 0.5
    holds: float = 0.5
    blocks: int = 24
    quiet: float = 0.01
    gain: float = 0.05
    changes: int = 5
    most: int = 3
    longest_delay: float = 0.25
    fastest: float = 0.01
    finest: float = 1.0 / 16.0
    delays: int = 10
    scale: float = 2.0
    drive_delay: float = 0.1
    drive_delays: int = 2
    kept: float = 0.9
    unit_tolerance: float = 0.02


RULE = Rule()


@dataclass(frozen=True)
class Fault:
    """A fault of a joint's channels.

    Attributes
    ----------
    kind : a wrong sign, unit or scale, a delay, a drifting clock, two channels exchanged, a magnitude, gravity taken out; or a
        gain, a stiffness that changes, or a spring with a loop (`OF_JOINT`)
    roles : of the affected channels
    factor : of recorded over true values
    delay : of the recorded values in the middle of the log [s]
    rate : seconds per second by which they become later
    changes : when a stiffness may jump, after the middle of the log, ascending [s]; in between it is a line over time
    """

    kind: Kind
    roles: tuple[str, ...]
    factor: float = 1.0
    delay: float = 0.0
    rate: float = 0.0
    changes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Found:
    """A fault that was found.

    Attributes
    ----------
    fault : what is likeliest
    instead : other faults that would explain the channels as well
    p_value : probability that a sound recording is explained so much better by any of the faults
    left : ratio of the squared residuals with the fault undone and as recorded, of the equation that it explains best
    """

    fault: Fault
    instead: tuple[Fault, ...]
    p_value: float
    left: float


def unit_factors(role: str) -> Iterator[float]:
    """Yield by what a role is multiplied in a unit that it is often recorded in: degrees, N·mm or kN·m, turns a minute."""
    degrees, rpm = math.degrees(1.0), 30.0 / math.pi
    yield from (1e3, 1e-3) if "torque" in role else (degrees, 1.0 / degrees)
    yield from (rpm,) if "velocity" in role else ()
