"""The figures of a joint in the summary: from the commands' results to named columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from msgspec import to_builtins

from vsalog.batch.records import Joint
from vsalog.diagnosis.document import Diagnosis
from vsalog.estimation.job import Job
from vsalog.estimation.joint import JointEstimate
from vsalog.validation.document import Report
from vsalog.validation.verdict import overview


def of_estimate(job: Job, estimate: JointEstimate) -> Joint:
    """Return a joint's key figures: those of the device as a whole, and each transmission's."""
    s = estimate.summary
    figures: dict[str, Any] = {
        "estimator": estimate.estimator,
        "modality": estimate.model.modality,
        "rig_guessed": job.guessed,
        "duration": s.duration,
        "rate": _rate(s.period),
        "findings": to_builtins(estimate.findings),
        "warnings": list(estimate.warnings),
        "transmissions": to_builtins(s.transmissions),
        "motor": [{"parameter": k, "value": v} for k, v in estimate.model.motor.items()],
    }
    whole = next((part for part in s.transmissions if part.transmission == "total"), None)
    whole = whole or next(iter(s.transmissions), None)
    if whole is not None:
        figures |= to_builtins(whole)
        # The device is not fitted: residuals belong to its transmissions.
        fitted = [part for part in s.transmissions if part.fit_share is not None]
        if whole.fit_share is None and fitted:
            worst = max(fitted, key=lambda part: part.fit_share or 0.0)
            figures |= {name: getattr(worst, name) for name in ("fit_rms", "fit_mean", "fit_share")}
    return Joint(joint=estimate.joint, figures=figures)


def of_validation(report: Report) -> Iterator[Joint]:
    """Yield each joint's verdict and the score it is based on."""
    (log,) = report.logs
    for line, joint in zip(overview(report), log.joints, strict=True):
        figures = {
            "verdict": line.verdict,
            "judged_on": line.judged_on,
            "inside_share": line.inside,
            "duration": joint.duration,
            "rate": _rate(joint.period),
            "sentences": list(joint.sentences),
            "not_independent": joint.not_independent,
            "findings": to_builtins((*joint.reasons, *joint.findings)),
            "warnings": list(joint.warnings),
        }
        if score := line.score:
            figures |= {name: getattr(score, name).value for name in ("nrmse", "rmse", "msrep", "r2", "bias")}
            figures |= {"nrmse_low": score.nrmse.low, "nrmse_high": score.nrmse.high, "samples": score.samples}
        yield Joint(joint=joint.joint, figures=figures)


def of_diagnosis(diagnosis: Diagnosis) -> Iterator[Joint]:
    """Yield each joint's causes and improvement; the verdict and the unexplained share belong to the log."""
    parts = (diagnosis.simulation_error, diagnosis.equations, diagnosis.causes)
    for name in dict.fromkeys(part.joint for several in parts for part in several):

        def own(parts: Sequence[Any], *fields: str, joint: str = name) -> list[dict[str, Any]]:
            """Return these fields of the joint's entries."""
            return [{field: getattr(part, field) for field in fields} for part in parts if part.joint == joint]

        figures = {
            "verdict": diagnosis.verdict,
            "causes": own(diagnosis.causes, "cause", "confidence", "error_removed"),
            "errors": own(diagnosis.simulation_error, "signal", "unit", "rmse", "noise_floor", "nrmse"),
            "gains": own(diagnosis.gain.signals, "signal", "rmse_before", "rmse_after", "reduction"),
            "unexplained": diagnosis.unexplained.fraction,
            "sentences": list(diagnosis.sentences),
            "next_experiment": diagnosis.next_experiment,
            "findings": [to_builtins(f) for f in diagnosis.findings if f.joint == name],
        }
        yield Joint(joint=name, figures=figures)


def _rate(period: float) -> float | None:
    return 1.0 / period if period > 0.0 else None
