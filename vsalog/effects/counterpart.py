"""What an effect becomes in a model of another simulator: attributes of the elements that have it there."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, NamedTuple

Dialect = Literal["mjcf", "urdf"]
"""MuJoCo's XML, and the Unified Robot Description Format."""


Bodied = Literal["motor", "link"]
BODIES: tuple[Bodied, Bodied] = ("motor", "link")
"""Parts that turn about the joint's axis and have inertia, damping and dry friction."""


Whole = Literal["motor", "drive", "link", "transmission"]
"""Parts of a joint that a model can have."""


class Term(NamedTuple):
    """What an effect adds to a model.

    Attributes
    ----------
    element : ``joint``, ``inertial``, ``payload``, ``actuator``, ``spring``, ``rotor``, ``dynamics`` or ``transmission``, of
        which a part has one, or ``fixed`` (a tendon) and ``dcmotor`` (a passive one), of which it has one more
    attributes : name → number or numbers, SI; several effects' numbers of an element that a part has once are added, and gains
        multiplied
    """

    element: str
    attributes: Mapping[str, Any]


class Lack(NamedTuple):
    """What a model cannot express of an effect.

    Attributes
    ----------
    key : of the rig, below the part
    reason : why, for the user
    """

    key: str
    reason: str


class Counterpart(NamedTuple):
    """What keys of a part of the rig become; a key that no counterpart names has none.

    Attributes
    ----------
    part : whose keys they are
    keys : names of keys that are converted together
    mjcf, urdf : of the part as the joint feels it, what there is of them; None where there is nothing
    """

    part: Whole
    keys: tuple[str, ...]
    mjcf: Callable[[Any], Iterable[Term | Lack]] | None = None
    urdf: Callable[[Any], Iterable[Term | Lack]] | None = None


def term(element: str, **attributes: Any) -> tuple[Term]:
    """Return one term."""
    return (Term(element, attributes),)
