"""Simulates a rig: inputs in, the sensors' recording and the truth out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.rig.schema import PneumaticJoint, RigFile, RigidJoint
from vsalog.simulation.control import Controller
from vsalog.simulation.control_loop import Controlled, EstimatorFactory, Loop
from vsalog.simulation.controllers import loops_of
from vsalog.simulation.experiment import Experiment, sample_stamps
from vsalog.simulation.inputs import Input, Motion, Servo, TorqueInput
from vsalog.simulation.machine import Movable, build
from vsalog.simulation.play import play
from vsalog.simulation.pneumatic import simulate_pneumatic
from vsalog.simulation.sensors import sense

Array = NDArray[np.float64]


def simulate(
    rig: RigFile,
    inputs: Mapping[str, Mapping[str, Input]],
    duration: float,
    *,
    period: float = 1e-3,
    steps: int | None = None,
    seed: int = 0,
    ideal: bool = False,
    start: Mapping[str, Array] | None = None,
    controllers: Mapping[str, Controller] | None = None,
    believed: RigFile | None = None,
    estimator: EstimatorFactory | None = None,
    name: str = "simulated",
) -> Experiment:
    """Move the joints of a rig and record them.

    Parameters
    ----------
    rig : the machine; motors need an inertia, transmissions a type, and there must be links. Rigid joints
        without an input stay at rest
    inputs : joint → role → what drives it, on the joint's side of the gear: a torque [N·m] as a continuous function of an
        array of times [s], or one value per sample (N), held until the next; a `Servo`; a `Motion`. Roles are
        ``motor_torque`` (elastic, serial), ``motor_torque_1`` and ``_2`` (antagonistic), ``secondary_torque`` (serial),
        ``commanded_position`` [rad] and ``commanded_velocity`` [rad/s] (with a drive), ``external_torque`` (all),
        ``valve_1`` and ``_2`` [V] (pneumatic,
        needed). Missing torques are zero
    duration : [s]; N = duration / period + 1 samples, the first before anything moves
    period : sample time T [s]
    steps : integration steps per period; as many as the fastest mode needs when absent
    seed : of all noise; equal seeds give equal recordings, bit for bit
    ideal : sensors without noise, steps, jitter and dropped samples; their systematic errors stay
    start : joint → initial state, (q, q̇, θ₁, θ̇₁, …) [rad, rad/s]; rest when absent
    controllers : joint → the controller that drives it, in addition to inputs or instead of them
    believed : the rig that controllers know; the machine itself when absent
    estimator : makes the estimators that controllers read (`vsalog.estimation.live.LiveEstimate`); needed where one is
    name : of the experiment

    Raises
    ------
    SimulationError
        The rig lacks what a simulation needs, an input does not fit, or the motion leaves the range of the model.
    """
    if not (np.isfinite(duration) and duration > 0.0 and period > 0.0 and (steps is None or steps >= 1)):
        raise SimulationError("a simulation needs a positive duration, period and number of steps")
    count = round(duration / period) + 1
    if count < 2:
        raise SimulationError(f"a duration of {duration:g} s is shorter than one sample period of {period:g} s")
    unknown = sorted({*inputs, *(start or {})} - set(rig.joint))
    if unknown:
        raise SimulationError(f"rig '{rig.name}' has no joint '{unknown[0]}'; it has {', '.join(rig.joint) or 'none'}")
    time = np.arange(count, dtype=np.float64) * period
    control = None
    if controllers:
        known = rig if believed is None else believed
        loops = loops_of(known, controllers, inputs, time, estimator)
        inputs = _with_commands(inputs, loops)
        without = {n: {role: _copied(given) for role, given in own.items()} for n, own in inputs.items()}
        dry = simulate(known, without, duration, period=period, steps=steps, seed=seed, ideal=ideal, start=start)
        for loop in loops.values():
            loop.prepare(dry.recording())
        control = Controlled(loops, rig, time, seed, ideal)
    truths = _truths(rig, inputs, time, steps, start or {}, control)
    if not truths:
        raise SimulationError(f"rig '{rig.name}' has no joint to simulate: nothing drives its rigid joints")
    return Experiment(name, rig, period, sample_stamps(count, period), time, sense(truths, rig, time, seed, ideal))


def _with_commands(
    inputs: Mapping[str, Mapping[str, Input]], loops: Mapping[str, Loop]
) -> dict[str, Mapping[str, Input]]:
    """Put the controllers' commands among the inputs, as the arrays that they write into."""
    for name, loop in loops.items():
        twice = sorted(set(inputs.get(name, {})) & set(loop.commands))
        if twice:
            raise SimulationError(
                f"joint '{name}': {twice[0]} is given, and its controller commands it; keep one of them"
            )
    return {**inputs, **{name: {**inputs.get(name, {}), **loop.commands} for name, loop in loops.items()}}


def _copied(given: Input) -> Input:
    if isinstance(given, Servo) and isinstance(given.reference, np.ndarray):
        return replace(given, reference=np.copy(given.reference))
    return np.copy(given) if isinstance(given, np.ndarray) else given


def _truths(
    rig: RigFile,
    inputs: Mapping[str, Mapping[str, Input]],
    time: Array,
    steps: int | None,
    start: Mapping[str, Array],
    control: Controlled | None,
) -> dict[str, dict[str, Array]]:
    chained = [] if rig.chain is None else [link.joint for link in rig.chain.link]
    found: dict[str, dict[str, Array]] = {}
    if chained:
        machine = build({n: _movable(rig, n) for n in chained}, rig.chain)
        found |= play(machine, inputs, time, steps=steps, start=start, control=_reader(control, chained))
    for name, joint in rig.joint.items():
        if isinstance(joint, PneumaticJoint):
            own = {role: _plain(name, role, given) for role, given in inputs.get(name, {}).items()}
            reader = _reader(control, [name])
            one = None if reader is None else partial(_as_one, reader, name)
            found[name] = simulate_pneumatic(joint, own, time, steps, start.get(name), one)
        elif name not in chained and (inputs.get(name) or not isinstance(joint, RigidJoint)):
            machine = build({name: joint})
            found |= play(machine, inputs, time, steps=steps, start=start, control=_reader(control, [name]))
    return {name: found[name] for name in rig.joint if name in found}


def _reader(control: Controlled | None, joints: Sequence[str]) -> Controlled | None:
    """Return the controllers if one of these joints has one."""
    return control if control is not None and any(name in control.loops for name in joints) else None


def _as_one(control: Controlled, name: str, k: int, truth: Mapping[str, Array]) -> None:
    control(k, {name: truth})


def _movable(rig: RigFile, name: str) -> Movable:
    joint = rig.joint[name]
    if isinstance(joint, RigidJoint | PneumaticJoint):
        raise SimulationError(f"joint '{name}' of the chain has no transmission between a motor and its link")
    return joint


def _plain(joint: str, role: str, given: Input) -> TorqueInput:
    if isinstance(given, Servo | Motion):
        raise SimulationError(f"joint '{joint}': {role} is given over time, neither by a servo nor as a motion")
    return given
