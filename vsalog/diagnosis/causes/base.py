"""What a cause is: where in a joint it may sit, what it changes in the rig, and its texts for the user."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.binding.joint import signal_of
from vsalog.core.precision import ROUNDING
from vsalog.effects.base import Exactness
from vsalog.residuals.sensing import is_commanded, motors_of, position_role, torque_role
from vsalog.rig.schema import RigidJoint

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number that a cause is described by.

    Attributes
    ----------
    name, unit : as the diagnosis reports it, SI
    start : what it is in the original rig, or where the search begins
    step : small enough for the equations to be straight over it
    low, high : bounds
    reach : largest step of a fit, where the equations are non-linear
    hard : whether its bounds are physical limits of such an effect, whatever the cause's other numbers
    blur : part of the value that no log determines, one standard deviation
    rounded : part of the value that filters may remove where equations determine it, one standard deviation; trajectories keep it
    shape : whether it is the shape of an effect, not its strength: nothing is known of it before a log is seen
    starts : values that a search begins with; `start` alone when absent
    key : of the rig below the cause's part; the name when absent
    scale : the value that would matter in the log
    nominal : what the rig has, where the search does not begin there
    """

    name: str
    unit: str
    start: float
    step: float
    low: float = -np.inf
    high: float = np.inf
    reach: float = np.inf
    hard: bool = False
    blur: float = 0.0
    rounded: float = 0.0
    shape: bool = False
    starts: tuple[float, ...] = ()
    key: str = ""
    scale: float = 0.0
    nominal: float | None = None


@dataclass(frozen=True, slots=True)
class Remainder:
    """Residuals of the equations at some stage of the search, for causes that look where to begin.

    Attributes
    ----------
    time : shape (N,) [s]
    equations : name → residual at every sample, shape (N,), NaN where it does not count
    roles : role → value and derivatives, shape (3, N), as the rig has them
    noise : name → what noise, drawn K times, makes of the equation at every sample, shape (K, N)
    """

    time: Array
    equations: Mapping[str, Array]
    roles: Mapping[str, Array]
    noise: Mapping[str, Array]


Apply = Callable[[Any, Sequence[float]], Any]
Starts = Callable[[Remainder], list[tuple[float, ...]]]
Report = Callable[[Sequence[float]], dict[str, tuple[float, str]]]


def starts_of(parameters: Sequence[Parameter]) -> Starts:
    """Return a search that begins with each combination of its parameters' starts, whatever the residual is."""
    begun = list(product(*(p.starts or (p.start,) for p in parameters)))
    return lambda _: begun


@dataclass(frozen=True, slots=True)
class Site:
    """A cause at a place: one hypothesis.

    Attributes
    ----------
    cause : name of the catalogue
    part : of the joint: motor, motor_1, transmission, link, or a sensor's role
    parameters : what is fitted
    apply : puts values into a joint of the rig
    starts : where a non-linear search begins; at the parameters' own start when absent
    report : fitted values → name → (value, unit), where other numbers are reported than are fitted
    excludes : causes that cannot be in a set with this one at the same part
    transient : happens once; its share of the log cannot be separated from the rest
    doubles : names of causes that would look the same with the roles there are, and have no numbers to be fitted
    members : sites of a cause that several parts have in common
    given : is no cause but a part of the joint that the rig leaves open, and in every set
    added : shape (1 + K, R, m, parameters), what the averaged equations and their noisy copies have in addition to the rig's, in
        proportion to the parameters, where no rig has it: an unknown function
    log : which of how many logs it is of, where it may differ from one to another
    """

    cause: str
    part: str
    parameters: tuple[Parameter, ...]
    apply: Apply
    starts: Starts | None = None
    report: Report | None = None
    excludes: frozenset[str] = frozenset()
    transient: bool = False
    doubles: tuple[str, ...] = ()
    members: tuple[Site, ...] = ()
    given: bool = False
    added: Array | None = None
    log: tuple[int, int] | None = None

    @property
    def named(self) -> bool:
        """Whether it is a cause of the catalogue."""
        return not self.given and self.added is None

    @property
    def parts(self) -> frozenset[str]:
        """Parts of the joint where it sits."""
        return frozenset(m.part for m in self.members) or frozenset((self.part,))

    def overlaps(self, other: Site) -> bool:
        """Return whether it is the same cause, at the same part or at one of its parts."""
        return self.cause == other.cause and bool(self.parts & other.parts)

    @property
    def key(self) -> tuple[str, str]:
        """Cause and part, and the log where it is of one."""
        return self.cause, self.part if self.log is None else f"{self.part} of log {self.log[0]}"

    @property
    def start(self) -> tuple[float, ...]:
        """Where the search begins."""
        return tuple(p.start for p in self.parameters)

    def driven_out(self, values: Array) -> bool:
        """Return whether all numbers, or one with hard bounds, have been driven as far as they may go.

        Nothing is no bound: a friction of 0 is one that is not there. Values come from units of their priors: one at a bound may
        be short of it by rounding.
        """
        near = [(p, v, ROUNDING * abs(v)) for p, v in zip(self.parameters, values, strict=True)]
        out = [(p.low != 0.0 and v <= p.low + e) or v >= p.high - e for p, v, e in near]
        return all(out) or any(o and p.hard for o, p in zip(out, self.parameters, strict=True))

    def reported(self, values: Sequence[float]) -> dict[str, tuple[float, str]]:
        """Return name → (value, unit) as reported."""
        if self.report is not None:
            return self.report(values)
        return {p.name: (float(v), p.unit) for p, v in zip(self.parameters, values, strict=True)}


@dataclass(frozen=True, slots=True)
class Setting:
    """What a cause may know of joint and log before anything is fitted.

    Attributes
    ----------
    joint : of the rig
    roles : role → value and derivatives, shape (3, N), as the rig has them
    period, duration : of the log [s]
    deflections : suffix → φ, shape (N,)
    torques : suffix → τ_T, shape (N,)
    equations : names of those that can be formed
    fitted : transmission whose spring was fitted to the log → the role that the torque at rest was taken for the offset of
    logs : how many logs are looked at together
    differs : causes that may differ from log to log
    """

    joint: Any
    roles: Mapping[str, Array]
    period: float
    duration: float
    deflections: Mapping[str, Array] = field(default_factory=dict)
    torques: Mapping[str, Array] = field(default_factory=dict)
    equations: tuple[str, ...] = ()
    fitted: Mapping[str, str] = field(default_factory=dict)
    logs: int = 1
    differs: frozenset[str] = frozenset()

    def torque_size(self, role: str | None = None) -> float:
        """Return the size of a torque role's changes, or of all torques [N·m]."""
        named = [v[0] for name, v in self.roles.items() if (name == role if role else "torque" in name)]
        named += [] if role else list(self.torques.values())
        return max((size(v) for v in named), default=0.0) or 1.0

    def deflection_size(self, suffix: str) -> float:
        """Return the largest deflection but for a few [rad]."""
        phi = self.deflections.get(suffix)
        return (float(np.nanquantile(np.abs(phi), 0.99)) if phi is not None and np.isfinite(phi).any() else 0.0) or 1.0

    def speed(self, role: str) -> float:
        """Return the size of a role's rate."""
        values = self.roles.get(role)
        return (size(values[1]) if values is not None else 0.0) or 1.0


class Cause:
    """A physical or sensing effect that a rig's simulation may lack or have wrong.

    A subclass states what it is, and yields its sites. The texts speak of `{part}`, in words. `exact` is the part of a value to
    which the equations determine it at best.
    """

    name: str
    title: str
    says: str
    confirm: str
    reference: str
    signature: str
    order: int = 0
    exact: float = Exactness.SMOOTH

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield where in the joint the cause may sit, given its roles."""
        raise NotImplementedError


def size(values: Array) -> float:
    """Return the standard deviation of what is a number."""
    finite = values[np.isfinite(values)]
    return float(np.std(finite)) if finite.size else 0.0


def with_part(joint: Any, part: str, **changes: Any) -> Any:
    """Return a joint with fields of one of its parts changed."""
    return replace(joint, **{part: replace(getattr(joint, part), **changes)})


def with_signal(joint: Any, role: str, **changes: Any) -> Any:
    """Return a joint with fields of one of its signals changed."""
    signal = replace(signal_of(getattr(joint.signals, role)), **changes)
    return replace(joint, signals=replace(joint.signals, **{role: signal}))


def suffix_of(part: str) -> str:
    """Return ``_1`` or ``_2`` of a part or role that has a twin, else nothing."""
    return part[-2:] if part.endswith(("_1", "_2")) else ""


def is_rigid(joint: Any) -> bool:
    """Return whether motor and link of a joint move as one."""
    return isinstance(joint, RigidJoint)


def link_equation(setting: Setting) -> str | None:
    """Return the equation in which the link acts: its own, or that of a motor rigidly connected to it; else none."""
    if getattr(setting.joint, "link", None) is None:
        return None
    if "link" in setting.equations:
        return "link"
    return "motor" if is_rigid(setting.joint) and "motor" in setting.equations and not setting.torques else None


def position_of(setting: Setting, part: str) -> str:
    """Return the role with the position of a motor or the link; in a rigid joint either encoder measures both."""
    role = "link_position" if part == "link" else position_role(part)
    if is_rigid(setting.joint) and role not in setting.roles:
        return "motor_position" if part == "link" else "link_position"
    return role


def angle_of(joint: Any, position: Array, part: str) -> Array:
    """Return the position of a motor or the link on the joint's side [rad], shape (N,); a set-point is a lever arm here."""
    x = position[0]
    return np.asarray((joint.lever.start - x) / joint.lever.travel if part == "secondary_motor" else x)


def one_clock(setting: Setting) -> bool:
    """Return whether a rigid joint has only one encoder and a motor torque in time: only their relative delay counts."""
    others = {"encoders", "link", "link_acceleration"} & set(setting.equations)
    return is_rigid(setting.joint) and not others and not {"torque_sensor", "external_torque"} & set(setting.roles)


def commanded(setting: Setting) -> bool:
    """Return whether the motor's torque is not recorded, but computed by its drive's model from a commanded position."""
    return is_commanded(setting.joint, setting.roles)


def transmissions_of(joint: Any) -> tuple[str, ...]:
    """Return the names under which a mechanical joint has transmissions of a known type."""
    names = [n for n in ("transmission", "transmission_1", "transmission_2") if hasattr(joint, n)]
    return tuple(n for n in names if hasattr(getattr(joint, n), "damping"))


def moved_motors(setting: Setting) -> Iterator[str]:
    """Yield the motors whose equation can be formed, and those whose equation determines the torque of a transmission."""
    for name in motors_of(setting.joint):
        motor = getattr(setting.joint, name)
        heavy = motor.inertia is not None or link_equation(setting) == "motor"
        if not heavy or torque_role(name) not in setting.roles:
            continue
        if name in setting.equations or (name != "secondary_motor" and "link" in setting.equations):
            yield name


def scale_of(setting: Setting, name: str) -> tuple[float, float]:
    """Return the sizes of a motor's torque and of its speed."""
    role = position_of(setting, name)
    if role not in setting.roles:
        role = "link_position"
    speed = setting.speed(role)
    if name == "secondary_motor" and setting.joint.lever is not None:
        speed /= setting.joint.lever.travel
    return setting.torque_size(torque_role(name)), speed


def recorded(setting: Setting, roles: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """Yield the roles that are recorded, with their signals."""
    for role in roles:
        spec = getattr(setting.joint.signals, role, None)
        if spec is not None and role in setting.roles and setting.equations:
            signal = signal_of(spec)
            if signal.constant is None:
                yield role, signal
