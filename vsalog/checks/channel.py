"""Checks of a single channel as recorded: interpolated between fewer samples, wrapped, in counts.

They read the recording before binding: on a joint's grid vsalog itself interpolates a slower channel.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.joint import offered_roles, wanted_channels
from vsalog.checks.samples import FEWEST_LEVELS
from vsalog.core.errors import UnitError
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.precision import ROUNDING
from vsalog.core.recording import Channel, Recording
from vsalog.core.resolution import spread_over
from vsalog.core.significance import FALSE_ALARM_OF_MANY
from vsalog.core.units import si_factor
from vsalog.filters.unwrapping import WRAP_JUMP, wraps_around
from vsalog.rig.schema import Joint

Array = NDArray[np.float64]

MEASURED = (
    "motor_position",
    "link_position",
    "deflection",
    "motor_torque",
    "torque_sensor",
    "link_acceleration",
    "pressure",
)
ANGLES = ("motor_position", "link_position")


class Lines(NamedTuple):
    """Criteria for a signal that was interpolated between fewer samples.

    Attributes
    ----------
    longest : samples per sample of a slower sensor that are searched
    samples : of each phase that are examined
    fewest : corners of a signal of which a share is taken
    straight : part of a signal's usual second difference below which three samples are on a line
    at_knots : part of the corners that are at one phase, at least. Those of a measured signal are at any: 38 of 40 are at one
    of two with a probability of 2e-9
    """

    longest: int = 64
    samples: int = 40
    fewest: int = 40
    straight: float = 1e-3
    at_knots: float = 0.95


LINES = Lines()


def channel_findings(recordings: Sequence[Recording], name: str, joint: Joint) -> Iterator[Finding]:
    """Yield the faults of a joint's single channels.

    Parameters
    ----------
    recordings : with the joint's channels
    name, joint : of the rig
    """
    for role in offered_roles(joint):
        if not role.startswith(MEASURED):
            continue
        found = [
            one.channels[channel]
            for one in recordings
            for channel in sorted(wanted_channels(joint, one.path.name, [role]))
            if channel in one.channels
        ]
        about = partial(Finding, joint=name, part=role)
        for channel in found:
            x = channel.values[np.isfinite(channel.values)]
            if x.size < FEWEST_LEVELS or np.ptp(x) == 0.0:
                continue
            if each := samples_per_knot(x):
                yield about(code="signal.interpolated", value=float(each), limit=1.0)
            if role.startswith(ANGLES):
                turn, counts = _turn(channel), np.array_equal(x, np.round(x)) and float(np.ptp(x)) > math.tau
                if (times := wraps(x, turn)) > 0:
                    yield about(code="encoder.wrapped", severity="info", value=float(times), evidence={"turn": turn})
                # No encoder reads whole radians; without a unit the guess reports it.
                if channel.unit and counts and turn <= math.tau:
                    yield about(code="encoder.counts", value=float(np.ptp(x)), limit=math.tau, unit="rad")


def samples_per_knot(x: Array) -> int:
    """Return the samples from one corner of a signal to the next, if it is straight in between; 0 for none.

    An interpolated signal has corners at one phase and none at the others; a repeated reading, or an encoder's step, has two
    corners. A measured channel is reported with a probability below `FALSE_ALARM_OF_MANY`: see `Lines.at_knots`, for each
    number that is tried.
    """
    x = x[: 8 * LINES.longest * LINES.samples]
    curvature = np.abs(np.diff(x, 2))
    if not curvature.size or float(curvature.max()) == 0.0:
        return 0
    knots = np.flatnonzero(
        curvature > LINES.straight * float(np.median(curvature[curvature > ROUNDING * curvature.max()]))
    )
    if knots.size < LINES.fewest:
        return 0
    at_one = (n for n in range(2, LINES.longest + 1) if np.bincount(knots % n).max() >= LINES.at_knots * knots.size)
    # The divisors of a number have the same knots.
    return max(at_one, default=0)


def wraps(x: Array, turn: float) -> int:
    """Return how often an encoder's reading jumps by a turn and stays within one."""
    if not wraps_around(float(np.ptp(x)), turn):
        return 0
    return int(np.count_nonzero(np.abs(np.diff(x)) > WRAP_JUMP * turn))


def _turn(channel: Channel) -> float:
    """Return a turn in a channel's unit; of whole numbers the power of two that they stay within."""
    if channel.unit:
        try:
            return math.tau / si_factor(channel.unit, "rad")
        except UnitError:
            return math.inf
    x = spread_over(channel.values[np.isfinite(channel.values)])
    span = float(np.ptp(x))
    if np.array_equal(x, np.round(x)) and span > math.tau:
        return float(2.0 ** math.ceil(math.log2(span)))
    return math.tau if span <= math.tau * 1.01 else 360.0


TEXTS = {
    "signal.interpolated": Text(
        "{part} has corners at every {value:.0f}th sample only and is straight in between: it was interpolated.",
        "Record the samples as they are: interpolated ones are late, and repeat the noise of their neighbours.",
        FALSE_ALARM_OF_MANY,
    ),
    "encoder.wrapped": Text(
        "{part} jumps by a turn ({turn:.6g}) {value:n time}: its encoder wraps.", "The jumps are taken out."
    ),
    "encoder.counts": Text(
        "{part} is in whole numbers over a range of {value:.6g}, but its unit is radian: it is in encoder counts.",
        "Give the unit in the rig, such as unit = \"0.001534 rad\" for 4096 counts a turn.",
    ),
}  # fmt: skip
add_texts(TEXTS)
