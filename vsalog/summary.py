"""Key figures of a trace, gathered while it goes by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from vsalog.estimators.device import Device
from vsalog.trace import Trace

if TYPE_CHECKING:
    from vsalog.filters.conditioning import Conditioner
    from vsalog.signals import JointSignals


class TransmissionSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Key figures of one transmission ("1", "2") or of the device ("total"); None where the log cannot tell.

    Attributes
    ----------
    transmission : name
    samples : rows of the trace
    excited_share : share of them at which the estimate is supported by the data so far
    stiffness_min, stiffness_max, stiffness_last : over the supported rows [N·m/rad]
    relative_std : root mean square of stiffness_std / stiffness over the supported rows
    fit_rms : of the flexibility torque fed minus fitted [N·m], after the first supported row
    fit_share : the same as a share of the torque's own standard deviation
    deflection_span : greatest minus least deflection [rad]
    """

    transmission: str
    samples: int
    excited_share: float
    stiffness_min: float | None
    stiffness_max: float | None
    stiffness_last: float | None
    relative_std: float | None
    fit_rms: float | None
    fit_share: float | None
    deflection_span: float | None


class JointSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Key figures of a joint, and what is to be said about them."""

    joint: str
    duration: float
    period: float
    transmissions: tuple[TransmissionSummary, ...]
    warnings: tuple[str, ...]


@dataclass(slots=True)
class _Sums:
    samples: int = 0
    excited: int = 0
    low: float = np.inf
    high: float = -np.inf
    last: float = np.nan
    relative: float = 0.0
    fit_count: int = 0
    fit_square: float = 0.0
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
            if excited.any():
                s.low, s.high = min(s.low, sigma[excited].min()), max(s.high, sigma[excited].max())
                s.last = float(sigma[excited][-1])
                s.relative += float(np.sum((std[excited] / sigma[excited]) ** 2))
            phi = np.asarray(columns["deflection"], float)
            if np.isfinite(phi).any():
                s.phi_low, s.phi_high = min(s.phi_low, np.nanmin(phi)), max(s.phi_high, np.nanmax(phi))
            fed = np.asarray(columns["flexibility_torque"], float)
            fit = np.asarray(columns["flexibility_torque_fit"], float)
            both = np.isfinite(fed) & np.isfinite(fit)
            if not s.excited:
                # Before anything is known the fit's error says nothing about the fit.
                both &= np.logical_or.accumulate(excited)
            s.excited += int(np.count_nonzero(excited))
            s.fit_count += int(np.count_nonzero(both))
            s.fit_square += float(np.sum((fed - fit)[both] ** 2))
            s.torque_sum += float(np.sum(fed[both]))
            s.torque_square += float(np.sum(fed[both] ** 2))

    def result(self, conditioner: Conditioner, signals: JointSignals) -> JointSummary:
        """Return the figures."""
        parts = tuple(_figures(name, s) for name, s in self.sums.items())
        return JointSummary(
            joint=self.device.joint,
            duration=len(signals) * signals.period,
            period=signals.period,
            transmissions=parts,
            warnings=tuple(_warnings(self.device.joint, parts)),
        )


def _figures(name: str, s: _Sums) -> TransmissionSummary:
    fit = (s.fit_square / s.fit_count) ** 0.5 if s.fit_count else None
    spread = (
        max(s.torque_square / s.fit_count - (s.torque_sum / s.fit_count) ** 2, 0.0) ** 0.5 if s.fit_count else 0.0
    )
    return TransmissionSummary(
        transmission=name,
        samples=s.samples,
        excited_share=s.excited / s.samples if s.samples else 0.0,
        stiffness_min=_known(s.low),
        stiffness_max=_known(s.high),
        stiffness_last=_known(s.last),
        relative_std=(s.relative / s.excited) ** 0.5 if s.excited else None,
        fit_rms=fit,
        fit_share=fit / spread if fit is not None and spread > 0.0 else None,
        deflection_span=_known(s.phi_high - s.phi_low),
    )


def _known(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def _warnings(joint: str, parts: tuple[TransmissionSummary, ...]) -> list[str]:
    warnings = []
    for p in parts:
        where = f"joint '{joint}', transmission {p.transmission}"
        if p.transmission == "total":
            continue
        if p.excited_share == 0.0:
            warnings.append(
                f"{where}: the data never support an estimate (standard deviation above a fifth of the stiffness"
                " everywhere): move the joint more, or fit fewer terms ([joint.….basis] order in the rig)"
            )
        elif p.excited_share < 0.5:
            warnings.append(
                f"{where}: the estimate is supported by the data for {p.excited_share:.0%} of the time only"
                " (column excited)"
            )
        if p.stiffness_min is not None and p.stiffness_min < 0.0:
            warnings.append(
                f"{where}: a negative stiffness ({p.stiffness_min:.4g} N·m/rad) was estimated: check the signs of the"
                " torque and of the positions in the rig (sign = -1)"
            )
    return warnings
