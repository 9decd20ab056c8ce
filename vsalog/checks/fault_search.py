"""Which fault of a recording explains a joint's channels best, if any does.

A fault is something that was done to a channel, and can be undone: a sign, a factor, a delay, a clock that drifts, two channels
exchanged, a magnitude taken, gravity taken out. The joint's equations are fitted to the channels as recorded and with each fault
undone; log(squares left as recorded / squares left with the fault undone), summed over the equations, is the fault's profile
log-likelihood ratio per independent sample. The likeliest fault is reported where

- some equation leaves more than its sensors' noise and steps make of it;
- the ratio is above zero in blocks of time, by Student's t-test over the blocks' own ratios, at `FALSE_ALARM` for all faults of a
  joint together (Bonferroni); blocks need not have equal variances (Ibragimov and Müller 2010), and samples within a block may
  depend on one another as they like;
- it explains most of what is wrong (`Rule.left`), and the equation holds then (`Rule.holds`).

What is found is undone, and the search begins again, for a second fault.

Ibragimov, Müller, "t-statistic based correlation and heterogeneity robust inference", J. Bus. Econ. Stat. 28, 2010.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from vsalog.checks.fault import RULE, Fault, Found
from vsalog.checks.late_channels import late
from vsalog.checks.scaled_channels import scaled
from vsalog.checks.smoothed_motion import motion_of
from vsalog.checks.undone_channels import Channels, Faults, Trial
from vsalog.checks.unsigned_torque import unsigned
from vsalog.core.dependence import mean_above_zero
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
    channels, found = _channels(signals, unknown_scale), list[Found]()
    while channels is not None and len(found) < RULE.most:
        one = _likeliest(channels, [earlier.fault for earlier in found])
        if one is None:
            break
        found.append(one)
    return found


def exchanged_between(joints: Joints) -> tuple[tuple[str, str], Found] | None:
    """Return the two joints of which channels of one role were taken for one another; None for none.

    Of one sound log in a thousand (`FALSE_ALARM`) there are two by chance.

    Parameters
    ----------
    joints : of one log, by name
    """
    known = {name: channels for name, its in joints.items() if (channels := _channels(its)) is not None}
    wrong = [name for name, channels in known.items() if _wrong(channels, ())]
    tried = [one for pair in combinations(wrong, 2) for one in _exchanged(joints, known, pair)]
    if not tried:
        return None
    ratio, p, left, names, role = max(tried)
    p = min(1.0, p * len(tried))
    if ratio <= 0.0 or p > FALSE_ALARM or left > RULE.left:
        return None
    return names, Found(Fault("exchanged", (role,)), (), p, left)


def with_exchanged(joints: Joints, a: str, b: str, role: str) -> dict[str, JointSignals]:
    """Return joints of which two have each other's channel of a role."""
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
            there = _channels(its)
            touched = known[name].touched(Fault("exchanged", (role,)))
            if there is None or not touched <= set(there.equations):
                worst = 1.0
                continue
            now, then = known[name].trial((), touched), there.trial((), touched)
            ratio += then.better(now)
            blocks += then.block_ratios(now)
            worst = max(worst, _part_left(now, then)[0])
        yield ratio, mean_above_zero(blocks), worst, pair, role


def _channels(signals: JointSignals, unknown_scale: Collection[str] = ()) -> Channels | None:
    """Return the channels of a joint; None where its equations cannot be formed."""
    motion = motion_of(signals, RULE.longest_delay)
    channels = None if motion is None else Channels(signals, motion, unknown_scale)
    return channels if channels is not None and channels.equations else None


def _wrong(channels: Channels, undone: Faults) -> set[str]:
    """Return the equations that leave more than noise."""
    now, floor = channels.trial(undone), _floor(channels, undone)
    return {e for e in channels.equations if now.left(e) > floor[e]}


def _floor(channels: Channels, undone: Faults) -> dict[str, float]:
    """Return what noise makes of what each equation leaves."""
    return {e: channels.noise(e, undone) for e in channels.equations}


def _likeliest(channels: Channels, undone: Faults) -> Found | None:
    """Return the likeliest fault beyond those that are undone; None where none is."""
    now, wrong = channels.trial(undone), _wrong(channels, undone)
    tried = list[tuple[float, Fault, Trial]]()
    for fault in _candidates(channels, undone, wrong) if wrong else ():
        trial = channels.trial((*undone, fault), channels.touched(fault))
        tried.append((trial.better(now), fault, trial))
    if not tried:
        return None
    # Equations that are left with no more than noise are explained alike.
    floor = _floor(channels, (*undone, max(tried, key=lambda one: one[0])[1]))
    tried = [(trial.better(now, floor), fault, trial) for _, fault, trial in tried]
    likeliest = max(ratio for ratio, *_ in tried)
    # Of faults that are as likely, the one that is about the fewest equations: the others' are sound. A unit has no free number.
    tried.sort(
        key=lambda one: (one[0] < likeliest - RULE.as_likely, len(one[2].squares), one[1].kind == "scale", -one[0])
    )
    ratio, fault, trial = tried[0]
    p = min(1.0, len(tried) * mean_above_zero(trial.block_ratios(now)))
    left, holds = _part_left(now, trial)
    if ratio <= 0.0 or p > FALSE_ALARM or left > RULE.left or holds > RULE.holds:
        return None
    same = (f for r, f, t in tried[1:] if ratio - r < RULE.as_likely and t.squares.keys() == trial.squares.keys())
    return Found(fault, tuple(dict.fromkeys(same)), p, left)


def _part_left(now: Trial, then: Trial) -> tuple[float, float]:
    """Return the part that the equation leaves which is explained best, of what it left before and of its target's squares."""
    return min((then.left(e) / now.left(e), then.left(e)) for e in then.squares)


def _candidates(channels: Channels, undone: Faults, wrong: set[str]) -> Iterator[Fault]:
    """Yield the faults that equations which are wrong tell of."""
    for fault in _all(channels, undone, wrong):
        if channels.touched(fault) & wrong:
            yield fault


def _all(channels: Channels, undone: Faults, wrong: set[str]) -> Iterator[Fault]:
    for role in channels.roles:
        yield Fault("sign", (role,), factor=-1.0)
        yield from scaled(channels, undone, role)
        if "torque" in role:
            magnitude = unsigned(channels, undone, role)
            yield from () if magnitude is None else (magnitude,)
            if "link_position" in channels.motion.values and not channels.unknown_scale:
                yield Fault("gravity", (role,))
        if channels.touched(Fault("late", (role,))) & wrong:
            yield from late(channels, undone, role)
    for a, b in combinations(channels.roles, 2):
        if ("torque" in a) == ("torque" in b):
            yield Fault("exchanged", (a, b))
