"""A proposed experiment in words, and as a file."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsalog.core.documents import toml_tables
from vsalog.core.notation import listed, part_name, signal_name, unit_of
from vsalog.core.units import shown
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.experiment_design import DESIGN
from vsalog.diagnosis.suggest import Suggestion
from vsalog.diagnosis.suggest_questions import Question, Questions
from vsalog.simulation.scenario import unit_of as driven_unit
from vsalog.simulation.scenario_parts import sum_of_parts
from vsalog.simulation.scenario_schema import ScenarioFile, ServoDrive

Array = NDArray[np.float64]

FILE = "next.scenario.toml"


def confirmation(cause: str) -> str:
    """Return the experiment that confirms a cause of the catalogue, with names where its words ask for fitted numbers."""
    return re.sub(r"\{(\w+)\}", lambda m: f"its {signal_name(m[1])}", catalogue()[cause].confirm)


def experiment_words(proposed: Suggestion) -> str:
    """Return what to do, why, and how well it would separate the causes; of several joints also with which."""
    best, questions, joint = proposed.best, proposed.questions, proposed.joint
    file, payload = best.candidate.file, best.payload
    bounds = listed([f"{what} {low:.2g} to {high:.2g} {unit}" for what, low, high, unit in swings(file, joint)])
    what = f"Run {FILE}: {best.candidate.words}, {file.duration:g} s, {bounds}, within the range that this log covers"
    if proposed.of_several:
        what += f", in joint {joint}"
    if payload is not None:
        what += f", with a known mass of {payload.mass:g} kg on the link at {payload.distance:g} m from its axis"
    why = _apart(questions, best.separations) if questions.confused else _shown(questions, best.separations)
    return f"{what}. {why}"


def swings(file: ScenarioFile, joint: str) -> list[tuple[str, float, float, str]]:
    """Return what is driven in a joint, from where to where, and the unit; constant inputs are left out."""
    driven = _driven(file, joint)
    return [(name, float(v.min()), float(v.max()), unit) for name, v, unit in driven if np.ptp(v) > 0.0]


def _begins(file: ScenarioFile, joint: str) -> list[tuple[str, float, str]]:
    """Return what is driven in a joint, where it begins, and the unit."""
    return [(name, float(values[0]), unit) for name, values, unit in _driven(file, joint)]


def _driven(file: ScenarioFile, joint: str) -> list[tuple[str, Array, str]]:
    time = np.linspace(0.0, file.duration, 2000)
    out = []
    for key in file.joint[joint].__struct_fields__:
        drive = getattr(file.joint[joint], key)
        if drive:
            parts = drive.reference if isinstance(drive, ServoDrive) else drive
            values = sum_of_parts(parts, driven_unit(key), file.duration, Path(), ("joint", joint, key))(time)
            out.append((signal_name(key.replace("servo", "position")), values, driven_unit(key)))
    return out


def _apart(questions: Questions, separations: Array) -> str:
    """Return how well the confused causes would be separated."""
    separated = [(q, float(d)) for q, d in zip(questions.asked, separations, strict=True) if d >= DESIGN.separate]
    left = [q for q, d in zip(questions.asked, separations, strict=True) if d < DESIGN.separate]
    out = []
    if separated:
        first, least = min(separated, key=lambda t: t[1])
        closest = f"{_name(first, 'one', questions)} and {_name(first, 'other', questions)}, the closest,"
        pair = closest if len(separated) > 1 else "they"
        out.append(
            f"It separates {_all(separated, questions)}: in this log {pair} differ by {_times(first.now)} the noise of an"
            f" averaged equation, there by {_times(least)}."
        )
    if left:
        pairs = "; ".join(f"{_name(q, 'one', questions)} from {_name(q, 'other', questions)}" for q in left)
        most = max(float(d) for d in separations if d < DESIGN.separate)
        site = left[0].other.site
        confirm = f" {confirmation(site.cause)}" if site is not None and not separated else ""
        out.append(f"No experiment within those bounds separates {pairs} ({_times(most)} the noise at best).{confirm}")
    return " ".join(out)


def _all(separated: list[tuple[Question, float]], questions: Questions) -> str:
    return listed(list(dict.fromkeys(_name(q, side, questions) for q, _ in separated for side in ("one", "other"))))


def _shown(questions: Questions, separations: Array) -> str:
    """Return what the log could not have shown, and the experiment would."""
    less, hidden = [], []
    for question, there in zip(questions.asked, separations, strict=True):
        value, unit = question.size or (0.0, "1")
        now = value * DESIGN.separate / question.now if question.now > 0.0 else np.inf
        then = value * DESIGN.separate / there if there > 0.0 else np.inf
        name = _name(question, "one", questions)
        if now > DESIGN.worthwhile * then:
            less.append(f"{name} from {_size(then, unit)} on instead of from {_size(now, unit)}")
        else:
            hidden.append(f"{name} below {_size(now, unit)}")
    if not less:
        return f"It would show little more than this log: {listed(hidden)} takes a larger or a faster motion."
    words = f"Of the effects that this log shows least it would show {listed(less)}."
    if hidden:
        words += f" No motion within those bounds shows {listed(hidden)}: that takes a larger or a faster motion."
    return words


def _size(value: float, unit: str) -> str:
    return f"{value:.2g}{unit_of(unit)}" if np.isfinite(value) else "any"


def _name(question: Question, side: str, questions: Questions) -> str:
    site = getattr(question, side).site
    if site is None:
        return "nothing"
    others = [s for q in questions.asked for s in (q.one.site, q.other.site) if s is not None and s.key != site.key]
    alike = any(s.cause == site.cause for s in others)
    return f"{site.cause} ({part_name(site.part)})" if alike else str(site.cause)


def _times(d: float) -> str:
    return f"{d:.2g} times" if d >= 0.01 else "less than 0.01 times"


def scenario_text(proposed: Suggestion, by: str = "vsalog diagnose --suggest", now: str = "in the log") -> str:
    """Return the scenario as TOML, with its purpose as a heading; names must not end the comment.

    Parameters
    ----------
    proposed : the experiment
    by : the command that proposes it
    now : the present experiment, in words
    """
    import tomli_w

    best, questions, joint = proposed.best, proposed.questions, proposed.joint
    lines = [
        f"Proposed by {by} for joint {shown(joint)}: {best.candidate.words}.",
        "All numbers are SI.",
    ]
    for question, there in zip(questions.asked, best.separations, strict=True):
        if question.size is None:
            what = f"{_name(question, 'one', questions)} against {_name(question, 'other', questions)}: apart by"
        else:
            what = f"{_name(question, 'one', questions)} of {_size(*question.size)}: shows as"
        lines.append(f"{what} {_times(question.now)} the noise of an average {now}, {_times(float(there))} here.")
    begins = [f"{what} at {first:.4g} {unit}" for what, first, unit in _begins(best.candidate.file, joint)]
    lines.append(f"It begins with {listed(begins)}: bring the joint there first.")
    payload = best.payload
    if payload is not None:
        key = f"joint.{shown(joint)}.link.payload"
        lines.append(
            f"Put {payload.mass:g} kg on the link, {payload.distance:g} m from its axis, and state it in the rig:"
            f" --set {key}.mass={payload.mass:g} --set {key}.distance={payload.distance:g}"
        )
    return "".join(f"# {line}\n" for line in lines) + "\n" + tomli_w.dumps(toml_tables(best.candidate.file))
