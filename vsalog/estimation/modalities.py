"""The stiffness by the motor's equation and by the torque sensor: they are independent except for the rig."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.joint import bind
from vsalog.checks.sensor import without_clipped
from vsalog.core.errors import VsalogError
from vsalog.core.recording import Recording, Stamps
from vsalog.core.trace import Trace
from vsalog.estimation.joint import choose
from vsalog.estimators.device import device_of
from vsalog.perturbations.quantisation import Quantisation
from vsalog.perturbations.trials import TRIED_SAMPLES, Subject, tried

Array = NDArray[np.float64]
Traces = Mapping[str, Trace]

MODALITIES = ("RESIDUAL", "SENSOR")


def stiffness_traces(name: str, joint: Any, recording: Recording) -> Traces:
    """Estimate a joint's stiffness by the motor's equation and by the torque sensor (`residual-rls`).

    Parameters
    ----------
    name, joint : of a rig, as it is written
    recording : that was not used for the fit, where there is one; no more than its first 32768 samples are used

    Returns
    -------
    Modality → trace, of those that the roles and the rig allow
    """
    traces = {}
    for modality in MODALITIES:
        try:
            choice = choose(name, joint, "residual-rls", {"modality": modality})
            signals = without_clipped(bind([recording], name, joint, choice.roles)[:TRIED_SAMPLES])
            device = device_of(name, joint, signals.roles)
            fold = choice.method.build(device, signals, choice.tuning)
            fold.conditioner.check_length(signals.longest_run)
            subject = Subject(choice.method, device, signals, choice.tuning, fold)
            traces[modality] = tried(subject, (Quantisation(),))
        except VsalogError:
            continue  # a role or a parameter is missing
    return traces


def stiffness_change(after: Traces, without: Traces) -> float | None:
    """Return the relative RMS change of the joint's stiffness if the extended rig lacks a cause.

    Parameters
    ----------
    after, without : with the extended rig, and with the one that lacks the cause

    Returns
    -------
    That of the modality which changes more; None where neither excites a stiffness with both rigs
    """
    changes = []
    for modality in after.keys() & without.keys():
        trace = after[modality]
        off, _ = differences((without[modality], trace), "total", trace.stamps)
        good = np.isfinite(off)
        if good.any():
            own = np.asarray(trace.transmissions["total"]["stiffness"], dtype=np.float64)[good]
            changes.append(float(np.sqrt(np.sum(off[good] ** 2) / np.sum(own**2))))
    return max(changes, default=None)


def differences(pair: tuple[Trace, ...], transmission: str, stamps: Stamps) -> tuple[Array, Array]:
    """Return the first − the second of two traces at some stamps, NaN where either is not excited; and its variance.

    If only one rig has a delay, the traces begin and end at different times. In the first half of a log estimators
    settle.
    """
    columns = [
        {k: _at(stamps, trace, trace.transmissions[transmission][k]) for k in ("excited", "stiffness", "stiffness_std")}
        for trace in pair
    ]
    good = stamps > stamps[0] + 0.5 * (stamps[-1] - stamps[0])
    for c in columns:
        good &= (c["excited"] > 0.5) & np.isfinite(c["stiffness"])
    off = np.where(good, columns[0]["stiffness"] - columns[1]["stiffness"], np.nan)
    return off, columns[0]["stiffness_std"] ** 2 + columns[1]["stiffness_std"] ** 2


def _at(stamps: Stamps, trace: Trace, values: NDArray[Any]) -> Array:
    seconds, own = (stamps - stamps[0]) * 1e-9, (trace.stamps - stamps[0]) * 1e-9
    return np.asarray(np.interp(seconds, own, np.asarray(values, dtype=np.float64), left=np.nan, right=np.nan))
