"""What the causes mean for the stiffness estimate: with the rig as it stands, extended, and without one of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.binding import bind
from vsalog.diagnosis.document import Gain
from vsalog.diagnosis.gain import reduction_of
from vsalog.errors import VsalogError
from vsalog.estimation import choose
from vsalog.estimators.device import device_of
from vsalog.estimators.fewer import TRIED
from vsalog.estimators.folding import estimated
from vsalog.recording import Recording, Stamps
from vsalog.trace import Trace

Array = NDArray[np.float64]
Traces = Mapping[str, Trace]

# The part of a log in which the estimators settle, and the blocks the rest is cut into.
SETTLED, BLOCKS = 0.5, 20
MODALITIES = ("RESIDUAL", "SENSOR")


def stiffness_traces(name: str, joint: Any, recording: Recording) -> Traces:
    """Estimate a joint's stiffness by the motor's equation and by the torque sensor (`residual-rls`).

    Parameters
    ----------
    name, joint : of a rig, as it is written
    recording : that was not used for the fit, where there is one; no more than its first 32768 samples are looked at

    Returns
    -------
    Modality → trace, of those that the roles and the rig allow
    """
    traces = {}
    for modality in MODALITIES:
        try:
            choice = choose(name, joint, "residual-rls", {"modality": modality})
            signals = bind([recording], name, joint, choice.roles)[:TRIED]
            fold = choice.method.build(device_of(name, joint, signals.roles), signals, choice.tuning)
            fold.conditioner.check_length(signals.longest_run)
            traces[modality] = estimated(fold, signals)
        except VsalogError:
            continue  # a role or a parameter is missing
    return traces


def stiffness_gains(name: str, before: Traces, after: Traces) -> list[Gain]:
    """Compare how near the two modalities are to each other with two rigs.

    They know of each other only through the rig: the nearer they are, the less is wrong with it.

    Parameters
    ----------
    name : of the joint
    before, after : with the rig as it stands, and extended

    Returns
    -------
    A gain per transmission; nothing where the log does not allow both modalities with both rigs
    """
    if len(before) < len(MODALITIES) or len(after) < len(MODALITIES):
        return []
    first, second = (tuple(traces[m] for m in MODALITIES) for traces in (before, after))
    out = []
    single = len([t for t in first[0].transmissions if t != "total"]) == 1
    for transmission in first[0].transmissions:
        if single and transmission == "total":
            continue  # the same as the one transmission
        if all(transmission in trace.transmissions for trace in (*first, *second)):
            stamps = first[0].stamps
            old, new = (_differences(pair, transmission, stamps) for pair in (first, second))
            gain = _gain(name, "total" if single else transmission, old, new)
            out += [gain] if gain is not None else []
    return out


def stiffness_change(after: Traces, without: Traces) -> float | None:
    """Return by which part the joint's stiffness changes, in root mean square, if the extended rig lacks a cause.

    Parameters
    ----------
    after, without : with the extended rig, and with the one that lacks the cause

    Returns
    -------
    That of the modality which changes more; None where neither supports a stiffness with both rigs
    """
    changes = []
    for modality in after.keys() & without.keys():
        trace = after[modality]
        off, _ = _differences((without[modality], trace), "total", trace.stamps)
        good = np.isfinite(off)
        if good.any():
            own = np.asarray(trace.transmissions["total"]["stiffness"], dtype=np.float64)[good]
            changes.append(float(np.sqrt(np.sum(off[good] ** 2) / np.sum(own**2))))
    return max(changes, default=None)


def _differences(pair: tuple[Trace, ...], transmission: str, stamps: Stamps) -> tuple[Array, Array]:
    """Return the first − the second of two traces at some stamps, NaN where either is not supported; and the variance of that.

    A delay that one rig knows of and the other does not leaves traces that begin and end apart.
    """
    columns = [
        {k: _at(stamps, trace, trace.transmissions[transmission][k]) for k in ("excited", "stiffness", "stiffness_std")}
        for trace in pair
    ]
    good = stamps > stamps[0] + SETTLED * (stamps[-1] - stamps[0])
    for c in columns:
        good &= (c["excited"] > 0.5) & np.isfinite(c["stiffness"])
    off = np.where(good, columns[0]["stiffness"] - columns[1]["stiffness"], np.nan)
    return off, columns[0]["stiffness_std"] ** 2 + columns[1]["stiffness_std"] ** 2


def _at(stamps: Stamps, trace: Trace, values: NDArray[Any]) -> Array:
    seconds, own = (stamps - stamps[0]) * 1e-9, (trace.stamps - stamps[0]) * 1e-9
    return np.asarray(np.interp(seconds, own, np.asarray(values, dtype=np.float64), left=np.nan, right=np.nan))


def _gain(name: str, transmission: str, old: tuple[Array, Array], new: tuple[Array, Array]) -> Gain | None:
    good = np.isfinite(old[0]) & np.isfinite(new[0])
    if np.count_nonzero(good) < 10 * BLOCKS:
        return None
    squares = [np.array([np.mean(part**2) for part in np.array_split(off[good], BLOCKS)]) for off in (old[0], new[0])]
    reduction, interval = reduction_of(*squares)
    before, after = (float(np.sqrt(s.mean())) for s in squares)
    signal = "stiffness" if transmission == "total" else f"stiffness, {transmission}"
    return Gain(
        joint=name,
        signal=signal,
        unit="N*m/rad",
        rmse_before=before,
        rmse_after=after,
        noise_floor=float(np.sqrt(np.nanmean(new[1][good]))),
        reduction=reduction,
        ci95=interval,
    )
