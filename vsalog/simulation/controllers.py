"""The controllers of a rig's joints, set up."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.rig.schema import PneumaticJoint, RigFile
from vsalog.simulation.control import Controller, StateFeedback, StiffnessControl
from vsalog.simulation.control_loop import EstimatorFactory, Loop
from vsalog.simulation.control_pi import PiLoop
from vsalog.simulation.control_state import StateLoop
from vsalog.simulation.control_stiffness import StiffnessLoop
from vsalog.simulation.inputs import Input, Servo, at_samples

Array = NDArray[np.float64]


def loops_of(
    rig: RigFile,
    controllers: Mapping[str, Controller],
    inputs: Mapping[str, Mapping[str, Input]],
    time: Array,
    estimator: EstimatorFactory | None = None,
) -> dict[str, Loop]:
    """Return joint → its controller, ready but for a look at a run without feedback.

    Parameters
    ----------
    rig : as controllers know it
    controllers : joint → as asked for
    inputs : joint → role → what drives the other joints: where a servo holds one of a chain is where a plan takes it to be
    time : shape (N,), uniform [s]
    estimator : makes those that controllers read

    Raises
    ------
    SimulationError
        A controller does not suit its joint, or the rig lacks what it needs.
    """
    held = {n: given.reference for n, own in inputs.items() for given in own.values() if isinstance(given, Servo)}
    plans = {n: at_samples(reference, time) for n, reference in held.items()}
    plans |= {n: at_samples(c.reference, time) for n, c in controllers.items() if isinstance(c, StateFeedback)}
    loops: dict[str, Loop] = {}
    for name, control in controllers.items():
        if isinstance(control, StateFeedback):
            loops[name] = StateLoop(rig, name, control, plans, time, estimator)
        elif isinstance(control, StiffnessControl):
            loops[name] = StiffnessLoop(rig, name, control, time, estimator)
        elif isinstance(rig.joint[name], PneumaticJoint):
            loops[name] = PiLoop(rig, name, control, time, estimator)
        else:
            raise SimulationError(
                f"joint '{name}': pi_control drives the valves of a pneumatic joint, and this is none"
            )
    return loops
