"""Joints that record a position command and an encoder: what their drive, motor, spring or link has that the rig does not know.

The machines are integrated here, by equations of their own.
"""

from pathlib import Path

import numpy as np
import pytest

from vsalog.diagnosis.run import Options, diagnose
from vsalog.rig import Rig

pytestmark = pytest.mark.share(4)

PERIOD, LOOP, DURATION = 0.01, 1e-3, 40.0
MACHINE = {
    "inertia": 0.03, "damping": 0.3, "coulomb": 0.15, "link": 0.02, "weight": 0.8, "kp": 20.0, "kd": 0.6, "delay": 0.01,
    "acceleration": np.inf, "speed": np.inf, "stiffness": 40.0, "gap": 0.0,
}  # fmt: skip
HEAD = """
[joint.a]
kind = "{kind}"
[joint.a.motor]
inertia = 0.03
damping = 0.3
friction = {{ coulomb = 0.15 }}
[joint.a.link]
inertia = 0.02
gravity_torque = 0.8
[joint.a.drive]
kind = "position-servo"
kp = 20.0
kd = 0.6
delay = "10 ms"
[joint.a.signals]
commanded_position = {{ channel = "command", unit = "rad" }}
link_position = {{ channel = "q", unit = "rad" }}
"""
SPRING = """
motor_position = { channel = "theta", unit = "rad" }
[joint.a.transmission]
type = "linear"
stiffness = 40.0
"""
STEP = 1e-3


def command(time):
    return 0.5 * np.sin(1.9 * time) + 0.12 * np.sin(10.7 * time) + 0.08 * np.sin(18.2 * time) + 0.3 * np.sin(0.7 * time)


def planned(asked, speed, acceleration):
    """Return the least-time motion to a command that changes, in steps of the loop; no limit where both are infinite."""
    if np.isinf(speed) and np.isinf(acceleration):
        return asked, np.zeros_like(asked)
    r, w, positions, rates = asked[0], 0.0, [], []
    for goal in asked:
        positions.append(r)
        rates.append(w)
        left = goal - r
        stop = abs(left) / LOOP if np.isinf(acceleration) else np.sqrt(2 * acceleration * abs(left))
        wanted = np.sign(left) * min(stop, speed, abs(left) / LOOP)
        w += np.clip(wanted - w, -acceleration * LOOP, acceleration * LOOP)
        r += w * LOOP
    return np.array(positions), np.array(rates)


def moved(m, elastic):
    """Return time, command, q and θ; semi-implicit steps of a tenth of the loop."""
    fine, every = 10, round(PERIOD / LOOP)
    time = np.arange(round(DURATION / LOOP)) * LOOP
    sampled = command(np.arange(round(DURATION / PERIOD)) * PERIOD)
    late = np.floor((time - m["delay"]) / PERIOD + 1e-9).astype(int)
    reference, rate = planned(sampled[np.maximum(late, 0)], m["speed"], m["acceleration"])
    h = LOOP / fine
    theta = q = reference[0]
    omega = v = 0.0
    out = np.empty((time.size, 2))
    for k in range(time.size):
        out[k] = q, theta
        torque = m["kp"] * (reference[k] - theta) + m["kd"] * (rate[k] - omega)
        for _ in range(fine):
            phi = q - theta
            bent = np.sign(phi) * max(abs(phi) - 0.5 * m["gap"], 0.0)
            pull = m["stiffness"] * bent if elastic else m["weight"] * np.sin(theta)
            heavy = m["inertia"] if elastic else m["inertia"] + m["link"]
            push = torque + pull if elastic else torque - pull
            free = omega + h * (push - m["damping"] * omega) / heavy
            rub = h * m["coulomb"] / heavy
            omega = 0.0 if abs(free) <= rub else free - np.sign(free) * rub
            theta += h * omega
            if elastic:
                v += h * (-pull - m["weight"] * np.sin(q)) / m["link"]
                q += h * v
            else:
                q = theta
    return np.arange(sampled.size) * PERIOD, sampled, out[::every, 0], out[::every, 1]


def log_of(path, hidden, elastic=False):
    time, asked, q, theta = moved(MACHINE | hidden, elastic)
    columns = [time, asked, *(STEP * np.round(x / STEP) for x in (q, theta))]
    np.savetxt(
        path, np.stack(columns, axis=1), delimiter=",", header="time [s],command,q,theta", comments="", fmt="%.6f"
    )
    return path


def found_in(path, elastic=False):
    rig = Rig.from_toml(HEAD.format(kind="elastic" if elastic else "rigid") + (SPRING if elastic else ""))
    found = diagnose(path, None, Options(rig=rig)).diagnosis
    return found, {c.cause: c for c in found.causes if c.material}


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("hidden", "names", "number", "value", "within"),
    [
        ({"kp": 26.0}, {"drive.proportional_gain"}, "kp", 26.0, 0.02),
        ({"damping": 0.6}, {"motor.viscous_friction", "drive.derivative_gain"}, None, 0.0, 0.0),
        ({"kd": 0.9}, {"motor.viscous_friction", "drive.derivative_gain"}, None, 0.0, 0.0),
        ({"delay": 0.03}, {"drive.delay"}, "delay", 0.03, 0.02),
        ({"coulomb": 0.4}, {"motor.coulomb_friction"}, "torque", 0.4, 0.05),
        ({"inertia": 0.05}, {"motor.inertia", "link.inertia"}, None, 0.0, 0.0),
        ({"acceleration": 8.0}, {"drive.acceleration_limit"}, "limit", 8.0, 0.1),
        ({"speed": 1.0}, {"drive.speed_limit"}, "limit", 1.0, 0.02),
    ],
)
def test_what_the_rig_does_not_know_is_named(tmp_path, hidden, names, number, value, within):
    found, causes = found_in(log_of(tmp_path / "log.csv", hidden))
    assert set(causes) & names
    first = found.causes[0]
    assert first.cause in names
    if number is not None:
        assert first.parameters[number].value == pytest.approx(value, rel=within)


def test_a_rig_that_is_right_is_consistent(tmp_path):
    found, causes = found_in(log_of(tmp_path / "log.csv", {}))
    assert found.verdict == "consistent"
    assert not causes


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("hidden", "name", "number", "value"),
    [
        ({"stiffness": 30.0}, "transmission.stiffness", "factor", 0.75),
        ({"gap": 0.017}, "transmission.backlash", "gap", 0.017),
    ],
)
def test_the_spring_of_an_elastic_joint_is_questioned_too(tmp_path, hidden, name, number, value):
    _, causes = found_in(log_of(tmp_path / "log.csv", hidden, elastic=True), elastic=True)
    assert causes[name].parameters[number].value == pytest.approx(value, rel=0.05)


def test_two_joints_that_differ_by_a_common_factor_are_the_same(tmp_path):
    """Without any torque nothing tells a scale that all have in common: gains, inertia, friction and weight, all × 1.5."""
    factor = {name: 1.5 * MACHINE[name] for name in ("inertia", "damping", "coulomb", "link", "weight", "kp", "kd")}
    found, causes = found_in(log_of(tmp_path / "log.csv", factor))
    assert found.verdict == "consistent"
    assert not causes


def test_a_real_servo_is_found_to_plan_its_motion():
    """An SO-101 arm and a rig that was never fitted: the limit that is found is the servo's register, 254 · 100 steps/s²."""
    folder = Path(__file__).parents[2] / "sample_logs" / "so101_servo"
    found = diagnose(
        folder / "chirp_sweep",
        folder / "multisine",
        Options(rig=folder / "first_guess.rig.toml"),
    ).diagnosis
    causes = {c.cause: c for c in found.causes if c.material}
    register = 254 * 100 * 2 * np.pi / 4096
    assert causes["drive.acceleration_limit"].parameters["limit"].value == pytest.approx(register, rel=0.1)
    assert found.verdict == "partly explained"
    (gain,) = found.gain.signals
    assert gain.ci95[0] > 0.3
