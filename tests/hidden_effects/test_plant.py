"""The hidden machines against scipy's integrator, against energy, statics and closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.hidden_effects import _plant, motion
from tests.hidden_effects.machines import DEVICES, random_machine

PERIOD = 1e-3


def played(machine, values, start=0.0, step=5e-4, x0=None):
    x0 = np.zeros(_plant.STATES) if x0 is None else x0
    arrays = machine.motors, machine.springs, machine.link, machine.lever, machine.servos
    return _plant.play(machine.code, *arrays, values, start, PERIOD, step, x0)


def moved(machine, seconds=0.6, seed=0):
    """Wanted angles that get a machine going."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    values = np.zeros((time.size, 2, 2))
    for i in range(2):
        f = rng.uniform(1.0, 3.0)
        values[:, i, 0] = 0.3 * machine.deflection * np.sin(2.0 * np.pi * f * time)
    values[:, :, 1] = np.gradient(values[:, :, 0], PERIOD, axis=0)
    return values


def everything(device):
    """A machine with every effect that is smooth."""
    machine = random_machine(device, np.random.default_rng(3))
    for motor in machine.motors:
        motor["offset"], motor["cogging"], motor["order"] = 0.05 * machine.torque, 0.03 * machine.torque, 3.0
        motor["level"], motor["breakaway"], motor["stribeck"] = 0.05 * machine.torque, 0.08 * machine.torque, 0.2
        motor["presliding"], motor["load"] = 1e-3, 0.0
        motor["ripple"], motor["ripple_order"] = 0.05, 5.0
        motor["uneven"], motor["uneven_order"] = 0.5, 3.0
    for spring in machine.springs:
        spring["loop"], spring["width"] = 0.05 * machine.torque, 0.2 * machine.deflection
        spring["slip_torque"], spring["slip_width"] = 0.05 * machine.torque, 0.3 * machine.deflection
        spring["drift"], spring["added_cubic"] = 0.1, 0.1 * machine.torque / machine.deflection**3
    if device == "serial":
        machine.motors[1]["presliding"] = 0.02  # its angle turns much faster
    machine.link["drag"] = 0.001 * machine.torque
    machine.link["base_inertia"] = 4.0 * machine.link["inertia"]
    machine.link["base_stiffness"] = machine.link["base_inertia"] * 60.0**2
    machine.link["base_damping"] = machine.link["base_inertia"] * 3.0
    return machine


@pytest.mark.parametrize("device", DEVICES)
def test_steps_agree_with_scipy(device):
    machine = everything(device)
    values = moved(machine)
    states, torques, commands = played(machine, values)
    assert np.isfinite(states).all()
    assert np.ptp(states[:, 4]) > 0.05 * machine.deflection

    def rate(t, x):
        return _plant.rates(
            machine.code, machine.motors, machine.springs, machine.link, machine.lever, x, t, commands[index]
        )[0]

    begin = 200
    x = states[begin]
    for index in range(begin, begin + 120):  # a command is held from sample to sample
        piece = index * PERIOD, (index + 1) * PERIOD
        x = solve_ivp(rate, piece, x, method="DOP853", rtol=1e-9, atol=1e-12).y[:, -1]
    scale = np.ptp(states, axis=0) + 1e-9
    assert np.max(np.abs(x - states[begin + 120]) / scale) < 1e-4
    assert np.isfinite(torques).all()


@pytest.mark.parametrize("device", ["elastic", "antagonistic"])
def test_without_friction_energy_stays(device):
    machine = random_machine(device, np.random.default_rng(5))
    machine.motors["damping"] = machine.springs["damping"] = machine.link["damping"] = 0.0
    machine.servos["stiffness"] = machine.servos["damping"] = 0.0
    x0 = np.zeros(_plant.STATES)
    x0[4] = 0.5 * machine.deflection
    states, _, _ = played(machine, np.zeros((1500, 2, 2)), x0=x0)
    kinetic = 0.5 * machine.link[0]["inertia"] * states[:, 5] ** 2
    potential = -machine.link[0]["gravity"] * np.cos(states[:, 4] - machine.link[0]["hangs_at"])
    for i, _suffix in enumerate(machine.suffixes):
        kinetic = kinetic + 0.5 * machine.motors[i]["inertia"] * states[:, 2 * i + 1] ** 2
        phi, grid = states[:, 4] - states[:, 2 * i], np.linspace(-1.2, 1.2, 4001) * machine.deflection
        torque = np.array([_plant.spring_torque(machine.springs[i], u, 0.0) for u in grid])
        stored = np.concatenate([[0.0], np.cumsum(0.5 * (torque[1:] + torque[:-1]) * np.diff(grid))])
        potential = potential + np.interp(phi, grid, stored)
    energy = kinetic + potential
    assert np.ptp(kinetic) > 0.0
    assert np.ptp(energy) < 2e-4 * np.ptp(kinetic)


def test_at_rest_the_spring_carries_the_link():
    machine = random_machine("elastic", np.random.default_rng(1))
    machine.link["gravity"], machine.link["hangs_at"] = 0.4 * machine.torque, 0.3
    machine.link["damping"] = 20.0 * machine.link["inertia"]
    values = np.zeros((8000, 2, 2))
    values[:, 0, 0] = 0.9
    states, torques, commands = played(machine, values)
    q, carried = states[-1, 4], -0.4 * machine.torque * np.sin(states[-1, 4] - 0.3)
    assert abs(states[-1, 5]) < 1e-6
    assert torques[-1, 0] == pytest.approx(carried, rel=1e-5)
    assert commands[-1, 0] == pytest.approx(-carried, rel=1e-5)
    k1, k3 = machine.springs[0]["k1"], machine.springs[0]["k3"]
    phi = q - states[-1, 0]
    assert k1 * phi + k3 * phi**3 == pytest.approx(carried, rel=1e-5)


@pytest.mark.parametrize("delay", [0.0, 0.3e-3, 2e-3, 3.7e-3])
def test_a_late_drive_holds_the_command_before(delay):
    machine = random_machine("elastic", np.random.default_rng(2))
    machine.motors["damping"], machine.motors["delay"] = 0.0, delay
    machine.springs["k1"], machine.springs["k3"], machine.springs["damping"] = 1e-9, 0.0, 0.0
    states, _, commands = played(machine, moved(machine, 0.1))
    whole = int(delay / PERIOD + 1e-9)
    part = delay - whole * PERIOD
    gained = np.diff(states[:, 1]) * machine.motors[0]["inertia"]
    held = np.concatenate([np.zeros(whole + 1), commands[:, 0]])
    newer, older = held[1 : len(gained) + 1], held[: len(gained)]
    assert np.max(np.abs(commands)) > 0.0
    np.testing.assert_allclose(gained, part * older + (PERIOD - part) * newer, atol=1e-7 * machine.torque)


def test_bristles_slide_at_the_stribeck_curve():
    motor = random_machine("elastic", np.random.default_rng(2)).motors[0]
    motor["level"], motor["breakaway"], motor["stribeck"], motor["presliding"] = 2.0, 3.0, 0.1, 1e-4
    for speed in (0.01, 0.1, -0.3):
        z, h = 0.0, 1e-6
        for _ in range(200000):
            force, dz = _plant._bristles(motor, z, 0.0, speed, 0.0, 0.0)
            z += h * dz
            if abs(dz) < 1e-9:
                break
        assert force == pytest.approx(np.sign(speed) * (2.0 + np.exp(-((speed / 0.1) ** 2))), rel=1e-3)


def test_the_loop_is_as_high_as_it_says():
    machine = random_machine("elastic", np.random.default_rng(4))
    for law in ({"loop": 1.5, "width": 0.01}, {"slip_torque": 1.5, "slip_width": 0.01}):
        spring = machine.copy().springs[0]
        for name, value in law.items():
            spring[name] = value
        z, y = 0.0, np.zeros(3)
        phi = np.concatenate([np.linspace(0.0, 0.1, 20000), np.linspace(0.1, 0.0, 20000)])
        heights = []
        for du, u in zip(np.diff(phi), phi[1:], strict=True):
            z += (du - abs(du) * z) / spring["width"] if spring["loop"] else 0.0
            shares = np.array(_plant.SLIP_SHARES)
            y += (du - abs(du) * y**5) / (shares * spring["slip_width"]) if spring["slip_torque"] else 0.0
            loaded = _plant._transmitted(spring, u, 0.0, 0.0, 0.0, z, *y)[0]
            heights.append(loaded - _plant.spring_torque(spring, u, 0.0))
        assert heights[19998] == pytest.approx(1.5, rel=1e-3)
        assert heights[-1] == pytest.approx(-1.5, rel=1e-2)


def test_in_the_gap_nothing_is_transmitted_and_walls_do_not_pull():
    spring = random_machine("elastic", np.random.default_rng(4)).springs[0]
    spring["damping"] = 0.0
    spring["gap"], spring["wall"] = 0.02, 5.0
    free = _plant.spring_torque(spring, 0.03, 0.0)
    assert _plant._transmitted(spring, 0.0099, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)[0] == 0.0
    assert _plant._transmitted(spring, 0.04, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)[0] == pytest.approx(free)
    assert _plant._transmitted(spring, -0.04, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)[0] == pytest.approx(-free)
    assert _plant._transmitted(spring, 0.04, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)[0] > free
    assert _plant._transmitted(spring, 0.04, -9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)[0] == 0.0


def test_a_lever_pushes_back_as_its_energy_falls():
    machine = random_machine("serial", np.random.default_rng(6))
    spring, (r0, b) = machine.springs[0], machine.lever
    x = np.zeros(_plant.STATES)
    x[4], x[2] = 0.1, 30.0
    rates, _ = _plant.rates(
        machine.code, machine.motors, machine.springs, machine.link, machine.lever, x, 0.0, np.zeros(2)
    )

    def energy(theta):
        return spring["k1"] * (r0 - b * theta) ** 2 * np.sin(0.1) ** 2

    slope = (energy(30.0 + 1e-4) - energy(30.0 - 1e-4)) / 2e-4
    assert rates[3] * machine.motors[1]["inertia"] == pytest.approx(-slope, rel=1e-6)


@pytest.mark.parametrize("device", DEVICES)
def test_trajectories_use_the_springs_and_turn_back_often(device):
    rng = np.random.default_rng(8)
    machine = random_machine(device, rng)
    follow = motion.wanted(machine, 20.0, 2e-3, rng)
    truth = motion.happened(machine, follow)
    q = truth.roles["link_position"][truth.inside]
    phi = q - truth.roles[f"motor_position{machine.suffixes[0]}"][truth.inside]
    assert 0.6 * machine.deflection < np.max(np.abs(phi)) < 1.5 * machine.deflection
    assert np.sum(np.diff(np.sign(np.gradient(q))) != 0) > 20
    assert truth.time[truth.inside][0] == 0.0
