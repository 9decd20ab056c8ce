"""What to measure before any experiment: which causes a rig's sensors separate, and the sensor and the motion that separate more.

A motion is simulated with the rig and diagnosed in expectation (`isolability`). For each class of causes that it confuses the
cheapest further sensor is sought that splits it, and one motion for all classes, by the bench that `diagnose --suggest` uses
(`suggest`); it is made as short as it may be.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from dataclasses import replace as changed
from pathlib import Path
from typing import Any, Literal

import numpy as np
from msgspec.structs import replace

from vsalog.binding.joint import bind, offered_roles
from vsalog.core.errors import DiagnosisError, UnitError, VsalogError, did_you_mean
from vsalog.core.progress import counted
from vsalog.core.signals import JointSignals
from vsalog.core.significance import SIGNIFICANCE
from vsalog.core.units import parse_quantity
from vsalog.core.units import shown as shown_text
from vsalog.diagnosis.experiment_design import DESIGN
from vsalog.diagnosis.isolability import Isolation, Key, Rival, Structure, isolations, structure_of, until
from vsalog.diagnosis.joint import Progress
from vsalog.diagnosis.posterior import Problem
from vsalog.diagnosis.priors import felt
from vsalog.diagnosis.setting import setting_of
from vsalog.diagnosis.suggest import Bench, Subject, Suggestion, separation
from vsalog.diagnosis.suggest_candidates import Trial
from vsalog.diagnosis.suggest_questions import Hypothesis, Question, Questions, shown
from vsalog.diagnosis.suggest_range import Limits, seen_in
from vsalog.estimation.joint import pick_joints
from vsalog.residuals.channels import channels_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.sensing import at_joint, bare
from vsalog.residuals.system import System, build_system
from vsalog.rig import Rig
from vsalog.rig.find import given_rig
from vsalog.rig.roles import ROLE_UNITS, Signal, role_units
from vsalog.rig.schema import RigidJoint
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.scenario_generic import servos
from vsalog.simulation.scenario_schema import Drives
from vsalog.simulation.simulate import simulate

# Sensors that a joint may be given, by what they cost, the cheapest first: a drive reports its motor's torque by its current and
# often its position; an accelerometer is a chip; an encoder needs a place on the axis, and one across the spring two; torque
# sensors are parts of the load's path, and a push is measured by six axes of one.
CHEAPEST_FIRST = (
    "motor_torque", "secondary_torque", "motor_position", "setpoint", "pressure", "link_acceleration", "link_position",
    "deflection", "torque_sensor", "external_torque",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Options:
    """What can be asked of `plan`; the command line's options of the same names.

    Attributes
    ----------
    joints : names of the joints wanted; all when empty
    set : key → value of the rig
    scenario : the motion to judge, a scenario's name or file; the one that `simulate` takes when absent
    limits : of torque, speed and angle; what the motion takes where there is none
    sensors : role that might be added → its noise, one standard deviation [SI], the cheapest first; none where it is as good as
        the rig's best of its unit. Those of the joint's type in the order `CHEAPEST_FIRST` when empty
    """

    joints: tuple[str, ...] = ()
    set: Mapping[str, str] = field(default_factory=dict)
    scenario: str | None = None
    limits: Limits = field(default_factory=Limits)
    sensors: Mapping[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Confused:
    """Causes that a motion confuses.

    Attributes
    ----------
    members : cause and part of each; what looks the same by the roles there are is at no part
    causes : those of them that were there in turn, as large as tolerated
    structure : which of them no motion separates, with the sensors that there are
    sensor : role of the cheapest sensor that splits them with the same motion; none where none does
    by_motion : whether the proposed motion splits them
    """

    members: frozenset[Key]
    causes: tuple[Isolation, ...]
    structure: Structure
    sensor: str | None = None
    by_motion: bool = False

    @property
    def open(self) -> bool:
        """Whether a motion may separate more of them."""
        return any(self.structure.open(one) for one in self.causes)

    @property
    def kind(self) -> Literal["equal", "richer", "confused"]:
        """What it is: causes that no motion separates, ones that a richer one covers whatever is measured, or others."""
        if self.open:
            return "confused"
        known = [(r, one) for one in self.causes for r in one.rivals if r.site.named]
        whole = all(self.structure.richer(r, one) for r, one in known) and all(part for _, part in self.members)
        return "richer" if whole else "equal"


@dataclass(frozen=True, slots=True)
class JointPlan:
    """What is planned for a joint.

    Attributes
    ----------
    name : of the joint
    reason : why nothing can be planned; empty where it can
    equations : that the sensors allow
    causes : how well the motion isolates each
    classes : that it confuses
    tried : sensors that were looked at, the cheapest first
    proposed : the motion; none where nothing is open or none separates more
    no_motion : why there is none; empty where there is one
    after : how well the proposed motion isolates the causes of classes, or those that did not show
    """

    name: str
    reason: str = ""
    equations: tuple[str, ...] = ()
    causes: tuple[Isolation, ...] = ()
    classes: tuple[Confused, ...] = ()
    tried: tuple[str, ...] = ()
    proposed: Suggestion | None = None
    no_motion: str = ""
    after: tuple[Isolation, ...] = ()


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run gives.

    Attributes
    ----------
    rig : that was planned for
    scenario : name of the motion that was judged
    joints : what is planned for each
    """

    rig: Rig
    scenario: str
    joints: tuple[JointPlan, ...]

    @property
    def proposed(self) -> Suggestion | None:
        """The motion of the first joint that has one."""
        return next((j.proposed for j in self.joints if j.proposed is not None), None)


def plan(source: Rig | str | Path, options: Options, progress: Progress = lambda _: None) -> Outcome:
    """Plan the experiments of a rig.

    Parameters
    ----------
    source : a rig, its file or a preset's name
    options : what is asked for
    progress : called with the step that begins

    Raises
    ------
    VsalogError
        The rig or the scenario cannot be used, or nothing can be planned for its only joint.
    """
    rig = given_rig(source).with_settings(options.set)
    wanted = pick_joints(rig.joints, options.joints)
    _require_known(wanted, options.sensors)
    scenario = planned(Scenario.find(options.scenario, rig.file), rig, wanted)
    joints, proposed = list[JointPlan](), False
    for name in wanted:
        try:
            one = plan_joint(rig, name, scenario, options, not proposed, progress)
        except VsalogError as error:
            if len(wanted) == 1:
                raise DiagnosisError(f"nothing can be planned: {error}") from error
            one = JointPlan(name, reason=str(error))
        joints.append(one)
        proposed = proposed or one.proposed is not None
    return Outcome(rig, scenario.where.removeprefix("scenario "), tuple(joints))


def sensors_in_si(asked: Mapping[str, str]) -> dict[str, float | None]:
    """Return role → noise in SI of sensors as they are asked for, a text with a unit, or an empty one.

    Raises
    ------
    DiagnosisError
        There is no such role, or the text is no noise of it.
    """
    out = dict[str, float | None]()
    for role, text in asked.items():
        try:
            unit = role_units(role)[0]
        except KeyError:
            raise DiagnosisError(
                f"--sensor: there is no role '{shown_text(role)}'{did_you_mean(role, ROLE_UNITS)}"
            ) from None
        try:
            noise = parse_quantity(text, unit) if text else None
        except UnitError as error:
            raise DiagnosisError(f"--sensor {role}: {error}") from error
        if noise is not None and not 0.0 <= noise < float("inf"):
            raise DiagnosisError(f"--sensor {role}: '{shown_text(text)}' is no noise: a standard deviation is wanted")
        out[role] = noise
    return out


def _require_known(wanted: Mapping[str, Any], sensors: Iterable[str]) -> None:
    known = {role for joint in wanted.values() for role in joint.signals.__struct_fields__}
    for role in sensors:
        if role not in known:
            raise DiagnosisError(f"'{role}' is no role of these joints; they know {', '.join(sorted(known))}")


def planned(scenario: Scenario, rig: Rig, wanted: Iterable[str]) -> Scenario:
    """Return the scenario with position loops on rigid joints that it leaves at rest."""
    file, more = scenario.file, dict[str, Drives]()
    for name in wanted:
        joint = rig.joints[name]
        if isinstance(joint, RigidJoint) and joint.drive is None and name not in file.joint:
            loops: dict[str, Any] = dict(servos(name, joint, rig.file, 0, file.period))
            more[name] = Drives(**loops)
    return changed(scenario, file=replace(file, joint={**file.joint, **more})) if more else scenario


def plan_joint(
    rig: Rig,
    name: str,
    scenario: Scenario,
    options: Options,
    propose: bool = True,
    progress: Progress = lambda _: None,
) -> JointPlan:
    """Plan for one joint.

    Parameters
    ----------
    rig, name : of the joint
    scenario : the motion to judge
    options : limits and sensors
    propose : look for a motion, too
    progress : called with the step that begins

    Raises
    ------
    VsalogError
        The joint cannot be simulated, or its roles allow no equation.
    """
    progress(f"joint {name}: simulating the motion")
    subject = subject_of(rig, name, scenario, rig.joints[name])
    found = tuple(isolations(subject.problem, subject.system))
    if not found:
        raise DiagnosisError(f"joint '{name}': no cause of the catalogue has a number in its equations")
    hidden = [one for one in found if not one.visible]
    structure = structure_of(subject.problem, subject.system)
    classes = _classes(found, structure)
    tried = list[str]()
    if classes:
        progress(f"joint {name}: looking for sensors")
        classes, tried = _with_sensors(rig, name, scenario, classes, _lacking(rig.joints[name], options.sensors))
    proposed, no_motion, after = None, "", tuple[Isolation, ...]()
    if propose and (classes or hidden):
        progress(f"joint {name}: looking for the motion that separates most causes")
        seen = seen_in(subject.joint, subject.system).within(options.limits.of(rig.joints[name]))
        bench = Bench(rig, subject, seen)
        try:
            questions = _questions(subject, found, classes)
            best = bench.best(questions) if questions.asked else None
        except VsalogError as error:
            best, no_motion = None, str(error)
        if best is not None and not np.any(best.separations > [q.now for q in questions.asked]):
            best, no_motion = None, "within the limits none separates the causes better than the one that was judged"
        if best is not None:
            best, after, structure = _shortest(bench, best, classes, hidden, structure)
            proposed = Suggestion(name, best, questions, len(rig.joints) > 1)
    done = [changed(c, structure=structure) for c in classes]
    done = [changed(c, by_motion=bool(after) and c.open and splits(c, after, structure)) for c in done]
    return JointPlan(name, "", subject.system.names, found, tuple(done), tuple(tried), proposed, no_motion, after)


def subject_of(rig: Rig, name: str, scenario: Scenario, joint: Any) -> Subject:
    """Simulate a scenario with a rig and its sensors, and form the equations of a joint.

    Parameters
    ----------
    rig, name : of the joint
    scenario : the motion
    joint : in its place, with other sensors

    Raises
    ------
    VsalogError
        It cannot be simulated, or its roles allow no equation.
    """
    machine = rig.with_joints({**rig.joints, name: joint})
    alone = _alone(rig, name, joint)
    return formed(name, alone, signals_of(machine, name, scenario, joint), felt(alone, rig.tolerances.get(name, {})))


def formed(name: str, joint: Any, signals: JointSignals, stated: Mapping[str, float]) -> Subject:
    """Form the equations of a joint.

    Parameters
    ----------
    name, joint : of the rig
    signals : bound without undoing what the rig states of sensors and drives
    stated : tolerances of the rig, as the joint feels them

    Raises
    ------
    DiagnosisError
        Its roles allow no equation.
    """
    plain = at_joint(joint)
    system = build_system(plain, channels_of(signals).thinned(), balance_for(plain), 0.5 * signals.period)
    if not system.count:
        raise DiagnosisError(
            f"joint '{name}': its roles allow no equation to be formed on this motion, in which a cause would show"
        )
    return Subject(name, plain, plain, system, Problem(plain, setting_of(plain, system), stated))


def signals_of(machine: Rig, name: str, scenario: Scenario, joint: Any, seed: int = 0) -> JointSignals:
    """Return the signals of a joint's log, bound as a diagnosis does.

    Parameters
    ----------
    machine : that is simulated
    name : of the joint
    scenario : that it simulates
    joint : as the rig has it
    seed : of the sensors' noise
    """
    file = scenario.file
    experiment = simulate(
        machine.file, scenario.inputs(machine.file), file.duration, period=file.period, seed=seed,
        controllers=scenario.controllers(machine.file),
    )  # fmt: skip
    alone = _alone(machine, name, joint)
    roles = [role for role in offered_roles(alone) if _recorded(experiment, name, alone, role)]
    if not roles:
        raise DiagnosisError(
            f"joint '{name}': the rig names no signal of it that a simulation records: state there what is measured"
        )
    return bind([experiment.recording()], name, bare(alone, gains=True), roles, noise=True)


def _alone(rig: Rig, name: str, joint: Any) -> Any:
    """Return a joint as a diagnosis looks at it: the link of one in a chain is moved by the others, too."""
    chained = rig.file.chain is not None and name in [link.joint for link in rig.file.chain.link]
    return replace(joint, link=None) if chained else joint


def _recorded(experiment: Experiment, name: str, joint: Any, role: str) -> bool:
    signal = offered_roles(joint)[role]
    return signal.constant is not None or role in experiment.joints[name].measured


def _classes(found: Sequence[Isolation], structure: Structure) -> list[Confused]:
    """Return the classes that a motion confuses, each once."""
    classes = dict[frozenset[Key], list[Isolation]]()
    for one in found:
        members = one.members(SIGNIFICANCE)
        if one.visible and len(members) > 1:
            classes.setdefault(members, []).append(one)
    return [Confused(members, tuple(causes), structure) for members, causes in classes.items()]


def _lacking(joint: Any, asked: Mapping[str, float | None]) -> dict[str, Any]:
    """Return the sensors that a joint might be given, the cheapest first: role → the joint with it.

    One is as good as the best of its unit that the joint has; where there is none, and none is stated, it cannot be judged.
    """
    known = joint.signals.__struct_fields__
    there = offered_roles(joint)
    stems = {role: role.removesuffix("_1").removesuffix("_2") for role in known}
    usual = {role: None for stem in CHEAPEST_FIRST for role, own in stems.items() if own == stem}
    out = dict[str, Any]()
    for role, noise in (asked or usual).items():
        if role in there or role not in known:
            continue
        alike = [s for r, s in there.items() if role_units(r)[0] == role_units(role)[0] and s.channel is not None]
        if noise is None and not alike:
            continue
        good = min(alike, key=lambda s: (s.noise, s.resolution or 0.0), default=Signal())
        sensor = Signal(noise=noise) if noise is not None else Signal(noise=good.noise, resolution=good.resolution)
        added = replace(sensor, channel=f"/planned/{role}.data")
        out[role] = replace(joint, signals=replace(joint.signals, **{role: added}))
    return out


def _with_sensors(
    rig: Rig, name: str, scenario: Scenario, classes: Sequence[Confused], lacking: Mapping[str, Any]
) -> tuple[list[Confused], list[str]]:
    """Return the classes with the cheapest sensor that splits each, and the sensors that could be judged."""
    found, tried = dict[int, str](), list[str]()
    for role, joint in counted("sensors", lacking.items(), len(lacking), at_most=True):
        left = {
            one.site.key for i, c in enumerate(classes) if i not in found and c.kind != "richer" for one in c.causes
        }
        if not left:
            break
        try:
            subject = subject_of(rig, name, scenario, joint)
        except VsalogError:
            continue  # it cannot be simulated: nothing is known of it
        if role not in subject.system.channels.raw:
            continue  # a simulation does not record it
        tried.append(role)
        there, structure = (
            isolations(subject.problem, subject.system, left),
            structure_of(subject.problem, subject.system),
        )
        for i, one in enumerate(classes):
            if i not in found and one.kind != "richer" and splits(one, there, structure, sensor=True):
                found[i] = role
    return [changed(one, sensor=found.get(i)) for i, one in enumerate(classes)], tried


def splits(confused: Confused, found: Iterable[Isolation], structure: Structure, sensor: bool = False) -> bool:
    """Return whether causes are separated from the others of their class, but for what structure excuses.

    Parameters
    ----------
    confused : the class
    found : how well a motion with its sensors isolates its members
    structure : what no motion separates
    sensor : whether a further sensor has to separate them: then only richer sets are excused, which no sensor rules out
    """
    there = {one.site.key: one for one in found}
    for cause in confused.causes:
        now = there.get(cause.site.key)
        if now is None or not now.visible:
            return False
        for rival in (r for r in now.rivals if r.site.named):
            excused = structure.covers(rival, now) and (not sensor or structure.richer(rival, now))
            if rival.site.key in confused.members and not excused:
                return False
        if sensor and any((double, "") in confused.members for double in now.site.doubles):
            return False
    return True


def _questions(subject: Subject, found: Sequence[Isolation], classes: Sequence[Confused]) -> Questions:
    """Return what a motion is for: to separate pairs of causes that some motion may, or else to show causes that do not show."""
    system, joint = subject.system, subject.joint
    pairs = dict[frozenset[Key], tuple[Isolation, Rival, bool]]()
    for one, structure in ((cause, c.structure) for c in classes for cause in c.causes):
        lasting = [r for r in structure.open(one) if not r.site.transient]
        if lasting:
            # What separates a cause from its nearest rival mostly separates it from the others: they are looked at afterwards.
            rival = max(lasting, key=lambda r: r.probability)
            pair = frozenset((one.site.key, rival.site.key))
            pairs.setdefault(pair, (one, rival, structure.nested(rival, one)))
    # Each cause is simulated once, however many it is confused with.
    ones = {one.site.key: Hypothesis(one.site, one.fit) for one, *_ in pairs.values()}
    asked = [_question(system, joint, ones[one.site.key], rival, nested) for one, rival, nested in pairs.values()]
    if asked:
        return Questions(tuple(asked), True)
    nothing = Hypothesis(None, ())
    asked = [
        Question(one, nothing, shown(system, joint, one, nothing), None)
        for one in (Hypothesis(i.site, i.fit) for i in found if not i.visible)
    ]
    return Questions(tuple(asked), False)


def _question(system: System, joint: Any, one: Hypothesis, rival: Rival, nested: bool) -> Question:
    other = Hypothesis(rival.site, rival.fit)
    return Question(one, other, separation(system, joint, one, other, predicted=True), nested=nested)


def _shortest(
    bench: Bench, best: Trial, classes: Sequence[Confused], hidden: Sequence[Isolation], structure: Structure
) -> tuple[Trial, tuple[Isolation, ...], Structure]:
    """Return an experiment no longer than it takes to separate and isolate the same causes."""
    subject, file = bench.subject, best.candidate.file
    system = bench.simulated(subject.joint, file)
    structure &= structure_of(subject.problem, system)
    wanted = {one.site.key for c in classes if c.open for one in c.causes}
    asked = wanted or {one.site.key for one in hidden}

    def separated(there: Sequence[Isolation]) -> tuple[bool, ...]:
        if not wanted:
            return tuple(one.visible for one in there)
        return tuple(splits(c, there, structure) for c in classes if c.open)

    after = isolations(subject.problem, system, asked)
    aim = separated(after)
    # What does not separate causes reliably may do so by chance, the longer the likelier.
    for duration in _halves(file.duration) if any(aim) else ():
        there = isolations(subject.problem, until(system, duration), asked)
        if separated(there) != aim:
            break
        file, after = replace(file, duration=duration), there
    return changed(best, candidate=changed(best.candidate, file=file)), tuple(after), structure


def _halves(duration: float) -> Iterator[float]:
    """Yield shorter durations [s], down to that in which a joint reaches the middle of its range."""
    while (duration := 0.5 * duration) >= DESIGN.approach:
        yield duration
