"""The diagnosis of one joint: what is wrong, why, the extended joint, the gain."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.balance import Motion
from vsalog.diagnosis.causes.base import Setting
from vsalog.diagnosis.channels import Channels, channels_of, span_of
from vsalog.diagnosis.fit import Fit, applied, fit_at, fitted
from vsalog.diagnosis.found import Found, found_by
from vsalog.diagnosis.gain import Compared, Standing, compared, standing
from vsalog.diagnosis.held_out import held_out_windows, kept_by
from vsalog.diagnosis.hints import hint_of
from vsalog.diagnosis.independent import not_independent
from vsalog.diagnosis.kinds import balance_for, motion_for
from vsalog.diagnosis.remainder import depends_on, loop_over, rate_of, variables_of
from vsalog.diagnosis.selection import Selection, blocks_of, remainder, renewed, select, sites_of
from vsalog.diagnosis.sensing import at_joint, true_roles
from vsalog.diagnosis.setting import setting_of
from vsalog.diagnosis.sides import side_of
from vsalog.diagnosis.system import BELL, System, build_system
from vsalog.diagnosis.unknown import TAKEN_UP, with_springs
from vsalog.diagnosis.windows import windows_of
from vsalog.diagnosis.windows_search import sought
from vsalog.errors import DiagnosisError, SimulationError
from vsalog.signals import JointSignals

Array = NDArray[np.float64]
Progress = Callable[[str], None]

# A simulation that is off by so many times its noise is doubted though the equations close, and outweighs them.
DOUBTED, GROSS = 3.0, 20.0
# A cause that the simulation shows takes the place of the equations' when it leaves less than this part of the squares.
BETTER = 0.5
# A log has so many times the samples that filter and bell take.
LEAST = 3
# The mean square of an equation that noise explains, and the part of what was wrong that may be left of an explained log.
# Of gross ones that may be a good deal more than noise, but not more than this mean square.
NOISE, LEFT, FAR = 2.0, 0.015, 25.0


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
    fit : of those that were kept
    found : causes that were kept, the weightiest first
    computed : torque sensor's role → why it is no measurement
    standing : the rig as it stands against the log; none where nothing can be simulated
    gain : simulations before and after; none where nothing can be simulated
    held_out : what the gain was measured on, in words; and whether it is another log
    fraction : of what the rig left over that no cause explains
    warnings : what a person should know
    """

    name: str
    joint: Any
    extended: Any
    system: System
    selection: Selection
    fit: Fit
    found: tuple[Found, ...]
    computed: Mapping[str, str]
    standing: Standing | None
    gain: Compared | None
    held_out: str
    fraction: float
    warnings: tuple[str, ...] = field(default=())

    @property
    def closed(self) -> bool:
        """Whether nothing but noise is left over in the equations."""
        return self.fit.loss <= NOISE * self.system.count

    @property
    def adds_up(self) -> bool:
        """Whether something is wrong that only the simulation shows, while the equations close or can be formed nowhere.

        They close easily where a torque sensor tells the deflection: then its noise is theirs. So they may with coarse encoders
        whose accelerations are mostly noise, but nothing less than a gross error of the simulation speaks against them then.
        """
        if not self.closed or self.found or self.standing is None:
            return False
        everywhere = bool(np.any(self.system.weights, axis=0).all())
        return far_off(self.standing, DOUBTED if not everywhere or _motion(self).measured else GROSS) is not None

    @property
    def in_doubt(self) -> bool:
        """Whether the equations close with the one cause that was found, and its simulation does not."""
        if not self.closed or len(self.found) != 1 or self.gain is None:
            return False
        after, floor = self.gain.after, self.gain.floor
        return any(self.gain.rmse(after, role) > DOUBTED * noise > 0.0 for role, noise in floor.items())

    @property
    def consistent(self) -> bool:
        """Whether nothing is left over but noise."""
        return self.closed and not self.adds_up

    @property
    def whole(self) -> bool:
        """Whether all that was wrong is explained, but for what noise and a small part of a gross effect make."""
        return self.consistent or (self.fraction <= LEFT and self.fit.loss <= FAR * self.system.count)

    @property
    def trust(self) -> float:
        """How far what is left over leaves a cause that was found believable, 0 to 1."""
        left = self.fit.loss / (NOISE * self.system.count)
        return 1.0 if self.whole else (1.0 - self.fraction) / max(left, 1.0) ** 0.5

    def rows(self, fit: Fit) -> Array:
        """Return what a fit leaves over, whitened, shape (R, m)."""
        return fit.residual.reshape(-1, len(self.system.names))


def diagnose_joint(
    name: str, joint: Any, signals: JointSignals, holdout: JointSignals | None, progress: Progress = lambda _: None
) -> JointDiagnosis:
    """Find what a joint's simulation gets wrong.

    Parameters
    ----------
    name, joint : of the rig
    signals : of the log, bound without undoing what the rig says of sensors and drives
    holdout : of another log, bound alike
    progress : told what is being done

    Raises
    ------
    DiagnosisError
        The roles allow no equation at all.
    """
    computed = not_independent(signals, joint)
    joint, said = with_springs(at_joint(joint), signals)
    warnings = list(said)
    channels = channels_of(without(signals, computed))
    _require_motion(name, channels)
    system = build_system(joint, channels.thinned(), balance_for(joint), 0.5 * signals.period)
    if not system.count and computed:
        return _only_computed(name, joint, signals, computed, warnings)
    holdout = None if holdout is None else without(holdout, computed)
    if not system.count:
        raise DiagnosisError(
            f"joint '{name}': its roles allow no equation to be checked; a diagnosis needs positions of motor and link (or the"
            " deflection) with a torque sensor, or with the motor's torque and inertia, and a transmission of a known type; one"
            " with muscles needs their pressures with the angle, or with the torque meter; a rigid one its position, its motor's"
            " torque and an inertia"
        )
    progress(f"joint {name}: looking for causes")
    setting, barred = setting_of(joint, system), TAKEN_UP if said else frozenset[str]()
    selection = select(system, joint, setting, barred)
    system, fit = selection.system, selection.fit
    progress(f"joint {name}: simulating")
    stands, gain, held_out, kept = None, None, "", fit
    try:
        own = windows_of(joint, channels, system.hold > 0.0)
        windows, held_out = held_out_windows(joint, own, holdout)
        kept, gain, dropped = kept_by(name, system, joint, selection, windows)
        if dropped:  # and with them what they made of the noise
            system, kept = renewed(system, joint, kept, selection.blocks)
            nothing = fitted(system, joint, (), np.zeros(0), selection.blocks)
            selection = replace(selection, system=system, nothing=nothing)
        stands = standing(joint, own, gain if holdout is None else None)
        warnings += dropped
    except SimulationError as error:
        # In a simulation of its own it has no name.
        why = str(error).replace("joint 'joint': ", "").replace("joint 'joint'", "it")
        warnings.append(f"joint '{name}' could not be simulated, so nothing was measured of the gain: {why}")
    found = found_by(system, joint, selection, kept)
    done = JointDiagnosis(
        name, joint, kept.joint(joint), system, selection, kept, tuple(found), computed, stands, gain, held_out,
        _fraction(system, selection.nothing, kept), tuple(warnings),
    )  # fmt: skip
    done = _looked_at_longer(done, setting, barred)
    return replace(done, warnings=(*done.warnings, *_doubts(done)))


def _looked_at_longer(done: JointDiagnosis, setting: Setting, barred: frozenset[str]) -> JointDiagnosis:
    """Look for what only the simulation shows, or shows to be another cause than the equations seem to say."""
    system, stands, gain = done.system, done.standing, done.gain
    if not (done.adds_up or done.in_doubt) or stands is None or gain is None:
        return done
    # Such equations cannot tell held torques from smooth ones either.
    windows = replace(gain.windows, scale=None)
    otherwise = standing(done.joint, replace(stands.windows, hold=not stands.windows.hold))
    if otherwise.whole < stands.whole:
        stands, windows = otherwise, replace(windows, hold=otherwise.windows.hold)
        if not done.found:
            done = replace(done, standing=stands, gain=compared(done.joint, done.joint, windows))
    if far_off(stands) is None:
        return done
    if not done.found:
        done = replace(done, fraction=1.0)
    left = remainder(system, done.joint, setting)
    seen = sought(done.joint, sites_of(setting, barred), left, stands.windows, stands.shot)
    if seen is None:
        return done
    site, blocks = seen.choice.site, done.selection.blocks
    extended = applied(done.joint, (site,), seen.values)
    instead = compared(done.joint, extended, replace(windows, hold=seen.hold))
    if not instead.helps or (done.found and instead.whole(instead.after) > BETTER * gain.whole(gain.after)):
        return done
    gain = instead
    return replace(
        done,
        extended=extended,
        fit=fit_at(system, done.joint, (site,), seen.values, blocks),
        selection=replace(done.selection, choices=(seen.choice,)),
        found=(Found(site, seen.values, seen.covariance, seen.choice, seen.removed),),
        gain=gain,
        fraction=0.0,
    )


def far_off(stands: Standing, least: float = DOUBTED) -> tuple[str, float] | None:
    """Return the signal whose simulation is farthest off, and by how many times its noise, if that is more than the least."""
    off = {role: stands.rmse(role) / stands.floor[role] for role in stands.floor if stands.floor[role] > 0.0}
    worst = max(off, key=lambda role: off[role], default="")
    return (worst, off[worst]) if worst and off[worst] > least else None


def _doubts(found: JointDiagnosis) -> list[str]:
    """Return what speaks against what was found."""
    system = found.system
    said = [
        f"joint '{found.name}': the equation '{equation}' can be formed nowhere in this log, and was not checked"
        for equation, used in zip(system.names, np.any(system.weights, axis=0).tolist(), strict=True)
        if not used
    ]
    if not found.whole and not found.adds_up:
        hint = hint_of(found.name, found.joint, system)
        return said if hint is None else [*said, hint]
    stands = found.standing
    if found.found or stands is None:
        return said
    far = far_off(stands)
    if far is None:
        return said
    return [
        *said,
        f"joint '{found.name}': though the equations close, the simulation of {far[0]} is off by {far[1]:.3g} times its noise:"
        " something moves the joint that the rig does not have, or its inputs are not the whole of what drives it",
    ]


def _require_motion(name: str, channels: Channels) -> None:
    """Refuse a log of a joint that rests, or one that is over before a filter has seen it."""
    least = LEAST * (channels.window + round(BELL / channels.period))
    if len(channels) < least:
        raise DiagnosisError(
            f"joint '{name}': {len(channels)} samples, {len(channels) * channels.period:.3g} s, are too few: the filters alone"
            f" need {least}, and some seconds of motion tell more"
        )
    moving = [v for r, v in channels.raw.items() if any(word in r for word in ("position", "deflection", "pressure"))]
    if not any(span_of(values) > 0.0 for values in moving):
        raise DiagnosisError(
            f"joint '{name}': no position changes in this log; at rest nothing can be told from anything"
        )


def _only_computed(
    name: str, joint: Any, signals: JointSignals, computed: Mapping[str, str], warnings: list[str]
) -> JointDiagnosis:
    """Return the diagnosis of a log whose only torque is none: there is nothing else to be checked with."""
    channels = channels_of(signals).thinned()
    system = build_system(joint, channels, balance_for(joint), 0.5 * signals.period)
    blocks = blocks_of(system)
    fit = fitted(system, joint, (), np.zeros(0), blocks)
    warnings.append(
        f"joint '{name}': without a torque that was measured no equation can be checked: nothing else was looked for"
    )
    nothing = Selection(system, fit, fit, (), blocks)
    return JointDiagnosis(name, joint, joint, system, nothing, fit, (), computed, None, None, "", 0.0, tuple(warnings))


def without(signals: JointSignals, roles: Mapping[str, str]) -> JointSignals:
    """Return the signals without some roles."""
    return replace(signals, roles={r: v for r, v in signals.roles.items() if r not in roles})


def _fraction(system: System, nothing: Fit, fit: Fit) -> float:
    """Return the part of what was wrong beyond noise that is still left."""
    wrong, left = nothing.loss - system.count, fit.loss - NOISE * system.count
    return float(np.clip(left / wrong, 0.0, 1.0)) if wrong > 0.0 and left > 0.0 else 0.0


def unexplained_side(found: JointDiagnosis) -> tuple[str, int] | None:
    """Return the side that most of what is left over is on, and the equation that shows it; none where nothing is left."""
    rows = plain_rows(found, found.extended)
    squares = mean_squares(rows)
    if not np.any(squares[np.isfinite(squares)] > NOISE):
        return None
    motion = _motion(found)
    springs = [s for s in motion.deflections if s not in motion.measured]
    return side_of(found.system, found.extended, found.rows(found.fit), springs)


def mean_squares(rows: Array) -> Array:
    """Return the mean square of each equation's rows, shape (m,), over those that count; NaN where none does."""
    counts = np.count_nonzero(np.isfinite(rows), axis=0)
    return np.asarray(np.where(counts > 0, np.nansum(rows**2, axis=0) / np.maximum(counts, 1), np.nan))


def plain_rows(found: JointDiagnosis, joint: Any) -> Array:
    """Return the averaged equations of a joint over their own noise, shape (R, m), NaN where they do not count."""
    rows = found.system.averaged(joint) / found.system.deviation
    return np.where(found.system.weights > 0.0, rows, np.nan)


def variables(found: JointDiagnosis) -> dict[str, tuple[Array, str]]:
    """Return what remainders of a joint may depend on."""
    return variables_of(found.system, _motion(found))


def _motion(found: JointDiagnosis) -> Motion:
    channels = found.system.channels
    roles = true_roles(found.extended, channels, found.system.hold)
    return motion_for(found.extended, roles, channels.time, channels.spread)


def remainder_depends_on(found: JointDiagnosis, equation: int) -> tuple[list[str], str | None]:
    """Return the variables that an equation's remainder depends on, strongest first, and the one over which it is a loop."""
    rows = plain_rows(found, found.extended)[:, equation]
    blocks = found.selection.blocks.reshape(-1, len(found.system.names))[:, 0]
    known = variables(found)
    told = depends_on(rows, blocks, known)
    loop, names = loop_over(rows, blocks, known, told), [d.name for d in told]
    return names if loop is None else [loop, rate_of(loop), "time"], loop
