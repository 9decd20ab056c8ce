"""From scores to a verdict and its findings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from msgspec.structs import replace

from vsalog.core.dependence import LEAST_BLOCKS, REPORTED_SHARE
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.validation.dependence import CODES
from vsalog.validation.document import (
    Comparison,
    Dependence,
    JointReport,
    LogReport,
    ModalityScore,
    Reference,
    Report,
    Score,
    StiffnessVerdict,
    Threshold,
    TransmissionReport,
    Verdict,
)
from vsalog.validation.joint import Judged
from vsalog.validation.references import WINDOW

# A model whose torque is this close to the reference holds [% of the torque's span].
HOLDING_ERROR = 5.0
# A torque, or a stiffness, that differs from the prediction by more than this share is another spring's [1].
GAIN_ERROR = 0.1
# References of a stiffness, the most reliable first.
STIFFNESS_CODES: Mapping[Reference, str] = {
    "truth": "validation.stiffness_by_truth",
    "nominal": "validation.stiffness_by_nominal",
}
# A verdict needs as many of the filter's windows as a bootstrap needs blocks.
LEAST_SAMPLES = LEAST_BLOCKS * WINDOW


def joint_report(
    judged: Judged,
    signals: JointSignals,
    modalities: Mapping[str, Sequence[ModalityScore]],
    findings: Sequence[Finding],
    learnt_from: bool = False,
) -> JointReport:
    """Decide whether a joint's model holds.

    Parameters
    ----------
    judged, signals, modalities : of the joint
    findings : about the log and its signals
    learnt_from : whether this is the log that the model was fitted to
    """
    parts = tuple(replace(t, modalities=tuple(modalities.get(t.transmission, ()))) for t in judged.transmissions)
    worst = _worst(parts)
    found = partial(Finding, joint=signals.joint)
    standing: Verdict = "cannot be judged" if worst is None else _verdict(parts, worst)
    if judged.not_independent is not None:
        reasons = [
            judged.not_independent,
            *_error(partial(found, code="validation.compared_only", severity="info"), worst),
        ]
    elif worst is None:
        reasons = [_nothing_judged(found, parts)]
    elif standing != "fails" and (missing := _unjudged(parts)):
        # A part of the joint without a reference may have any error.
        names = " and ".join(t.transmission for t in missing if t.transmission != "total")
        reasons = [found(code="validation.part_unjudged", part=names, severity="invalidates")]
    elif standing != "fails" and learnt_from:
        reasons = [*_error(partial(found, code="validation.own_log", severity="invalidates"), worst)]
    else:
        reasons = [
            *_error(partial(found, code="validation.error", severity="info"), worst),
            *_off_gains(found, parts),
            _region(found, worst),
            *_why(found, _telling(parts, worst), standing),
        ]
    further = (*_cautions(found, parts, worst), *findings)
    # Uninformative signals may make an error smaller; an error that shows nevertheless is kept.
    decisive = reasons if standing == "fails" else (*reasons, *further)
    if any(f.severity == "invalidates" for f in decisive):
        standing = "cannot be judged"
    return JointReport(
        joint=signals.joint,
        verdict=standing,
        reasons=tuple(reasons),
        findings=further,
        duration=len(signals) * signals.period,
        period=signals.period,
        transmissions=parts,
        stiffness=_stiffness(found, parts, standing),
    )


def _stiffness(
    found: partial[Finding], parts: Sequence[TransmissionReport], torque: Verdict
) -> StiffnessVerdict | None:
    """Judge the stiffness by the available reference: a torque that holds over a short range determines its slope badly.

    A nominal stiffness is as good as the rig: where the model's differs, either may be wrong. It is a reference only where the
    measured torque agrees with the model, else it may not be the log's spring.
    """
    for reference, code in STIFFNESS_CODES.items():
        if reference == "nominal" and torque != "holds":
            continue
        scores = [
            (c.inside.msrep, t.transmission)
            for t in parts
            for c in t.comparisons
            if c.quantity == "stiffness" and c.reference == reference and c.inside is not None
        ]
        known = [(off.value, off, part) for off, part in scores if off.value is not None]
        if not known:
            continue
        _, off, part = max(known, key=lambda one: one[0])
        value, low, high = (_rms(off.value or 0.0 if end is None else end) for end in (off.value, off.low, off.high))
        limit = 100.0 * GAIN_ERROR
        wrong: Verdict = "fails" if reference == "truth" else "undecided"
        verdict: Verdict = "holds" if high <= limit else wrong if low > limit else "undecided"
        reason = found(
            code=code,
            part=part,
            severity="info" if verdict == "holds" else "warning",
            value=value,
            limit=limit,
            unit="%",
            evidence={"low": low, "high": high},
        )
        return StiffnessVerdict(verdict=verdict, reference=reference, reason=reason)
    return None


def _rms(msrep: float) -> float:
    """Return the root of a mean square relative error, both in per cent."""
    return math.sqrt(100.0 * msrep)


def thresholds(logs: Sequence[LogReport], max_nrmse: float | None, max_msrep: float | None) -> tuple[Threshold, ...]:
    """Compare every joint of every log with the requested thresholds; what cannot be judged does not meet them."""
    out = []
    for name, limit in (("nrmse", max_nrmse), ("msrep", max_msrep)):
        if limit is not None:
            met = all(_meets(joint, name, limit) for log in logs for joint in log.joints)
            out.append(Threshold(name=name, limit=limit, met=met))
    return tuple(out)


@dataclass(frozen=True, slots=True)
class Line:
    """One joint of one log in a table of several: its verdict and the score for it; none where nothing is judged."""

    log: str
    joint: str
    verdict: Verdict
    judged_on: str | None
    score: Score | None
    inside: float
    stiffness: Verdict | None = None


def overview(report: Report) -> list[Line]:
    """Return a line per log and joint, in the order of the logs."""
    lines = []
    for log in report.logs:
        for joint in log.joints:
            worst = _worst(joint.transmissions)
            judged_on, score = (None, None) if worst is None else (worst.judged_on, _main(worst))
            inside = min((t.inside_share for t in joint.transmissions), default=0.0)
            stiffness = None if joint.stiffness is None else joint.stiffness.verdict
            lines.append(Line(log.log, joint.joint, joint.verdict, judged_on, score, inside, stiffness))
    return lines


def _meets(joint: JointReport, name: str, limit: float) -> bool:
    mains = [_main(t) for t in _counted(joint.transmissions) if t.judged_on is not None]
    values = [getattr(score, name).value for score in mains if score is not None]
    return joint.verdict != "cannot be judged" and bool(values) and all(v is not None and v <= limit for v in values)


def _worst(parts: Sequence[TransmissionReport]) -> TransmissionReport | None:
    """Return the transmission that is predicted worst, of those that can be judged."""
    judged = [t for t in _counted(parts) if _judged(t)]
    return max(judged, key=_nrmse, default=None)


def _counted(parts: Sequence[TransmissionReport]) -> list[TransmissionReport]:
    """Leave out comparisons with a residual where there is a torque sensor: a joint's sensor is better than its noise."""
    by_sensor = [t for t in parts if t.judged_on == "sensor"]
    if any(t.transmission == "total" for t in by_sensor):
        return [t for t in parts if t.judged_on != "residual"]
    return list(parts)


def _judged(part: TransmissionReport) -> bool:
    score = _main(part)
    return score is not None and score.nrmse.value is not None and score.samples >= LEAST_SAMPLES


def _is_noise(part: TransmissionReport) -> bool:
    """Return whether the error is the sensor's noise or quantisation: no dependence, not even on its own past."""
    return not part.dependence or part.dependence[0].on == "resolution"


def _cautions(
    found: partial[Finding], parts: Sequence[TransmissionReport], worst: TransmissionReport | None
) -> Iterator[Finding]:
    """Yield findings in addition to the verdict."""
    if worst is not None and worst.judged_on == "residual":
        yield found(code="validation.judged_by_residual", part=worst.transmission)
    alone = [t.transmission for t in parts if t.transmission != "total" and t.judged_on != "sensor"]
    if alone and any(t.transmission == "total" and t.judged_on == "sensor" for t in parts):
        yield found(code="validation.sum_only", part=" and ".join(alone))
    score = None if worst is None else _main(worst)
    if score is not None and score.effective_samples < LEAST_BLOCKS:
        evidence = {"samples": score.samples}
        yield found(
            code="validation.few_independent_samples",
            value=score.effective_samples,
            limit=LEAST_BLOCKS,
            evidence=evidence,
        )


def _unjudged(parts: Sequence[TransmissionReport]) -> list[TransmissionReport]:
    """Return the transmissions without a verdict though the log has a reference for them."""
    return [t for t in _counted(parts) if not _judged(t) and (t.judged_on is not None or t.inside_share == 0.0)]


def _main(part: TransmissionReport) -> Score | None:
    """Return the score that the verdict is based on."""
    return None if part.judged_on is None or not part.comparisons else _of(part, part.judged_on).inside


def _of(part: TransmissionReport, reference: str) -> Comparison:
    return next(c for c in part.comparisons if c.reference == reference and c.quantity == "flexibility_torque")


def _nrmse(part: TransmissionReport) -> float:
    score = _main(part)
    return 0.0 if score is None or score.nrmse.value is None else score.nrmse.value


def _verdict(parts: Sequence[TransmissionReport], worst: TransmissionReport) -> Verdict:
    """Return the verdict of the errors, if nothing invalidates them."""
    score = _main(worst)
    if score is None or score.nrmse.value is None:
        return "cannot be judged"
    low = score.nrmse.value if score.nrmse.low is None else score.nrmse.low
    high = score.nrmse.value if score.nrmse.high is None else score.nrmse.high
    if any(_gain_is_off(part) for part in _counted(parts)):
        return "fails"
    # A signal that hides the model's error is no error of the model.
    return (
        "holds" if high <= HOLDING_ERROR else "fails" if low > HOLDING_ERROR and not _is_noise(worst) else "undecided"
    )


def _gain_is_off(part: TransmissionReport) -> bool:
    """Return whether the measurement is clearly more or less than predicted, however small that is against the span."""
    return part.gain is not None and abs(part.gain - 1.0) > GAIN_ERROR


def _error(found: partial[Finding], worst: TransmissionReport | None) -> Iterator[Finding]:
    """Yield the error of the transmission that is predicted worst, with its 95 % interval."""
    score = None if worst is None else _main(worst)
    if worst is None or score is None or score.nrmse.value is None:
        return
    nrmse = score.nrmse
    low, high = (nrmse.value if end is None else end for end in (nrmse.low, nrmse.high))
    yield found(
        part=worst.transmission,
        value=nrmse.value,
        limit=HOLDING_ERROR,
        unit="%",
        evidence={"reference": worst.judged_on or "", "low": low, "high": high},
    )


def _off_gains(found: partial[Finding], parts: Sequence[TransmissionReport]) -> Iterator[Finding]:
    for part in filter(_gain_is_off, _counted(parts)):
        yield found(code="validation.gain_off", part=part.transmission, value=part.gain, limit=GAIN_ERROR)


def _nothing_judged(found: partial[Finding], parts: Sequence[TransmissionReport]) -> Finding:
    """Return why nothing is judged."""
    void = partial(found, severity="invalidates")
    on = next((t for t in _counted(parts) if t.judged_on is not None), None)
    if on is not None:
        score, evidence = _main(on), {"reference": on.judged_on or ""}
        if score is not None and score.nrmse.value is None:
            return void(code="validation.reference_constant", part=on.transmission, evidence=evidence)
        samples = LEAST_BLOCKS if score is None else score.samples
        return void(code="validation.too_few_samples", part=on.transmission, value=samples, limit=LEAST_SAMPLES)
    outside = all(t.inside_share == 0.0 for t in parts)
    if outside and not any(c.inside or c.outside for t in parts for c in t.comparisons):
        return void(code="validation.nothing_filtered", limit=LEAST_BLOCKS, evidence={"window": WINDOW})
    return void(code="validation.all_outside_region" if outside else "validation.no_reference")


def _telling(parts: Sequence[TransmissionReport], worst: TransmissionReport) -> TransmissionReport:
    """Return the part whose error shows its cause best: of a sum the summand that is predicted worst, if anything is known."""
    single = [t for t in parts if t.transmission != "total" and _judged(t) and _causes(t)]
    return max(single, key=_nrmse) if worst.transmission == "total" and single else worst


def _causes(part: TransmissionReport) -> list[Dependence]:
    return [d for d in part.dependence if d.on != "itself"]


def _region(found: partial[Finding], part: TransmissionReport) -> Finding:
    """Return the share of the log that is judged separately, outside the region that the model was fitted in."""
    outside = _of(part, part.judged_on or "sensor").outside
    share = 1.0 - part.inside_share
    if outside is None:
        return found(code="validation.inside_region", part=part.transmission, severity="info", value=part.inside_share)
    off = outside.nrmse.value
    evidence = {} if off is None else {"nrmse": off}
    return found(code="validation.outside_region", part=part.transmission, value=share, evidence=evidence)


def _why(found: partial[Finding], part: TransmissionReport, verdict: Verdict) -> Iterator[Finding]:
    """Yield what the error depends on."""
    about = partial(found, part=part.transmission)
    causes = _causes(part)
    if not causes and verdict == "holds":
        yield about(code="error.independent", severity="info")
    elif not part.dependence:
        yield about(code="error.noise", severity="info", evidence={"reference": part.judged_on or ""})
    for d in causes[:2] if causes or verdict == "holds" else part.dependence:
        yield about(code=d.code, value=d.share, limit=REPORTED_SHARE, evidence=d.evidence | {"p_value": d.p_value})
        if d.not_told_from:
            others = ", ".join(CODES[on].removeprefix("error.").replace("_", " ") for on in d.not_told_from)
            yield about(code="error.ambiguous", evidence={"others": others})
