"""The experiments of the papers, ready to run: VSA-II, AwAS, and an elastic joint.

Values that a paper prints are cited; the others are marked as chosen. Sensors are those of the presets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypedDict, Unpack

import numpy as np
from msgspec.structs import replace as changed
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.rig import Rig
from vsalog.rig.schema import (
    AntagonisticJoint,
    AwasTransmission,
    ElasticJoint,
    Joint,
    Motor,
    RigFile,
    SerialJoint,
    Transmission,
    Vsa2Transmission,
)
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.inputs import Input, sine, soft_square, sum_of
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]
Torques = Mapping[int, Mapping[str, Callable[[Array], Array]]]


def vsa2_rig() -> RigFile:
    """Return the VSA-II of Flacco 2012 §6.1, the preset ``vsa2``."""
    return Rig.preset("vsa2").file


def awas_rig() -> RigFile:
    """Return the AwAS of Flacco 2012 §6.2, the preset ``awas``."""
    return Rig.preset("awas").file


def elastic_rig(transmission: Transmission | None = None) -> RigFile:
    """Return a series elastic joint that hangs, the preset ``sea``.

    Parameters
    ----------
    transmission : instead of the preset's hardening spring
    """
    rig = Rig.preset("sea").file
    joint = rig.joint["sea"]
    assert isinstance(joint, ElasticJoint)
    return rig if transmission is None else changed(rig, joint={"sea": changed(joint, transmission=transmission)})


# The second experiment of each has other inputs: what a model fitted to the first is validated with. Chosen.
_VSA2_TORQUES: Torques = {
    1: {"motor_torque_1": sine(0.05, 0.05), "motor_torque_2": sine(0.05, 1.0)},
    2: {
        "motor_torque_1": sine(0.035, 0.13),
        "motor_torque_2": sum_of(sine(-0.035, 0.13), sine(0.050, 1.4)),
    },
}
_AWAS_TORQUES: Torques = {
    1: {"motor_torque": sine(15.0, 0.1), "secondary_torque": soft_square(200.0, 10.0, 0.05)},
    2: {
        "motor_torque": sum_of(sine(6.0, 0.23), sine(1.0, 0.9)),
        "secondary_torque": soft_square(265.0, 10.0, 0.6),
    },
}
_ELASTIC_TORQUES: Torques = {
    1: {"motor_torque": sum_of(sine(2.0, 0.2), sine(1.0, 1.3))},
    2: {"motor_torque": sum_of(sine(1.6, 0.37), sine(1.2, 0.8))},
}


class Play(TypedDict, total=False):
    """Options of an experiment: without quantisation and noise, the noise's seed, duration and period [s], other torques."""

    ideal: bool
    seed: int
    duration: float
    period: float
    torques: Mapping[str, Input] | None


def vsa2_experiment(
    number: int = 1, *, drift: float = 0.0, inertia: float | None = None, damping: float | None = None,
    rig: RigFile | None = None, **play: Unpack[Play],
) -> Experiment:  # fmt: skip
    """Run the VSA-II (Flacco 2012 §6.1; Flacco 2014 §V with `drift`, `inertia` and `damping`).

    Parameters
    ----------
    number : 1 for the paper's torques, 50 sin 0.1πt and 50 sin 2πt N·mm; 2 for others, to validate with
    drift : ∂k/∂t of both springs [N·m/rad/s]; Flacco 2014 has 0.5e-6
    inertia, damping : of both motors as they are [kg·m²], [N·m·s/rad], where they differ from the rig's;
        Flacco 2014 has 7.5e-3 and 0.9e-3
    rig : instead of the preset, such as with other sensors
    play : 20 s at 1 kHz with the paper's torques unless stated otherwise
    """
    believed = vsa2_rig() if rig is None else rig
    joint = believed.joint["vsa2"]
    assert isinstance(joint, AntagonisticJoint)
    motor, spring = _altered(joint.motor_1, inertia, damping), joint.transmission_1
    assert isinstance(spring, Vsa2Transmission)
    drifting = changed(spring, drift=drift / spring.stiffness)
    actual = changed(joint, motor_1=motor, motor_2=motor, transmission_1=drifting, transmission_2=drifting)
    return _played(believed, "vsa2", actual, number, _VSA2_TORQUES, **play)


def awas_experiment(
    number: int = 1, *, drift: float = 0.0, inertia: float | None = None, damping: float | None = None,
    rig: RigFile | None = None, **play: Unpack[Play],
) -> Experiment:  # fmt: skip
    """Run the AwAS (Flacco 2012 §6.2).

    Parameters
    ----------
    number : 1 for the paper's motor torque, 0.3 sin 0.2πt N·m on the rotor (15 on the joint's side), and a secondary
        torque that moves the lever arm between 47 and 100 mm; 2 for others, to validate with
    drift : ∂k_s/∂t of the springs [N/m/s]
    inertia, damping : of the primary motor's rotor as they are, where they differ from the rig's
    rig, play : as for `vsa2_experiment`
    """
    believed = awas_rig() if rig is None else rig
    joint = believed.joint["awas"]
    assert isinstance(joint, SerialJoint)
    spring = joint.transmission
    assert isinstance(spring, AwasTransmission)
    drifting = changed(spring, drift=drift / spring.spring_stiffness)
    actual = changed(joint, motor=_altered(joint.motor, inertia, damping), transmission=drifting)
    return _played(believed, "awas", actual, number, _AWAS_TORQUES, **play)


def elastic_experiment(
    number: int = 1, *, transmission: Transmission | None = None, **play: Unpack[Play]
) -> Experiment:
    """Run a series elastic joint that hangs under gravity (Flacco 2012 eq. 3–4), 500 Hz, all values chosen.

    Parameters
    ----------
    number : 1 or 2, two sets of torques
    transmission : as for `elastic_rig`
    play : as for `vsa2_experiment`
    """
    rig, slower = elastic_rig(transmission), Play(period=2e-3)
    slower.update(play)
    return _played(rig, "sea", rig.joint["sea"], number, _ELASTIC_TORQUES, **slower)


def _played(
    believed: RigFile, name: str, actual: Joint, number: int, table: Torques, *, ideal: bool = False, seed: int = 1,
    duration: float = 20.0, period: float = 1e-3, torques: Mapping[str, Input] | None = None,
) -> Experiment:  # fmt: skip
    """Simulate the joint as it is, with the log carrying the nominal rig."""
    if number not in table:
        raise SimulationError(f"there is no experiment {number}, only {', '.join(map(str, table))}")
    machine, label = changed(believed, joint={name: actual}), f"{name}_exp{number}"
    inputs = {name: torques or table[number]}
    simulated = simulate(machine, inputs, duration, period=period, seed=seed, ideal=ideal, name=label)
    return replace(simulated, rig=believed)


def _altered(motor: Motor, inertia: float | None, damping: float | None) -> Motor:
    return changed(
        motor,
        inertia=motor.inertia if inertia is None else inertia,
        damping=motor.damping if damping is None else damping,
    )
