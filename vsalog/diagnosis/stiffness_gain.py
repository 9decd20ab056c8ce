"""What the causes are worth for the stiffness estimate: how near its two modalities are with either rig."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.document import Gain
from vsalog.diagnosis.gain import PARTS, reduction_of
from vsalog.estimation.modalities import MODALITIES, Traces, differences
from vsalog.uncertainty.long_run import FEWEST_SAMPLES

Array = NDArray[np.float64]


def stiffness_gains(name: str, before: Traces, after: Traces) -> list[Gain]:
    """Compare how near the two modalities are to each other with two rigs.

    They are independent but for the rig: the nearer they are, the less is wrong with it.

    Parameters
    ----------
    name : of the joint
    before, after : with the original rig, and extended

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
            old, new = (differences(pair, transmission, stamps) for pair in (first, second))
            gain = _gain(name, "total" if single else transmission, old, new)
            out += [gain] if gain is not None else []
    return out


def _gain(name: str, transmission: str, old: tuple[Array, Array], new: tuple[Array, Array]) -> Gain | None:
    good = np.isfinite(old[0]) & np.isfinite(new[0])
    if np.count_nonzero(good) < FEWEST_SAMPLES:
        return None
    squares = [np.array([np.mean(part**2) for part in np.array_split(off[good], PARTS)]) for off in (old[0], new[0])]
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
