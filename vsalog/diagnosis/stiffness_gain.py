"""What the causes are worth for the stiffness estimate: RESIDUAL against SENSOR, with the rig as it stands and extended."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.document import Gain
from vsalog.diagnosis.gain import DRAWS, SEED
from vsalog.errors import VsalogError
from vsalog.estimation import choose, estimate_joint
from vsalog.recording import Recording, Stamps
from vsalog.trace import Trace

Array = NDArray[np.float64]

# The part of a log in which the estimators settle, and the blocks the rest is cut into.
SETTLED, BLOCKS = 0.5, 20
MODALITIES = ("RESIDUAL", "SENSOR")


def stiffness_gains(name: str, before: Any, after: Any, recording: Recording) -> list[Gain]:
    """Estimate the stiffness by the motor's equation and by the torque sensor, with two rigs, and compare.

    The two modalities know of each other only through the rig: the nearer they are, the less is wrong with it.

    Parameters
    ----------
    name : of the joint
    before, after : the joint as the rig has it, and extended
    recording : that was not used for the fit, where there is one

    Returns
    -------
    A gain per transmission; nothing where the log does not allow both modalities with both rigs
    """
    pairs = [_traces(name, joint, recording) for joint in (before, after)]
    if any(pair is None for pair in pairs):
        return []
    first, second = (p for p in pairs if p is not None)
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


def _traces(name: str, joint: Any, recording: Recording) -> tuple[Trace, Trace] | None:
    found = []
    for modality in MODALITIES:
        try:
            estimate = estimate_joint(
                [recording], name, joint, choose(name, joint, "residual-rls", {"modality": modality})
            )
        except VsalogError:
            return None  # a role or a parameter is missing
        if estimate.trace is None:
            return None
        found.append(estimate.trace)
    return found[0], found[1]


def _differences(pair: tuple[Trace, Trace], transmission: str, stamps: Stamps) -> tuple[Array, Array]:
    """Return RESIDUAL − SENSOR at some stamps, NaN where either is not supported by the data; and the variance of that.

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
    counts = np.random.default_rng(SEED).multinomial(BLOCKS, np.full(BLOCKS, 1.0 / BLOCKS), size=DRAWS)
    drawn = 1.0 - np.sqrt((counts @ squares[1]) / np.maximum(counts @ squares[0], 1e-300))
    before, after = (float(np.sqrt(s.mean())) for s in squares)
    low, high = np.quantile(drawn, [0.025, 0.975])
    signal = "stiffness" if transmission == "total" else f"stiffness, {transmission}"
    return Gain(
        joint=name,
        signal=signal,
        unit="N*m/rad",
        rmse_before=before,
        rmse_after=after,
        noise_floor=float(np.sqrt(np.nanmean(new[1][good]))),
        reduction=1.0 - after / max(before, 1e-300),
        ci95=(float(low), float(high)),
    )
