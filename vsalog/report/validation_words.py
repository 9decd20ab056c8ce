"""A validation's findings in words: what a report says of its verdicts, made of the catalogue."""

from __future__ import annotations

from msgspec.structs import replace

from vsalog.core.finding import Finding
from vsalog.core.finding_texts import says, sentence, sentences_of
from vsalog.validation.document import Dependence, JointReport, Report


def worded(report: Report) -> Report:
    """Return a report with its findings in sentences."""
    return replace(report, logs=tuple(replace(log, joints=tuple(_joint(j) for j in log.joints)) for log in report.logs))


def _joint(joint: JointReport) -> JointReport:
    computed = [says(f) for f in joint.reasons if f.code.startswith("torque.")]
    parts = [replace(t, dependence=tuple(map(_dependence, t.dependence))) for t in joint.transmissions]
    return replace(
        joint,
        transmissions=tuple(parts),
        sentences=tuple(map(_reason, joint.reasons)),
        not_independent=computed[0] if computed else None,
        warnings=sentences_of(joint.findings),
    )


def _dependence(found: Dependence) -> Dependence:
    return replace(found, words=says(Finding(code=found.code, evidence=found.evidence)).removesuffix("."))


def _reason(finding: Finding) -> str:
    words = sentence(finding, joint=False)
    if "p_value" in finding.evidence and finding.value is not None:
        return f"Of the error's mean square {100.0 * finding.value:.3g} % says: {words}"
    # A role is written as the rig has it.
    return words if "_" in words.split()[0] else f"{words[0].upper()}{words[1:]}"
