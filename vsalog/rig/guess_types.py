"""What a guess consists of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from msgspec import Struct

from vsalog.core.finding import Finding
from vsalog.core.recording import Channel
from vsalog.rig.guess_names import Meaning
from vsalog.rig.roles import COMMANDS

Kind = Literal["rigid", "elastic", "serial", "antagonistic"]


@dataclass(frozen=True, slots=True)
class Candidate:
    """A channel that may have a role, what its name says, and what tells its part where the name does not."""

    channel: Channel
    meaning: Meaning
    because: str = ""

    def with_part(self, part: str, because: str) -> Candidate:
        """Return it as a part's, which something other than its name tells."""
        return replace(self, meaning=replace(self.meaning, part=part), because=because)


class RoleGuess(Struct, frozen=True):
    """A channel for a role.

    Attributes
    ----------
    channel : its name, with ``{run}`` where the log has runs
    confidence : 0 … 1
    reasons : in words
    unit : to be stated in the rig, where the log does not say what the name does
    side, sign : as in the rig
    is_current : a motor torque that is recorded as a current
    counts_per_turn : after how many counts its encoder wraps; None for one that does not, or that is not in ``counts``
    """

    channel: str
    confidence: float
    reasons: tuple[str, ...]
    unit: str | None = None
    side: Literal["joint", "rotor"] = "joint"
    sign: Literal[1, -1] = 1
    is_current: bool = False
    counts_per_turn: int | None = None


class RunGuess(Struct, frozen=True):
    """A run: what ``{run}`` stands for, and the number in it, whose unit the log does not tell."""

    name: str
    setpoint: float | None = None


class JointGuess(Struct, frozen=True):
    """A joint: its kind, its roles, and what is missing.

    Attributes
    ----------
    name, kind : as for the rig
    reason : why that kind
    confidence : of the kind
    roles : role → channel
    missing : role → why there is none
    not_needed : those of the missing roles that an estimate does without
    stiffness, inertia : in front of which an identification may begin, by the sizes of torque and motion; in the torque's unit
        and per rad; None where there is no torque of a motor, or the joint has two
    gear_ratio : rotor turns per joint turn as the ranges of two positions show it
    runs : where the log holds several
    findings : what a person should know
    """

    name: str
    kind: Kind
    reason: str
    confidence: float
    roles: Mapping[str, RoleGuess]
    missing: Mapping[str, str]
    gear_ratio: float | None = None
    runs: tuple[RunGuess, ...] = ()
    findings: tuple[Finding, ...] = ()
    not_needed: tuple[str, ...] = ()
    stiffness: float | None = None
    inertia: float | None = None

    @property
    def is_driven(self) -> bool:
        """Whether a drive with a command moves it, and nothing tells a deflection."""
        return self.kind == "rigid" and any(role in self.roles for role in COMMANDS)


class Guess(Struct, frozen=True):
    """All joints that were recognised, and what a person should know."""

    joints: tuple[JointGuess, ...]
    findings: tuple[Finding, ...] = ()
