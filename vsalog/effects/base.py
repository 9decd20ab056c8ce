"""What an effect is: keys of the rig, tolerances and causes as data. Its formulas are functions on plain numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Literal, NamedTuple

from vsalog.core.units import parse_unit, split_number
from vsalog.effects.body_torque import BodyTorque
from vsalog.effects.counterpart import Counterpart
from vsalog.effects.reading_error import ReadingError


class Exactness(float, Enum):
    """Part of a number that filters and averages identify it to, by the shape of what it does.

    Dry friction, loops and gaps have corners, which are also rounder in a machine than in any rig.
    """

    SMOOTH = 5e-4
    WAVY = 2e-3
    CORNERED = 1e-2


class Default(NamedTuple):
    """Half-width of the 95 % interval of a kind of quantity: the largest of three parts.

    Attributes
    ----------
    names : the keys it holds for, or the ends of their paths
    reason : why it is as wide
    share : of the nominal value [1]
    share_of_scale : of the size that would matter, for what may be absent [1]
    least : with its unit
    """

    names: tuple[str, ...]
    reason: str
    share: float = 0.0
    share_of_scale: float = 0.0
    least: str = "0"

    def half_width(self, nominal: float, scale: float) -> float:
        """Return it in SI."""
        number, unit = split_number(self.least)
        least = number * parse_unit(unit).factor if unit else number
        return max(self.share * abs(nominal), self.share_of_scale * abs(scale), least)

    @property
    def words(self) -> str:
        """The half-width as text, such as "± 50 %, at least 10 % of scale"."""
        parts = [f"± {100.0 * self.share:g} %"] if self.share else []
        parts += [f"± {100.0 * self.share_of_scale:g} % of scale"] if self.share_of_scale else []
        parts += [f"± {self.least}"] if self.least != "0" else []
        return ", at least ".join(parts[:1] + [part.removeprefix("± ") for part in parts[1:]]) or "exact"


@dataclass(frozen=True, slots=True)
class Sizes:
    """What a cause may know of the log at the place where it sits.

    Attributes
    ----------
    value : of the cause's key in the rig, SI
    torque : size of the torque there [N·m]
    speed : size of the velocity there [rad/s]
    deflection : the largest of the transmission but for a few [rad]
    range : of a valve's voltage [V], or of the areas that fill a muscle [m²]
    period, duration : of the log [s]
    one_clock : whether one encoder and the motor's torque are all that has a time
    one_body : whether motor and link are seen moving as one, in one equation
    rotor : whether the rig gives that motor an inertia
    commanded : whether the motor's torque is not recorded but computed by the model of its drive from a commanded position
    computable : whether the torque sensor's reading may have been computed from a deflection that is not in the log
    """

    value: float
    torque: float
    speed: float
    deflection: float
    range: float
    period: float
    duration: float
    one_clock: bool = False
    one_body: bool = False
    rotor: bool = True
    commanded: bool = False
    computable: bool = False


Rule = float | Callable[[Sizes], float]
Place = Literal[
    "motor", "drive", "transmission", "link", "torque sensor", "encoder", "clock", "valve", "filled muscle", "pulling muscle"
]  # fmt: skip


def _always(_: Sizes) -> bool:
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class OneNumber:
    """A cause that is one number of the rig: a row of the catalogue of causes.

    Attributes
    ----------
    name : in the catalogue
    title, says, confirm, reference, signature : texts for the user; `{part}` is replaced by the part's name
    place : the kind of part where it sits
    key : of the rig, below the part; in a table of it, as ``drag.coefficient``
    number, unit : as the diagnosis reports it, SI
    step : small enough for the equations to be straight over it
    low, high : bounds
    reach : as far as one step of a fit may go
    blur : part of the value that no log determines, one standard deviation
    scale : the value that would matter in the log
    starts : where a search begins; at the rig's value when absent
    where : whether it is looked for in a log
    doubles : causes that look the same, where `doubled`
    order : in the catalogue, before the name
    exact : best relative accuracy to which equations determine the value
    """

    name: str
    title: str
    says: str
    confirm: str
    reference: str
    signature: str
    place: Place
    key: str
    number: str
    unit: str
    step: Rule
    low: Rule = -float("inf")
    high: Rule = float("inf")
    reach: Rule = float("inf")
    blur: Rule = 0.0
    scale: Rule = 0.0
    starts: tuple[Rule, ...] = ()
    where: Callable[[Sizes], bool] = _always
    doubles: tuple[str, ...] = ()
    doubled: Callable[[Sizes], bool] = _always
    order: int = 0
    exact: float = Exactness.SMOOTH


class Key(NamedTuple):
    """A table that an effect adds to a part of the rig.

    Attributes
    ----------
    part : that has it; a signal has errors of a sensor's reading
    name : of the key
    table : its structure
    says : text for the user
    many : whether a part may have several, as [[…]]
    """

    part: Literal["motor", "link", "signal"]
    name: str
    table: type[BodyTorque] | type[ReadingError]
    says: str
    many: bool = False


class Effect(NamedTuple):
    """A physical or sensing effect, as the registry knows it.

    Attributes
    ----------
    tolerances : how well its quantities are known where the rig states nothing
    causes : that are one number of the rig
    keys : of the rig, for torques on motors and links and for errors of sensors
    counterparts : what its keys become in models of other simulators
    """

    tolerances: tuple[Default, ...] = ()
    causes: tuple[OneNumber, ...] = ()
    keys: tuple[Key, ...] = ()
    counterparts: tuple[Counterpart, ...] = ()


def valued(rule: Rule, sizes: Sizes) -> float:
    """Return a number that may depend on the log."""
    return rule(sizes) if callable(rule) else rule
