"""A second engine: MuJoCo simulates elastic and rigid joints that the same servos drive.

Springs are tendons between motor and link, with a dead zone for a gap and frictionloss for a loop; inertias are armatures and
bodies that hang in gravity; dry friction is MuJoCo's frictionloss. The drive and its delay are a control loop about it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import rigid
from .bench import Hidden
from .machines import GRAVITY, Machine
from .motion import LEAD, TAIL, Truth, Wanted

# Steps are no longer than this [s]; MuJoCo's friction gives way within FRICTION [s].
STEP, FRICTION = 5e-4, 1e-3
# What it has.
CAUSES = {
    "motor.inertia", "motor.viscous_friction", "motor.torque_constant", "motor.coulomb_friction", "motor.torque_offset",
    "motor.torque_delay", "motor.cogging", "transmission.stiffness", "transmission.nonlinearity", "transmission.damping",
    "transmission.backlash", "transmission.hysteresis", "link.inertia", "link.viscous_friction", "link.coulomb_friction",
    "link.gravity", "link.payload",
}  # fmt: skip


def simulates(nominal: Machine, hidden: list[Hidden] | None = None) -> bool:
    """Tell whether MuJoCo has what a machine is made of and what is hidden in it; a loop is made one of dry friction."""
    if nominal.device not in ("elastic", "rigid"):
        return False
    for one in hidden or ():
        if one.effect.cause not in CAUSES and not one.effect.cause.startswith("sensor."):
            return False
        if one.effect.cause == "transmission.backlash" and nominal.springs[0]["damping"] > 0.0:
            # A tendon's damper acts within the gap too.
            return False
        if one.effect.cause == "transmission.hysteresis":
            one.shape["slips"] = 1.0
    return True


def _text(**values: float | str) -> str:
    return " ".join(f'{k}="{v if isinstance(v, str) else repr(float(v))}"' for k, v in values.items())


def _link(machine: Machine) -> str:
    """Return the inertia of a link: a body whose centre of mass hangs where and as strongly as the machine's."""
    row = machine.link[0]
    inertia, weight, at = float(row["inertia"]), float(row["gravity"]), float(row["hangs_at"])
    distance = 0.5 * GRAVITY * inertia / weight if weight else 0.0
    mass = weight / GRAVITY / distance if weight else 1e-6
    own = max(inertia - mass * distance**2, 1e-12)
    place = f"{float(distance * np.sin(at))!r} 0 {float(-distance * np.cos(at))!r}"
    return f'<inertial pos="{place}" mass="{mass!r}" diaginertia="{own!r} {own!r} {own!r}"/>'


def model_text(machine: Machine, step: float) -> str:
    """Return a machine as MJCF."""
    motor, spring, link = machine.motors[0], machine.springs[0], machine.link[0]
    friction = f"{FRICTION} 1"
    hinge = {"type": "hinge", "axis": "0 1 0", "solreffriction": friction}
    head = (
        f'<option timestep="{step!r}" integrator="RK4" gravity="0 0 {-GRAVITY}">'
        '<flag contact="disable" energy="disable"/></option><compiler boundmass="0" boundinertia="0"/>'
    )
    if machine.device == "rigid":
        both = _text(
            armature=motor["inertia"], damping=motor["damping"] + link["damping"], frictionloss=motor["level"] + link["level"],
            **hinge,
        )  # fmt: skip
        bodies = f'<body><joint name="motor" {both}/>{_link(machine)}</body>'
        tendon = ""
    else:
        rotor = _text(armature=motor["inertia"], damping=motor["damping"], frictionloss=motor["level"], **hinge)
        arm = _text(damping=link["damping"], frictionloss=link["level"], **hinge)
        light = '<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/>'
        bodies = (
            f'<body><joint name="motor" {rotor}/>{light}</body><body><joint name="link" {arm}/>{_link(machine)}</body>'
        )
        stiffness = float(spring["factor"] * spring["k1"])
        cubic = float(spring["factor"] * spring["k3"] + spring["added_cubic"])
        half = 0.5 * float(spring["gap"])
        own = _text(
            stiffness=f"{stiffness!r} 0 {cubic!r}", springlength=f"{-half!r} {half!r}", damping=spring["damping"],
            frictionloss=spring["slip_torque"], solreffriction=friction,
        )  # fmt: skip
        ends = '<joint joint="link" coef="1"/><joint joint="motor" coef="-1"/>'
        tendon = f'<tendon><fixed name="spring" {own}>{ends}</fixed></tendon>'
    return (
        f"<mujoco>{head}<worldbody>{bodies}</worldbody>{tendon}"
        '<actuator><motor joint="motor"/></actuator></mujoco>'
    )  # fmt: skip


def _transmitted(mujoco: Any, model: Any, data: Any, damping: float) -> float:
    """Return the torque that the tendon transmits: spring, damper and dry friction."""
    torque = data.qfrc_spring[0] + data.qfrc_damper[0] + damping * data.qvel[0]
    rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON)
    return float(torque - np.sum(data.efc_force[rows]))


def play(machine: Machine, follow: Wanted) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Let a machine follow; return positions, shape (N, 1 or 2), transmitted torques and commands, shape (N,)."""
    import mujoco

    period, motor, servo = follow.period, machine.motors[0], machine.servos[0]
    count = max(1, int(np.ceil(period / STEP - 1e-9)))
    step = period / count
    model = mujoco.MjModel.from_xml_string(model_text(machine, step))
    data = mujoco.MjData(model)
    n, late = follow.values.shape[0], float(motor["delay"]) / period
    positions, torques, commands = np.zeros((n, model.nq)), np.zeros(n), np.zeros(n)
    gain, offset, damping = float(motor["gain"]), float(motor["offset"]), float(motor["damping"])
    cogging, turns, phase = float(motor["cogging"]), float(motor["order"] * motor["gear"]), float(motor["phase"])
    stiff, damp, limit, quantum = (float(servo[k]) for k in ("stiffness", "damping", "limit", "quantum"))
    wanted = follow.values[:, 0].tolist()
    elastic = machine.device == "elastic"
    for k in range(n):
        if elastic:
            mujoco.mj_forward(model, data)
            torques[k] = _transmitted(mujoco, model, data, damping)
        positions[k] = data.qpos
        command = stiff * (wanted[k][0] - data.qpos[0]) + damp * (wanted[k][1] - data.qvel[0])
        command = round(command / quantum) * quantum if quantum else command
        commands[k] = min(max(command, -limit), limit)
        for j in range(count):
            # Of a command that begins within a step its share acts.
            applied = _mean_command(commands, k + j / count - late, 1.0 / count)
            torque = gain * applied + offset
            if cogging:
                torque += cogging * np.sin(turns * (data.qpos[0] + 0.5 * step * data.qvel[0]) + phase)
            data.ctrl[0] = torque
            mujoco.mj_step(model, data)
    return positions, torques, commands


def _mean_command(commands: np.ndarray, begin: float, length: float) -> float:
    """Return the mean of held commands over a time that begins at a sample's number, or between two."""
    first = int(np.floor(begin + 1e-9))
    share = min(max((first + 1 - begin) / length, 0.0), 1.0)
    now = commands[first] if first >= 0 else 0.0
    if share > 1.0 - 1e-9:
        return float(now)
    return float(share * now + (1.0 - share) * (commands[first + 1] if first >= -1 else 0.0))


def happened(machine: Machine, follow: Wanted) -> Truth | None:
    """Let a machine follow, as a device's own `happened`."""
    lead, tail = round(LEAD / follow.period), round(TAIL / follow.period)
    positions, torques, commands = play(machine, follow)
    if not (np.isfinite(positions).all() and np.isfinite(torques).all()):
        return None
    if machine.device == "rigid":
        return rigid.truth_of(machine, positions[:, 0], commands, follow)
    time = (np.arange(positions.shape[0]) - lead) * follow.period
    roles = {
        "link_position": positions[:, 1], "motor_position": positions[:, 0], "motor_torque": commands, "torque_sensor": torques,
    }  # fmt: skip
    return Truth(time, roles, slice(lead, positions.shape[0] - tail), follow.period)
