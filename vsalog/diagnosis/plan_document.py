"""The structures of what `plan --json` prints. `docs/plan.schema.json` is generated from them."""

from __future__ import annotations

from typing import Literal

import msgspec

SCHEMA = ("Plan", "vsalog plan", "What 'vsalog plan' predicts and proposes.")

Kind = Literal["confused", "equal", "richer"]


class _Part(msgspec.Struct, frozen=True, kw_only=True):
    """Values never change."""


class Member(_Part, frozen=True):
    """A cause at a part of a joint.

    Attributes
    ----------
    cause : name in the catalogue; "unknown" for any smooth function of a signal
    part : of the joint; empty where the available roles do not separate it from another one
    """

    cause: str
    part: str


class Rival(Member, frozen=True):
    """A cause that a diagnosis may name instead of another one, or along with it.

    Attributes
    ----------
    probability : that a diagnosis does not separate the two
    """

    probability: float


class Value(_Part, frozen=True):
    """A number of a cause.

    Attributes
    ----------
    value : that is assumed
    rig : that the rig has
    unit : SI
    """

    value: float
    rig: float
    unit: str


class Cause(Member, frozen=True):
    """A cause, as large as the rig's tolerance of it, on the motion that is judged.

    Attributes
    ----------
    parameters : its numbers
    seen : probability that a diagnosis names it, or a cause of its class
    confused_with : what it may not be separated from
    """

    parameters: dict[str, Value]
    seen: float
    confused_with: tuple[Rival, ...]


class ClassOfCauses(_Part, frozen=True):
    """Causes that the motion confuses.

    Attributes
    ----------
    members : of the class
    kind : "equal" where no motion separates them with these sensors, "richer" where one of them can do all that another does
        and more, so that only its being less simple counts against it, else "confused"
    sensor : role of the cheapest further sensor that separates them with the same motion; null where none of those tried does
    by_motion : whether the proposed motion separates them with the available sensors
    """

    members: tuple[Member, ...]
    kind: Kind
    sensor: str | None
    by_motion: bool


class Driven(_Part, frozen=True):
    """What the proposed motion drives.

    Attributes
    ----------
    signal : in words
    low, high : its least and greatest value
    unit : SI
    """

    signal: str
    low: float
    high: float
    unit: str


class Motion(_Part, frozen=True):
    """The proposed motion.

    Attributes
    ----------
    words : what is done
    duration : [s]
    driven : what moves
    payload_mass, payload_distance : of a mass to be put on the link [kg], [m]; null where none is
    """

    words: str
    duration: float
    driven: tuple[Driven, ...]
    payload_mass: float | None = None
    payload_distance: float | None = None


class JointPlan(_Part, frozen=True):
    """What is planned for a joint.

    Attributes
    ----------
    joint : name
    reason : why nothing can be planned; empty where it can
    equations : that the sensors allow
    causes : of the catalogue, wherever they may sit
    classes : that the motion confuses
    sensors_tried : roles, the cheapest first
    motion : that is proposed; null where none is needed, or none separates more
    no_motion : why there is none; empty where there is one or none is needed
    """

    joint: str
    reason: str
    equations: tuple[str, ...]
    causes: tuple[Cause, ...]
    classes: tuple[ClassOfCauses, ...]
    sensors_tried: tuple[str, ...]
    motion: Motion | None
    no_motion: str


class Plan(_Part, frozen=True, kw_only=True):
    """A whole plan.

    Attributes
    ----------
    version : of this structure
    vsalog : version that wrote it
    rig : as it was planned for, TOML
    scenario : the motion that was judged
    joints : what is planned for each
    """

    version: int = 1
    vsalog: str
    rig: str
    scenario: str
    joints: tuple[JointPlan, ...]
