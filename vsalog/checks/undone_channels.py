"""A joint's channels with faults undone, and the residuals of its equations."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.checks.constrained_fit import residual_of
from vsalog.checks.fault import RULE, Fault
from vsalog.checks.joint_equations import COMMAND, Equation, equation, names_of
from vsalog.checks.smoothed_motion import Motion
from vsalog.core.dependence import above_zero
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM

Array = NDArray[np.float64]
Faults = Sequence[Fault]

# Equations that hold at every instant; a link lags behind its motor by its inertia, and a motor behind its command.
TIMED = ("spring", "motor", "body", "rate")


@dataclass(frozen=True)
class Trial:
    """The residuals of equations with some faults undone.

    Attributes
    ----------
    squares : name → squares over those of the target as it was recorded, by blocks of time
    holds : name → squares over those of the equation's largest term
    """

    squares: Mapping[str, Array]
    holds: Mapping[str, float]

    def better(self, other: Trial) -> float:
        """Return the log-likelihood ratio of this over another, which has the equations of this one."""
        return sum(math.log(_above_0(other.left(e)) / _above_0(self.left(e))) for e in self.squares)

    def is_better(self, other: Trial) -> bool:
        """Return whether this explains the equations better than another, by more than chance does once in a thousand."""
        return self.better(other) > 0.0 and above_zero(self.block_ratios(other)) <= FALSE_ALARM

    def block_ratios(self, other: Trial) -> Array:
        """Return the log-likelihood ratio in each block; a block with almost no residual contributes almost nothing."""
        ratios = np.zeros(RULE.blocks)
        for e, own in self.squares.items():
            rest = _above_0(RULE.quiet * float(other.squares[e].mean()))
            ratios += np.log((other.squares[e] + rest) / (own + rest))
        return ratios

    def left(self, name: str) -> float:
        """Return an equation's squared residual, over its target's squares."""
        return float(self.squares[name].sum())


class Channels:
    """The channels of a joint, of which faults can be undone.

    Parameters
    ----------
    signals : of the joint
    motion : of them
    unknown_scale : roles whose unit is none of a torque's, such as a current without its constant

    Attributes
    ----------
    equations : that the roles are enough for; none where too few rows are known
    read : equation → roles that it reads
    elastic : equations with a spring of any shape in them
    magnitudes : torques that are never negative, and come to zero
    signs : role → signs that it has where it is taken for a magnitude, shape (R,)
    """

    def __init__(self, signals: JointSignals, motion: Motion, unknown_scale: Collection[str]) -> None:
        self.signals, self.motion, self.unknown_scale = signals, motion, frozenset(unknown_scale)
        rows = motion.rows
        for known in motion.known.values():
            # All samples within reach have to be known: a row that is shifted across a gap would be another time.
            unknown = np.cumsum(np.concatenate(([0], ~known)))
            rows = rows[unknown[rows + motion.reach + 1] == unknown[rows - motion.reach]]
        self.rows = rows
        enough = rows.size > 10 * RULE.blocks
        self.equations = names_of(motion.values) if enough else ()
        self.block = np.arange(rows.size) * RULE.blocks // max(rows.size, 1)
        middle = 0.5 * float(rows[0] + rows[-1]) if enough else 0.0
        self.time: Array = np.asarray((rows - middle) * signals.period, dtype=np.float64)
        self.magnitudes = {
            r for r, x in signals.roles.items() if "torque" in r and r in motion.values and np.nanmin(x) == 0.0
        }
        self.signs: dict[str, Array] = {}
        self._plain = {role: values[:, rows] for role, values in motion.values.items()}
        self._kept: dict[tuple[object, ...], tuple[Array, float]] = {}
        plain = {e: equation(e, self._plain, None, self.unknown_scale) for e in self.equations}
        self.read = {e: one.roles for e, one in plain.items()}
        self.elastic = {e for e, one in plain.items() if one.elastic}

    @property
    def independent(self) -> float:
        """Number of independent squares: behind a Gaussian filter their correlations add up to √(2π) of its deviation."""
        span = float(self.rows[-1] - self.rows[0]) / (math.sqrt(2.0 * math.pi) * self.motion.width)
        return min(float(self.rows.size), span)

    @property
    def roles(self) -> list[str]:
        """Roles that equations read and that a fault may be in, in order."""
        return sorted(frozenset[str]().union(*self.read.values()) - {"setpoint"})

    def touched(self, fault: Fault, undone: Faults) -> set[str]:
        """Return the equations that can show a fault in addition to others that are undone.

        A drive's equation shows only that a command comes after the motion. A possible magnitude is tested for nothing else.
        """
        timed = fault.kind in ("late", "drift", "unsigned", "gravity", "gain") and fault.roles != (COMMAND,)
        signed = {role for one in undone if one.kind == "unsigned" for role in one.roles}
        unsure = frozenset[str]() if fault.kind == "unsigned" else self.magnitudes - signed
        return {
            e
            for e, read in self.read.items()
            if set(fault.roles) & read
            and not unsure & read
            and (not timed or e.split(" ")[0] in TIMED)
            and (fault.kind != "stiffness" or e in self.elastic)
        }

    def trial(self, faults: Faults, equations: Collection[str] | None = None) -> Trial:
        """Return the residuals of equations with faults undone; all equations where none are named."""
        squares, holds = dict[str, Array](), dict[str, float]()
        for e in self.equations if equations is None else equations:
            about = [fault for fault in faults if set(fault.roles) & self.read[e]]
            signs = (id(self.signs[role]) for fault in about if fault.kind == "unsigned" for role in fault.roles)
            key = (e, *about, *signs)
            if key not in self._kept:
                eq = self.equation(e, faults)
                left, _ = residual_of(eq.y, eq.free, eq.positive)
                blocks = np.bincount(self.block, left**2, RULE.blocks)
                largest = max(_squares(eq.scale), _squares(eq.y - eq.scale))
                self._kept[key] = blocks / self._spread(eq.target, faults), float(blocks.sum()) / _above_0(largest)
            squares[e], holds[e] = self._kept[key]
        return Trial(squares, holds)

    def equation(self, name: str, faults: Faults) -> Equation:
        """Return an equation of the channels with faults undone."""
        return self._equation(name, self._acting(name, faults))

    def _acting(self, name: str, faults: Faults) -> Faults:
        """Return faults, and of a drive the delay at which it acts that explains most."""
        if not name.startswith("drive"):
            return faults

        def acting(delay: float) -> Faults:
            return (*faults, Fault("late", (COMMAND,), delay=-delay))

        def left(delay: float) -> float:
            eq = self._equation(name, acting(delay))
            return float(np.sum(residual_of(eq.y, eq.free, eq.positive)[0] ** 2))

        step = RULE.drive_delay / RULE.drive_delays
        tried = {k * step: left(k * step) for k in range(RULE.drive_delays + 1)}
        while step > self.signals.period:
            step *= 0.5
            best = min(tried, key=tried.__getitem__)
            tried |= {d: left(d) for d in (best - step, best + step) if 0.0 <= d <= RULE.drive_delay}
        return acting(min(tried, key=tried.__getitem__))

    def _equation(
        self, name: str, faults: Faults, more: Mapping[str, Array] = MappingProxyType({}), knots: Array | None = None
    ) -> Equation:
        """Return an equation of channels with faults undone, and with so much more in them, shape (3, R) each."""
        roles = {role: self.values(role, faults) + more.get(role, 0.0) for role in self.read[name]}
        eq = equation(name, roles, knots, self.unknown_scale)
        for fault in faults:
            if fault.kind == "stiffness" and eq.elastic and set(fault.roles) & eq.roles:
                eq = eq.changing(_pieces(self.time, fault.changes))
        if any(f.kind == "gravity" and set(f.roles) & eq.roles for f in faults):
            q = (roles["link_position"] if "link_position" in roles else self.values("link_position", faults))[0]
            eq = replace(eq, free=np.column_stack((eq.free, np.sin(q), np.cos(q))))
        return eq

    def values(self, role: str, faults: Faults) -> Array:
        """Return value, rate and acceleration of a role with faults undone, shape (3, R)."""
        source, factor, delay, rate, signs = role, 1.0, 0.0, 0.0, None
        for fault in reversed(faults):
            if fault.kind == "exchanged" and source in fault.roles:
                a, b = fault.roles
                source = b if source == a else a
            elif source in fault.roles:
                factor, delay, rate = factor * fault.factor, delay + fault.delay, rate + fault.rate
                signs = self.signs[source] if fault.kind == "unsigned" else signs
        values = self._moved(source, delay, rate) if delay or rate else self._plain[source]
        values = values / factor
        return values if signs is None else values * signs

    def wrong(self, faults: Faults, equations: Collection[str] | None = None) -> set[str]:
        """Return the equations whose residual exceeds their noise floor by more than chance makes it once in a thousand."""
        found = set()
        for e, squares in self.trial(faults, equations).squares.items():
            floor = self.noise(e, faults)
            # Both are squares of as many independent values; of fewer, where noise is larger in a part of the log.
            even = float(floor.sum() ** 2 / (floor.size * floor @ floor)) if floor.any() else 1.0
            count = even * self.independent
            if special.fdtrc(count, count, float(squares.sum()) / _above_0(float(floor.sum()))) <= FALSE_ALARM:
                found.add(e)
        return found

    def noise(self, name: str, faults: Faults) -> Array:
        """Return the noise floor of an equation's squared residual, over its target's squares, by blocks of time."""
        faults = self._acting(name, faults)
        eq = self._equation(name, faults)
        left, x = residual_of(eq.y, eq.free, eq.positive)
        a = np.linalg.lstsq(eq.free, eq.y - left - eq.positive @ x, rcond=None)[0]
        errors = {role: self._error(role, faults) for role in self.read[name]}
        noisy = self._equation(name, faults, errors, eq.knots)
        more = noisy.y - eq.y - (noisy.positive - eq.positive) @ x - (noisy.free - eq.free) @ a
        return np.bincount(self.block, (more - more.mean()) ** 2, RULE.blocks) / self._spread(eq.target, faults)

    def _moved(self, role: str, delay: float, rate: float) -> Array:
        """Return a role shifted by its delay, between two samples on the line: the filter leaves nothing as fast as a sample."""
        shift = np.clip((delay + rate * self.time) / self.signals.period, -self.motion.reach, self.motion.reach)
        before = np.minimum(np.floor(shift), self.motion.reach - 1).astype(np.int64)
        part, values = shift - before, self.motion.values[role]
        return np.asarray((1.0 - part) * values[:, self.rows + before] + part * values[:, self.rows + before + 1])

    def _error(self, role: str, faults: Faults) -> Array:
        """Return a realisation of a role's sensor error, shape (3, R)."""
        factor = math.prod(fault.factor for fault in faults if role in fault.roles)
        return self.motion.noise[role][:, self.rows] / factor

    def _spread(self, role: str, faults: Faults) -> float:
        """Return the squares of a role as recorded, about its mean, in the unit that undoing faults gives it."""
        recorded = self.values(role, [fault for fault in faults if fault.kind != "unsigned"])[0]
        return _above_0(_squares(recorded))


def _pieces(time: Array, changes: Sequence[float]) -> Array:
    """Return functions of time that are lines between changes, where they may jump, shape (R, 2 (number of changes + 1))."""
    edges = np.array([time[0], *changes, time[-1]])
    piece = np.searchsorted(edges[1:-1], time, side="left")
    part, rows = (time - edges[piece]) / np.diff(edges)[piece], np.arange(time.size)
    out = np.zeros((time.size, 2 * edges.size - 2))
    out[rows, 2 * piece], out[rows, 2 * piece + 1] = 1.0 - part, part
    return out


def _squares(x: Array) -> float:
    return float(np.sum((x - x.mean()) ** 2))


def _above_0(x: float) -> float:
    return max(x, float(np.finfo(np.float64).tiny))
