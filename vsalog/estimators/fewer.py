"""What too few samples do to an estimate, detected by taking every second one.

A motion that is hardly resolved, as of jerks at 50 Hz, bends what is estimated from it: torques jump between samples, and
derivatives lose what is fast. That repeats with the motion and is in no left-over. But every second sample alone is a recording
at half the rate, in which the error is twice to eight times as large. How far the estimate moves then, beyond what its band there
allows, is no less than how far it is off. (After Richardson's deferred approach to the limit.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import VsalogError
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.by_deflection import ByDeflection, part_moved
from vsalog.estimators.device import Device
from vsalog.estimators.equation import SUPPORTED_SHARE
from vsalog.estimators.folding import estimated
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.tuning import Tuning

if TYPE_CHECKING:
    from vsalog.estimators import Fold, Method

Array = NDArray[np.float64]
Columns = Mapping[str, NDArray[np.generic]]

# What moves a stiffness by less is no matter; what moves it by less than that, or by so few of the second estimate's deviations,
# is counted in without a word.
LEAST, WORTH_A_WORD, SURELY = 0.01, 0.03, 2.0
# So many samples are tried.
TRIED = 1 << 15


@dataclass(frozen=True, slots=True)
class Moved:
    """What half the samples make of an estimate.

    Attributes
    ----------
    shares : by which part each stiffness moves that does, transmission by transmission and as a whole
    surely : by which part at most, beyond what noise may do now and then
    tried : whether half the samples support anything, or nothing is supported anyhow
    """

    shares: Mapping[str, ByDeflection]
    surely: Mapping[str, float] = field(default_factory=dict)
    tried: bool = True


def moved_by_samples(method: Method, device: Device, signals: JointSignals, tuning: Tuning, fold: Fold) -> Moved:
    """Return by which part each stiffness that is supported moves with half the samples.

    Parameters
    ----------
    method : by which the stiffness is estimated
    device, signals, tuning : what it is built for
    fold : as it was built for them
    """
    if device.pneumatic is not None:
        return Moved({})
    part = signals[:TRIED]
    before = estimated(_alone(fold), part)
    changes: dict[str, list[tuple[Array, Array]]] = {}
    tried = not any(np.any(columns["excited"]) for columns in before.transmissions.values())
    for first in (0, 1):
        half = every_second(part, first)
        try:
            other = method.build(device, half, tuning)
            other.conditioner.check_length(half.longest_run)
        except VsalogError:
            continue  # there is nothing to compare with
        after = estimated(_alone(other), half)
        tried = tried or any(np.any(columns["excited"]) for columns in after.transmissions.values())
        for name, columns in before.transmissions.items():
            changes.setdefault(name, []).append(change(columns, after[name], slice(first, None, 2)))
    shares, surely = {}, {}
    for name, halves in changes.items():
        columns = before.transmissions[name]
        phi, sure = np.asarray(columns["deflection"], dtype=np.float64), np.asarray(columns["excited"], dtype=np.bool_)
        squares, noise = (np.array(part) for part in zip(*halves, strict=True))
        found = part_moved(phi, sure, squares - noise)
        if found is not None and found.most > LEAST:
            shares[name] = found
            beyond = part_moved(phi, sure, squares - SURELY**2 * noise)
            surely[name] = 0.0 if beyond is None else beyond.most
    return Moved(shares, surely, tried)


def _alone(fold: Fold) -> Fold:
    return fold.alone() if isinstance(fold, RegressionFold) else fold


def every_second(signals: JointSignals, first: int) -> JointSignals:
    """Return every second sample, of those from the `first` on, as a log of half the rate."""
    part = signals[first::2]
    starts = np.zeros(len(part), dtype=np.bool_)
    begins = (np.flatnonzero(signals.starts) - first + 1) // 2
    starts[begins[(begins >= 0) & (begins < len(part))]] = True
    starts[:1] = True
    return replace(part, period=2.0 * signals.period, starts=starts)


def widened(trace: Trace, moved: Moved) -> Trace:
    """Return a trace with standard deviations that count in by which part each stiffness moves."""
    parts = dict(trace.transmissions)
    for name, share in moved.shares.items():
        columns = parts[name]
        stiffness = np.asarray(columns["stiffness"], dtype=np.float64)
        moves = share.at(np.asarray(columns["deflection"], dtype=np.float64)) * stiffness
        std = np.hypot(np.asarray(columns["stiffness_std"], dtype=np.float64), moves)
        excited = np.asarray(columns["excited"], dtype=np.bool_) & (std < SUPPORTED_SHARE * stiffness)
        parts[name] = {**columns, "stiffness_std": std, "excited": excited}
    return replace(trace, transmissions=parts)


def sampling_findings(device: Device, moved: Moved) -> list[Finding]:
    """Return for which stiffness samples are too few, or that this cannot be tried."""
    if not moved.tried:
        return [Finding(code="sampling.untried", joint=device.joint)]
    found: list[Finding] = []
    for name, share in moved.shares.items():
        surely = moved.surely[name]
        if surely <= WORTH_A_WORD or (name == "total" and len(device.transmissions) < 2):
            continue
        found_of = partial(
            Finding, joint=device.joint, value=surely, limit=WORTH_A_WORD, evidence={"stiffness_change": share.most}
        )
        if name == "total":
            found.append(found_of(code="sampling.too_slow_for_total"))
        else:
            found.append(found_of(code="sampling.too_slow", part=name))
    return found


def change(before: Columns, after: Columns, every: slice) -> tuple[Array, Array]:
    """Return the square of how far a stiffness moves, as a part of it, and the variance of the second estimate, likewise.

    Parameters
    ----------
    before, after : columns of the first estimate, of N samples, and of the second
    every : the samples of the first that the second has

    Returns
    -------
    shape (N,) each; NaN where the second has none, or either is not known
    """
    sigma, now, std = (
        np.asarray(values, dtype=np.float64)
        for values in (before["stiffness"], after["stiffness"], after["stiffness_std"])
    )
    found = np.full((2, sigma.size), np.nan)
    found[:, every] = (now - sigma[every]) ** 2 / sigma[every] ** 2, std**2 / sigma[every] ** 2
    found[:, ~np.isfinite(found).all(axis=0)] = np.nan
    return found[0], found[1]
