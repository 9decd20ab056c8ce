"""An estimator in a control loop."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from vsalog.binding.drive_model import made_of
from vsalog.binding.joint import bind, offered_roles
from vsalog.binding.neighbours import own_and_others
from vsalog.binding.sensor_model import seen_by
from vsalog.core.errors import EstimatorError
from vsalog.core.live_estimator import Said
from vsalog.core.recording import Recording
from vsalog.core.signals import JointSignals
from vsalog.estimation.joint import choose
from vsalog.estimators.device import device_of
from vsalog.rig.schema import RigFile
from vsalog.simulation.channels import is_lever_arm


class LiveEstimate:
    """An estimator that is given samples one by one; see `vsalog.core.live_estimator.LiveEstimator`.

    Parameters
    ----------
    rig : as the estimator assumes it
    joint : in it
    estimator : name
    tune : NAME → VALUE
    """

    def __init__(self, rig: RigFile, joint: str, estimator: str, tune: Mapping[str, str]) -> None:
        self.rig, self.joint = rig, joint
        self.choice = choose(joint, rig.joint[joint], estimator, tune, rig)
        own, others = own_and_others(self.choice.roles, rig.joint)
        self.neighbours = others
        self.reads: dict[str, Collection[str]] = {joint: own, **{name: roles for name, (_, roles) in others.items()}}
        self.fold: Any = None
        self.state: Any = None

    def prepare(self, dry: Recording) -> None:
        """Build the estimator for signals like those of a run without feedback."""
        joint = self.rig.joint[self.joint]
        signals = bind([dry], self.joint, joint, self.reads[self.joint], neighbours=self.neighbours)
        device = device_of(self.joint, joint, signals.roles, self.rig)
        self.fold = self.choice.method.build(device, signals, self.choice.tuning)
        if self.fold.passes > 1:
            raise EstimatorError(f"joint '{self.joint}': {self.choice.name} reads a log twice; it cannot be in a loop")
        self.state, self.period = self.fold.start(), signals.period

    def take(self, k: int, said: Said) -> dict[str, float]:
        """Return the estimate after sample `k`; empty while there is none."""
        roles = {}
        for name, wanted in self.reads.items():
            offered = offered_roles(self.rig.joint[name])
            for role in wanted:
                sensor, value = offered[role], said[name][role]
                true = seen_by(np.array([value]), sensor, np.array([k * self.period]) if sensor.drift else None)[0]
                if role == "motor_torque":
                    driven: Any = self.rig.joint[name]
                    true = made_of(true, driven.motor.reflected)
                lever = getattr(self.rig.joint[name], "lever", None) if role == "setpoint" else None
                if lever is not None and not is_lever_arm(role, sensor):
                    true = lever.arm(true)
                roles[role if name == self.joint else f"{name}/{role}"] = true
        block = JointSignals(
            self.joint, self.period, np.array([round(k * self.period * 1e9)], dtype=np.int64), np.array([k * self.period]), roles,
            np.array([k == 0]), np.zeros(1, dtype=np.int32),
        )  # fmt: skip
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            self.state, traces = self.fold.step(self.state, block)
        if not traces:
            return {}
        columns = traces[-1]["total"]
        return {name: float(values[-1]) for name, values in columns.items() if np.ndim(values) == 1 and len(values)}
