"""One log by all modalities, that is sources of the torque (Flacco 2012 eq. 44, Tables 1 and 2)."""

from __future__ import annotations

import numpy as np

from vsalog.core.errors import VsalogError
from vsalog.core.progress import counted
from vsalog.core.recording import Recording
from vsalog.core.trace import Trace
from vsalog.estimation.joint import choose, estimate_joint
from vsalog.rig.schema import AntagonisticJoint, Joint
from vsalog.validation.document import ModalityScore
from vsalog.validation.references import Smoothed, true_stiffness
from vsalog.validation.scores import LEAST_TORQUE, score

MODALITIES = ("MODEL", "SENSOR", "RESIDUAL")


def side_by_side(name: str, joint: Joint, recording: Recording) -> dict[str, list[ModalityScore]]:
    """Estimate a joint's stiffness by each modality that the log allows: transmission → scores.

    Each is judged after the first half of the log, by when its parameters have settled.
    """
    found: dict[str, list[ModalityScore]] = {}
    for modality in counted("modalities", MODALITIES):
        try:
            choice = choose(name, joint, "residual-rls", {"modality": modality})
            estimate = estimate_joint([recording], name, joint, choice)
        except VsalogError:
            continue  # a role or a parameter is missing: the report lists the available modalities
        for transmission in estimate.trace.transmissions:
            row = _score(modality, name, joint, transmission, estimate.trace, recording)
            found.setdefault(transmission, []).append(row)
    return found


def _score(
    modality: str, name: str, joint: Joint, transmission: str, trace: Trace, recording: Recording
) -> ModalityScore:
    columns = {key: np.asarray(values, dtype=np.float64) for key, values in trace.transmissions[transmission].items()}
    settled = (columns["excited"] > 0.0) & (trace.time > 0.5 * (trace.time[0] + trace.time[-1]))
    sigma, std = columns["stiffness"][settled], columns["stiffness_std"][settled]
    fed = columns.get("residual", columns["flexibility_torque"])[settled]
    fit = columns.get("residual_fit", columns["flexibility_torque_fit"])[settled]
    suffix = "_total" if transmission == "total" else f"_{transmission}" if isinstance(joint, AntagonisticJoint) else ""
    stamps = Smoothed(trace.time, trace.stamps, np.zeros(trace.time.size, dtype=np.bool_), {})
    truth = true_stiffness(recording.channels, name, suffix, stamps)
    return ModalityScore(
        modality=modality,
        stiffness_low=float(np.quantile(sigma, 0.01)) if sigma.size else None,
        stiffness_high=float(np.quantile(sigma, 0.99)) if sigma.size else None,
        stiffness_std=float(np.median(std)) if std.size else None,
        against_truth=None if truth is None else score(sigma, truth[settled]),
        torque=score(fit, fed, LEAST_TORQUE),
    )
