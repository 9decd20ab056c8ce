"""One run of `identify`: a log and its rig in, the rig with its numbers fitted to the log out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog._version import __version__
from vsalog.checks.fault import RULE
from vsalog.core.errors import DiagnosisError, SimulationError, VsalogError
from vsalog.core.finding import Finding, of_log
from vsalog.core.finding_texts import sentences_of
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM
from vsalog.diagnosis import run as diagnosis
from vsalog.diagnosis.gain import floors, weighed
from vsalog.estimation.job import sha256
from vsalog.estimation.joint import pick_joints
from vsalog.identification.beginning import turned_signs
from vsalog.identification.document import Combination, Identification, IdentifiedNumber
from vsalog.identification.document import SimulationError as ErrorThere
from vsalog.identification.fit import Fit, absence, begun_with, fitted, refitted
from vsalog.identification.identifiability import combinations, correlations, determined
from vsalog.identification.lever import bound_by, lever_of
from vsalog.identification.unknowns import (
    Scales,
    Unknown,
    as_felt,
    felt,
    placed,
    torque_constants_without_effect,
    unknowns_of,
    unstated_frictions,
)
from vsalog.residuals.channels import channels_of
from vsalog.residuals.windows import WITHIN, Windows, begun, player_of, windows_of
from vsalog.rig import Rig
from vsalog.rig.roles import ROLE_UNITS
from vsalog.rig.schema import Lever, UnknownTransmission
from vsalog.rig.uncertain import Path as KeyPath
from vsalog.rig.uncertain import Tolerance

Array = NDArray[np.float64]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Options:
    """What can be asked of `identify`; the command line's options of the same names.

    Attributes
    ----------
    rig, joints, set, rate, time, start, end : as for `diagnose`
    free, fixed : keys below a joint, or patterns, that are fitted too, and that are not
    """

    rig: Rig | str | Path | None = None
    joints: tuple[str, ...] = ()
    set: Mapping[str, str] = field(default_factory=dict)
    rate: float | None = None
    time: str = "auto"
    start: str | None = None
    end: str | None = None
    free: tuple[str, ...] = ()
    fixed: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class JointFit:
    """What was found of one joint.

    Attributes
    ----------
    name : of the joint
    joint : as the rig has it
    fit : of its numbers
    errors : simulations before and after
    turned : torques with the wrong sign → part of the equations' squared residual that is left with it reversed; all numbers
        are invalid where there is one, and no simulation is made
    """

    name: str
    joint: Any
    fit: Fit
    errors: tuple[ErrorThere, ...]
    turned: Mapping[str, float]

    @property
    def identified(self) -> Any:
        """The joint with the numbers that were identified."""
        return placed(self.joint, self.fit.unknowns, self.fit.values)

    @property
    def findings(self) -> Iterator[Finding]:
        """Wrong signs, where the fit leaves more than noise, and where the rig is nearer to data that were not fitted."""
        for role, left in self.turned.items():
            yield Finding(
                code="signal.sign", joint=self.name, part=role, severity="invalidates", value=left, limit=RULE.left,
                evidence={"left": left},
            )  # fmt: skip
        worst = max(
            self.errors, key=lambda e: e.identified / e.noise_floor if e.noise_floor > 0.0 else 0.0, default=None
        )
        if worst is not None and worst.identified > WITHIN * worst.noise_floor > 0.0:
            yield Finding(
                code="identification.misfit", joint=worst.joint, part=worst.signal,
                value=worst.identified / worst.noise_floor, limit=WITHIN, evidence={"where": worst.where},
            )  # fmt: skip
        for e in self.errors:
            if e.part != "itself" and e.identified**2 > e.rig**2 + e.noise_floor**2:
                yield Finding(
                    code="identification.worse_elsewhere", joint=e.joint, part=e.signal, value=e.identified, limit=e.rig,
                    unit=e.unit, evidence={"where": e.where},
                )  # fmt: skip


def identify(
    log: Path, holdouts: Sequence[Path], options: Options, progress: Progress = lambda _: None
) -> tuple[Identification, Rig]:
    """Fit the numbers of a rig to a log.

    Parameters
    ----------
    log : to fit
    holdouts : other logs of the same machine, to judge the fit by
    options : what is asked for
    progress : called with the step that begins

    Returns
    -------
    What was found, and the rig with it

    Raises
    ------
    VsalogError
        A log cannot be read, the rig is missing or does not fit, or nothing can be simulated.
    """
    asked = diagnosis.Options(
        options.rig, options.joints, options.set, options.rate, options.time, start=options.start, end=options.end
    )
    rig = diagnosis.rig_for(log, asked)
    wanted = pick_joints(rig.joints, options.joints)
    whole = dataclasses.replace(asked, start=None, end=None)
    log_sha256 = sha256(log)
    diagnosis.require_other(holdouts, [log_sha256])
    progress(f"reading {log.name}")
    recording = diagnosis.read_wanted(log, wanted, asked)
    others = {path.name: diagnosis.read_wanted(path, wanted, whole) for path in holdouts}
    found, findings = list[JointFit](), list[Finding]()
    for name, joint in wanted.items():
        try:
            signals = diagnosis.bound_as_recorded(recording, name, joint, gains=False)
            held = {
                path: diagnosis.bound_as_recorded(other, name, joint, set(signals.roles), gains=False)
                for path, other in others.items()
            }
            lever = lever_of(recording, joint, set(signals.roles))
            progress(f"joint {name}: fitting")
            kept = (*options.fixed, *torque_constants_without_effect(recording, joint))
            asked_of_it = dataclasses.replace(options, fixed=kept)
            found.append(identified(name, joint, log.name, signals, held, rig.tolerances[name], asked_of_it, lever))
            findings += [*signals.findings, *found[-1].findings]
        except VsalogError as error:
            if len(wanted) == 1:
                raise
            findings.append(diagnosis.left_out_for(name, error))
    if not found:
        raise DiagnosisError(f"{log.name}: no joint of the rig can be identified: {'; '.join(sentences_of(findings))}")
    found = [one for one in found if not one.turned]
    rig = _with_numbers(rig, found, log.name)
    document = Identification(
        vsalog=__version__,
        log=log.name,
        log_sha256=log_sha256,
        holdouts=tuple(path.name for path in holdouts),
        rig=rig.to_toml(),
        settings={f"set {k}": v for k, v in options.set.items()}
        | {name: ",".join(given) for name in ("free", "fixed", "joints") if (given := getattr(options, name))},
        numbers=tuple(number for one in found for number in _numbers(one)),
        combinations=tuple(c for one in found for c in _combinations(one)),
        errors=tuple(error for one in found for error in one.errors),
        correlations={one.name: tuple(map(tuple, correlations(one.fit).tolist())) for one in found},
        findings=(*of_log(log.name, recording.findings), *findings),
    )
    return document, rig


def identified(
    name: str,
    joint: Any,
    log: str,
    signals: JointSignals,
    held: Mapping[str, JointSignals],
    stated: Mapping[str, float],
    options: Options,
    lever: Lever | None,
) -> JointFit:
    """Fit the numbers of one joint.

    Parameters
    ----------
    name, joint : of the rig, as it is written
    log : name of the log
    signals : of it, as recorded
    held : of logs that are held out: name → signals
    stated : key's path below the joint → one standard deviation
    options : of the run
    lever : that bound the set-point of all logs, see `lever.bound_by`

    Raises
    ------
    VsalogError
        There is nothing to fit, or the joint cannot be simulated.
    """
    _require_springs(name, joint)
    windows = _windows(joint, signals)
    moving, scales = player_of(as_felt(joint), windows.channels).moving(), _scales(joint, windows)
    unknowns = unknowns_of(joint, stated, scales, options.free, options.fixed, moving)
    if not unknowns:
        raise DiagnosisError(f"joint '{name}': the rig leaves no number to be fitted; --free KEY adds one")
    frictions = unstated_frictions(joint, stated, scales, (*options.free, *options.fixed), moving)
    # With a wrong sign all numbers are wrong, and friction is not worth a search.
    turned = dict(turned_signs(joint, (*unknowns, *frictions), windows.channels))
    fit = _with_frictions(joint, unknowns, [] if turned else frictions, weighed(as_felt(joint), windows), lever)
    if turned and fit.misfit > WITHIN:
        return JointFit(name, joint, fit, (), turned)
    there = [
        error
        for path, other in held.items()
        for error in _errors(name, joint, fit, path, "whole", _windows(joint, other), lever)
    ]
    if not held:
        cut = 2 * len(windows.spans) // 3
        first, rest = np.arange(cut), np.arange(cut, len(windows.spans))
        if cut and rest.size:
            part = refitted(joint, fit, fit.windows.part(first), lever)
            there = _errors(name, joint, part, log, "last third", windows.part(rest), lever)
        else:
            there = _errors(name, joint, fit, log, "itself", windows, lever)
    return JointFit(name, joint, fit, tuple(there), {})


def _require_springs(name: str, joint: Any) -> None:
    """Refuse a joint with a spring of an unknown law, which has no numbers to begin with."""
    for key in ("transmission", "transmission_1", "transmission_2"):
        if isinstance(getattr(joint, key, None), UnknownTransmission):
            raise DiagnosisError(
                f"joint '{name}': the rig does not state the type of its spring, so nothing can be simulated or fitted; state it"
                f" with a first value under [joint.{name}] in the rig:"
                f""" {key} = {{ type = "linear", stiffness = "100 N*m/rad" }}"""
            )


def _with_frictions(
    joint: Any, unknowns: Sequence[Unknown], frictions: Sequence[Unknown], windows: Windows, lever: Lever | None
) -> Fit:
    """Fit numbers of a joint along with those frictions that the log shows; of one log in a thousand there is one by chance
    (`FALSE_ALARM`).

    Far from a log that has friction, a fit without it has optima of its own, and takes long to find them.
    """
    begin = begun_with(joint, unknowns, windows, lever)
    fit, left = None, list(frictions)
    if frictions and begin.misfit > WITHIN:
        starts = [np.append(begin.values, np.zeros(len(frictions)))]
        fit = fitted(joint, (*unknowns, *frictions), windows, starts, lever)
        found = [one for one in frictions if fit.above_zero(fit.unknowns.index(one)) * len(frictions) <= FALSE_ALARM]
        left = [one for one in frictions if one not in found]
        kept = [one not in left for one in fit.unknowns]
        if not found:
            fit = None
        elif left:
            fit = fitted(joint, (*unknowns, *found), windows, [fit.values[kept]], lever)
    fit = fit or fitted(joint, unknowns, windows, [begin.values], lever)
    while left:
        p = absence(joint, fit, left, lever)
        if np.min(p) * len(frictions) > FALSE_ALARM:
            break
        one = left.pop(int(np.argmin(p)))
        fit = fitted(joint, (*fit.unknowns, one), fit.windows, [np.append(fit.values, 0.0)], lever)
    return fit


def _windows(joint: Any, signals: JointSignals) -> Windows:
    return windows_of(as_felt(joint), channels_of(signals), hold=False)


def _scales(joint: Any, windows: Windows) -> Scales:
    """Return the usual torque and velocity of a joint in a log."""
    channels = windows.channels
    torques = [np.nanstd(v) for role, v in channels.raw.items() if "torque" in role]
    again = channels.with_noise(seed=0)
    speeds = [
        _beyond_noise(v[1], again.roles[role][1] - v[1])
        for role, v in channels.roles.items()
        if "position" in role and "commanded" not in role
    ]
    speed = float(max(speeds, default=0.0)) or 1.0
    if not torques and getattr(joint, "drive", None) is not None:
        # The loop's torque from the recorded error.
        position = next(channels.raw[r] for r in ("motor_position", "link_position") if r in channels.raw)
        torques = [joint.drive.kp * np.nanstd(channels.raw["commanded_position"] - position)]
    return Scales(float(max(torques, default=0.0)) or 1.0, speed, channels.period)


def _beyond_noise(values: Array, noise: Array) -> float:
    """Return the standard deviation of what is recorded without its noise, or the least that would be noticed in it."""
    of_noise = float(np.nanvar(noise))
    least = of_noise * np.sqrt(2.0 / np.count_nonzero(np.isfinite(noise)))  # standard deviation of a variance
    return float(np.sqrt(max(np.nanvar(values) - of_noise, least)))


def _errors(
    name: str, joint: Any, fit: Fit, where: str, part: Any, windows: Windows, lever: Lever | None
) -> list[ErrorThere]:
    """Return how far the original rig, and with a fit, is from windows that it was not fitted to."""
    windows = dataclasses.replace(windows, scale=fit.windows.scale, hold=fit.windows.hold)
    after = felt(joint, fit.unknowns, fit.values)
    try:
        one = begun(as_felt(joint), windows)
    except SimulationError:
        one = None
    windows = bound_by(lever, windows, after)
    two = begun(after, windows)
    floor = floors(after, windows, two)
    out = []
    for role in windows.roles:
        there = np.concatenate([windows.channels.raw[role][a:b] for a, b in windows.spans])
        rms = [float("nan") if s is None else float(np.sqrt(np.nanmean(s.errors[role] ** 2))) for s in (one, two)]
        unit = ROLE_UNITS[role.removesuffix("_1").removesuffix("_2")][0]
        out.append(
            ErrorThere(
                joint=name, where=where, part=part, signal=role, unit=unit, rig=rms[0], identified=rms[1],
                noise_floor=floor[role], spread=float(np.nanstd(there)),
            )
        )  # fmt: skip
    return out


def _numbers(one: JointFit) -> list[IdentifiedNumber]:
    fit, matrix, kinds = one.fit, correlations(one.fit), determined(one.fit)
    deviation = fit.half_widths
    out = []
    for i, unknown in enumerate(fit.unknowns):
        others = np.abs(matrix[i]).copy()
        others[i] = -1.0
        nearest = int(np.argmax(others)) if len(others) > 1 else None
        at = float(fit.values[i])
        low, high = (np.clip(at + sign * deviation[i], *unknown.bounds) for sign in (-1.0, 1.0))
        out.append(
            IdentifiedNumber(
                joint=one.name, key=unknown.key, unit=unknown.number.unit, rig=unknown.number.value, value=unknown.value(at),
                low=unknown.value(float(low)), high=unknown.value(float(high)), determined=kinds[i],
                correlated_with=None if nearest is None else fit.unknowns[nearest].key,
                correlation=None if nearest is None else float(matrix[i, nearest]),
            )
        )  # fmt: skip
    return out


def _combinations(one: JointFit) -> list[Combination]:
    return [
        Combination(joint=one.name, keys=tuple(one.fit.unknowns[i].key for i in members), changes=changes)
        for members, changes in combinations(one.fit)
    ]


def _with_numbers(rig: Rig, found: Sequence[JointFit], log: str) -> Rig:
    """Return the rig with the numbers that were identified, each with its interval as its tolerance."""
    identified = rig.with_joints(
        {**rig.joints, **{one.name: one.identified for one in found}}, f"{rig.where}, identified"
    )
    stated = dict[KeyPath, Tolerance](identified.stated)
    for one in found:
        for unknown, value, deviation in zip(one.fit.unknowns, one.fit.values, one.fit.half_widths, strict=True):
            half = abs(unknown.slope(float(value))) * float(deviation)
            stated["joint", one.name, *unknown.number.path] = Tolerance(half, unknown.number.unit)
    return dataclasses.replace(identified, stated=stated)
