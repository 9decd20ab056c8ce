"""A joint's channels with faults undone, and the residuals of its equations."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.checks.constrained_fit import residual_of
from vsalog.checks.fault import OF_SPRING, RULE, Fault
from vsalog.checks.joint_equations import COMMAND, Equation, deflection_of, deflects, equation, names_of, slips_of
from vsalog.checks.smoothed_motion import Motion
from vsalog.core.dependence import above_zero
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM
from vsalog.mechanics.slip_elements import slip_deflections

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
Source = tuple[str, float, float, float]
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


class Path(NamedTuple):
    """Samples by which a deflection is followed from the first to the last.

    Attributes
    ----------
    samples, time : shape (P,), ascending; time as that of the rows [s]
    asked : which are rows of the equations
    """

    samples: Integers
    time: Array
    asked: Flags


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
        self.rows = rows = _all_known(motion, motion.rows)
        enough = rows.size > 10 * RULE.blocks
        self.equations = names_of(motion.values) if enough else ()
        self.block = np.arange(rows.size) * RULE.blocks // max(rows.size, 1)
        middle = 0.5 * float(rows[0] + rows[-1]) if enough else 0.0
        self.time: Array = np.asarray((rows - middle) * signals.period, dtype=np.float64)
        self._followed: dict[str, tuple[Mapping[str, Source], Array]] = {}
        self.magnitudes = {
            r for r, x in signals.roles.items() if "torque" in r and r in motion.values and np.nanmin(x) == 0.0
        }
        self.signs: dict[str, Array] = {}
        self._plain = {role: values[:, rows] for role, values in motion.values.items()}
        self._kept: dict[tuple[object, ...], tuple[Array, float]] = {}
        plain = {e: equation(e, self._plain, None, self.unknown_scale) for e in self.equations}
        self.read = {e: one.roles for e, one in plain.items()}
        self.elastic = {e for e, one in plain.items() if one.elastic}

    @cached_property
    def _path(self) -> Path:
        # The filter leaves no turn of a deflection between two samples that are its width apart.
        first, last = self.motion.reach, len(self.signals) - self.motion.reach - 1
        between = np.arange(first, last, max(1, int(self.motion.width)))
        samples = np.union1d(_all_known(self.motion, between), self.rows)
        middle = 0.5 * float(self.rows[0] + self.rows[-1])
        time = np.asarray((samples - middle) * self.signals.period, dtype=np.float64)
        return Path(samples, time, np.isin(samples, self.rows))

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
            and (fault.kind not in OF_SPRING or e in self.elastic)
        }

    def springs(self, wrong: Collection[str]) -> Iterator[str]:
        """Yield the role that names the spring of each equation with one, of those that are wrong."""
        for name in sorted(self.elastic & set(wrong)):
            suffix = name.split(" ")[1]
            yield next(r for r in (f"deflection{suffix}", f"motor_position{suffix}") if r in self.read[name])

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

    def _equation(self, name: str, faults: Faults, noisy: Equation | None = None) -> Equation:
        """Return an equation of channels with faults undone; the one formed before with a realisation of their errors."""
        roles = {role: self.values(role, faults) for role in self.read[name]}
        if noisy is not None:
            roles = {role: values + self._error(role, faults, self.rows) for role, values in roles.items()}
        loop = name in self.elastic and any(f.kind == "loop" and set(f.roles) & self.read[name] for f in faults)
        slipping = self._slipping(name, faults, noisy is not None) if loop else None
        eq = equation(name, roles, None if noisy is None else noisy.knots, self.unknown_scale, slipping)
        for fault in faults:
            if fault.kind == "stiffness" and eq.elastic and set(fault.roles) & eq.roles:
                eq = eq.changing(_pieces(self.time, fault.changes))
        if any(f.kind == "gravity" and set(f.roles) & eq.roles for f in faults):
            q = (roles["link_position"] if "link_position" in roles else self.values("link_position", faults))[0]
            eq = replace(eq, free=np.column_stack((eq.free, np.sin(q), np.cos(q))))
        return eq

    def values(self, role: str, faults: Faults) -> Array:
        """Return value, rate and acceleration of a role with faults undone, shape (3, R)."""
        source, factor, delay, rate, signs = self._source(role, faults)
        values = self._plain[source]
        if delay or rate:
            values = self._moved(self.motion.values[source], self.rows, self.time, delay, rate)
        values = values / factor
        return values if signs is None else values * signs

    def _source(self, role: str, faults: Faults) -> tuple[*Source, Array | None]:
        """Return what was recorded as a role: which role, by what factor, how late, how fast that grows, and its signs."""
        source, factor, delay, rate, signs = role, 1.0, 0.0, 0.0, None
        for fault in reversed(faults):
            if fault.kind == "exchanged" and source in fault.roles:
                a, b = fault.roles
                source = b if source == a else a
            elif source in fault.roles:
                factor, delay, rate = factor * fault.factor, delay + fault.delay, rate + fault.rate
                signs = self.signs[source] if fault.kind == "unsigned" else signs
        return source, factor, delay, rate, signs

    def _slipping(self, name: str, faults: Faults, noisy: bool) -> Array:
        """Return the deflections of a spring's friction elements, of either kind, shape (R, 2 n)."""
        suffix, path = name.split(" ")[1], self._path
        sources = {role: self._source(role, faults)[:-1] for role in deflects(self.read[name], suffix)}
        if not noisy and name in self._followed and self._followed[name][0] == sources:
            return self._followed[name][1]
        roles = {
            role: self._moved(self.motion.values[source][0], path.samples, path.time, delay, rate) / factor
            for role, (source, factor, delay, rate) in sources.items()
        }
        phi = deflection_of(roles, suffix)
        slips = slips_of(phi)
        if noisy:
            phi = deflection_of({r: x + self._error(r, faults, path.samples)[0] for r, x in roles.items()}, suffix)
        # Between two turns the elements need no other samples than those that are asked for.
        steps, kept = np.diff(phi), path.asked.copy()
        kept[1:-1] |= steps[1:] * steps[:-1] < 0.0
        of_kinds = [slip_deflections(phi[kept], slips, smooth)[:, path.asked[kept]] for smooth in (False, True)]
        slipping = np.vstack(of_kinds).T
        if not noisy:
            self._followed[name] = sources, slipping
        return slipping

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
        noisy = self._equation(name, faults, eq)
        more = noisy.y - eq.y - (noisy.positive - eq.positive) @ x - (noisy.free - eq.free) @ a
        return np.bincount(self.block, (more - more.mean()) ** 2, RULE.blocks) / self._spread(eq.target, faults)

    def _moved(self, values: Array, at: Integers, time: Array, delay: float, rate: float) -> Array:
        """Return values shifted by a delay, between two samples on the line: the filter leaves nothing as fast as a sample."""
        late = delay + rate * time if rate else np.float64(delay)
        shift = np.clip(late / self.signals.period, -self.motion.reach, self.motion.reach)
        before = np.minimum(np.floor(shift), self.motion.reach - 1).astype(np.int64)
        part = shift - before
        return np.asarray((1.0 - part) * values[..., at + before] + part * values[..., at + before + 1])

    def _error(self, role: str, faults: Faults, at: Integers) -> Array:
        """Return a realisation of a role's sensor error at samples, shape (3, R)."""
        factor = math.prod(fault.factor for fault in faults if role in fault.roles)
        return self.motion.noise[role][:, at] / factor

    def _spread(self, role: str, faults: Faults) -> float:
        """Return the squares of a role as recorded, about its mean, in the unit that undoing faults gives it."""
        recorded = self.values(role, [fault for fault in faults if fault.kind != "unsigned"])[0]
        return _above_0(_squares(recorded))


def _all_known(motion: Motion, rows: Integers) -> Integers:
    """Return the rows of which all samples within reach are known: one that is shifted across a gap would be another time."""
    for known in motion.known.values():
        unknown = np.cumsum(np.concatenate(([0], ~known)))
        rows = rows[unknown[rows + motion.reach + 1] == unknown[rows - motion.reach]]
    return rows


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
