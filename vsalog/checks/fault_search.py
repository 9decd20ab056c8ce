"""Which fault of a recording explains a joint's channels best, if any does.

A fault is a change of a channel that can be undone: a sign, a factor, a delay, a clock that drifts, two channels exchanged, a
magnitude taken, gravity taken out. The joint's equations are fitted to the channels as recorded and with each fault undone;
log(squared residual as recorded / squared residual with the fault undone), summed over the equations, is the fault's profile
log-likelihood ratio per independent sample. The likeliest fault is reported where

- the residual of some equation exceeds its noise floor, which includes quantisation, by an F-test at `FALSE_ALARM`;
- the ratio is above zero in blocks of time, by Student's t-test or the sign test over the blocks' own ratios, at `FALSE_ALARM`
  for all faults of a joint together (Bonferroni); blocks need not have equal variances (Ibragimov and Müller 2010), and samples
  within a block may depend on one another as they like;
- it explains most of the error (`Rule.left`), and the equation holds then (`Rule.holds`).

Of faults that the blocks do not separate from the likeliest the simplest is named. It is undone, and the search starts again,
for a second fault. What the joint may do instead is compared in the same way, and undone where it is likeliest, or not separated
from a fault, but is none of the recording: a channel's gain, a stiffness that changes, and a spring with a loop
(`fault.OF_JOINT`). Where it leaves more than noise, it does not excuse a fault that does not. What a spring does changes what a
delay explains: faults that were found before it are searched again with it. A loop and a delay may each explain little without
the other: where delays explain most of the error only with loops, the search is repeated with these, and of both results the
first is kept unless the blocks reject it.

Ibragimov, Müller, "t-statistic based correlation and heterogeneity robust inference", J. Bus. Econ. Stat. 28, 2010.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from vsalog.checks.changed_spring import changing_stiffness
from vsalog.checks.fault import FREE, OF_JOINT, OF_SPRING, RULE, Fault, Found
from vsalog.checks.late_channels import late, late_by
from vsalog.checks.scaled_channels import scaled
from vsalog.checks.smoothed_motion import exchanged, motion_of
from vsalog.checks.undone_channels import Channels, Faults, Trial
from vsalog.checks.unsigned_torque import unsigned
from vsalog.core.dependence import above_zero
from vsalog.core.progress import counted
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM

Joints = Mapping[str, JointSignals]


def faults_of(signals: JointSignals, unknown_scale: Collection[str] = ()) -> list[Found]:
    """Return the faults of a joint's channels; of one sound joint in a thousand (`FALSE_ALARM`) there is one by chance.

    Parameters
    ----------
    signals : of the joint, as recorded but for their units
    unknown_scale : roles whose unit is none of a torque's, such as a current without its constant
    """
    channels = _channels(signals, unknown_scale)
    if channels is None:
        return []
    found, undone = _searched(channels, ())
    loops = tuple(_loops(channels, undone, channels.wrong(undone)))
    # A loop and a delay may each explain little without the other.
    if loops and _late_with(channels, undone, loops):
        others, instead = _searched(channels, loops)
        found = others if channels.trial(instead).is_better(channels.trial(undone)) else found
    return [one for one in found if one.fault.kind not in OF_JOINT]


def _searched(channels: Channels, springs: Faults) -> tuple[list[Found], Faults]:
    """Return what is found one after another where springs do so, and all that is undone then."""
    found = list[Found]()
    while len(found) < RULE.most:
        one = _likeliest(channels, (*springs, *(earlier.fault for earlier in found)))
        if one is None:
            break
        if one.fault.kind in OF_SPRING:
            # What was found before may be what the spring does.
            springs, found = (*springs, one.fault), []
        else:
            found.append(one)
    return found, (*springs, *(one.fault for one in found))


def _loops(channels: Channels, undone: Faults, wrong: set[str]) -> Iterator[Fault]:
    """Yield that a spring has a loop, if equations with it are wrong."""
    yield from (one for role in channels.springs(wrong) if (one := Fault("loop", (role,))) not in undone)


def _late_with(channels: Channels, undone: Faults, loops: Faults) -> bool:
    """Return whether a delay explains, with loops, what is wrong."""
    now, wrong, both = channels.trial(undone), channels.wrong(undone), (*undone, *loops)
    roles = [role for role in channels.roles if channels.touched(Fault("late", (role,)), undone) & wrong]
    delays = ((role, late_by(channels, both, role)) for role in roles)
    late = (Fault("late", (role,), delay=delay) for role, delay in delays if delay is not None)
    return any(_tried(channels, undone, (*loops, one), now, len(roles)) for one in late)


def exchanged_between(joints: Joints) -> tuple[tuple[str, str], Found] | None:
    """Return the two joints whose channels of one role were exchanged; None for none.

    Of one sound log in a thousand (`FALSE_ALARM`) there are two by chance.

    Parameters
    ----------
    joints : of one log, by name
    """
    alone = {name: channels for name, its in joints.items() if (channels := _channels(its)) is not None}
    wrong = [name for name, channels in alone.items() if channels.wrong(())]
    # Exchanged channels must have passed through one filter.
    width = max((alone[name].motion.width for name in wrong), default=None)
    known = {name: its for name in wrong if (its := _channels(joints[name], (), width)) is not None}
    tried = [one for pair in combinations(known, 2) for one in _exchanged(joints, known, pair)]
    if not tried:
        return None
    ratio, p, left, names, role = max(tried)
    p = min(1.0, p * len(tried))
    if ratio <= 0.0 or p > FALSE_ALARM or left > RULE.left:
        return None
    return names, Found(Fault("exchanged", (role,)), (), p, left)


def with_exchanged(joints: Joints, a: str, b: str, role: str) -> dict[str, JointSignals]:
    """Return joints with the channels of a role exchanged between two of them."""
    one, other = joints[a], joints[b]
    return {
        **joints,
        a: replace(one, roles={**one.roles, role: other.roles[role]}),
        b: replace(other, roles={**other.roles, role: one.roles[role]}),
    }


def _exchanged(
    joints: Joints, known: Mapping[str, Channels], pair: tuple[str, str]
) -> Iterator[tuple[float, float, float, tuple[str, str], str]]:
    """Yield of each role of two joints the ratio, p-value and part left with their channels exchanged, and whose they are."""
    a, b = pair
    if len(joints[a]) != len(joints[b]):
        return
    for role in sorted(set(known[a].roles) & set(known[b].roles)):
        ratio, blocks, worst = 0.0, np.zeros(RULE.blocks), 0.0
        for name, its in zip(pair, map(with_exchanged(joints, a, b, role).__getitem__, pair), strict=True):
            other = known[b if name == a else a].motion
            there = Channels(its, exchanged(known[name].motion, other, role), ())
            touched = known[name].touched(Fault("exchanged", (role,)), ())
            if not touched <= set(there.equations):
                worst = 1.0
                continue
            now, then = known[name].trial((), touched), there.trial((), touched)
            ratio += then.better(now)
            blocks += then.block_ratios(now)
            worst = max(worst, _part_left(now, then))
        yield ratio, above_zero(blocks), worst, pair, role


def _channels(
    signals: JointSignals, unknown_scale: Collection[str] = (), width: float | None = None
) -> Channels | None:
    """Return the channels of a joint, filtered so widely; None where its equations cannot be formed."""
    motion = motion_of(signals, RULE.longest_delay, width)
    channels = None if motion is None else Channels(signals, motion, unknown_scale)
    return channels if channels is not None and channels.equations else None


@dataclass(frozen=True)
class _Tried:
    """A fault that explains channels: how much better, how likely by chance, and what part of the squares is left."""

    fault: Fault
    trial: Trial
    ratio: float
    p: float
    left: float


def _likeliest(channels: Channels, undone: Faults) -> Found | None:
    """Return the likeliest fault in addition to those that are undone; None where none is."""
    now, wrong = channels.trial(undone), channels.wrong(undone)
    candidates = list(_candidates(channels, undone, wrong)) if wrong else []
    explaining = [one for fault in candidates if (one := _tried(channels, undone, (fault,), now, len(candidates)))]
    if not explaining:
        return None
    # A torque that is never negative is tested as a magnitude first: its delay or scale has no meaning yet.
    magnitudes = [one for one in explaining if one.fault.kind == "unsigned"]
    best = max(magnitudes or explaining, key=lambda one: one.ratio)
    alike = [one for one in explaining if one is best or not _is_better(channels, undone, best.fault, one.fault)]
    # Of equally likely faults, the one with the fewest equations and fitted numbers; no fault that the joint itself may explain.
    if not channels.wrong((*undone, best.fault), best.trial.squares):
        # What leaves more than noise does not excuse it.
        joints = (one for one in alike if one.fault.kind in OF_JOINT)
        unlike = {one.fault for one in joints if channels.wrong((*undone, one.fault), one.trial.squares)}
        alike = [one for one in alike if one.fault not in unlike]
    of_joint = [one for one in alike if one.fault.kind in OF_JOINT]
    chosen = min(of_joint or alike, key=lambda one: (len(one.trial.squares), FREE.get(one.fault.kind, 0), -one.ratio))
    same = (one.fault for one in alike if one is not chosen and one.trial.squares.keys() == chosen.trial.squares.keys())
    return Found(chosen.fault, tuple(dict.fromkeys(same)), chosen.p, chosen.left)


def _tried(channels: Channels, undone: Faults, faults: Faults, now: Trial, many: int) -> _Tried | None:
    """Return how faults explain channels together, as one of many explanations; None where they do not."""
    touched = set[str]().union(*(channels.touched(fault, undone) for fault in faults))
    trial = channels.trial((*undone, *faults), touched)
    ratio, p = trial.better(now), min(1.0, many * above_zero(trial.block_ratios(now)))
    left = _part_left(now, trial)
    return None if ratio <= 0.0 or p > FALSE_ALARM or left > RULE.left else _Tried(faults[-1], trial, ratio, p, left)


def _is_better(channels: Channels, undone: Faults, one: Fault, other: Fault) -> bool:
    """Return whether a fault explains channels better than another."""
    about = channels.touched(one, undone) | channels.touched(other, undone)
    return channels.trial((*undone, one), about).is_better(channels.trial((*undone, other), about))


def _part_left(now: Trial, then: Trial) -> float:
    """Return the ratio of squared residuals of the equation that is explained best and holds."""
    held = (e for e in then.squares if then.holds[e] <= RULE.holds and now.left(e) > 0.0)
    return min((then.left(e) / now.left(e) for e in held), default=1.0)


def _candidates(channels: Channels, undone: Faults, wrong: set[str]) -> Iterator[Fault]:
    """Yield the faults that equations with large residuals can show."""
    for fault in _all(channels, undone, wrong):
        if channels.touched(fault, undone) & wrong:
            yield fault


def _all(channels: Channels, undone: Faults, wrong: set[str]) -> Iterator[Fault]:
    for role in counted("recording_faults", channels.roles):
        for together in _measured_together(channels, role):
            yield Fault("sign", together, factor=-1.0)
            yield from scaled(channels, undone, together)
        if "torque" in role:
            magnitude = unsigned(channels, undone, role)
            yield from () if magnitude is None else (magnitude,)
            if "link_position" in channels.motion.values and not channels.unknown_scale:
                yield Fault("gravity", (role,))
        if channels.touched(Fault("late", (role,)), undone) & wrong:
            yield from late(channels, undone, role)
    yield from changing_stiffness(channels, undone, wrong)
    yield from _loops(channels, undone, wrong)
    for a, b in combinations(channels.roles, 2):
        if _quantity(a) == _quantity(b):
            yield Fault("exchanged", (a, b))


def _measured_together(channels: Channels, role: str) -> Iterator[tuple[str, ...]]:
    """Yield a role, and a position with its velocity and command in the same unit and on the same side."""
    yield (role,)
    others = [
        r for r in channels.roles if r in ("commanded_position", role.replace("_position", "_velocity")) and r != role
    ]
    if role.startswith(("motor_position", "link_position")):
        for many in range(1, len(others) + 1):
            yield from ((role, *some) for some in combinations(others, many))


def _quantity(role: str) -> str:
    return next(quantity for quantity in ("torque", "velocity", "") if quantity in role)
