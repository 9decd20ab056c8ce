"""Machines that differ from the rig, for Shin 2021 §IV: otherwise the simulation's model would be exact."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import replace as with_fields

import numpy as np
from msgspec.structs import replace

from vsalog.rig import Rig
from vsalog.rig.schema import Muscle, PneumaticJoint, PressureFriction, RigFile, Valve
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate


@dataclass(frozen=True, slots=True)
class Spread:
    """Largest deviations: each is drawn uniformly between minus and plus that much, independently.

    Attributes
    ----------
    supply : part of the supply's pressure, which a regulator holds
    area : part of the orifices A₁, A₂, each valve's two; the paper found them by trial and error (§II-C)
    offset : of the valve's map [V]: half a per cent of 10 V, about the hysteresis of a proportional valve's spool
    pull : part of each muscle's pull: the spread of the points about their lines in such a fit (Fig. 2), and of muscles of a kind
    volume : part of each muscle's volume, measured with a graduated cylinder (§II-C)
    friction : part of all of eq. 10, which was found by trial and error (§II-C) and changes with wear and warmth
    leak : part of the inflow orifice that each muscle leaks at most, at least nothing
    """

    supply: float = 0.02
    area: float = 0.05
    offset: float = 0.05
    pull: float = 0.03
    volume: float = 0.03
    friction: float = 0.2
    leak: float = 0.005


SPREAD = Spread()
STATED = (
    "each seed has a machine of its own, off from the rig evenly up to ± these, each on its own: supply pressure 2 % (a"
    " regulator), orifice areas 5 % and friction 20 % (found by trial and error, §II-C), valve map 0.05 V (spool hysteresis),"
    " each muscle's pull and volume 3 % (scatter of Fig. 2, a graduated cylinder), leakage 0 to 0.5 % of the orifice"
)
MACHINES = "simulated machines that differ from the rig as stated, in place of the paper's"


def machine(joint: PneumaticJoint, seed: int) -> PneumaticJoint:
    """Return the true joint where the rig has `joint`.

    Parameters
    ----------
    joint : of the rig, with friction of the paper's kind
    seed : equal seeds give equal machines
    """
    rng = np.random.default_rng(seed)

    def off(most: float) -> float:
        return 1.0 + most * float(rng.uniform(-1.0, 1.0))

    def muscle(m: Muscle, valve: Valve) -> Muscle:
        volume, pull, leak = off(SPREAD.volume), off(SPREAD.pull), SPREAD.leak * float(rng.uniform(0.0, 1.0))
        return replace(
            m,
            force_gain=pull * m.force_gain,
            volume_curvature=volume * m.volume_curvature,
            volume_slope=volume * m.volume_slope,
            volume_constant=volume * m.volume_constant,
            leak_area=m.leak_area + leak * valve.inflow_area,
        )

    def valve(v: Valve) -> Valve:
        into, out, offset = off(SPREAD.area), off(SPREAD.area), SPREAD.offset * float(rng.uniform(-1.0, 1.0))
        return replace(v, inflow_area=into * v.inflow_area, outflow_area=out * v.outflow_area, offset=v.offset + offset)

    friction = joint.friction
    if isinstance(friction, PressureFriction):
        level = off(SPREAD.friction)
        friction = replace(
            friction,
            viscous=level * friction.viscous,
            shaft_coefficient=level * friction.shaft_coefficient,
            muscle=level * friction.muscle,
        )
    return replace(
        joint,
        air=replace(joint.air, supply_pressure=off(SPREAD.supply) * joint.air.supply_pressure),
        muscle_1=muscle(joint.muscle_1, joint.valve_1),
        muscle_2=muscle(joint.muscle_2, joint.valve_2),
        valve_1=valve(joint.valve_1),
        valve_2=valve(joint.valve_2),
        friction=friction,
    )


def recorded(seed: int, *, clamped: bool, scenario: str = "pam-range", duration: float | None = None) -> Experiment:
    """Return the recording of another machine than the preset `pam`, with the preset's rig as the nominal one.

    Parameters
    ----------
    seed : of the machine and of the sensors' noise
    clamped : at 0°, as in the paper where the torque is measured (§IV-A2); so is the rig
    scenario : its voltages
    duration : [s], the scenario's when absent
    """
    believed = Rig.preset("pam").file
    joint = believed.joint["pam"]
    assert isinstance(joint, PneumaticJoint)
    if clamped:
        joint = replace(joint, seesaw=replace(joint.seesaw, held_at=0.0))
    actual, believed = _with(believed, machine(joint, seed)), _with(believed, joint)
    inputs = Scenario.find(scenario, actual)
    length = inputs.file.duration if duration is None else duration
    # Classical Runge-Kutta misses less than a Pa and 1e-6 rad with two steps per millisecond: far below the sensors.
    simulated = simulate(actual, inputs.inputs(actual), length, seed=seed, steps=2)
    return with_fields(simulated, rig=believed)


def _with(rig: RigFile, joint: PneumaticJoint) -> RigFile:
    return replace(rig, joint={"pam": joint})
