"""Simulates a joint of two pneumatic muscles: valve voltages in, the truth out."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError, did_you_mean
from vsalog.mechanics._pneumatic_joint import (
    integrate_pam,
)
from vsalog.mechanics.pneumatic_friction import friction_level, viscous_coefficient
from vsalog.mechanics.pneumatic_numbers import air_numbers, friction_numbers, muscle_numbers, seesaw_numbers
from vsalog.mechanics.pneumatics import (
    isobaric_stiffness,
    joint_torque,
    mode_index,
    muscle_lengths,
    muscle_pulls,
    muscle_volume,
    resting_angle,
    resting_pressure,
    trapped_stiffness,
    valve_opening,
)
from vsalog.rig.schema import (
    PneumaticJoint,
)
from vsalog.simulation.accuracy import FINE, Accuracy
from vsalog.simulation.inputs import TorqueInput, at_samples, at_steps
from vsalog.simulation.machine import MOST_STEPS

Array = NDArray[np.float64]

INPUTS = ("valve_1", "valve_2", "external_torque")


def simulate_pneumatic(
    joint: PneumaticJoint,
    inputs: Mapping[str, TorqueInput],
    time: Array,
    steps: int | None = None,
    start: Array | None = None,
    control: Callable[[int, Mapping[str, Array]], None] | None = None,
) -> dict[str, Array]:
    """Simulate a pneumatic joint (Shin, Ibayashi, Kogiso 2021 eq. 11).

    Parameters
    ----------
    joint : of the rig
    inputs : ``valve_1`` and ``valve_2`` [V], and ``external_torque`` [N·m], zero when absent: a continuous function of an array
        of times, a number, or one value per sample (N) that is held until the next
    time : shape (N,), N ≥ 2, uniform [s]
    steps : integration steps per sample; as many as the seesaw's swinging needs when absent
    start : (ψ, ψ̇, P₁, P₂) [rad, rad/s, Pa, Pa]; when absent, rest under the first valve voltages and external torque: the
        pressures at which no air flows and the angle at which the torques cancel, friction aside
    control : called with sample and name → truth, shape (1,), of each sample when it is over, to write what is held in the next
        one into an input that is an array

    Returns
    -------
    name → shape (N,): ``link_position``, ``link_velocity``, ``link_acceleration``, ``pressure_1``, ``pressure_2``, ``valve_1``,
    ``valve_2`` (as commanded), ``muscle_force_1``, ``muscle_force_2``, ``transmission_torque`` (τ, what a torque meter on the
    joint reads), ``friction_torque`` (T_f; the holding torque where the joint sticks, 0 where it is clamped), ``stiffness``
    (−dτ/dψ with the air locked in), ``stiffness_isobaric`` (at constant pressures), ``external_torque``, ``mode`` (1 to 18)

    Raises
    ------
    SimulationError
        An input is missing, unknown or does not fit, the joint has no rest position to start from, or its motion leaves the
        range in which the muscles' volumes are positive.
    """
    for name in inputs:
        if name not in INPUTS:
            hint = did_you_mean(name, INPUTS) or "."
            raise SimulationError(f"a pneumatic joint has no input '{name}'{hint} (inputs: {', '.join(INPUTS)})")
    for name in INPUTS[:2]:
        if name not in inputs:
            raise SimulationError(f"the input '{name}' is missing: a valve needs a voltage [V]")
    if time.ndim != 1 or time.size < 2:
        raise SimulationError("a simulation needs at least two samples")
    external = inputs.get("external_torque", 0.0)
    voltages = [at_samples(inputs[name], time) for name in INPUTS[:2]]
    push = at_samples(external, time)
    state = _start(joint, start, voltages, push)
    period = float(time[1] - time[0])
    if not period > 0.0:
        raise SimulationError("the samples' times have to rise")
    if steps is None:
        steps = needed_steps(joint, state, period)
    if steps < 1:
        raise SimulationError("a simulation needs at least one step per sample")
    muscles = [muscle_numbers(joint.muscle_1, joint.valve_1), muscle_numbers(joint.muscle_2, joint.valve_2)]
    plant = (
        period / steps, air_numbers(joint), np.array(muscles), seesaw_numbers(joint), friction_numbers(joint),
        joint.seesaw.held_at is not None,
    )  # fmt: skip

    all_inputs = {**inputs, "external_torque": external}

    def moved(state: Array, part: slice) -> Array:
        given = {
            role: values if callable(values) else at_samples(values, time)[part] for role, values in all_inputs.items()
        }
        driven = [
            valve_opening(valve, at_steps(given[name], time[part], steps))
            for valve, name in ((joint.valve_1, "valve_1"), (joint.valve_2, "valve_2"))
        ]
        push = at_steps(given["external_torque"], time[part], steps)
        return np.asarray(integrate_pam(state, np.stack([*driven, push]), *plant))

    if control is None:
        states = moved(state, slice(None))
    else:
        states = np.empty((time.size, state.size))
        states[0] = state
        for k in range(time.size - 1):
            states[k + 1] = moved(states[k], slice(k, k + 2))[1]
            over = slice(k, k + 1)
            sample = _truth(joint, states[over], push[over])
            control(k, sample | {name: at_samples(inputs[name], time)[over] for name in INPUTS[:2]})
        voltages = [at_samples(inputs[name], time) for name in INPUTS[:2]]
    _require_finite(joint, states, time)
    return {**_truth(joint, states, push), "valve_1": voltages[0], "valve_2": voltages[1]}


def _truth(joint: PneumaticJoint, states: Array, external: Array) -> dict[str, Array]:
    psi, velocity, p1, p2 = (np.ascontiguousarray(column) for column in states.T)
    f1, f2 = muscle_pulls(joint, psi, p1, p2)
    torque = joint_torque(joint, psi, p1, p2)
    drive = torque - joint.seesaw.return_stiffness * psi + external
    level = friction_level(joint, p1, p2, f1, f2, velocity)
    if joint.seesaw.held_at is not None:
        slipping, friction, acceleration = np.zeros(psi.shape, np.bool_), np.zeros_like(psi), np.zeros_like(psi)
    elif joint.friction is None:
        slipping, friction = np.ones(psi.shape, np.bool_), np.zeros_like(psi)
        acceleration = drive / joint.seesaw.inertia
    else:
        # A drive that is above the level by rounding alone sticks: its velocity is exactly zero.
        slipping = (velocity != 0.0) | (np.abs(drive) > level * (1.0 + 16.0 * np.finfo(np.float64).eps))
        way = np.where(velocity != 0.0, np.sign(velocity), np.sign(drive))
        friction = np.where(slipping, viscous_coefficient(joint) * velocity + way * level, drive)
        acceleration = (drive - friction) / joint.seesaw.inertia
    return {
        "link_position": psi,
        "link_velocity": velocity,
        "link_acceleration": acceleration,
        "pressure_1": p1,
        "pressure_2": p2,
        "muscle_force_1": f1,
        "muscle_force_2": f2,
        "transmission_torque": torque,
        "friction_torque": friction,
        "stiffness": trapped_stiffness(joint, psi, p1, p2),
        "stiffness_isobaric": isobaric_stiffness(joint, psi, p1, p2),
        "external_torque": external,
        "mode": mode_index(joint.air, p1, p2, slipping),
    }


def _start(joint: PneumaticJoint, start: Array | None, voltages: list[Array], external: Array) -> Array:
    held = joint.seesaw.held_at
    if start is not None:
        state = np.array(start, dtype=np.float64)
        if state.shape != (4,) or not bool(np.all(np.isfinite(state))) or not (state[2:] > 0.0).all():
            raise SimulationError(
                "a pneumatic joint starts from (ψ, ψ̇, P₁, P₂) in SI, four finite numbers, pressures above 0"
            )
        if held is not None:
            state[:2] = held, 0.0
    else:
        pairs = ((joint.valve_1, joint.muscle_1), (joint.valve_2, joint.muscle_2))
        openings = (float(valve_opening(valve, u[0])) for (valve, _), u in zip(pairs, voltages, strict=True))
        p1, p2 = (
            resting_pressure(joint.air, valve, muscle, opening)
            for (valve, muscle), opening in zip(pairs, openings, strict=True)
        )
        state = np.array([resting_angle(joint, p1, p2, float(external[0])), 0.0, p1, p2])
    volumes = [
        muscle_volume(m, x)
        for m, x in zip((joint.muscle_1, joint.muscle_2), muscle_lengths(joint, state[0]), strict=True)
    ]
    if min(float(v) for v in volumes) <= 0.0:
        raise SimulationError(
            f"at the angle {state[0]:.4g} rad a muscle's volume would not be positive; give another start"
        )
    return state


def needed_steps(joint: PneumaticJoint, state: Array, period: float, accuracy: Accuracy = FINE) -> int:
    """Return how many steps per sample the seesaw's swinging, its damping and the filling of the muscles need."""
    pressure = joint.air.supply_pressure
    stiffest = max(
        abs(float(trapped_stiffness(joint, psi, p1, p2)))
        for psi, p1, p2 in ((float(state[0]), float(state[2]), float(state[3])), (0.0, pressure, pressure))
    )
    inertia = joint.seesaw.inertia
    # Away from the start the spring may be twice as stiff; the error falls with the fourth power of the step.
    swing = np.sqrt((2.0 * stiffest + abs(joint.seesaw.return_stiffness)) / inertia)
    filling = 0.0
    for muscle, valve in ((joint.muscle_1, joint.valve_1), (joint.muscle_2, joint.valve_2)):
        area = valve.area_scale * max(valve.inflow_area, valve.outflow_area) + muscle.leak_area
        sound = np.sqrt(joint.air.gas_constant * joint.air.temperature)
        filling += joint.air.inflow_index * sound * area / float(muscle_volume(muscle, muscle.length))
    settling = max(viscous_coefficient(joint) / inertia, filling)
    needed = max(swing / accuracy.angle, settling / accuracy.decay) * period
    if not needed <= MOST_STEPS:
        raise SimulationError(
            f"the joint would need {needed:.3g} integration steps per sample; are the units of its inertia, areas and volumes"
            " right?"
        )
    return max(1, int(np.ceil(needed)))


def _require_finite(joint: PneumaticJoint, states: Array, time: Array) -> None:
    finite = np.isfinite(states).all(axis=1)
    if bool(finite.all()):
        return
    last = int(np.argmin(finite)) - 1
    psi, _, p1, p2 = (float(v) for v in states[last])
    raise SimulationError(
        f"after {time[last]:.6g} s the joint leaves the range of its model: at {psi:.3g} rad, {p1:.4g} and {p2:.4g} Pa a"
        " muscle's volume or pressure comes to zero. Use valve voltages that turn it less far, or check volume_… and the units"
    )
