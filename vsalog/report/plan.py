"""Document of `plan`: classes of causes, sensors and the motion that split them, causes that do not show."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from vsalog._version import __version__
from vsalog.core.notation import duration, listed, number, part_name, percent, signal_name, unit_of
from vsalog.core.significance import SIGNIFICANCE
from vsalog.diagnosis import plan_document as document
from vsalog.diagnosis.isolability import Isolation, Rival
from vsalog.diagnosis.plan import Confused, JointPlan, Options, Outcome, plan
from vsalog.diagnosis.plan_document import Plan
from vsalog.diagnosis.suggest import Suggestion
from vsalog.report.document import Block, Document, Facts, Section, Table, Words
from vsalog.report.experiment import scenario_text, swings
from vsalog.report.html import page_of
from vsalog.writers.atomic import check_path, together, write_text

KINDS: Mapping[document.Kind, str] = {
    "confused": "",
    "equal": "equal in every motion",
    "richer": "one can do all that another does",
}

# Who proposed the motion, and what its swings are compared with.
MOTION_OF = ("vsalog plan", "in the motion that was judged")


def write_plan(
    source: str, options: Options, output: Path | None, page: Path | None, progress: Callable[[str], None] = lambda _: None
) -> tuple[Plan, dict[str, str]]:  # fmt: skip
    """Plan, and write the requested files.

    Parameters
    ----------
    source, options : of `vsalog.diagnosis.plan.plan`
    output : the proposed motion's file
    page : the plan's page
    progress : called with the step that begins

    Returns
    -------
    The plan; what each file is, and its path

    Raises
    ------
    VsalogError
        The rig or the scenario is at fault, or a file cannot be written.
    """
    for path in (output, page):
        if path is not None:
            check_path(path)
    outcome = plan(source, options, progress)
    found, files, proposed = planned(outcome), dict[str, str](), outcome.proposed
    with together():
        if output is not None and proposed is not None:
            write_text(output, scenario_text(proposed, *MOTION_OF))
            files["motion"] = str(output)
        if page is not None:
            write_text(page, page_of(plan_document(found)))
            files["report"] = str(page)
    return found, files


def planned(outcome: Outcome) -> Plan:
    """Return a plan in the names of its document."""
    return Plan(
        vsalog=__version__,
        rig=outcome.rig.to_toml(),
        scenario=outcome.scenario,
        joints=tuple(map(_joint, outcome.joints)),
    )


def _joint(one: JointPlan) -> document.JointPlan:
    return document.JointPlan(
        joint=one.name,
        reason=one.reason,
        equations=one.equations,
        causes=tuple(map(_cause, one.causes)),
        classes=tuple(map(_class, one.classes)),
        sensors_tried=one.tried,
        motion=None if one.proposed is None else _motion(one.proposed),
        no_motion=one.no_motion,
    )


def _cause(one: Isolation) -> document.Cause:
    reported, rig = one.site.reported(one.values.tolist()), one.absent()
    values = {name: document.Value(value=v, rig=rig[name][0], unit=unit) for name, (v, unit) in reported.items()}
    return document.Cause(
        cause=one.site.cause,
        part=one.site.part,
        parameters=values,
        seen=one.seen,
        confused_with=tuple(_rivals(one)),
    )


def _rivals(one: Isolation) -> Iterator[document.Rival]:
    for rival in one.rivals:
        yield document.Rival(cause=rival.site.cause, part=_place(rival), probability=rival.probability)
        for double in rival.site.doubles:
            yield document.Rival(cause=double, part="", probability=rival.probability)
    for double in one.site.doubles:
        yield document.Rival(cause=double, part="", probability=1.0)


def _place(rival: Rival) -> str:
    return rival.site.part if rival.site.named else ""


def _class(one: Confused) -> document.ClassOfCauses:
    members = sorted({(cause, part if _is_part(part) else "") for cause, part in one.members})
    return document.ClassOfCauses(
        members=tuple(document.Member(cause=cause, part=part) for cause, part in members),
        kind=one.kind,
        sensor=one.sensor,
        by_motion=one.by_motion,
    )


def _is_part(part: str) -> bool:
    """Return whether it is a part of a joint, and not a variable of an unknown function."""
    return "," not in part


def _motion(proposed: Suggestion) -> document.Motion:
    best = proposed.best
    driven = [
        document.Driven(signal=what, low=low, high=high, unit=unit)
        for what, low, high, unit in swings(best.candidate.file, proposed.joint)
    ]
    return document.Motion(
        words=best.candidate.words,
        duration=best.candidate.file.duration,
        driven=tuple(driven),
        payload_mass=None if best.payload is None else best.payload.mass,
        payload_distance=None if best.payload is None else best.payload.distance,
    )


def plan_document(found: Plan, files: Mapping[str, str] = {}) -> Document:  # fmt: skip
    """Return a plan.

    Parameters
    ----------
    found : what was predicted and is proposed
    files : what was written: what each is, and its path
    """
    items: list[Block] = [
        Section(f"Joint {joint.joint}", tuple(_items(joint, found.scenario, bool(files)))) for joint in found.joints
    ]
    items.append(Section("", (Facts(tuple(files.items())),), where="terminal"))
    title = f"Plan for {', '.join(joint.joint for joint in found.joints)}"
    return Document(title, "Which causes the sensors separate", tuple(items), found)


def _items(joint: document.JointPlan, scenario: str, written: bool) -> Iterator[Block]:
    if joint.reason:
        yield Words(f"Nothing can be planned: {joint.reason}.")
        return
    hidden = [c for c in joint.causes if c.seen < 0.5]
    confused = {(m.cause, m.part) for c in joint.classes for m in c.members}
    seen = [c for c in joint.causes if c not in hidden]
    clear = [c for c in seen if (c.cause, c.part) not in confused]
    yield Words(
        f"Of {len(joint.causes)} causes as large as the rig's tolerances the motion '{scenario}' isolates {len(clear)},"
        f" confuses {len(seen) - len(clear)}, and does not show {len(hidden)}. Equations: {', '.join(joint.equations)}."
    )
    if joint.classes:
        heads = ("causes that are confused", "why", "sensor that splits them", "the proposed motion")
        rows = tuple(
            (
                _names(c.members),
                KINDS[c.kind],
                signal_name(c.sensor) if c.sensor else "none of those tried",
                _told(c, joint.classes),
            )
            for c in joint.classes
        )
        yield Table("Classes of causes", heads, rows, texts=4)
        yield Words(f"Sensors tried, the cheapest first: {_listed(joint.sensors_tried)}.")
    if hidden:
        shown = tuple((c.cause, part_name(c.part), _size(c), percent(c.seen)) for c in hidden)
        yield Table(
            "Causes that would not show", ("cause", "part", "as large as", "found with probability"), shown, texts=3
        )
    if joint.motion is not None:
        yield Words(_motion_words(joint.motion, written))
    elif joint.no_motion:
        yield Words(f"No motion is proposed: {joint.no_motion}.")


def _told(one: document.ClassOfCauses, classes: tuple[document.ClassOfCauses, ...]) -> str:
    if one.kind != "confused":
        return "no motion splits them"
    never = any(c.kind != "confused" and set(c.members) <= set(one.members) for c in classes)
    splits = "splits them, except those that no motion splits" if never else "splits them"
    return splits if one.by_motion else f"splits them in fewer than {percent(1.0 - SIGNIFICANCE)} of logs"


def _names(members: tuple[document.Member, ...]) -> str:
    return ", ".join(f"{m.cause} ({part_name(m.part)})" if m.part else m.cause for m in members)


def _listed(roles: tuple[str, ...]) -> str:
    return listed([signal_name(role) for role in roles]) if roles else "none"


def _size(cause: document.Cause) -> str:
    return ", ".join(f"{name} {number(v.value, 5)}{unit_of(v.unit)}" for name, v in cause.parameters.items())


def _motion_words(motion: document.Motion, written: bool) -> str:
    moves = listed([f"{d.signal} {d.low:.2g} to {d.high:.2g} {d.unit}" for d in motion.driven])
    out = f"Proposed motion: {motion.words}, {duration(motion.duration)}, {moves}"
    if motion.payload_mass is not None and motion.payload_distance is not None:
        out += f", with a known mass of {motion.payload_mass:g} kg on the link at {motion.payload_distance:g} m from its axis"
    return f"{out}." if written else f"{out}. -o FILE writes it as a scenario."
