"""The parts of a guess."""

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
    """A channel that may have a role, the meaning of its name, and the evidence for its part where the name lacks it."""

    channel: Channel
    meaning: Meaning
    because: str = ""

    def with_part(self, part: str, because: str) -> Candidate:
        """Return it as a part's, by evidence other than its name."""
        return replace(self, meaning=replace(self.meaning, part=part), because=because)


@dataclass(frozen=True, slots=True)
class Load:
    """The load of a motor's torque, by least squares: B θ̈ + D θ̇ + friction + k s, of a spring's angle or torque s.

    Attributes
    ----------
    inertia, damping, friction, spring : B [kg·m²], D [N·m·s/rad], Coulomb friction [N·m], k [N·m/rad, or 1 for a torque s]; all
        negative where the motor's torque counts the other way round
    low, high : 95 % interval of `spring`, of any part of the noise that its signal has
    """

    inertia: float
    damping: float
    friction: float
    spring: float
    low: float
    high: float

    @property
    def sign(self) -> int:
        """Sign of the torque: 0 where the log does not show it, or motor and spring contradict each other."""
        if self.low * self.high <= 0.0 or self.inertia * self.spring <= 0.0:
            return 0
        return 1 if self.spring > 0.0 else -1


class RoleGuess(Struct, frozen=True):
    """A channel for a role.

    Attributes
    ----------
    channel : its name, with ``{run}`` where the log has runs
    confidence : 0 … 1
    reasons : in words
    unit : to be stated in the rig, where only the name contains it, not the log
    side, sign : as in the rig
    is_current : a motor torque that is recorded as a current
    has_sign : whether the numbers show `sign`
    counts_per_turn : the counts after which its encoder wraps; None for one that does not, or that is not in ``counts``
    """

    channel: str
    confidence: float
    reasons: tuple[str, ...]
    unit: str | None = None
    side: Literal["joint", "rotor"] = "joint"
    sign: Literal[1, -1] = 1
    is_current: bool = False
    counts_per_turn: int | None = None
    has_sign: bool = False


class RunGuess(Struct, frozen=True):
    """A run: the value of ``{run}``, and the number in it, whose unit is not in the log."""

    name: str
    setpoint: float | None = None


class JointGuess(Struct, frozen=True):
    """A joint: its kind, its roles, and what is missing.

    Attributes
    ----------
    name, kind : as for the rig
    reason : for that kind
    confidence : of the kind
    roles : role → channel
    missing : role → why there is none
    not_needed : those of the missing roles that an estimate does not need
    load : what the motor's torque moves, with the deflection as its spring; None where its scale or that of an angle is not
        known; of a current, per N·m/A of the torque constant
    stiffness : slope of the torque sensor over the deflection [N·m/rad]; None where it does not follow, or a scale is unknown
    gear_ratio : rotor turns per joint turn, estimated from two positions: no datum
    whole_gear_ratio : the only whole number in its interval; None where there is none, or several
    runs : if the log contains several
    findings : about the joint
    """

    name: str
    kind: Kind
    reason: str
    confidence: float
    roles: Mapping[str, RoleGuess]
    missing: Mapping[str, str]
    gear_ratio: float | None = None
    whole_gear_ratio: int | None = None
    runs: tuple[RunGuess, ...] = ()
    findings: tuple[Finding, ...] = ()
    not_needed: tuple[str, ...] = ()
    load: Load | None = None
    stiffness: float | None = None

    @property
    def is_driven(self) -> bool:
        """Whether a drive with a command moves it, and no deflection is known."""
        return self.kind == "rigid" and any(role in self.roles for role in COMMANDS)


class Guess(Struct, frozen=True):
    """All joints that were recognised, and the findings."""

    joints: tuple[JointGuess, ...]
    findings: tuple[Finding, ...] = ()
