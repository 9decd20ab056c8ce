"""From scores to a verdict and three sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from msgspec.structs import replace

from vsalog.core.signals import JointSignals
from vsalog.validation.document import (
    Comparison,
    Dependence,
    JointReport,
    LogReport,
    ModalityScore,
    Report,
    Score,
    Threshold,
    TransmissionReport,
    Verdict,
)
from vsalog.validation.joint import Judged
from vsalog.validation.references import WINDOW
from vsalog.validation.scores import FEWEST_BLOCKS

# A model whose torque is this close to the reference holds [% of the torque's span].
HOLDS = 5.0
MOSTLY_OUTSIDE = 0.5
# A torque that is measured by more than this part larger or smaller than predicted is another spring's.
GAIN = 0.1
# The second dependence is named too when it explains this part of the error's mean square.
WORTH_SAYING = 0.15
# A verdict needs as many of the filter's windows as a bootstrap needs blocks.
LEAST_SAMPLES = FEWEST_BLOCKS * WINDOW
# Words name what an error depends on; which parameter of the rig makes it, a simulation of the rig tells.
DIAGNOSE = "'vsalog diagnose LOG' looks for the cause and extends the rig by it"
# What else a residual feels.
MOTOR = "the residual rests on the rig's motor: a wrong inertia, damping, torque constant or sign of it shows here too"

_REFERENCE = {
    "sensor": "the torque sensor",
    "residual": "the residual of the motor equation (there is no torque sensor to judge by)",
}


def joint_report(
    judged: Judged,
    signals: JointSignals,
    modalities: Mapping[str, Sequence[ModalityScore]],
    warnings: Sequence[str],
    learnt_from: bool = False,
) -> JointReport:
    """Put what was found about a joint into words; `learnt_from` is true of the log that the model was learnt from."""
    parts = tuple(replace(t, modalities=tuple(modalities.get(t.transmission, ()))) for t in judged.transmissions)
    worst = _worst(parts)
    verdict: Verdict = "cannot be judged"
    if worst is not None and judged.not_independent is None:
        verdict = _verdict(_main(worst))
        if verdict == "fails" and _is_noise(worst):
            verdict = "undecided"  # what hides the model's error is no error of the model
        if verdict in ("holds", "undecided") and any(_gain_is_off(part) for part in _counted(parts)):
            verdict = "fails"
        if verdict != "fails" and _unjudged(parts):
            verdict = "cannot be judged"  # a part of the joint of which nothing is known may be as bad as can be
    sentences = _sentences(verdict, parts, worst, judged.not_independent)
    if learnt_from and worst is not None and verdict in ("holds", "undecided"):
        verdict, sentences = "cannot be judged", _of_its_own_log(worst)
    told = [*_cautions(parts, worst), *warnings]
    if worst is not None and worst.judged_on == "residual":
        told.insert(
            0,
            f"{_no_sensor(judged.not_independent)}: the model is judged by the residual, which the rig's own motor parameters"
            " make",
        )
    return JointReport(
        joint=signals.joint,
        verdict=verdict,
        sentences=sentences,
        not_independent=judged.not_independent,
        duration=len(signals) * signals.period,
        period=signals.period,
        transmissions=parts,
        warnings=tuple(told),
    )


def _no_sensor(why: str | None) -> str:
    return "there is no torque sensor" if why is None else "there is no torque sensor that measures for itself"


def thresholds(logs: Sequence[LogReport], max_nrmse: float | None, max_msrep: float | None) -> tuple[Threshold, ...]:
    """Hold every joint of every log against the thresholds asked for; what cannot be judged does not meet them."""
    out = []
    for name, limit in (("nrmse", max_nrmse), ("msrep", max_msrep)):
        if limit is not None:
            met = all(_meets(joint, name, limit) for log in logs for joint in log.joints)
            out.append(Threshold(name=name, limit=limit, met=met))
    return tuple(out)


@dataclass(frozen=True, slots=True)
class Line:
    """One joint of one log in a table of several: its verdict and the score that this rests on; none where nothing is judged."""

    log: str
    joint: str
    verdict: Verdict
    judged_on: str | None
    score: Score | None
    inside: float


def overview(report: Report) -> list[Line]:
    """Return a line per log and joint, in the order of the logs."""
    lines = []
    for log in report.logs:
        for joint in log.joints:
            worst = _worst(joint.transmissions)
            judged_on, score = (None, None) if worst is None else (worst.judged_on, _main(worst))
            inside = min((t.inside_share for t in joint.transmissions), default=0.0)
            lines.append(Line(log.log, joint.joint, joint.verdict, judged_on, score, inside))
    return lines


def _meets(joint: JointReport, name: str, limit: float) -> bool:
    mains = [_main(t) for t in _counted(joint.transmissions) if t.judged_on is not None]
    values = [getattr(score, name).value for score in mains if score is not None]
    return joint.verdict != "cannot be judged" and bool(values) and all(v is not None and v <= limit for v in values)


def _worst(parts: Sequence[TransmissionReport]) -> TransmissionReport | None:
    """Return the transmission that is predicted worst, of those that can be judged."""
    judged = [t for t in _counted(parts) if _judged(t)]
    return max(judged, key=lambda t: _nrmse(_main(t)), default=None)


def _counted(parts: Sequence[TransmissionReport]) -> list[TransmissionReport]:
    """Leave out what a residual judges where there is a torque sensor: one sensor of a whole joint tells more than its noise."""
    by_sensor = [t for t in parts if t.judged_on == "sensor"]
    if any(t.transmission == "total" for t in by_sensor):
        return [t for t in parts if t.judged_on != "residual"]
    return list(parts)


def _judged(part: TransmissionReport) -> bool:
    score = _main(part)
    return score is not None and score.nrmse.value is not None and score.samples >= LEAST_SAMPLES


def _is_noise(part: TransmissionReport) -> bool:
    """Tell whether the error is what the sensor's noise or steps make it: no dependence, not even on its own past."""
    return not part.dependence or part.dependence[0].on == "resolution"


def _cautions(parts: Sequence[TransmissionReport], worst: TransmissionReport | None) -> list[str]:
    """Say what the verdict does not tell."""
    out = []
    alone = [t.transmission for t in parts if t.transmission != "total" and t.judged_on != "sensor"]
    if alone and any(t.transmission == "total" and t.judged_on == "sensor" for t in parts):
        out.append(
            f"one torque sensor feels the sum of the transmissions, and the verdict rests on that; {' and '.join(alone)} alone"
            " may be off where their errors cancel"
        )
    score = None if worst is None else _main(worst)
    if score is not None and score.effective_samples < FEWEST_BLOCKS:
        out.append(
            f"the error stays alike for so long that {score.samples} samples are worth {score.effective_samples:.2g} independent"
            " ones: a longer experiment would make the interval surer"
        )
    return out


def _unjudged(parts: Sequence[TransmissionReport]) -> list[TransmissionReport]:
    """Return the transmissions that the verdict would pass over though the log has something to judge them by."""
    return [t for t in _counted(parts) if not _judged(t) and (t.judged_on is not None or t.inside_share == 0.0)]


def _main(part: TransmissionReport) -> Score | None:
    """Return the score the verdict rests on."""
    return None if part.judged_on is None or not part.comparisons else _of(part, part.judged_on).inside


def _of(part: TransmissionReport, reference: str) -> Comparison:
    return next(c for c in part.comparisons if c.reference == reference and c.quantity == "flexibility_torque")


def _nrmse(score: Score | None) -> float:
    return 0.0 if score is None or score.nrmse.value is None else score.nrmse.value


def _verdict(score: Score | None) -> Verdict:
    if score is None or score.nrmse.value is None:
        return "cannot be judged"
    low = score.nrmse.value if score.nrmse.low is None else score.nrmse.low
    high = score.nrmse.value if score.nrmse.high is None else score.nrmse.high
    return "holds" if high <= HOLDS else "fails" if low > HOLDS else "undecided"


def _gain_is_off(part: TransmissionReport) -> bool:
    """Tell whether what is measured is clearly more or less than predicted, however small that is against the span."""
    return part.gain is not None and abs(part.gain - 1.0) > GAIN


def _sentences(
    verdict: Verdict, parts: Sequence[TransmissionReport], worst: TransmissionReport | None, not_independent: str | None
) -> tuple[str, ...]:
    if not_independent is not None:
        score = None if worst is None or worst.judged_on != "residual" else _main(worst)
        return (
            f"Nothing is validated: {not_independent}.",
            "A model that agrees with such a channel agrees with whoever computed it.",
            "Record a torque sensor, or motor positions and torques, to judge the model by."
            if score is None
            else f"Against the residual of the motor equation the model is off by {_of_span(score.nrmse.value)}, which is told"
            " for comparison; record a torque sensor to judge the model by.",
        )
    if worst is None:
        on = next((t for t in _counted(parts) if t.judged_on is not None), None)
        if on is not None:
            return _too_little(on)
        if not any(c.inside or c.outside for t in parts for c in t.comparisons) and all(
            t.inside_share == 0.0 for t in parts
        ):
            return (
                "Nothing is judged: fewer than 20 samples of this log have a deflection and a torque once they are filtered.",
                "The filter needs 51 samples in a row without a gap or a missing value.",
                "Record longer, or without the gaps.",
            )
        inside = max((t.inside_share for t in parts), default=0.0)
        if inside == 0.0:
            return (
                "Nothing is judged: no sample of this log lies in the region that the model was fitted in.",
                "Everything it says here is extrapolation; the table of samples outside shows how far it is off.",
                "Fit the model on an experiment that covers these deflections and set-points; if it should, a position's sign,"
                " unit, zero or gear ratio is wrong in the rig.",
            )
        return (
            "Nothing is judged: the log has neither a torque sensor nor motor positions and torques with a known inertia.",
            "What the model is compared with below is no measurement.",
            "Name a torque_sensor, or motor_position and motor_torque, in the rig.",
        )
    if verdict == "cannot be judged":
        missing = ", ".join(t.transmission for t in _unjudged(parts) if t.transmission != "total")
        return (
            f"Not all of the joint can be judged: of transmission {missing} no sample lies in the region that the model was"
            " fitted in, or too little was measured.",
            f"Of what can be judged the worst is off by {_of_span(_nrmse(_main(worst)))}.",
            "Fit the model on an experiment that covers these deflections and set-points.",
        )
    score, where = _main(worst), _whose(worst) if len(parts) > 1 else ""
    assert score is not None
    interval = f"{_figure(score.nrmse.low)} to {_figure(score.nrmse.high)} %"
    error = _of_span(score.nrmse.value)
    if _nrmse(score) <= 1000.0:
        error += f" (95 %: {interval})"
    words = {
        "holds": "The model holds",
        "fails": "The model does not hold",
        "undecided": "Whether the model holds is too close to tell",
    }[verdict]
    first = f"{words}: judged by {_REFERENCE[worst.judged_on or 'sensor']}, its flexibility torque{where} is off by {error}."
    return first, _where(worst), _why(_telling(parts, worst), verdict)


def _of_its_own_log(worst: TransmissionReport) -> tuple[str, ...]:
    """Say what a model's own log is worth."""
    error = _of_span(_nrmse(_main(worst)))
    return (
        "Nothing is validated: this is the log that the model was learnt from, and no second experiment.",
        f"Judged by {_REFERENCE[worst.judged_on or 'sensor']}, the model fits it with an error of {error}.",
        "How well it predicts, only another experiment tells.",
    )


def _telling(parts: Sequence[TransmissionReport], worst: TransmissionReport) -> TransmissionReport:
    """Return whose error says most of its cause: of a sum the summand that is predicted worst, where something is told of it."""
    single = [t for t in parts if t.transmission != "total" and _judged(t) and _told(t)]
    return max(single, key=lambda t: _nrmse(_main(t))) if worst.transmission == "total" and single else worst


def _told(part: TransmissionReport) -> list[Dependence]:
    return [d for d in part.dependence if d.on != "itself"]


def _whose(part: TransmissionReport) -> str:
    return " of the whole joint" if part.transmission == "total" else f" of transmission {part.transmission}"


def _too_little(part: TransmissionReport) -> tuple[str, ...]:
    """Say why a reference that is there judges nothing."""
    score = _main(part)
    if score is not None and score.nrmse.value is None:
        what = "the torque sensor" if part.judged_on == "sensor" else "the residual of the motor equation"
        return (
            f"Nothing is judged: {what} never changes, so that an error has no span to be measured by.",
            "A sensor that is stuck or unplugged looks like that.",
            "See whether the rig names the right channel.",
        )
    count = "fewer than 20" if score is None else f"only {score.samples}"
    return (
        f"Nothing is judged: {count} samples that can be judged lie in the region that the model was fitted in.",
        f"An error's size needs at least {LEAST_SAMPLES}: {FEWEST_BLOCKS} windows of the filter, which makes the samples of each"
        " depend on one another.",
        "Record longer, or fit the model on an experiment that covers these deflections and set-points.",
    )


def _where(part: TransmissionReport) -> str:
    outside = _of(part, part.judged_on or "sensor").outside
    if outside is None:
        return (
            "All of this log lies in the region that the model was fitted in."
            if part.inside_share > 0.999
            else (f"{_share(part.inside_share)} of this log lies in the region that the model was fitted in.")
        )
    more = "most" if part.inside_share < MOSTLY_OUTSIDE else "some"
    return (
        f"{more.capitalize()} of the log, {_share(1.0 - part.inside_share)} of its samples, lies outside the region that the"
        f" model was fitted in and is judged apart: there it is off by {_of_span(outside.nrmse.value)}."
    )


def _why(part: TransmissionReport, verdict: Verdict) -> str:
    told = _told(part)
    if not told and verdict == "holds":
        return "The error shows no dependence worth a cause."
    if not told and not part.dependence:
        what = "the torque sensor" if part.judged_on == "sensor" else "the residual"
        return f"The error depends on none of the signals there are and is white, as noise of {what} is, which hides the model's."
    if not told:
        return f"What the error depends on does not show in the signals there are; {DIAGNOSE}."
    said = [f"{_share(d.share)} says: {d.words}" for d in told[:2] if d is told[0] or d.share >= WORTH_SAYING]
    also = f"; {MOTOR}" if part.judged_on == "residual" and verdict != "holds" else ""
    return f"Of the error's mean square {'; and '.join(said)}{also}; {DIAGNOSE}."


def _figure(value: float | None) -> str:
    return "?" if value is None else f"{value:.3g}"


def _share(value: float) -> str:
    return f"{100.0 * value:.3g} %"


def _of_span(percent: float | None) -> str:
    """Return an error in words: digits of one that is many times the torque say nothing more."""
    if percent is not None and percent > 1000.0:
        return "more than 10 times the torque's span"
    return f"{_figure(percent)} % of the torque's span"
