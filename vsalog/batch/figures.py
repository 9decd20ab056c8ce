"""The figures of a joint that stand in the summary: from what the commands find to columns by name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from vsalog.batch.records import Joint
from vsalog.diagnosis.document import Diagnosis
from vsalog.estimation.job import Job
from vsalog.estimation.joint import JointEstimate
from vsalog.estimation.summary import TransmissionSummary
from vsalog.validation.document import Report
from vsalog.validation.verdict import overview


def of_estimate(job: Job, estimate: JointEstimate) -> Joint:
    """Return a joint's key figures: those of the device as a whole, and each transmission's."""
    s = estimate.summary
    figures = {
        "estimator": estimate.estimator,
        "modality": estimate.model.modality,
        "rig_guessed": job.guessed,
        "duration": s.duration,
        "rate": 1.0 / s.period if s.period > 0.0 else None,
        "findings": msgspec.to_builtins(estimate.findings),
        "warnings": list(estimate.warnings),
    }
    whole = _whole(s.transmissions)
    if whole is not None:
        figures |= {k: v for k, v in msgspec.to_builtins(whole).items() if k != "transmission"}
        # The device is not fitted: residuals stand with its transmissions.
        fitted = [t for t in s.transmissions if t.fit_share is not None]
        if whole.fit_share is None and fitted:
            worst = max(fitted, key=lambda t: t.fit_share or 0.0)
            figures |= {"fit_rms": worst.fit_rms, "fit_mean": worst.fit_mean, "fit_share": worst.fit_share}
    figures["transmissions"] = [msgspec.to_builtins(t) for t in s.transmissions]
    figures["motor"] = [{"parameter": k, "value": v} for k, v in estimate.model.motor.items()]
    return Joint(joint=estimate.joint, figures=figures)


def _whole(parts: Sequence[TransmissionSummary]) -> TransmissionSummary | None:
    return next((p for p in parts if p.transmission == "total"), parts[0] if parts else None)


def of_validation(report: Report) -> Iterator[Joint]:
    """Yield each joint's verdict and the score it rests on."""
    (log,) = report.logs
    for line, joint in zip(overview(report), log.joints, strict=True):
        figures = {
            "verdict": line.verdict,
            "judged_on": line.judged_on,
            "inside_share": line.inside,
            "duration": joint.duration,
            "rate": 1.0 / joint.period if joint.period > 0.0 else None,
            "sentences": list(joint.sentences),
            "not_independent": joint.not_independent,
            "findings": msgspec.to_builtins((*joint.reasons, *joint.findings)),
            "warnings": list(joint.warnings),
        }
        if line.score is not None:
            score = line.score
            figures |= {
                "nrmse": score.nrmse.value,
                "nrmse_low": score.nrmse.low,
                "nrmse_high": score.nrmse.high,
                "rmse": score.rmse.value,
                "msrep": score.msrep.value,
                "r2": score.r2.value,
                "bias": score.bias.value,
                "samples": score.samples,
            }
        yield Joint(joint=joint.joint, figures=figures)


def of_diagnosis(diagnosis: Diagnosis) -> Iterator[Joint]:
    """Yield each joint's causes and what they are worth; the verdict and what is unexplained are the log's."""
    parts = (diagnosis.simulation_error, diagnosis.equations, diagnosis.causes)
    for name in dict.fromkeys(part.joint for several in parts for part in several):
        causes = [c for c in diagnosis.causes if c.joint == name]
        yield Joint(
            joint=name,
            figures={
                "verdict": diagnosis.verdict,
                "causes": [
                    {"cause": c.cause, "confidence": c.confidence, "error_removed": c.error_removed} for c in causes
                ],
                "errors": [
                    {"signal": e.signal, "unit": e.unit, "rmse": e.rmse, "noise_floor": e.noise_floor, "nrmse": e.nrmse}
                    for e in diagnosis.simulation_error
                    if e.joint == name
                ],
                "gains": [
                    {
                        "signal": g.signal,
                        "rmse_before": g.rmse_before,
                        "rmse_after": g.rmse_after,
                        "reduction": g.reduction,
                    }
                    for g in diagnosis.gain.signals
                    if g.joint == name
                ],
                "unexplained": diagnosis.unexplained.fraction,
                "sentences": list(diagnosis.sentences),
                "next_experiment": diagnosis.next_experiment,
                "findings": [msgspec.to_builtins(f) for f in diagnosis.findings if f.joint == name],
                "warnings": [],
            },
        )
