"""Guesses the joints of a log and the channels of their roles, each with its reasons and its confidence.

Names come first, then units and message types; the numbers confirm or refute them, and show gear ratios and signs. Outliers are
left out, as in an estimate. A confidence is a rough estimate, not a probability: 0.9 means "check it once", 0.5 means "may well
be something else".
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence

import msgspec
import numpy as np

from vsalog.core.finding import Finding
from vsalog.core.recording import Recording
from vsalog.rig.guess_data import gear_between, is_constant, without_outliers
from vsalog.rig.guess_joint import guess_joint
from vsalog.rig.guess_names import meaning_of, words_of
from vsalog.rig.guess_runs import RunGroup, find_runs
from vsalog.rig.guess_types import Candidate, Guess, JointGuess, RunGuess

__all__ = ["Guess", "JointGuess", "guess_roles", "or_unknown"]

_PLACED = ("position", "deflection")

LEAST_CHANNELS = 2
"""Channels of a joint that move [1]: an angle, and what is compared with it."""

_WANTED = {
    "motor_position": "an angle on the motor's side of the spring",
    "link_position": "an angle on the link's side of the spring",
    "deflection": "link − motor position; instead of one of the two",
    "motor_torque": "the motor's torque or current",
    "torque_sensor": "the spring's torque by a sensor",
}


@np.errstate(
    over="ignore", invalid="ignore", divide="ignore"
)  # a log may contain any number: an infinite one is no match
def guess_roles(recording: Recording) -> Guess:
    """Guess the joints of a log, their kinds and the channels of their roles.

    Parameters
    ----------
    recording : with all channels that may matter

    Returns
    -------
    joints in the order their names appear in the log; none where nothing looks like a joint's position
    """
    runs = find_runs(recording)
    candidates, findings = _candidates(recording, runs)
    joints = []
    for name, group in _by_joint(candidates).items():
        if any(c.meaning.quantity in _PLACED for c in group):
            joints.append(guess_joint(name, group, bool(runs and runs.numbers)))
        else:
            names = {"channels": ", ".join(f"'{c.channel.name}'" for c in group[:4])}
            findings.append(Finding(code="guess.no_position", value=len(group), evidence=names))
    if runs is not None:
        joints = [_with_runs(joint, runs) for joint in joints]
        findings += _left_out(runs)
    return Guess(tuple(joints), tuple(findings))


def or_unknown(guess: Guess, recording: Recording) -> Guess:
    """Return a guess, with a joint without channels where no joint was recognised, but enough channels move for one."""
    if guess.joints or sum(not is_constant(channel) for channel in recording.channels.values()) < LEAST_CHANNELS:
        return guess
    joint = JointGuess("joint", "elastic", "no name or unit of a channel shows a joint", 0.0, {}, _WANTED)
    return msgspec.structs.replace(guess, joints=(joint,))


def _candidates(recording: Recording, runs: RunGroup | None) -> tuple[list[Candidate], list[Finding]]:
    """Return the channels that may have a role, those of the runs once; and the ones that were skipped."""
    clockless = {name for name, stream in recording.streams.items() if stream.time_source == "none"}
    findings = []
    if clockless and clockless == set(recording.streams):
        findings += [Finding(code="clock.missing", part=stream) for stream in recording.streams]
        clockless = set()
    elif clockless:
        streams = {"streams": _quoted(sorted(clockless))}
        findings.append(Finding(code="guess.streams_without_time", value=len(clockless), evidence=streams))
    skipped = clockless | (set(runs.streams[1:]) | set(runs.left_out) if runs else set())
    found = []
    for channel in recording.channels.values():
        # A stiffness next to a damping is a controller's gain.
        if channel.stream in skipped or (
            "stiffness" in channel.name and channel.name.replace("stiffness", "damping") in recording.channels
        ):
            continue
        is_run = runs is not None and channel.stream == runs.streams[0]
        meaning = meaning_of(channel, with_stream=not is_run)
        if meaning.quantity != "other":
            found.append(Candidate(without_outliers(channel), meaning))
    return found, findings


def _by_joint(candidates: list[Candidate]) -> dict[str, list[Candidate]]:
    """Group candidates by the joint their names name."""
    groups: dict[str, list[Candidate]] = defaultdict(list)
    for candidate in candidates:
        if candidate.meaning.quantity != "velocity":
            groups["_".join(candidate.meaning.joint)].append(candidate)
    _merge_symbols(groups)
    _merge_numbered(groups)
    _merge_links(groups)
    _merge_strays(groups)
    _merge_nameless(groups)
    _add_velocities(groups, [c for c in candidates if c.meaning.quantity == "velocity"])
    return {name: _parts_by_topic(group) for name, group in _named(_split_numbered(groups)).items()}


def _merge_symbols(groups: dict[str, list[Candidate]]) -> None:
    """A word that may be a quantity's symbol names no joint, unless two of them have the same part: alpha_m and beta_m."""
    without: dict[str, list[str]] = defaultdict(list)
    for key, group in groups.items():
        symbols = {c.meaning.symbol for c in group}
        name = "_".join(word for word in group[0].meaning.joint if word not in symbols)
        without[f"joint_{name}" if name.isdigit() else name].append(key)
    for name, keys in without.items():
        held = [{(c.meaning.quantity, c.meaning.part, c.meaning.index) for c in groups[key]} for key in keys]
        if keys != [name] and sum(map(len, held)) == len(set().union(*held)):
            groups[name] = [c for key in keys for c in groups.pop(key)]


def _merge_numbered(groups: dict[str, list[Candidate]]) -> None:
    """A topic's ``motor_2`` belongs to another's ``joint_2``."""
    for candidate in list(groups.get("", ())):
        key = _numbered_joint(candidate)
        if key in groups and key:
            groups[""].remove(candidate)
            groups[key].append(candidate)
    if not groups.get("", True):
        del groups[""]


def _numbered_joint(candidate: Candidate) -> str:
    """Return ``joint_2`` for the element ``motor_2`` of a message, "" for other numbering."""
    meaning = candidate.meaning
    return f"joint_{meaning.index}" if meaning.label and meaning.part == "motor" and meaning.index is not None else ""


def _parts_by_topic(group: list[Candidate]) -> list[Candidate]:
    """Assign a motor topic's data of a joint to the motor, where another topic has the same data of the joint."""
    streams = {c.channel.stream: c.meaning.in_motor_topic for c in group if _is_unsided_position(c)}
    motors = [stream for stream, is_motors in streams.items() if is_motors]
    if len(streams) != 2 or len(motors) != 1:
        return group
    why = f"its topic {motors[0]} names a motor"
    return [
        c.with_part("motor", why) if c.channel.stream == motors[0] and c.meaning.part in ("", "link") else c
        for c in group
    ]


def _is_unsided_position(candidate: Candidate) -> bool:
    meaning = candidate.meaning
    return meaning.quantity == "position" and meaning.part in ("", "link") and not meaning.in_command_topic


def _merge_strays(groups: dict[str, list[Candidate]]) -> None:
    """A word that only one channel has ("angleJIM") names no joint, unless a message gave the name."""
    strays = [
        key
        for key, group in groups.items()
        if key and len(group) == 1 and not group[0].meaning.label and len(groups) > 1
    ]
    # A log with one position per joint and nothing else has as many words as channels: these are names, unless the
    # channels are the two ends of one joint.
    if len(strays) == len(groups):
        parts = sorted(group[0].meaning.part for group in groups.values())
        if parts != ["link", "motor"] and all(group[0].meaning.quantity in _PLACED for group in groups.values()):
            return
    for key in strays:
        groups[""].extend(groups.pop(key))


def _merge_nameless(groups: dict[str, list[Candidate]]) -> None:
    """A channel that names no joint belongs to the only one that is named."""
    named = [key for key in groups if key]
    if len(named) != 1 or not groups.get(""):
        return
    has_position = {key: any(c.meaning.quantity in _PLACED for c in groups[key]) for key in ("", named[0])}
    if has_position[""] and has_position[named[0]]:
        return
    target = named[0] if has_position[named[0]] else ""
    source = "" if target else named[0]
    groups[target].extend(groups.pop(source))


def _merge_links(groups: dict[str, list[Candidate]]) -> None:
    """A motor is that of the only joint without one whose name has a word more and that moves with it: ``left_motor``,
    ``left_shin``.
    """
    for key in list(groups):
        motors = _positions(groups.get(key, []))
        if not key or {c.meaning.part for c in motors} != {"motor"}:
            continue
        longer = [
            name
            for name, group in groups.items()
            if re.fullmatch(f"{re.escape(key)}_[^_\\d]+", name)
            and {c.meaning.part for c in _positions(group)} in ({""}, {"link"})
        ]
        if len(longer) == 1 and gear_between(motors[0].channel, _positions(groups[longer[0]])[0].channel) is not None:
            groups[key] += groups.pop(longer[0])


def _positions(group: list[Candidate]) -> list[Candidate]:
    return [c for c in group if c.meaning.quantity == "position"]


def _add_velocities(groups: dict[str, list[Candidate]], velocities: list[Candidate]) -> None:
    """A velocity belongs to the joint in its name, or to the only one; others are of something else."""
    words = {c.meaning.joint for group in groups.values() for c in group}
    owners = {"_".join(c.meaning.joint): key for key, group in groups.items() for c in group if key and c.meaning.joint}
    for candidate in velocities:
        key = "_".join(candidate.meaning.joint) or (_numbered_joint(candidate) if len(groups) > 1 else "")
        is_only = len(groups) == 1 and (not key or candidate.meaning.joint in words)
        only = next(iter(groups)) if is_only else owners.get(key, key)
        if only in groups:
            groups[only].append(candidate)


def _split_numbered(groups: dict[str, list[Candidate]]) -> dict[str, list[Candidate]]:
    """Split a group whose links are numbered (q1, q2): the numbers count joints, not the motors of one joint.

    Likewise those of a list's elements, and more than two of any kind.
    """
    split: dict[str, list[Candidate]] = {}
    for key, group in groups.items():
        elements = {c.meaning.index for c in group if c.meaning.is_element and c.meaning.quantity == "position"}
        motors, others = _numbers(group, "motor"), _numbers(group, "")
        # Two motors are those of one joint only where it has a link, or deflections.
        is_pair = any(c.meaning.part in ("link", "") and c.meaning.quantity in _PLACED for c in group)
        most = max(len(motors) + (not is_pair), len(others))
        if len(_numbers(group, "link")) < 2 and len(elements) < 2 and most < 3:
            split.setdefault(key, []).extend(group)
            continue
        for candidate in group:
            number = candidate.meaning.index
            name = key if number is None else f"{key}_{number}" if key else f"joint_{number}"
            split.setdefault(name, []).append(candidate)
    return split


def _numbers(group: list[Candidate], part: str) -> set[int]:
    return {
        c.meaning.index
        for c in group
        if c.meaning.part == part and c.meaning.quantity == "position" and c.meaning.index is not None
    }


def _named(groups: dict[str, list[Candidate]]) -> dict[str, list[Candidate]]:
    """Name each group: by the one label all its channels have, else by the remaining words, else ``joint``."""
    named: dict[str, list[Candidate]] = {}
    for key, group in groups.items():
        labels = {c.meaning.label for c in group}
        label = labels.pop() if len(labels) == 1 else ""
        is_whole = label and ("_".join(words_of(label)) == key or not any(c.meaning.part for c in group))
        name = label if is_whole else key or "joint"
        while name in named:
            name += "_"
        named[name] = group
    return named


def _with_runs(joint: JointGuess, runs: RunGroup) -> JointGuess:
    """Replace the first run's name by ``{run}`` in the channels, and list the runs."""
    first = runs.streams[0]
    roles = {}
    is_in_runs = False
    for role, guess in joint.roles.items():
        if guess.channel.startswith(first + "."):
            is_in_runs = True
            guess = msgspec.structs.replace(guess, channel=runs.template + guess.channel[len(first) :])
        roles[role] = guess
    if not is_in_runs:
        return joint
    numbers: Sequence[float | None] = runs.numbers or (None,) * len(runs.names)
    listed = tuple(RunGuess(name, number) for name, number in zip(runs.names, numbers, strict=True))
    missing = {role: why for role, why in joint.missing.items() if role != "setpoint" or not runs.numbers}
    return msgspec.structs.replace(joint, roles=roles, runs=listed, missing=missing)


def _left_out(runs: RunGroup) -> list[Finding]:
    if not runs.left_out:
        return []
    streams = {"streams": _quoted(runs.left_out)}
    return [Finding(code="guess.runs_left_out", part=runs.template, value=len(runs.left_out), evidence=streams)]


def _quoted(names: Sequence[str], most: int = 6) -> str:
    shown = ", ".join(f"'{name}'" for name in names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
