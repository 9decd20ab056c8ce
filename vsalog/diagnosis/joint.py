"""The diagnosis of one joint: what is wrong, why, the extended joint, the gain."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.dependence import LEAST_BLOCKS
from vsalog.core.errors import DiagnosisError, SimulationError
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM, variance_ratio
from vsalog.diagnosis.document import Verdict
from vsalog.diagnosis.found import Found, found_by, loss_of
from vsalog.diagnosis.gain import Compared, Share, Standing, compared, shares_of, standing, weighed
from vsalog.diagnosis.linear import placed
from vsalog.diagnosis.remainder import depends_on, loop_over, rate_of, variables_of
from vsalog.diagnosis.selection import APART, Selection, nothing_found, select
from vsalog.diagnosis.setting import setting_of
from vsalog.diagnosis.sides import side_of
from vsalog.diagnosis.signs_and_units import hint_of
from vsalog.diagnosis.smooth import SmoothSite
from vsalog.diagnosis.trajectory import refined
from vsalog.diagnosis.unknown_spring import ENCODERS, TAKEN_UP, spring_findings, with_springs
from vsalog.residuals.balance import Motion
from vsalog.residuals.channels import Channels, channels_of, span_of
from vsalog.residuals.kinds import balance_for, equations_of, motion_for
from vsalog.residuals.per_log import any_of, in_last
from vsalog.residuals.sensing import at_joint, each_sensor, motors_of, torque_role, true_roles
from vsalog.residuals.system import BELL, System, build_system
from vsalog.residuals.windows import WITHIN, Windows, windows_of
from vsalog.rig.schema import AwasTransmission
from vsalog.validation.computed_torque import computed_torques

Array = NDArray[np.float64]
Progress = Callable[[str], None]

# Name of the windows that the gain is measured on, where another log was given for it.
HELD_OUT = "the held-out log"


@dataclass(frozen=True, slots=True)
class JointDiagnosis:
    """What was found about one joint.

    Attributes
    ----------
    name : of the joint
    joint : as the rig has it, on the joint's side
    extended : with what was found
    system : the equations
    selection : of causes
    found : causes, the weightiest first
    computed : torque sensor's role → the finding that it is no measurement
    standing : the original rig against the log; none where nothing can be simulated
    gain : simulations before and after; none where nothing can be simulated
    held_out : what the gain was measured on, in words
    fraction : of the rig's squared residual that no cause explains
    findings : what the user should know
    shares : how well each of several logs is simulated
    """

    name: str
    joint: Any
    extended: Any
    system: System
    selection: Selection
    found: tuple[Found, ...]
    computed: Mapping[str, Finding]
    standing: Standing | None
    gain: Compared | None
    held_out: str
    fraction: float
    findings: tuple[Finding, ...] = ()
    shares: tuple[Share, ...] = ()

    def extended_without(self, cause: Found) -> Any:
        """Return the extended joint as it is without a cause, at all parts that share it."""
        rest = [(site, values) for site, values in self.selection.posterior.fit if not site.overlaps(cause.site)]
        return placed(self.joint, rest)

    @property
    def closed(self) -> bool:
        """Whether every equation that can be formed closes within its noise."""
        return self._closes(self.extended)

    def _closes(self, joint: Any) -> bool:
        return not bool(np.any(_stand_out(plain_rows(self, joint))))

    @property
    def right(self) -> bool:
        """Whether equations close, and every signal that can be is simulated within its noise, with the original rig."""
        return self._closes(self.joint) and (self.gain is None or self.gain.within(self.gain.before))

    @property
    def unchecked(self) -> tuple[str, ...]:
        """The equations, of the joint's kind or in addition to these, that could be formed nowhere."""
        some = np.any(self.system.weights, axis=0)
        formed = {name for name, seen in zip(self.system.names, some.tolist(), strict=True) if seen}
        # One torque sensor of several springs measures all of them.
        formed |= {"transmission"} if any(name.startswith("transmission") for name in formed) else set()
        return tuple(sorted({*self.system.names, *equations_of(self.joint)} - formed))

    @property
    def checked(self) -> bool:
        """Whether every equation of the joint's kind could be formed and something be simulated, with a spring that is known."""
        return self.gain is not None and not self.unchecked and not self.selection.problem.setting.fitted

    @property
    def helps(self) -> bool:
        """Whether the causes make the simulation of held-out data better, or the equations where nothing can be simulated."""
        return (round(100.0 * self.fraction) < 100 or bool(self.computed)) if self.gain is None else self.gain.helps

    @property
    def verdict(self) -> Verdict:
        """The verdict of the evidence."""
        material = [f for f in self.found if f.material]
        if not self.system.count:
            return "consistent as far as checked"
        if self.right and not material and not self.computed:
            return "consistent" if self.checked else "consistent as far as checked"
        gain = self.gain
        if self.closed and (gain.within(gain.after) if gain is not None else not material):
            return "explained"
        return "partly explained" if (self.found or self.computed) and self.helps else "unexplained"


def diagnose_joint(
    name: str,
    joint: Any,
    signals: JointSignals,
    holdout: JointSignals | None,
    progress: Progress = lambda _: None,
    stated: Mapping[str, float] = MappingProxyType({}),
    logs: int = 1,
    differs: frozenset[str] = frozenset(),
) -> JointDiagnosis:
    """Find what a joint's simulation gets wrong.

    Parameters
    ----------
    name, joint : of the rig
    signals : of the log, bound without undoing what the rig states of sensors and drives
    holdout : of another log, bound alike
    progress : called with the step that begins
    stated : tolerances of the rig, as the joint feels them
    logs : how many logs the signals are of: then their runs are logs
    differs : causes that may differ from log to log

    Raises
    ------
    DiagnosisError
        The roles allow no equation at all.
    """
    plain = at_joint(joint)
    # A formula in the drive or in the log has the positions, not their sensors' readings.
    lever = isinstance(getattr(joint, "transmission", None), AwasTransmission)
    computed = computed_torques(signals.joint, each_sensor(plain, signals), lever=lever)
    joint, fitted = with_springs(plain, signals)
    channels = channels_of(without(signals, computed), logs > 1)
    _require_motion(name, channels)
    system = build_system(joint, channels.thinned(), balance_for(joint), 0.5 * signals.period)
    # Motor and link may determine whose the torque at rest is.
    for zero in ENCODERS if fitted and system.count else ():
        other, whose = with_springs(plain, signals, zero)
        if loss_of(system, other) < loss_of(system, joint) - 2.0 * APART:
            joint, fitted = other, whose
            system = build_system(joint, channels.thinned(), balance_for(joint), 0.5 * signals.period)
    about = partial(Finding, joint=name)
    if not system.count and computed:
        nothing = nothing_found(system, joint, setting_of(joint, system))
        nothing_measured = (about(code="diagnosis.nothing_measured"),)
        return JointDiagnosis(name, joint, joint, system, nothing, (), computed, None, None, "", 0.0, nothing_measured)
    holdout = None if holdout is None else without(holdout, computed)
    if not system.count and system.names:
        raise DiagnosisError(
            f"joint '{name}': its equations ({', '.join(system.names)}) can be formed at no time of this log: samples are missing"
            " from each stretch of it that a filter needs, or nothing moves fast enough for friction to have a direction"
        )
    if not system.count:
        raise DiagnosisError(
            f"joint '{name}': its roles allow no equation to be checked; a diagnosis needs positions of motor and link (or the"
            " deflection) with a torque sensor, or with the motor's torque and inertia, and a transmission of a known type; one"
            " with muscles needs their pressures with the angle, or with the torque meter; a rigid one its position, an inertia"
            " and its motor's torque, or a drive with what it is commanded"
        )
    setting, hint = setting_of(joint, system, fitted), hint_of(name, joint, system)
    setting = replace(setting, logs=logs, differs=differs if logs > 1 else frozenset())
    findings = [] if hint is None else [hint]
    if hint is None:
        progress(f"joint {name}: looking for causes")
        selection = select(system, joint, setting, TAKEN_UP if fitted else frozenset[str](), stated)
    else:
        # Causes are small changes of a rig: fitted to a wrong sign they mean nothing.
        selection = nothing_found(system, joint, setting)
    progress(f"joint {name}: simulating")
    given, gain, held_out, extended = None, None, "", placed(joint, selection.posterior.fit)
    shares: tuple[Share, ...] = ()
    try:
        own = windows_of(joint, channels, selection.system.hold > 0.0)
        windows, held_out = _held_out(joint, own, holdout)
        selection = refined(selection, weighed(extended, own))
        extended = placed(joint, selection.posterior.fit)
        latest = extended if holdout is None else in_last(extended)
        gain = compared(joint, latest if selection.posterior.fit else joint, windows)
        # What happened once may not have happened in the other log.
        lasting = [(site, values) for site, values in selection.posterior.fit if not site.transient]
        if logs > 1:
            shares = shares_of(gain if holdout is None else compared(joint, extended, own))
        if holdout is not None and len(lasting) < len(selection.posterior.fit):
            gain = min(gain, compared(joint, placed(joint, lasting), windows), key=lambda g: g.whole(g.after))
        given = standing(joint, own, gain if holdout is None else None)
        if holdout is not None and not gain.within(gain.after):
            itself = compared(joint, extended, own)
            if itself.within(itself.after):
                findings.append(about(code="diagnosis.holdout_contradicts"))
    except SimulationError as error:
        # In a simulation of its own it has no name.
        why = str(error).replace("joint 'joint': ", "").replace("joint 'joint'", "it")
        findings.append(about(code="diagnosis.not_simulated", evidence={"reason": why}))
    done = JointDiagnosis(
        name, joint, extended, selection.system, selection, tuple(found_by(selection, joint)), computed, given, gain, held_out,
        _fraction(selection.system, joint, extended), (*spring_findings(name, plain, any_of(extended), fitted), *findings),
        shares,
    )  # fmt: skip
    return replace(done, findings=(*done.findings, *_doubts(done)))


def _held_out(joint: Any, own: Windows, holdout: JointSignals | None) -> tuple[Windows, str]:
    """Return the windows to measure the gain on, and what they are called."""
    if holdout is None:
        return own, "windows of the log itself"
    try:
        return windows_of(joint, channels_of(holdout), own.hold), HELD_OUT
    except SimulationError as error:
        raise SimulationError(f"{HELD_OUT}: {error}") from error


def _doubts(found: JointDiagnosis) -> Iterator[Finding]:
    """Yield findings that speak against the causes found."""
    about = partial(Finding, joint=found.name)
    for equation in found.unchecked:
        if key := _lacking(found, equation):
            yield about(code="diagnosis.rig_lacks", part=equation, evidence={"key": key})
        else:
            yield about(code="diagnosis.equation_unchecked", part=equation)
    if not found.selection.settled:
        yield about(code="diagnosis.search_unsettled")
    given = found.standing
    if given is not None and found.closed and not found.found:
        errors = ((given.rmse(role) / noise, role) for role, noise in given.floor.items() if noise > 0.0)
        off, role = max(errors, default=(0.0, ""))
        if off > WITHIN:
            yield about(code="diagnosis.simulation_off", part=role, value=off, limit=WITHIN)


def _lacking(found: JointDiagnosis, equation: str) -> str:
    """Return the key that the rig lacks for an equation whose signals are recorded; none where that is not why."""
    if equation in motors_of(found.joint) and torque_role(equation) in found.system.channels.raw:
        return f"{equation}.inertia" if getattr(found.joint, equation).inertia is None else ""
    return "link.inertia" if equation == "link" and getattr(found.joint, "link", None) is None else ""


def _require_motion(name: str, channels: Channels) -> None:
    """Refuse a log of a joint that rests, or one that is over before a filter has seen it."""
    # As many rows as blocks: they overlap by half.
    least = channels.window + LEAST_BLOCKS * round(0.5 * BELL / channels.period)
    if len(channels) < least:
        raise DiagnosisError(
            f"joint '{name}': {len(channels)} samples, {len(channels) * channels.period:.3g} s, are too few: the filters alone"
            f" need {least}, and some seconds of motion show more"
        )
    moving = [v for r, v in channels.raw.items() if any(word in r for word in ("position", "deflection", "pressure"))]
    if not any(span_of(values) > 0.0 for values in moving):
        raise DiagnosisError(
            f"joint '{name}': no position changes in this log; at rest no cause can be separated from another"
        )


def without(signals: JointSignals, roles: Collection[str]) -> JointSignals:
    """Return the signals without some roles."""
    return replace(signals, roles={r: v for r, v in signals.roles.items() if r not in roles})


def _fraction(system: System, joint: Any, extended: Any) -> float:
    """Return the part of what was wrong beyond noise that is still left."""
    wrong = loss_of(system, joint) - system.count
    left = loss_of(system, extended) - WITHIN**2 * system.count
    return float(np.clip(left / wrong, 0.0, 1.0)) if wrong > 0.0 and left > 0.0 else 0.0


def unexplained_side(found: JointDiagnosis) -> tuple[str, int] | None:
    """Return the side that most of the residual is on, and the equation that shows it; none where nothing is left."""
    rows = plain_rows(found, found.extended)
    if not np.any(_stand_out(rows)):
        return None
    unknown = unknown_function(found)
    if unknown is not None:
        return unknown.side, found.system.names.index(unknown.equation)
    motion = _motion(found)
    springs = [s for s in motion.deflections if s not in motion.measured]
    return side_of(found.system, any_of(found.extended), found.system.whitened(found.extended), springs)


def mean_squares(rows: Array) -> Array:
    """Return the mean square of each equation's rows, shape (m,), over those that count; NaN where none does."""
    counts = np.count_nonzero(np.isfinite(rows), axis=0)
    return np.asarray(np.where(counts > 0, np.nansum(rows**2, axis=0) / np.maximum(counts, 1), np.nan))


def _stand_out(rows: Array) -> NDArray[np.bool_]:
    """Return which equations leave more than their noise, as well as that is known, and more than chance makes of few rows."""
    # Rows overlap by half: every second one is independent.
    independent = (np.count_nonzero(np.isfinite(rows), axis=0) + 1) // 2
    limits = [max(WITHIN**2, variance_ratio(FALSE_ALARM, max(int(count), 1))) for count in independent]
    return np.asarray(mean_squares(rows) > np.array(limits))


def plain_rows(found: JointDiagnosis, joint: Any) -> Array:
    """Return the averaged equations of a joint over their own noise, shape (R, m), NaN where they do not count."""
    rows = found.system.averaged(joint) / found.system.deviation
    return np.where(found.system.weights > 0.0, rows, np.nan)


def variables(found: JointDiagnosis) -> dict[str, tuple[Array, str]]:
    """Return what remainders of a joint may depend on."""
    return variables_of(found.system, _motion(found))


def _motion(found: JointDiagnosis) -> Motion:
    channels = found.system.channels
    extended = any_of(found.extended)
    roles = true_roles(extended, channels, found.system.hold)
    return motion_for(extended, roles, channels.time, channels.spread)


def remainder_depends_on(found: JointDiagnosis, equation: int) -> tuple[list[str], str | None]:
    """Return the variables that an equation's remainder depends on, strongest first, and the rate whose sign it depends on."""
    unknown = unknown_function(found)
    if unknown is not None:
        return [name for name in (unknown.variable, unknown.rate) if name], unknown.rate or None
    rows = plain_rows(found, found.extended)[:, equation]
    known = variables(found)
    dependents = depends_on(rows, known)
    loop, names = loop_over(rows, known, dependents), [d.name for d in dependents]
    return (names, None) if loop is None else ([loop, rate_of(loop), "time"], rate_of(loop))


def unknown_function(found: JointDiagnosis) -> SmoothSite | None:
    """Return the largest of the unknown functions that a log needs in addition to its causes; none where it needs none."""
    sizes = {choice.site.key: choice.size for choice in found.selection.choices}
    functions = [site for site, _ in found.selection.posterior.fit if isinstance(site, SmoothSite)]
    return max(functions, key=lambda site: sizes.get(site.key, 0.0), default=None)
