"""A joint's diagnosis for the document and for the figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsalog.core.dependence import REPORTED_SHARE
from vsalog.core.finding import Finding
from vsalog.core.finding_texts import says
from vsalog.diagnosis.causes.base import Site
from vsalog.diagnosis.document import (
    Bin,
    EquationError,
    FoundCause,
    Gain,
    LogError,
    Number,
    SignalError,
    Unexplained,
)
from vsalog.diagnosis.evidence import CauseEvidence, EquationEvidence, JointEvidence, SignalEvidence
from vsalog.diagnosis.found import Found
from vsalog.diagnosis.joint import (
    HELD_OUT,
    JointDiagnosis,
    mean_squares,
    plain_rows,
    remainder_depends_on,
    unexplained_side,
    variables,
)
from vsalog.diagnosis.remainder import curve_of, predicted_share
from vsalog.residuals.channels import span_of
from vsalog.rig.schema import role_units

Array = NDArray[np.float64]

# The words of a cause, which the report makes.
UNWORDED = {"title": "", "why": "", "how_to_confirm": "", "tell_apart": "", "reference": ""}
# A cause is shown over the signal that predicts its shape; of several that do so about as well, over the first of these.
ORDER = ("velocity", "rate", "deflection", "position", "setpoint", "torque", "time")


def unit_of(role: str) -> str:
    """Return the SI unit of a role; a set-point is a lever arm here."""
    return "m" if role == "setpoint" else role_units(role)[0]


def causes_of(
    found: JointDiagnosis, stiffness_changes: Sequence[float | None], logs: Sequence[str]
) -> list[FoundCause]:
    """Return the causes for the document.

    Parameters
    ----------
    found : about a joint
    stiffness_changes : what each of its causes changes in the estimated stiffness
    logs : names of those that were looked at together
    """
    out = [_computed(found, role, why) for role, why in found.computed.items()]
    for cause, change in zip(found.found, stiffness_changes, strict=True):
        rivals = [name for r in cause.choice.rivals for name in (_member(r, cause.site), *r.doubles)]
        others = tuple(dict.fromkeys((*cause.site.doubles, *rivals)))
        known, absent = cause.determined(), {n: a for n, (a, _) in cause.absent().items()}
        numbers = {
            # A number that is the same without the cause is a shape: the rig has none.
            n: Number(value=v, std=s, unit=u, determined=known[n], rig=None if absent[n] in (v, np.inf) else absent[n])
            for n, (v, s, u) in cause.numbers().items()
        }
        out.append(
            FoundCause(
                cause=cause.site.cause,
                joint=found.name,
                part=cause.site.part,
                log=None if cause.site.log is None else logs[cause.site.log[0]],
                parameters=numbers,
                common_with=cause.common_with,
                material=cause.material,
                size=cause.choice.size,
                confidence=cause.confidence,
                class_confidence=cause.class_confidence,
                indistinguishable_from=others,
                error_removed=cause.removed,
                stiffness_change=change,
                **UNWORDED,
            )
        )
    return out


def _member(rival: Site, site: Site) -> str:
    """Return the name of a member of a cause's class; of the same cause elsewhere with its part."""
    return f"{rival.cause} ({rival.part})" if rival.cause == site.cause else rival.cause


def _computed(found: JointDiagnosis, role: str, why: Finding) -> FoundCause:
    return FoundCause(
        cause="sensor.torque_not_independent", joint=found.name, part=role, parameters={}, common_with=(), material=True,
        size=None, confidence=0.99, class_confidence=0.99, indistinguishable_from=(), error_removed=0.0,
        stiffness_change=None, **UNWORDED | {"why": says(why)},
    )  # fmt: skip


def signal_errors(found: JointDiagnosis) -> list[SignalError]:
    """Return the simulation errors of the original rig, on the log that is diagnosed."""
    given, out = found.standing, []
    for role in given.windows.roles if given is not None else ():
        assert given is not None
        rmse, span = given.rmse(role), span_of(given.windows.channels.raw[role])
        out.append(
            SignalError(
                joint=found.name,
                signal=role,
                unit=unit_of(role),
                rmse=rmse,
                noise_floor=given.floor[role],
                nrmse=100.0 * rmse / span if span else 0.0,
                rmse_whole_log=given.through.get(role),
            )
        )
    return out


def log_errors(found: JointDiagnosis, logs: Sequence[str], begins: Sequence[str | None]) -> list[LogError]:
    """Return how far simulations are from each of several logs; none of one."""
    return [
        LogError(
            log=logs[s.log], begin=begins[s.log], joint=found.name, signal=s.role, unit=unit_of(s.role), rmse_before=s.before,
            rmse_after=s.after,
        )
        for s in found.shares
    ]  # fmt: skip


def gains_of(found: JointDiagnosis) -> list[Gain]:
    """Return what the causes are worth; where there is none, how well the rig simulates a held-out log."""
    gain, out = found.gain, []
    if gain is None or not (found.found or found.held_out == HELD_OUT):
        return []
    for role in gain.windows.roles:
        reduction, interval = gain.reduction(role)
        out.append(
            Gain(
                joint=found.name,
                signal=role,
                unit=unit_of(role),
                rmse_before=gain.rmse(gain.before, role),
                rmse_after=gain.rmse(gain.after, role),
                noise_floor=gain.floor[role],
                reduction=reduction,
                ci95=interval,
            )
        )
    return out


def equation_errors(found: JointDiagnosis) -> list[EquationError]:
    """Return the RMS residual of each equation, before and after."""
    before, after = (np.sqrt(mean_squares(plain_rows(found, j))) for j in (found.joint, found.extended))
    system = found.system
    return [
        EquationError(
            joint=found.name,
            equation=name,
            side=side,  # type: ignore[arg-type]
            unit=unit,
            rms_before=float(before[i] * system.deviation[i]),
            rms_after=float(after[i] * system.deviation[i]),
            noise=float(system.deviation[i]),
        )
        for i, (name, side, unit) in enumerate(zip(system.names, system.sides, system.units, strict=True))
    ]


def unexplained_of(found: JointDiagnosis) -> Unexplained:
    """Return what no cause explains."""
    left = unexplained_side(found)
    if left is None:
        return Unexplained(fraction=found.fraction, where=None, depends_on=())
    side, equation = left
    (on, rate), known = remainder_depends_on(found, equation), variables(found)
    rows = plain_rows(found, found.extended)[:, equation] * found.system.deviation[equation]
    curve, back = tuple[Bin, ...](), tuple[Bin, ...]()
    if rate is not None:
        x, falls = known[on[0]][0], known[rate][0] < 0.0
        curve, back = (_bins(np.where(falls == way, rows, np.nan), x) for way in (False, True))
    elif on:
        curve = _bins(rows, known[on[0]][0])
    return Unexplained(
        fraction=found.fraction,
        where=side,  # type: ignore[arg-type]
        depends_on=tuple(on),
        equation=found.system.names[equation],
        curve=curve,
        curve_back=back,
        unit=known[on[0]][1] if on else "",
    )


def _bins(rows: Array, x: Array) -> tuple[Bin, ...]:
    return tuple(Bin(low=a, high=b, mean=m, std=s) for a, b, m, s in curve_of(rows, x))


def evidence_of(found: JointDiagnosis, log: str) -> JointEvidence:
    """Return what the figures of a joint draw.

    Parameters
    ----------
    found : about the joint
    log : name of the log that the gain was measured on
    """
    system, known = found.system, variables(found)
    before, after = (plain_rows(found, j) * system.deviation for j in (found.joint, found.extended))
    equations = {
        name: EquationEvidence(side, unit, before[:, i], after[:, i], float(system.deviation[i]))
        for i, (name, side, unit) in enumerate(zip(system.names, system.sides, system.units, strict=True))
    }
    signals, time = dict[str, SignalEvidence](), system.channels.time
    if found.gain is not None:
        windows, time = found.gain.windows, found.gain.windows.channels.time
        inside = windows.window >= 0
        for role in windows.roles:
            measured = np.where(inside, windows.channels.raw[role], np.nan)
            before, after = (measured - shot.errors[role] for shot in (found.gain.before, found.gain.after))
            signals[role] = SignalEvidence(unit_of(role), measured, before, after)
    views = tuple(_view(found, cause, known) for cause in found.found)
    return JointEvidence(found.name, time, signals, log, system.time, equations, known, views)


def _view(found: JointDiagnosis, cause: Found, known: dict[str, tuple[Array, str]]) -> CauseEvidence:
    """Return the equation and the variable in which a cause shows most."""
    without, with_it = (plain_rows(found, j) for j in (found.extended_without(cause), found.extended))
    shape = without - with_it
    i = int(np.nanargmax(mean_squares(shape)))
    shares = {name: predicted_share(shape[:, i], x) for name, (x, _) in known.items()}
    best = max(shares.values())
    near = [name for name, share in shares.items() if share >= best - REPORTED_SHARE]
    variable = min(near, key=lambda name: next((k for k, word in enumerate(ORDER) if word in name), len(ORDER)))
    scale = float(found.system.deviation[i])
    return CauseEvidence(
        cause.site.cause, cause.site.part, found.system.names[i], variable, without[:, i] * scale, shape[:, i] * scale
    )
