"""The physical relations between a joint's channels, for any values of its parameters.

With q the link's position, θ the motor's, φ = q − θ, τ_e the flexibility torque and τ_m the motor's:

- spring: τ_e rises with φ, plus damping, d φ̇ with d ≥ 0 (De Luca and Book, "Robots with flexible elements", 2016, §11.1),
  and where a loop is supposed, plus friction elements of stiffness ≥ 0 in parallel;
- motor: τ_m + τ_e = B θ̈ + D θ̇ + C sign(θ̇) with B, D, C ≥ 0, and where τ_e is not recorded the spring replaces it;
- body: a rigid joint's torque is M q̈ + D q̇ + C sign(q̇) + a gravity torque, a sine and a cosine of q, with M, D, C ≥ 0;
- pair: θ is q but for a deflection that is small next to both;
- rate: a velocity v is the derivative of its position, and at most behind it by a filter's lag: v = q̇ − T v̇ with T ≥ 0;
- drive: a commanded position q_c is ahead of the position by what moves inertia against damping and friction with the stiffness
  of the drive, less what is fed forward: q_c − q = a q̈ + b q̇ + c sign(q̇) with c ≥ 0. A drive may act late, never early.

Coefficients are unknown; their signs are known, and so is the torque sensor's coefficient in the motor's equation. This shows a
wrong sign, a wrong unit, a delay, a magnitude and an exchanged channel.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.constrained_fit import residual_of
from vsalog.core.dependence import hats

Array = NDArray[np.float64]

COMMAND = "commanded_position"


class Shape(NamedTuple):
    """How freely a spring and friction are described.

    Attributes
    ----------
    intervals : of a deflection, in each of which a spring has one stiffness
    setpoints : between which a spring's torque is interpolated
    rest_speed : part of a speed's root mean square below which the direction of friction is blurred
    slips : friction elements of either kind, which slip after the largest deflection, half of it … a thirty-second
    """

    intervals: int = 16
    setpoints: int = 5
    rest_speed: float = 0.05
    slips: int = 6


SHAPE = Shape()


@dataclass(frozen=True, slots=True)
class Equation:
    """An equation y = free · a + positive · b with b ≥ 0.

    Attributes
    ----------
    name : ``spring``, ``motor`` or ``pair`` with the transmission's suffix, ``body``, ``rate`` or ``drive`` with the target
    target : the role that y is made of
    roles : that it reads
    y, scale : shape (R,); and the target's term in y, whose standard deviation scales the residual
    free, positive : shape (R, m), (R, k)
    knots : of the spring in it
    elastic : how many columns of `positive`, the last ones, are the spring's; `free` is its torque at the first knot then
    """

    name: str
    target: str
    roles: frozenset[str]
    y: Array
    scale: Array
    free: Array
    positive: Array
    knots: Array | None = None
    elastic: int = 0

    def changing(self, whens: Array) -> Equation:
        """Return the equation of a spring whose stiffness and zero change with time, but not its shape.

        Parameters
        ----------
        whens : functions of time, shape (R, p), whose sum with any coefficients that are not negative is the stiffness
        """
        left, x = residual_of(self.y, self.free, self.positive)
        offsets = np.linalg.lstsq(self.free, self.y - left - self.positive @ x, rcond=None)[0]
        # Without its last column, the damping.
        spring = slice(self.positive.shape[1] - self.elastic, -1)
        torque = self.free @ offsets + self.positive[:, spring] @ x[spring]
        return replace(
            self,
            free=np.column_stack((self.free, whens)),
            positive=np.column_stack((whens * torque[:, None], self.positive)),
        )


Rows = Mapping[str, Array]


def names_of(roles: Rows) -> tuple[str, ...]:
    """Return the names of the equations that roles are enough for."""
    return tuple(equation for equation, needed in _needs(roles) if needed <= set(roles))


def equation(
    name: str,
    roles: Rows,
    knots: Array | None = None,
    unknown_scale: Collection[str] = (),
    slipping: Array | None = None,
) -> Equation:
    """Return an equation.

    Parameters
    ----------
    name : one of `names_of`
    roles : role → value, rate and acceleration at R instants, shape (3, R)
    knots : deflections between which a spring has one stiffness; quantiles of the deflection where absent
    unknown_scale : roles in a unit that is none of a torque's: a motor's torque among them is any multiple of the sensor's
    slipping : torques of a spring's friction elements, of stiffness one, shape (R, n)
    """
    kind, _, suffix = name.partition(" ")
    build = {"spring": _spring, "motor": _motor, "body": _body, "pair": _pair, "rate": _rate, "drive": _drive}[kind]
    found = build(name, roles, suffix, knots)
    if slipping is not None:
        # The last columns remain the spring's own.
        others, own = np.split(found.positive, [found.positive.shape[1] - found.elastic], axis=1)
        found = replace(found, positive=np.column_stack((others, -slipping if kind == "motor" else slipping, own)))
    if kind == "motor" and found.target in unknown_scale:
        rest = found.y - found.scale
        return replace(found, y=found.scale, positive=np.column_stack((-rest, found.positive)))
    return found


def _needs(roles: Rows) -> Iterator[tuple[str, frozenset[str]]]:
    twin = "motor_position_1" in roles or "deflection_1" in roles
    for suffix in ("_1", "_2") if twin else ("",):
        yield f"spring {suffix}", frozenset({f"torque_sensor{suffix}", *deflects(roles, suffix)})
        torque = {f"torque_sensor{suffix}"} if f"torque_sensor{suffix}" in roles else deflects(roles, suffix)
        yield f"motor {suffix}", frozenset({f"motor_torque{suffix}", f"motor_position{suffix}", *torque})
    if not twin:
        yield "pair ", frozenset({"link_position", "motor_position"})
        if "motor_position" not in roles and "deflection" not in roles:
            yield "body motor_torque", frozenset({"link_position", "motor_torque"})
            yield "body torque_sensor", frozenset({"link_position", "torque_sensor"})
        yield f"drive {COMMAND}", frozenset({COMMAND, _driven(roles)})
    for role in roles:
        if "_velocity" in role:
            yield f"rate {role}", frozenset({role, position_of(role)})


def slips_of(deflection: Array) -> Array:
    """Return after which deflections the friction elements of a loop slip, shape (n,)."""
    largest = float(np.abs(deflection - np.median(deflection)).max())
    return largest / 2.0 ** np.arange(SHAPE.slips, dtype=np.float64)


def position_of(velocity: str) -> str:
    """Return the role whose derivative a velocity is."""
    return velocity.replace("_velocity", "_position")


def _driven(roles: Rows) -> str:
    return "motor_position" if "motor_position" in roles else "link_position"


def deflects(roles: Collection[str], suffix: str) -> set[str]:
    """Return the roles that a transmission's deflection is made of."""
    return {f"deflection{suffix}"} if f"deflection{suffix}" in roles else {"link_position", f"motor_position{suffix}"}


def deflection_of(roles: Rows, suffix: str) -> Array:
    """Return a transmission's deflection, of the shape of each role."""
    if f"deflection{suffix}" in roles:
        return roles[f"deflection{suffix}"]
    return roles["link_position"] - roles[f"motor_position{suffix}"]


def _spring(name: str, roles: Rows, suffix: str, knots: Array | None) -> Equation:
    torque = roles[f"torque_sensor{suffix}"][0]
    free, positive, knots = _elastic(roles, suffix, knots)
    used = {f"torque_sensor{suffix}", *deflects(roles, suffix), *({"setpoint"} & set(roles))}
    columns = positive.shape[1]
    return Equation(name, f"torque_sensor{suffix}", frozenset(used), torque, torque, free, positive, knots, columns)


def _elastic(roles: Rows, suffix: str, knots: Array | None) -> tuple[Array, Array, Array]:
    """Return the columns of any spring whose torque rises with its deflection, and with the deflection's rate."""
    phi = deflection_of(roles, suffix)
    knots = knots if knots is not None else np.unique(np.quantile(phi[0], np.linspace(0.0, 1.0, SHAPE.intervals + 1)))
    ramps = np.clip(phi[0][:, None] - knots[:-1], 0.0, np.diff(knots))
    if "setpoint" not in roles:
        return np.ones((phi.shape[1], 1)), np.column_stack((ramps, phi[1])), knots
    r = roles["setpoint"][0]
    places = hats(r, np.linspace(float(r.min()), float(r.max()), SHAPE.setpoints))
    positive = (places[:, :, None] * ramps[:, None, :]).reshape(r.size, -1)
    return places, np.column_stack((positive, phi[1])), knots


def _resistance(position: Array) -> Array:
    """Return the columns of inertia, viscous and dry friction."""
    speed = position[1]
    rest = SHAPE.rest_speed * float(np.sqrt(np.mean(speed**2))) or 1.0
    return np.column_stack((position[2], speed, np.tanh(speed / rest)))


def _motor(name: str, roles: Rows, suffix: str, knots: Array | None) -> Equation:
    torque = roles[f"motor_torque{suffix}"][0]
    positive, elastic = _resistance(roles[f"motor_position{suffix}"]), 0
    used = {f"motor_torque{suffix}", f"motor_position{suffix}"}
    if f"torque_sensor{suffix}" in roles:
        used.add(f"torque_sensor{suffix}")
        y, free = torque + roles[f"torque_sensor{suffix}"][0], np.ones((torque.size, 1))
    else:
        used |= deflects(roles, suffix) | ({"setpoint"} & set(roles))
        free, spring, knots = _elastic(roles, suffix, knots)
        y, positive, elastic = torque, np.column_stack((positive, -spring)), spring.shape[1]
    return Equation(name, f"motor_torque{suffix}", frozenset(used), y, torque, free, positive, knots, elastic)


def _body(name: str, roles: Rows, torque: str, _: Array | None) -> Equation:
    q = roles["link_position"]
    free = np.column_stack((np.ones(q.shape[1]), np.sin(q[0]), np.cos(q[0])))
    y = roles[torque][0]
    return Equation(name, torque, frozenset({"link_position", torque}), y, y, free, _resistance(q))


def _pair(name: str, roles: Rows, _: str, __: Array | None) -> Equation:
    q, theta = roles["link_position"][0], roles["motor_position"][0]
    free = np.ones((q.size, 1))
    used = frozenset({"link_position", "motor_position"})
    return Equation(name, "link_position", used, q - theta, q, free, np.empty((q.size, 0)))


def _rate(name: str, roles: Rows, velocity: str, _: Array | None) -> Equation:
    v, q = roles[velocity], roles[position_of(velocity)]
    free, used = np.ones((v.shape[1], 1)), frozenset({velocity, position_of(velocity)})
    return Equation(name, velocity, used, v[0] - q[1], v[0], free, -v[1][:, None])


def _drive(name: str, roles: Rows, command: str, _: Array | None) -> Equation:
    moved = _driven(roles)
    q, goal = roles[moved], roles[command][0]
    *lead, friction = _resistance(q).T
    free = np.column_stack((np.ones(goal.size), *lead))
    return Equation(name, command, frozenset({command, moved}), goal - q[0], goal, free, friction[:, None])
