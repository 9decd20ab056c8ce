"""Which fault of a recording explains a joint's channels best, if any does.

A fault is something that was done to a channel, and can be undone: a sign, a factor, a delay, a clock that drifts, two channels
exchanged, a magnitude taken, gravity taken out. The joint's equations are fitted to the channels as recorded and with each fault
undone; log(squares left as recorded / squares left with the fault undone), summed over the equations, is the fault's profile
log-likelihood ratio per independent sample. The likeliest fault is reported where

- its ratio is above zero in blocks of time, by Student's t-test over the blocks' own ratios, at `FALSE_ALARM` for all faults of a
  joint together (Bonferroni); blocks need not have equal variances (Ibragimov and Müller 2010), and
- it explains most of what is wrong: the squares of some equation fall to `LEFT`, for no parameter of a sound joint is left free.

What is found is undone, and the search begins again, for a second fault.

Ibragimov, Müller, "t-statistic based correlation and heterogeneity robust inference", J. Bus. Econ. Stat. 28, 2010.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.constrained_fit import residual_of
from vsalog.checks.joint_equations import Equation, equation, names_of
from vsalog.checks.smoothed_motion import motion_of
from vsalog.core.dependence import mean_above_zero
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM

Array = NDArray[np.float64]

LONGEST_DELAY = 0.25
"""Delays [s] that are looked for: a few packets of the slowest bus; what is later than that is on another clock."""

TIMED = ("spring", "motor", "body")
"""Equations that hold at every instant; a link is late behind its motor by its inertia."""

LEFT = 0.5
"""Part of the squares [1] that an equation leaves, once a fault is undone that is reported: the fault was most of what was wrong."""

HOLDS = 0.5
"""Part of a target's squares [1] that an equation leaves at most, once a fault is undone: one that does not hold tells nothing."""

BLOCKS = 16
"""Blocks of time [1] whose likelihoods are compared."""

MOST_FAULTS = 3
"""Faults of one joint [1] that are looked for, one after another."""

QUIET = 0.01
"""Part of a mean block's squares [1] below which a block says nothing."""

AS_LIKELY = 0.05
"""Log-likelihood per independent sample [1] by which faults differ that are as likely as one another."""

SCALE = 2.0
"""Factor [1] beyond which one torque is out of proportion to another: gears lose less than half of a torque."""

UNIT_TOLERANCE = 0.02
"""Part [1] by which a factor differs from a unit's at most: what filters and encoders' steps make of a slope."""

STARTS = (0.3, 0.5, 0.7)
"""Parts of the time [1] that a magnitude may have been negative, from which its signs are looked for."""

TINY = 1e-300
DEBUG = False

DEGREES = 180.0 / math.pi
UNIT_FACTORS = {"position": (DEGREES, 1.0 / DEGREES), "torque": (1e3, 1e-3)}


@dataclass(frozen=True)
class Fault:
    """What was done to channels of a joint.

    Attributes
    ----------
    kind : ``sign``, ``unit``, ``scale``, ``late``, ``drift``, ``exchanged``, ``unsigned`` or ``gravity``
    roles : that it was done to
    factor : of recorded over true values
    delay : of the recorded values in the middle of the log [s]
    rate : seconds per second by which they become later
    """

    kind: str
    roles: tuple[str, ...]
    factor: float = 1.0
    delay: float = 0.0
    rate: float = 0.0


@dataclass(frozen=True)
class Found:
    """A fault that was found.

    Attributes
    ----------
    fault : what is likeliest
    instead : other faults that would explain the channels as well
    p_value : probability that a sound recording is explained so much better by any of the faults
    left : part of the squares that is left of the equation that it explains best
    """

    fault: Fault
    instead: tuple[Fault, ...]
    p_value: float
    left: float


@dataclass(frozen=True)
class Trial:
    """What the equations leave once some faults are undone: name → squares over those of the target, shape (`BLOCKS`,)."""

    squares: Mapping[str, Array]

    def better(self, other: Trial) -> float:
        """Return the log-likelihood ratio of this over another, which has the equations of this one."""
        return float(sum(math.log(other.squares[e].sum() / max(own.sum(), TINY)) for e, own in self.squares.items()))

    def block_ratios(self, other: Trial) -> Array:
        """Return the log-likelihood ratio in each block; one in which next to nothing is left says next to nothing."""
        ratios = np.zeros(BLOCKS)
        for e, own in self.squares.items():
            rest = QUIET * other.squares[e].mean() + TINY
            ratios += np.log((other.squares[e] + rest) / (own + rest))
        return ratios


def faults_of(signals: JointSignals, unknown_scale: Collection[str] = ()) -> list[Found]:
    """Return the faults of a joint's channels.

    Parameters
    ----------
    signals : of the joint, as recorded but for their units
    unknown_scale : roles whose unit is none of a torque's, such as a current without its constant
    """
    return _Search(signals, frozenset(unknown_scale)).faults()


def exchanged_between(joints: Mapping[str, JointSignals]) -> tuple[tuple[str, str], Found] | None:
    """Return the two joints of which channels of one role were taken for one another, and which role; None for none.

    Parameters
    ----------
    joints : of one log, by name, on one grid
    """
    searches = {name: _Search(signals, frozenset()) for name, signals in joints.items()}
    wrong = [name for name, search in searches.items() if search.equations and search.wrong()]
    tried: list[tuple[float, float, float, tuple[str, str], str]] = []
    for a, b in combinations(wrong, 2):
        one, other = joints[a], joints[b]
        if len(one) != len(other):
            continue
        for role in sorted((set(one.roles) & set(other.roles)) - {"setpoint"}):
            swapped = (
                replace(one, roles={**one.roles, role: other.roles[role]}),
                replace(other, roles={**other.roles, role: one.roles[role]}),
            )
            ratios, block, left = [], np.zeros(BLOCKS), 0.0
            for before, signals in zip((searches[a], searches[b]), swapped, strict=True):
                now, then = before.now(), _Search(signals, frozenset()).now()
                touched = [e for e in then.squares if role in before.read[e]] if then.squares.keys() == now.squares.keys() else []
                now, then = (Trial({e: t.squares[e] for e in touched}) for t in (now, then))
                ratios.append(then.better(now))
                block += then.block_ratios(now)
                shares = [float(then.squares[e].sum() / now.squares[e].sum()) for e in touched if then.squares[e].sum() <= HOLDS]
                left = max(left, min(shares, default=1.0))
            tried.append((sum(ratios), mean_above_zero(block), left, (a, b), role))
    if not tried:
        return None
    ratio, p, left, names, role = max(tried)
    if ratio <= 0.0 or len(tried) * p > FALSE_ALARM or left > LEFT:
        return None
    return names, Found(Fault("exchanged", (role,)), (), min(1.0, len(tried) * p), left)


class _Search:
    """The channels of a joint, and the faults that are undone."""

    def __init__(self, signals: JointSignals, unknown_scale: frozenset[str]) -> None:
        self.signals, self.unknown_scale = signals, unknown_scale
        self.undone: tuple[Fault, ...] = ()
        self.signs: dict[str, Array] = {}
        self.equations: tuple[str, ...] = ()
        motion = motion_of(signals, LONGEST_DELAY)
        if motion is None:
            return
        self.motion = motion
        rows = motion.rows
        for known in motion.known.values():
            for shift in (-motion.reach, 0, motion.reach):
                rows = rows[known[rows + shift]]
        self.rows = rows
        self.block = np.arange(rows.size) * BLOCKS // max(rows.size, 1)
        self.middle = 0.5 * float(rows[0] + rows[-1]) if rows.size else 0.0
        self.equations = names_of(motion.values) if rows.size > 10 * BLOCKS else ()
        self.at = {role: values[:, rows] for role, values in motion.values.items()}
        self.read = {e: equation(e, self.at, None, unknown_scale).roles for e in self.equations}
        self.kept: dict[tuple[object, ...], Array] = {}

    def faults(self) -> list[Found]:
        found: list[Found] = []
        if not self.equations:
            return found
        while len(found) < MOST_FAULTS and (one := self._likeliest()) is not None:
            found.append(one)
            self.undone = (*self.undone, one.fault)
        return found

    def now(self) -> Trial:
        """Return what the equations leave of the channels, with what was found undone."""
        return self._trial(self.undone, self.equations)

    def wrong(self) -> set[str]:
        """Return the equations that leave more than noise, by so much that a fault may be found in it."""
        now = self.now()
        return {e for e in self.equations if now.squares[e].sum() > self._noise(e) / LEFT}

    def _likeliest(self) -> Found | None:
        now, wrong = self.now(), self.wrong()
        if DEBUG:
            print("     now", {e: (float(now.squares[e].sum()), self._noise(e)) for e in self.equations})
        if not wrong:
            return None
        tried: list[tuple[float, Fault, Trial]] = []
        for fault in self._candidates(wrong, now):
            touched = self._touched(fault)
            if touched & wrong:
                trial = self._trial((*self.undone, fault), touched)
                tried.append((trial.better(now), fault, trial))
        if not tried:
            return None
        likeliest = max(ratio for ratio, *_ in tried)
        # Of faults that are as likely, the one that is about the fewest equations: the others' are sound.
        tried.sort(key=lambda one: (one[0] < likeliest - AS_LIKELY, len(one[2].squares), -one[0]))
        ratio, fault, trial = tried[0]
        if DEBUG:
            for r, f, t in tried[:6]:
                print("     ", round(r, 2), f, {e: (float(now.squares[e].sum()), float(q.sum())) for e, q in t.squares.items()}, mean_above_zero(t.block_ratios(now)))
        p = min(1.0, len(tried) * mean_above_zero(trial.block_ratios(now)))
        lefts = {e: float(own.sum() / now.squares[e].sum()) for e, own in trial.squares.items()}
        best = min(lefts, key=lambda e: lefts[e])
        if ratio <= 0.0 or p > FALSE_ALARM or lefts[best] > LEFT or trial.squares[best].sum() > HOLDS:
            return None
        same = [f for r, f, t in tried[1:] if ratio - r < AS_LIKELY and t.squares.keys() == trial.squares.keys()]
        return Found(fault, tuple(same), p, lefts[best])

    def _touched(self, fault: Fault) -> set[str]:
        kinds = TIMED if fault.kind in ("late", "drift", "unsigned", "gravity") else (*TIMED, "pair")
        return {e for e in self.equations if e.split(" ")[0] in kinds and set(fault.roles) & self.read[e]}

    def _candidates(self, wrong: set[str], now: Trial) -> Iterator[Fault]:
        roles = sorted(set().union(*(self.read[e] for e in self.equations)) - {"setpoint"})
        for role in roles:
            yield Fault("sign", (role,), factor=-1.0)
            if role not in self.unknown_scale:
                for factor in UNIT_FACTORS["torque" if "torque" in role else "position"]:
                    yield Fault("unit", (role,), factor=factor)
            yield from self._scales(role)
            if "torque" in role:
                if self._one_sided(role):
                    yield from self._unsigned(role)
                if "link_position" in self.motion.values and not self.unknown_scale:
                    yield Fault("gravity", (role,))
        for a, b in combinations(roles, 2):
            if ("torque" in a) == ("torque" in b):
                yield Fault("exchanged", (a, b))
        for role in roles:
            yield from self._late(role, wrong, now)

    def _scales(self, role: str) -> Iterator[Fault]:
        """Yield the factor by which a role stands out of proportion to the others, where an equation tells it."""
        for e in self.equations:
            kind = e.split(" ")[0]
            eq = self._equation(e, self.undone)
            if role not in eq.roles or kind == "body":
                continue
            if kind == "motor" and role == eq.target and not self.unknown_scale and any("torque_sensor" in r for r in eq.roles):
                # τ_m = s (B θ̈ + … − τ_e): the sensor's torque becomes a column.
                rest = eq.y - eq.scale
                _, x = residual_of(eq.scale, eq.free, np.column_stack((eq.positive, -rest)))
                slope = float(x[-1]) or self._by_grid(role)
            elif kind == "pair" and role == "motor_position":
                q = eq.scale
                theta = q - eq.y
                slope = float((theta - theta.mean()) @ (q - q.mean()) / np.sum((q - q.mean()) ** 2))
            elif kind == "spring" and role.startswith("motor_position"):
                q, theta = (self._values(r, self.undone) for r in ("link_position", role))
                _, x = _line(eq.y, np.column_stack((np.ones(q.shape[1]), q[0], theta[0], q[1], theta[1])))
                slope = -float(x[1] / x[2]) if x[2] else 0.0
            elif kind == "spring" and role == "link_position" and "pair " not in self.equations:
                theta = self._values(next(r for r in eq.roles if r.startswith("motor_position")), self.undone)
                q = self._values(role, self.undone)
                _, x = _line(eq.y, np.column_stack((np.ones(q.shape[1]), q[0], theta[0], q[1], theta[1])))
                slope = -float(x[2] / x[1]) if x[1] else 0.0
            else:
                continue
            if slope > 0.0 and abs(math.log(slope)) > math.log(SCALE):
                yield self._refined(role, slope)

    def _by_grid(self, role: str) -> float:
        """Return the power of two by which a torque is multiplied that explains the channels best."""
        one = Fault("scale", (role,))
        touched, now = self._touched(one), self._trial(self.undone, self.equations)
        powers = [2.0**k for k in range(-10, 11)]
        return max(powers, key=lambda s: self._trial((*self.undone, replace(one, factor=s)), touched).better(now))

    def _refined(self, role: str, slope: float) -> Fault:
        """Return the factor near one that explains the channels best, as a unit where it is one's."""
        one = Fault("scale", (role,))
        touched, now = self._touched(one), self._trial(self.undone, self.equations)

        def worse(exponent: float) -> float:
            fault = replace(one, factor=slope * math.exp(exponent))
            return -self._trial((*self.undone, fault), touched).better(now)

        factor = slope * math.exp(_least(worse, 0.25, 0.05, UNIT_TOLERANCE / 20) or 0.0)
        for unit in UNIT_FACTORS["torque" if "torque" in role else "position"]:
            if abs(factor / unit - 1.0) < UNIT_TOLERANCE and role not in self.unknown_scale:
                return Fault("unit", (role,), factor=unit)
        return replace(one, factor=factor)

    def _one_sided(self, role: str) -> bool:
        x = self.signals.roles[role]
        return bool(np.nanmin(x) >= 0.0 or np.nanmax(x) <= 0.0) and role not in {r for f in self.undone for r in f.roles if f.kind == "unsigned"}

    def _unsigned(self, role: str) -> Iterator[Fault]:
        """Yield that a torque is a magnitude, once the signs that it lost are guessed from the equation that it is the target of."""
        best, least = None, math.inf
        for e in self.equations:
            eq = self._equation(e, self.undone)
            if eq.target != role:
                continue
            size, rest = np.abs(eq.scale), eq.y - eq.scale
            for signs in self._beginnings(eq, rest):
                for _ in range(10):
                    y = signs * size + rest
                    left, _ = residual_of(y, eq.free, eq.positive)
                    fresh = np.where(y - left - rest >= 0.0, 1.0, -1.0)
                    if np.array_equal(fresh, signs):
                        break
                    signs = fresh
                if (now := float(left @ left)) < least:
                    best, least = signs, now
            break
        if best is not None and 0.0 < np.mean(best > 0.0) < 1.0:
            self.signs[role] = best
            yield Fault("unsigned", (role,))

    def _beginnings(self, eq: Equation, rest: Array) -> Iterator[Array]:
        """Yield signs that a magnitude may have lost: those of what it may be made of."""
        ahead = [rest, *eq.positive.T[-3:], *(self._values(r, self.undone)[0] for r in sorted(eq.roles - {eq.target}))]
        if {"link_position", "motor_position"} <= eq.roles:
            ahead.append(self._values("link_position", self.undone)[0] - self._values("motor_position", self.undone)[0])
        for column in ahead:
            for share in STARTS:
                yield np.where(column >= np.quantile(column, share), 1.0, -1.0)

    def _late(self, role: str, wrong: set[str], now: Trial) -> Iterator[Fault]:
        """Yield by how much a role is late if it is, and how fast it becomes later."""
        one = Fault("late", (role,))
        touched = self._touched(one)
        if not touched & wrong:
            return
        longest = (self.motion.reach - 1) * self.signals.period

        def worse(delay: float, rate: float) -> float:
            end = abs(delay) + abs(rate) * (self.rows[-1] - self.middle) * self.signals.period
            if end > longest:
                return math.inf
            return -self._trial((*self.undone, replace(one, delay=delay, rate=rate)), touched).better(now)

        half = float(self.rows[-1] - self.middle) * self.signals.period
        fine = self.signals.period / 4
        seed, seed_rate = self._apart(role)
        delay = _least(lambda d: worse(d, 0.0), longest, LONGEST_DELAY / 10, fine, seed)
        if delay is not None and abs(delay) >= self.signals.period:
            yield replace(one, delay=delay)
        rate: float | None = 0.0
        delay = delay or 0.0
        if (end := worse(seed, seed_rate)) < worse(delay, 0.0) and end < math.inf:
            delay, rate = seed, seed_rate
        for _ in range(2):
            widest = (longest - abs(delay)) / half
            rate = _least(lambda r: worse(delay, r), widest, LONGEST_DELAY / 10 / half, fine / half, rate)
            if rate is None:
                return
            delay = _least(lambda d: worse(d, rate), longest, LONGEST_DELAY / 10, fine, delay) or delay
        if abs(rate) * half >= self.signals.period:
            yield Fault("drift", (role,), delay=delay, rate=rate)

    def _apart(self, role: str) -> tuple[float, float]:
        """Return by how much a position is later than the other one in the middle of the log [s], and how fast that grows.

        Where a deflection is small a delay makes much more of a difference than it, and only near the right one less.
        """
        other = {"link_position": "motor_position", "motor_position": "link_position"}.get(role)
        if other is None or other not in self.motion.values:
            return 0.0, 0.0
        mine, its = self._values(role, self.undone), self._values(other, self.undone)
        time = (self.rows - self.middle) * self.signals.period
        _, x = _line(its[0] - mine[0], np.column_stack((np.ones(time.size), its[1], time * its[1])))
        return float(x[1]), float(x[2])

    def _trial(self, faults: tuple[Fault, ...], equations: Collection[str]) -> Trial:
        squares = {}
        for e in equations:
            key = (e, *(f for f in faults if set(f.roles) & self.read[e]), *(id(self.signs.get(r)) for f in faults if f.kind == "unsigned" for r in f.roles))
            if key not in self.kept:
                eq = self._equation(e, faults)
                left, _ = residual_of(eq.y, eq.free, eq.positive)
                recorded = self._recorded(eq.target, faults)
                self.kept[key] = np.bincount(self.block, left**2, BLOCKS) / max(float(np.sum((recorded - recorded.mean()) ** 2)), TINY)
            squares[e] = self.kept[key]
        return Trial(squares)

    def _equation(self, name: str, faults: tuple[Fault, ...]) -> Equation:
        eq = equation(name, {role: self._values(role, faults) for role in self.read[name]}, None, self.unknown_scale)
        if any(f.kind == "gravity" and set(f.roles) & eq.roles for f in faults):
            q = self._values("link_position", faults)[0]
            eq = replace(eq, free=np.column_stack((eq.free, np.sin(q), np.cos(q))))
        return eq

    def _recorded(self, role: str, faults: tuple[Fault, ...]) -> Array:
        """Return a role with its signs lost, as it stands in the log."""
        return np.asarray(self._values(role, tuple(f for f in faults if f.kind != "unsigned"))[0])

    def _values(self, role: str, faults: tuple[Fault, ...], noisy: bool = False) -> Array:
        """Return value, rate and acceleration of a role with faults undone, shape (3, R)."""
        source, factor, delay, rate, signs = role, 1.0, 0.0, 0.0, None
        for fault in reversed(faults):
            if fault.kind == "exchanged" and source in fault.roles:
                a, b = fault.roles
                source = b if source == a else a
            elif source in fault.roles:
                factor, delay, rate = factor * fault.factor, delay + fault.delay, rate + fault.rate
                signs = self.signs[source] if fault.kind == "unsigned" else signs
        if not (delay or rate or noisy):
            values = self.at[source] / factor
            return np.asarray(values if signs is None else values * signs)
        period = self.signals.period
        shift = np.round((delay + rate * (self.rows - self.middle) * period) / period).astype(np.int64)
        at = self.rows + np.clip(shift, -self.motion.reach, self.motion.reach)
        values = self.motion.values[source][:, at] / factor
        if noisy:
            values = values + self.motion.noise[source][:, at] / factor
        return np.asarray(values if signs is None else values * signs)

    def _noise(self, name: str) -> float:
        """Return what the sensors' white noise makes of what an equation leaves, over the target's squares."""
        eq = self._equation(name, self.undone)
        _, x = residual_of(eq.y, eq.free, eq.positive)
        noisy = equation(name, {role: self._values(role, self.undone, noisy=True) for role in self.read[name]}, eq.knots, self.unknown_scale)
        more = noisy.y - eq.y - (noisy.positive - eq.positive) @ x
        recorded = self._recorded(eq.target, self.undone)
        return float(np.sum((more - more.mean()) ** 2) / max(float(np.sum((recorded - recorded.mean()) ** 2)), TINY))


def _line(y: Array, columns: Array) -> tuple[Array, Array]:
    x = np.linalg.lstsq(columns, y, rcond=None)[0]
    return y - columns @ x, x


def _least(
    f: Callable[[float], float], longest: float, step: float, finest: float, seed: float = 0.0
) -> float | None:
    """Return where a function is least between −longest and longest: on a grid, near a seed, then by halving the step.

    None where it is nowhere below its value at 0 by more than `AS_LIKELY`.
    """
    count = max(1, int(longest / step))
    near = [seed + k * finest * 4**m for k in (-1, 0, 1) for m in range(4) if abs(seed) < longest]
    values = {x: f(x) for x in (*(k * step for k in range(-count, count + 1)), *near)}
    best = min(values, key=values.__getitem__)
    value = values[best]
    if value > f(0.0) - AS_LIKELY:
        return None
    while step > finest:
        step *= 0.5
        for trial in (best - step, best + step):
            if abs(trial) <= longest and (other := f(trial)) < value:
                best, value = trial, other
                break
    return best
