"""pam-model: the model of pneumatic muscles alone, from the first pressures and the valves' commands; nothing corrects it.

Shin, Ibayashi, Kogiso (2021) §IV-A compare their filter with it.
"""

from __future__ import annotations

from collections.abc import Collection

from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device
from vsalog.estimators.methods.pam_ukf import PRESSURES, PamEstimate, PamTuning, estimate_of
from vsalog.estimators.methods.pam_ukf import roles as filter_roles
from vsalog.estimators.needs import require

NAME = "pam-model"
SUMMARY = "the model of pneumatic muscles alone, driven by the valves; the pressures only begin it (Shin 2021)"
TUNING = PamTuning
VALVES = ("valve_1", "valve_2")


def roles(device: Device, offered: Collection[str], tuning: PamTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    found = filter_roles(device, offered, tuning, NAME)
    require(NAME, device, (*PRESSURES, *VALVES), offered)
    return found


def build(device: Device, signals: JointSignals, tuning: PamTuning) -> PamEstimate:
    """Assemble the model for a joint's signals; raises EstimatorError as the filter does."""
    return estimate_of(NAME, device, signals, tuning, correct=False)
