"""Key figures of a trace, gathered block by block."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import partial

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimation.external_stiffness import COLUMN
from vsalog.estimators.device import Device
from vsalog.estimators.equation import MOST_OF_LOG, NEGLIGIBLE_SHARE, SUPPORTED_SHARE
from vsalog.uncertainty.sensor_error import ENOUGH

Array = NDArray[np.float64]


class TransmissionSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Key figures of one transmission ("1", "2") or of the device ("total"); None where the log does not determine them.

    Attributes
    ----------
    transmission : name
    samples : rows of the trace
    excited_share : share of them at which the estimate is excited by the data so far
    stiffness_low, stiffness_high : 1 % and 99 % quantile over the excited rows [N·m/rad]
    stiffness_last : at the last of them [N·m/rad]
    negative_share : share of all rows with a stiffness that is negative beyond its uncertainty
    relative_std : root mean square of stiffness_std / stiffness over the excited rows
    fit_rms : of the measured minus the fitted flexibility torque [N·m], after the first excited row; a residual is compared with
        the fit behind the residual's own lag
    fit_mean : mean of measured minus fitted [N·m]
    fit_share : fit_rms as a share of the torque's own standard deviation
    deflection_span : greatest minus least deflection [rad]
    external_stiffness_low, external_stiffness_high : as of the stiffness, with the link's weight [N·m/rad]; of the device
    """

    transmission: str
    samples: int
    excited_share: float
    stiffness_low: float | None
    stiffness_high: float | None
    stiffness_last: float | None
    negative_share: float
    relative_std: float | None
    fit_rms: float | None
    fit_mean: float | None
    fit_share: float | None
    deflection_span: float | None
    external_stiffness_low: float | None
    external_stiffness_high: float | None


class JointSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Key figures of a joint."""

    joint: str
    duration: float
    period: float
    transmissions: tuple[TransmissionSummary, ...]


@dataclass(slots=True)
class _Kept:
    """Thinned samples for quantiles, of bounded size however long the log is."""

    seen: list[Array] = field(default_factory=list)
    every: int = 1

    def add(self, values: Array) -> None:
        """Keep some of a block's values."""
        self.seen.append(values[:: self.every].copy())
        if sum(x.size for x in self.seen) > ENOUGH:
            self.seen = [np.concatenate(self.seen)[::2]]
            self.every *= 2

    def range(self) -> tuple[float | None, float | None]:
        """Return the 1 % and the 99 % quantile; None where there is nothing."""
        values = np.concatenate(self.seen) if self.seen else np.empty(0)
        low, high = np.quantile(values, (0.01, 0.99)) if values.size else (np.nan, np.nan)
        return _known(low), _known(high)


@dataclass(slots=True)
class _Sums:
    samples: int = 0
    excited: int = 0
    estimated: int = 0
    uncertain: int = 0
    precise: int = 0
    stiffness: _Kept = field(default_factory=_Kept)
    external: _Kept = field(default_factory=_Kept)
    negative: int = 0
    last: float = np.nan
    relative: float = 0.0
    fit_count: int = 0
    fit_square: float = 0.0
    fit_sum: float = 0.0
    torque_sum: float = 0.0
    torque_square: float = 0.0
    phi_low: float = np.inf
    phi_high: float = -np.inf


class Summarizer:
    """Gather key figures from the blocks of a trace."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.sums: dict[str, _Sums] = {}

    def add(self, trace: Trace) -> None:
        """Take a block into account."""
        for name, columns in trace.transmissions.items():
            s = self.sums.setdefault(name, _Sums())
            excited = np.asarray(columns["excited"], dtype=bool)
            sigma, std = np.asarray(columns["stiffness"], float), np.asarray(columns["stiffness_std"], float)
            s.samples += len(trace)
            with np.errstate(invalid="ignore"):
                # A stiffness below zero never counts as excited, however well it is known.
                s.negative += int(np.count_nonzero(SUPPORTED_SHARE * sigma < -std))
                s.estimated += int(np.count_nonzero(np.isfinite(sigma)))
                s.uncertain += int(np.count_nonzero(np.isfinite(sigma) & ~np.isnan(std)))
                s.precise += int(np.count_nonzero(std < SUPPORTED_SHARE * sigma))
            if excited.any():
                s.stiffness.add(sigma[excited])
                if COLUMN in columns:
                    external = np.asarray(columns[COLUMN], float)[excited]
                    s.external.add(external[np.isfinite(external)])
                s.last = float(sigma[excited][-1])
                s.relative += float(np.sum((std[excited] / sigma[excited]) ** 2))
            phi = np.asarray(columns["deflection"], float)
            if np.isfinite(phi).any():
                s.phi_low, s.phi_high = min(s.phi_low, np.nanmin(phi)), max(s.phi_high, np.nanmax(phi))
            fed = np.asarray(columns.get("residual", columns["flexibility_torque"]), float)
            fit = np.asarray(columns.get("residual_fit", columns["flexibility_torque_fit"]), float)
            both = np.isfinite(fed) & np.isfinite(fit)
            if not s.excited:
                # Before anything is known the fit's error has no meaning.
                both &= np.logical_or.accumulate(excited)
            s.excited += int(np.count_nonzero(excited))
            s.fit_count += int(np.count_nonzero(both))
            s.fit_square += float(np.sum((fed - fit)[both] ** 2))
            s.fit_sum += float(np.sum((fed - fit)[both]))
            s.torque_sum += float(np.sum(fed[both]))
            s.torque_square += float(np.sum(fed[both] ** 2))

    def too_short(self) -> set[str]:
        """Return the transmissions for which the log ends too early.

        A stiffness has no standard deviation yet, which takes `samples_until_known`; or one that is small enough, but not the
        samples after which a deflection counts as covered.
        """
        waiting = {name: s for name, s in self.sums.items() if s.estimated and not s.excited}
        return {name for name, s in waiting.items() if s.precise or not s.uncertain}

    def result(self, signals: JointSignals) -> JointSummary:
        """Return the figures."""
        parts = tuple(_figures(name, s) for name, s in self.sums.items())
        return JointSummary(
            joint=self.device.joint,
            duration=len(signals) * signals.period,
            period=signals.period,
            transmissions=parts,
        )


def _figures(name: str, s: _Sums) -> TransmissionSummary:
    fit = (s.fit_square / s.fit_count) ** 0.5 if s.fit_count else None
    spread = max(s.torque_square / s.fit_count - (s.torque_sum / s.fit_count) ** 2, 0.0) ** 0.5 if s.fit_count else 0.0
    (low, high), (external_low, external_high) = s.stiffness.range(), s.external.range()
    return TransmissionSummary(
        transmission=name,
        samples=s.samples,
        excited_share=s.excited / s.samples if s.samples else 0.0,
        stiffness_low=low,
        stiffness_high=high,
        stiffness_last=_known(s.last),
        negative_share=s.negative / s.samples if s.samples else 0.0,
        relative_std=(s.relative / s.excited) ** 0.5 if s.excited else None,
        fit_rms=fit,
        fit_mean=s.fit_sum / s.fit_count if s.fit_count else None,
        fit_share=fit / spread if fit is not None and spread > 0.0 else None,
        deflection_span=_known(s.phi_high - s.phi_low),
        external_stiffness_low=external_low,
        external_stiffness_high=external_high,
    )


def _known(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def findings_of(
    summary: JointSummary, device: Device, whole: float, void: Collection[str] = (), short: Collection[str] = ()
) -> Iterator[Finding]:
    """Yield the findings from the key figures.

    Parameters
    ----------
    summary, device : of a joint
    whole : the share of the filters' windows in which no sample is missing
    void : transmissions whose estimate another finding invalidates
    short : transmissions for which the log ends too early
    """
    odd = 0 not in device.basis.powers
    for p in (p for p in summary.transmissions if p.transmission != "total"):
        found = partial(Finding, joint=summary.joint, part=p.transmission)
        if p.excited_share < MOST_OF_LOG and whole < MOST_OF_LOG:
            # Missing samples are why the log is not excited.
            yield found(code="estimate.torn", value=whole, limit=MOST_OF_LOG)
        elif p.excited_share == 0.0 and p.negative_share < NEGLIGIBLE_SHARE and p.transmission not in void:
            never = partial(found, severity="invalidates")
            if p.transmission in short:
                yield never(code="estimate.too_short", value=summary.duration, unit="s")
            else:
                code = "estimate.never_excited" if p.fit_rms is None else "estimate.fit_never_excited"
                yield never(code=code, value=p.excited_share, limit=0.0)
        elif 0.0 < p.excited_share < MOST_OF_LOG:
            yield found(code="estimate.partly_excited", severity="info", value=p.excited_share, limit=MOST_OF_LOG)
        if odd and p.fit_mean and p.fit_rms and p.fit_share:
            limit = max(0.5, NEGLIGIBLE_SHARE / p.fit_share) * p.fit_rms
            if abs(p.fit_mean) > limit:
                yield found(code="fit.offset", value=p.fit_mean, limit=limit, unit="N*m")
        if p.negative_share > NEGLIGIBLE_SHARE:
            # A sign is wrong.
            yield found(code="stiffness.negative", value=p.negative_share, limit=NEGLIGIBLE_SHARE)
