"""Controllers in the loop: they receive the sensors' readings, sample by sample, and an estimator's results.

A controller receives each sample when it is over, and what it commands then is held in the next one: it is late by one sample, as
a digital controller is that computes for as long. It knows the joint as the rig has it, not as the machine is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.core.live_estimator import LiveEstimator, Said
from vsalog.core.recording import Recording
from vsalog.rig.schema import RigFile
from vsalog.simulation.inputs import Servo
from vsalog.simulation.sensors import LiveSensors

Array = NDArray[np.float64]
Truth = Mapping[str, Mapping[str, Array]]
# Makes an estimator: the nominal rig, a joint in it, the estimator's name, NAME → VALUE to tune it.
EstimatorFactory = Callable[[RigFile, str, str, Mapping[str, str]], LiveEstimator]


class Loop(Protocol):
    """A controller that runs.

    Attributes
    ----------
    commands : role → shape (N,), what it commands, or a motor's position loop whose reference, shape (N, 2), it writes; filled as
        time goes on; first all of it is the command without feedback
    reads : joint → roles of the sensors that it needs
    """

    reads: Mapping[str, Collection[str]]

    @property
    def commands(self) -> Mapping[str, Array | Servo]:
        """What it commands."""
        ...

    def prepare(self, dry: Recording) -> None:
        """Look at a run without feedback, from which the estimator learns how noisy its sensors are."""
        ...

    def act(self, k: int, readings: Said, truth: Truth) -> None:
        """Take the sensors' readings of sample `k`, and command sample k + 1."""
        ...


def made(
    estimator: EstimatorFactory | None, rig: RigFile, joint: str, name: str, tune: Mapping[str, str]
) -> LiveEstimator:
    """Return the estimator of this name for a joint of the rig.

    Raises
    ------
    SimulationError
        No estimators were given.
    """
    if estimator is None:
        raise SimulationError(f"joint '{joint}': its controller reads '{name}', and no estimators were given")
    return estimator(rig, joint, name, tune)


class Controlled:
    """All controllers of a rig, which receive its joints sample by sample."""

    def __init__(self, loops: Mapping[str, Loop], rig: RigFile, time: Array, seed: int, ideal: bool) -> None:
        self.loops = loops
        wanted: dict[str, list[str]] = {}
        for loop in loops.values():
            for name, roles in loop.reads.items():
                wanted[name] = list(dict.fromkeys([*wanted.get(name, []), *roles]))
        self.sensors = LiveSensors(rig, wanted, time, seed, ideal)

    def __call__(self, k: int, truth: Truth) -> None:
        """Read the sensors of these joints at sample `k`, and have their controllers act."""
        readings = self.sensors.read(k, truth)
        for name in truth.keys() & self.loops.keys():
            self.loops[name].act(k, readings, truth)
