"""From recordings and a rig to traces and models: the main job."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence, Set
from dataclasses import dataclass
from types import MappingProxyType

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.binding.joint import bind, offered_roles
from vsalog.binding.neighbours import own_and_others
from vsalog.checks import Checks
from vsalog.checks.check import Context, without_superseded
from vsalog.checks.sensor import without_clipped
from vsalog.checks.signals import DeadSensorError, refuse_dead_sensors, whole_windows
from vsalog.core.errors import EstimatorError, VsalogError, did_you_mean
from vsalog.core.finding import Finding
from vsalog.core.finding_texts import sentence
from vsalog.core.look import of_signals
from vsalog.core.model import JointModel
from vsalog.core.precision import ROUNDING
from vsalog.core.recording import Recording
from vsalog.core.trace import Trace
from vsalog.estimation.external_stiffness import ExternalStiffness
from vsalog.estimation.summary import JointSummary, Summarizer, findings_of
from vsalog.estimators.acceleration_group import senses_acceleration
from vsalog.estimators.device import Device, device_of
from vsalog.estimators.fold import Fold, Method
from vsalog.estimators.folding import BLOCK, fold_over, run
from vsalog.estimators.methods.grioli_bicchi import told_by_the_link
from vsalog.estimators.needs import meaning
from vsalog.estimators.registry import method, methods
from vsalog.estimators.tuning import Tuning, read_tuning
from vsalog.perturbations import PERTURBATIONS
from vsalog.perturbations.trials import TRIED_SAMPLES, Subject, run_trials
from vsalog.rig.schema import Joint, RigFile

Sink = Callable[[Trace], None]

# The tuning key for the values of a method's paper.
PRESET, PAPER = "preset", "paper"
# The tuning key for causal estimates by any method.
CAUSAL = "causal"
# The estimator of `auto` for estimates that need not be causal.
SMOOTHER = "smoother"
# The benefit of one more sensor.
SENSOR_ADDS = (
    "a joint torque sensor would check the motor's torque and show the link's inertia and damping too (impedance)"
)


@dataclass(frozen=True, slots=True)
class Choice:
    """The estimator for a joint, the roles it will read, and why it was chosen."""

    name: str
    method: Method
    tuning: Tuning
    roles: tuple[str, ...]
    reason: str

    def for_joint(self, device: Device, offered: Collection[str], remark: str) -> Choice:
        """Return the same estimator for a joint that offers other roles; raises EstimatorError where it needs more."""
        roles = self.method.roles(device, offered, self.tuning)
        return dataclasses.replace(self, roles=roles, reason=self.reason + remark)


@dataclass(frozen=True, slots=True)
class JointEstimate:
    """The estimate of one joint.

    Attributes
    ----------
    joint : the joint's name
    estimator, reason : the method, and why it was chosen
    settings : its tuning
    model : the fitted model, frozen at the end of the log
    summary : key figures per transmission
    findings : about its signals and its fit
    kept : the estimates over time, `trace`; None where they went to a sink instead
    """

    joint: str
    estimator: str
    reason: str
    settings: dict[str, str | float | int | bool]
    model: JointModel
    summary: JointSummary
    findings: tuple[Finding, ...]
    kept: Trace | None

    @property
    def trace(self) -> Trace:
        """The estimates over time.

        Raises
        ------
        EstimatorError
            They went to a sink.
        """
        if self.kept is None:
            raise EstimatorError(f"the trace of joint '{self.joint}' went to a sink, and is not kept")
        return self.kept

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings, in sentences."""
        return tuple(sentence(finding) for finding in self.findings)


def choose(name: str, joint: Joint, estimator: str, tuning: Mapping[str, str], rig: RigFile | None = None) -> Choice:
    """Choose the estimator for a joint by the roles its rig offers, or take the requested one.

    Parameters
    ----------
    name, joint : of the rig
    estimator : a method's name or ``auto``
    tuning : NAME → VALUE of the method's tuning; ``preset=paper`` takes its paper's values as defaults, and
        ``causal=true`` makes any method causal
        rig : the whole rig, for methods that read the joint's neighbours in an arm

    Raises
    ------
    EstimatorError
        The joint has no transmission, or a role is missing; the message says which.
    """
    offered = offered_roles(joint)
    device = device_of(name, joint, rig=rig)
    automatic = estimator == "auto"
    estimator, reason = _automatic(device, offered, tuning) if automatic else (estimator, "asked for")
    found = method(estimator)
    if automatic:
        _refuse_others_tuning(found, tuning)
    values = read_tuning(found.TUNING, estimator, with_printed(found, device, with_causal(found, tuning)))
    return Choice(estimator, found, values, found.roles(device, offered, values), reason)


def _refuse_others_tuning(found: Method, tuning: Mapping[str, str]) -> None:
    """Refuse a name to tune that only estimators have that were not chosen; raises EstimatorError.

    A name that none has is refused as one of the chosen estimator.
    """
    for name in tuning:
        if name in (PRESET, CAUSAL) or name in tunable(found):
            continue
        others = [other for other in methods() if name in tunable(method(other))]
        if others:
            raise EstimatorError(
                f"{found.NAME}, which was chosen for this joint, has nothing to tune named '{name}'; these estimators have:"
                f" {', '.join(others)} (--estimator {others[0]} --tune {name}={tuning[name]})"
            )


def tunable(found: Method) -> set[str]:
    """Return the names that a method has to tune."""
    return set(found.TUNING.__struct_fields__) - set(found.TUNING.unused)


def tuning(preset: str | None, tune: Mapping[str, str], causal: bool) -> dict[str, str]:
    """Return --preset-tuning, --tune and --causal as one tuning."""
    own = {} if preset is None else {PRESET: preset}
    return own | dict(tune) | ({CAUSAL: "true"} if causal else {})


def no_preset(preset: str) -> str:
    """Return the message that there is no such preset tuning."""
    return f"there is no preset tuning '{preset}': '{PAPER}' takes the values of a method's paper"


def with_causal(found: Method, tuning: Mapping[str, str]) -> dict[str, str]:
    """Return the tuning with which a method is causal, if ``causal=true`` requests it: a causal filter before it.

    Raises
    ------
    EstimatorError
        The method has no causal filter.
    """
    names = tunable(found)
    if tuning.get(CAUSAL) != "true":
        return dict(tuning)
    if "filter" not in names:
        raise EstimatorError(f"{found.NAME} has no causal filter: leave out --causal, or use another estimator")
    if tuning.get("filter", "kinematic") != "kinematic":
        raise EstimatorError(
            f"{found.NAME}: filter={tuning['filter']} is not causal: leave it out, or leave out --causal"
        )
    own = {name: value for name, value in tuning.items() if name != CAUSAL or CAUSAL in names}
    return {"filter": "kinematic", **own}


def with_printed(found: Method, device: Device, tuning: Mapping[str, str]) -> dict[str, str]:
    """Take the values of a method's paper as defaults of the tuning, if ``preset=paper`` requests it.

    Raises
    ------
    EstimatorError
        There is no such preset, or the paper prints no values.
    """
    own = {name: value for name, value in tuning.items() if name != PRESET}
    preset = tuning.get(PRESET)
    if preset is None:
        return own
    if preset != PAPER:
        raise EstimatorError(no_preset(preset))
    printed: Callable[[Device], Mapping[str, str]] | None = getattr(found, "printed", None)
    if printed is None:
        raise EstimatorError(f"{found.NAME}: no paper prints values of its tuning; leave the preset tuning out")
    return {**printed(device), **own}


def _automatic(device: Device, offered: Collection[str], tuning: Mapping[str, str]) -> tuple[str, str]:
    views = device.transmissions
    causal = tuning.get(CAUSAL) == "true" or tuning.get("filter", "savitzky-golay") != "savitzky-golay"
    if device.pneumatic is not None:
        return "pam-ukf", "the joint has pneumatic muscles, whose pressures determine its state" + (
            ""
            if "link_position" in offered
            else "; with an encoder on the joint (link_position) 'vsalog validate' would check the angle"
        )
    missing = _missing(device, offered)
    if missing and told_by_the_link(device, offered):
        # The one that needs no basis needs no set-point.
        return "grioli-bicchi" if "setpoint" in missing else SMOOTHER, (
            "neither the motor's torque nor the joint's is recorded, but the external torque is, and the rig has the link's"
            " inertia"
        )
    if missing and senses_acceleration(device, offered):
        return "acceleration-observer", (
            "the link's acceleration is measured, and no deflection from which a stiffness could be estimated: the joint's state"
            f" is observed with the rig's stiffness; {_observer_lacks(missing)} would let the stiffness itself be estimated"
        )
    _refuse(device, missing)
    motors = all({v.motor_position, v.motor_torque} <= set(offered) for v in views)
    sensor = "torque_sensor" in offered or all(v.torque_sensor in offered for v in views)
    known = all(v.motor.inertia is not None for v in views)
    if not causal:
        return SMOOTHER, _whole_log(device, offered, motors, sensor, known)
    if motors and known:
        why = "it is causal, motor position and torque are recorded, and the motor's inertia is known"
        return "residual-rls", why if sensor else f"{why}; {SENSOR_ADDS}"
    if sensor:
        return "direct", "it is causal, and there is a torque sensor"
    return "qr-rls", f"it is causal, and neither the motor's inertia nor a torque sensor is there; {SENSOR_ADDS}"


def _whole_log(device: Device, offered: Collection[str], motors: bool, sensor: bool, known: bool) -> str:
    """Return the equations that a smoother can use, and which sensors would add to them."""
    if sensor and motors:
        return "the torque sensor's and the motor's equations together, and every instant from the whole log" + (
            "" if known else "; the motor's inertia is not known, and is estimated, too"
        )
    if motors:
        why = "motor position and torque are recorded, and every instant is estimated from the whole log"
        return f"{why if known else why + ', the inertia too'}; {SENSOR_ADDS}"
    lacking = dict.fromkeys(
        r for v in device.transmissions for r in (v.motor_torque, v.motor_position) if r not in offered
    )
    inertia, roles = "" if known else ", with the motor's inertia,", " and ".join(lacking)
    return (
        "there is a torque sensor, and every instant is estimated from the whole log;"
        f" {roles} in the rig{inertia} would add the motor's equation to it, a cross-check"
    )


def _observer_lacks(missing: Collection[str]) -> str:
    """Name the sensors that a joint of which the acceleration is measured lacks for its stiffness."""
    names = {"link_position": "an encoder on the link (link_position)"}
    return " and ".join(names.get(role, f"{meaning(role)} ({role})") for role in dict.fromkeys(missing))


def _missing(device: Device, offered: Collection[str]) -> list[str]:
    """Return the roles without which no stiffness can be estimated."""
    missing: list[str] = []
    for view in device.transmissions:
        if view.deflection not in offered:
            missing += [r for r in ("link_position", view.motor_position) if r not in offered]
        if view.torque_sensor not in offered and "torque_sensor" not in offered:
            missing += [r for r in (view.motor_torque, view.motor_position) if r not in offered]
    if device.has_setpoint and "setpoint" not in offered:
        missing.append("setpoint")
    return missing


def _refuse(device: Device, missing: Collection[str]) -> None:
    """Refuse a joint that no method can estimate, naming each missing role."""
    if not missing:
        return
    listed = "; ".join(f"{role}: {meaning(role)}" for role in dict.fromkeys(missing))
    raise EstimatorError(
        f"joint '{device.joint}': no stiffness can be estimated, because a role is missing: {listed}. A stiffness needs"
        " the deflection (link_position and motor_position, or deflection) and a torque (torque_sensor, or motor_torque"
        f" with motor_position). Name the channels under [joint.{device.joint}.signals] in the rig"
    )


def estimate_joint(
    recordings: Sequence[Recording],
    name: str,
    joint: Joint,
    choice: Choice,
    *,
    setpoints: Sequence[float | None] = (),
    sink: Sink | None = None,
    block: int = BLOCK,
    rig: RigFile | None = None,
    stated: Mapping[str, float] = MappingProxyType({}),
) -> JointEstimate:
    """Run an estimator over recordings, several of which make one model.

    Parameters
    ----------
    recordings : in order; a fit continues from one to the next; where one is in files, memory does not grow with them
    name, joint : of the rig
    choice : the estimator, of `choose`
    setpoints : a fixed set-point per recording [SI], None for none
    sink : where blocks of the trace go; they are kept in memory when absent
    block : rows at a time
    rig : as for `choose`
    stated : how well the joint's quantities are known, as `Rig.tolerances` has it

    Raises
    ------
    VsalogError
        The recordings do not fit the rig, or the signals do not fit the estimator.
    """
    own, neighbours = own_and_others(choice.roles, {} if rig is None else rig.joint)
    signals = bind(recordings, name, joint, own, setpoints, neighbours=neighbours)
    # Filters, scales and priors are derived from it.
    look = of_signals(signals)
    device = device_of(name, joint, look.roles, rig)
    try:
        refuse_dead_sensors(choice.name, look)
    except DeadSensorError as error:
        living = replace(joint, signals=replace(joint.signals, **{error.role: None}))
        try:
            other = choice.for_joint(device_of(name, living, rig=rig), offered_roles(living), f", without {error.role}")
        except EstimatorError:
            raise error from None
        living_estimate = estimate_joint(
            recordings, name, living, other, setpoints=setpoints, sink=sink, block=block, rig=rig, stated=stated
        )
        dead_sensor = Finding(code="sensor.dead", joint=name, part=error.role, value=error.value, unit="N*m")
        return dataclasses.replace(living_estimate, findings=(dead_sensor, *living_estimate.findings))
    recorded, seen = signals, look
    signals = without_clipped(recorded)
    look = signals if seen is recorded else of_signals(signals)
    kept: list[Trace] = []
    summarizer = Summarizer(device)
    external = ExternalStiffness.of(recordings, joint, device, signals, stated)
    # Where numbers overflow the estimate is infinite or none, as the trace shows; numpy's warnings add nothing.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        fold = choice.method.build(device, look, choice.tuning)
        fold.conditioner.check_length(signals.longest_run)
        checks = Checks(Context(recordings, setpoints, device, joint, choice.name, choice.roles, recorded, seen, fold))
        pass_on = kept.append if sink is None else sink
        subject = Subject(choice.method, device, look, choice.tuning, fold)
        # A short log is estimated once, and its trace kept until the effect of perturbations is known.
        short = run(fold, look, block) if signals is look and len(look) <= TRIED_SAMPLES else None
        trials = run_trials(subject, PERTURBATIONS, short)

        rows = 0
        dead = {finding.part for finding in checks.of_signals() if finding.severity == "invalidates"}

        def give(trace: Trace) -> None:
            nonlocal rows
            trace = trials.widened(trace, rows)
            if dead:
                trace = trace.never_excited(_invalidated(dead, trace.transmissions.keys()))
            rows += len(trace)
            if external is not None:
                trace = external.added(trace)
            summarizer.add(trace)
            checks.add(trace)
            pass_on(trace)

        if short is None:
            state = fold_over(fold, signals, block, give)
        else:
            for trace in short.blocks:
                give(trace)
            state = short.state
        summary = summarizer.result(signals)
        whole = whole_windows(look, fold.conditioner.window)
        fit_findings, checked = fold.findings(state), checks.findings()
        void = {finding.part for finding in (*checked, *fit_findings) if finding.severity == "invalidates"}
        found = (
            *signals.findings,
            *findings_of(summary, device, whole, void, summarizer.too_short()),
            *fit_findings,
            *trials.findings(),
            *checked,
        )
        if _stands_still(look.roles.get("setpoint")) and any(f.severity != "info" for f in found):
            found += (Finding(code="setpoint.constant", joint=device.joint, severity="info"),)
        return JointEstimate(
            name,
            choice.name,
            choice.reason,
            _settings(choice.tuning, fold),
            trials.widened_model(fold.model(state)),
            summary,
            tuple(without_superseded(found, checks.supersedes)),
            Trace.concatenate(kept) if kept else None,
        )


def _invalidated(parts: Set[str], transmissions: Set[str]) -> Set[str]:
    """Return the transmissions whose estimate is not to be used, and the total; all, where a role or the joint is at fault."""
    return {*parts, "total"} if parts <= transmissions else transmissions


def _stands_still(values: NDArray[np.float64] | None) -> bool:
    """Return whether a signal exists and has one value only, except for rounding."""
    known = np.empty(0) if values is None else values[np.isfinite(values)]
    return known.size > 0 and bool(np.ptp(known) <= ROUNDING * np.abs(known).max())


def _settings(tuning: Tuning, fold: Fold) -> dict[str, str | float | int | bool]:
    """Return the tuning with what was derived from the log filled in."""
    given = {k: v for k, v in msgspec.structs.asdict(tuning).items() if v is not None}
    return {**given, **fold.derived}


def pick_joints(joints: Mapping[str, Joint], wanted: Sequence[str]) -> dict[str, Joint]:
    """Return the joints of that name, all when none is named.

    Raises
    ------
    EstimatorError
        The rig has no joint of that name, or none at all.
    """
    if not joints:
        raise EstimatorError("the rig has no joint; describe one under [joint.NAME], 'vsalog init LOG' writes a start")
    for name in wanted:
        if name not in joints:
            raise EstimatorError(
                f"the rig has no joint '{name}'{did_you_mean(name, joints) or '.'} It has: {', '.join(joints)}"
            )
    return {name: joint for name, joint in joints.items() if not wanted or name in wanted}


def choose_all(
    joints: Mapping[str, Joint], estimator: str, tuning: Mapping[str, str], rig: RigFile | None = None
) -> tuple[dict[str, Choice], list[Finding]]:
    """Choose an estimator for every joint; joints that offer too little are left out, with the reason.

    Raises
    ------
    VsalogError
        No joint is left.
    """
    choices: dict[str, Choice] = {}
    left_out: list[Finding] = []
    first: VsalogError | None = None
    for name, joint in joints.items():
        try:
            choices[name] = choose(name, joint, estimator, tuning, rig)
        except EstimatorError as error:
            left_out.append(Finding(code="rig.joint_left_out", part=name, evidence={"reason": str(error)}))
            first = first or error
    if not choices and first is not None:
        raise first
    return choices, left_out
