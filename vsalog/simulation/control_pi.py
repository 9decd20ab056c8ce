"""A proportional and integral controller of two pneumatic muscles, on a sensor or on what a filter makes of the pressures."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from vsalog.core.live_estimator import Said
from vsalog.core.recording import Recording
from vsalog.rig.schema import RigFile
from vsalog.simulation.control import PiControl
from vsalog.simulation.control_loop import EstimatorFactory, Truth, made
from vsalog.simulation.inputs import at_samples

Array = NDArray[np.float64]

VALVES = ("valve_1", "valve_2")
# A filter's names of the controlled quantities.
COLUMNS = {"link_position": "link_position", "torque_sensor": "flexibility_torque"}


class PiLoop:
    """u = bias ± (T_P e + T_I ∫ e dt), e = reference − what is fed back (Shin 2021 §IV-C).

    The paper writes the integral as a sum of samples times T_I / T_step; as a gain per second T_I is what moves a valve by some
    volts within a step of its references, and is taken so. The integral stops while a valve is at its end.

    Parameters
    ----------
    rig, name : the nominal rig, and the joint in it
    control : as asked for
    time : shape (N,), uniform [s]
    estimator : makes what the controller reads, where that is no sensor
    """

    def __init__(
        self, rig: RigFile, name: str, control: PiControl, time: Array, estimator: EstimatorFactory | None = None
    ) -> None:
        self.name, self.control, self.period = name, control, float(time[1] - time[0])
        self.reference = at_samples(control.reference, time)
        self.commands = {role: np.full(time.size, control.bias) for role in VALVES}
        self.watcher = None
        if control.feedback != "sensor":
            self.watcher = made(estimator, rig, name, control.feedback, control.tune)
        self.reads: Mapping[str, Collection[str]] = (
            {name: (control.of,)} if self.watcher is None else self.watcher.reads
        )
        self.integral, self.last = 0.0, 0.0

    def prepare(self, dry: Recording) -> None:
        """Look at a run at the bias."""
        if self.watcher is not None:
            self.watcher.prepare(dry)

    def act(self, k: int, readings: Said, truth: Truth) -> None:
        """Command the valves for sample k + 1."""
        control = self.control
        if self.watcher is None:
            fed_back = readings[self.name][control.of]
        else:
            fed_back = self.watcher.take(k, readings).get(COLUMNS[control.of], np.nan)
        # Where nothing is known, the last value is held.
        self.last = fed_back = fed_back if np.isfinite(fed_back) else self.last
        error = float(self.reference[k]) - fed_back
        moved = self.integral + error * self.period
        low, high = control.limits
        asked = control.proportional * error + control.integral * moved
        reach = min(high - control.bias, control.bias - low)
        if abs(asked) < reach or error * asked < 0.0:
            self.integral = moved
        u = float(np.clip(control.proportional * error + control.integral * self.integral, -reach, reach))
        if k + 1 < self.reference.size:
            self.commands["valve_1"][k + 1] = control.bias + u
            self.commands["valve_2"][k + 1] = control.bias - u
