"""The pneumatic joint: every model and effect does what its name says, and what cannot be simulated is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pam_reference import EQUAL, PAM, SMOOTH, Array, opening, replace, seconds, stretches

from vsalog.binding.joint import bind
from vsalog.core.errors import OtherKindError, SimulationError
from vsalog.estimation.joint import choose
from vsalog.mechanics.pneumatics import joint_torque, muscle_lengths, pressure_rate, valve_flow
from vsalog.readers import read
from vsalog.rig import Rig
from vsalog.rig.schema import (
    BraidForce,
    ExponentialForce,
    SimpleFriction,
    SpringForce,
    TonduFriction,
)
from vsalog.simulation.inputs import TorqueInput
from vsalog.simulation.pneumatic import simulate_pneumatic

MODELS = [
    PAM.muscle_1.force,
    BraidForce(rest_length=0.19, rest_radius=5e-3, braid_angle=np.deg2rad(22.0)),
    ExponentialForce(rest_length=0.19, a1=1.2e-4, a2=30.0, a3=-6.0, a4=-1.5e-4, a5=2e-5, a6=-8.0),
    SpringForce(rest_length=0.14, c0=300.0, c1=2e4, c2=0.03, c3=1e-9),
]
FRICTIONS = [PAM.friction, SimpleFriction(level=0.05), TonduFriction(static=0.12, kinetic=0.03, speed=0.5), None]


@pytest.mark.parametrize("friction", FRICTIONS, ids=lambda f: type(f).__name__)
@pytest.mark.parametrize("force", MODELS, ids=lambda f: type(f).__name__)
def test_every_model_moves_as_its_formulas_say(force: object, friction: object) -> None:
    # Every effect at once: the differences of the recorded motion against the formulas for arrays.
    def muscle(gain: float, leak: float):  # type: ignore[no-untyped-def]
        return replace(PAM.muscle_1, force=force, force_gain=gain, leak_area=leak)

    joint = replace(
        PAM, muscle_1=muscle(1.1, 2e-9), muscle_2=muscle(0.95, 5e-9), friction=friction,
        valve_1=replace(PAM.valve_1, offset=0.2, area_scale=0.8), valve_2=replace(PAM.valve_2, offset=-0.1, area_scale=1.3),
    )  # fmt: skip
    time = np.arange(8001) * 1e-4
    push = 0.4 * np.sin(2.0 * np.pi * 4.0 * time)
    start = np.array([0.05, 0.3, 3e5, 3.4e5])
    inputs: dict[str, TorqueInput] = {
        "valve_1": 5.3, "valve_2": 4.7, "external_torque": lambda t: 0.4 * np.sin(2.0 * np.pi * 4.0 * t)
    }  # fmt: skip
    truth = simulate_pneumatic(joint, inputs, time, start=start)
    v = truth["link_velocity"]
    # Away from the changes between stick and slip, where the velocity has kinks.
    steady = np.array([len({*np.sign(v[max(0, k - 3) : k + 4])}) == 1 for k in range(v.size)])
    steady[:3] = steady[-3:] = False
    assert steady.mean() > 0.8
    rate = np.gradient(v, time)
    assert rate[steady] == pytest.approx(truth["link_acceleration"][steady], abs=2e-3 * np.abs(rate).max())
    torque = joint_torque(joint, truth["link_position"], truth["pressure_1"], truth["pressure_2"])
    rest = torque - 4.117e-4 * truth["link_position"] + push - truth["friction_torque"]
    assert rest / 4.263e-4 == pytest.approx(truth["link_acceleration"], abs=1e-6)
    lengths = muscle_lengths(joint, truth["link_position"])
    for i, side, alpha in ((1, -1.0, opening(5.5)), (2, 1.0, opening(4.6))):
        pressure = truth[f"pressure_{i}"]
        part, valve = getattr(joint, f"muscle_{i}"), getattr(joint, f"valve_{i}")
        speed = side * 0.0365 * np.cos(truth["link_position"]) * v
        expected = pressure_rate(
            joint.air, part, pressure, lengths[i - 1], speed, valve_flow(valve, joint.air, alpha, pressure)
        )
        found = np.gradient(pressure, time)
        assert found[steady] == pytest.approx(expected[steady], abs=2e-3 * np.abs(expected).max())


def test_a_joint_starts_at_rest_and_stays_there() -> None:
    for joint in (SMOOTH, PAM):
        truth = simulate_pneumatic(joint, {"valve_1": 5.7, "valve_2": 4.4, "external_torque": 0.2}, seconds(5.0))
        assert np.ptp(truth["link_position"]) < 1e-9
        assert np.ptp(truth["pressure_1"]) < 1e-3
        assert np.ptp(truth["pressure_2"]) < 1e-3
        assert truth["transmission_torque"][0] + 0.2 == pytest.approx(4.117e-4 * truth["link_position"][0], abs=1e-9)


def test_equal_muscles_under_equal_voltages_stay_in_the_middle() -> None:
    volts = stretches(7, 10)
    truth = simulate_pneumatic(EQUAL, {"valve_1": volts, "valve_2": volts}, seconds(5.0))
    assert np.abs(truth["link_position"]).max() < 1e-12
    assert np.ptp(truth["pressure_1"]) > 5e4


def test_exchanged_voltages_mirror_the_motion() -> None:
    u1, u2 = stretches(8, 6), stretches(9, 6)
    one = simulate_pneumatic(EQUAL, {"valve_1": u1, "valve_2": u2}, seconds(3.0))
    other = simulate_pneumatic(EQUAL, {"valve_1": u2, "valve_2": u1}, seconds(3.0))
    assert one["link_position"] == pytest.approx(-other["link_position"], abs=1e-9)
    assert one["stiffness"] == pytest.approx(other["stiffness"], rel=1e-9)


def test_more_voltage_on_muscle_1_turns_towards_positive_angles_and_more_on_both_stiffens() -> None:
    up, level_volts = np.append(np.full(100, 5.0), np.full(5901, 6.2)), np.full(6001, 5.0)
    turned = simulate_pneumatic(PAM, {"valve_1": up, "valve_2": level_volts}, seconds(6.0))
    assert turned["link_position"][-1] > turned["link_position"][0] + 0.03
    stiffened = simulate_pneumatic(PAM, {"valve_1": up, "valve_2": up}, seconds(6.0))
    assert stiffened["stiffness_isobaric"][-1] > 1.1 * stiffened["stiffness_isobaric"][0]
    assert (stiffened["stiffness"] > stiffened["stiffness_isobaric"]).all()


def test_effects_do_what_they_are_called() -> None:
    time = seconds(6.0)
    volts = np.append(np.full(100, 4.6), np.full(5901, 5.4))
    inputs = {"valve_1": volts, "valve_2": volts}
    plain = simulate_pneumatic(PAM, inputs, time)

    leaky = simulate_pneumatic(replace(PAM, muscle_1=replace(PAM.muscle_1, leak_area=5e-9)), inputs, time)
    assert leaky["pressure_1"][-1] < plain["pressure_1"][-1] - 1e4

    offset = simulate_pneumatic(replace(PAM, valve_1=replace(PAM.valve_1, offset=0.3)), inputs, time)
    shifted = simulate_pneumatic(PAM, {"valve_1": volts + 0.3, "valve_2": volts}, time)
    assert offset["pressure_1"] == pytest.approx(shifted["pressure_1"], rel=1e-12)
    assert offset["valve_1"].tolist() == volts.tolist()

    # At a constant volume half the orifice takes twice the time for everything.
    held = replace(PAM, seesaw=replace(PAM.seesaw, held_at=0.0))
    half = replace(held, valve_1=replace(PAM.valve_1, area_scale=0.5))
    fast, slow = (simulate_pneumatic(j, inputs, time)["pressure_1"] for j in (held, half))
    assert slow[100::2] == pytest.approx(fast[100:][: slow[100::2].size], rel=1e-9)

    strong = replace(held, muscle_1=replace(held.muscle_1, force_gain=1.2))
    weak, more = (simulate_pneumatic(j, inputs, time) for j in (held, strong))
    assert more["muscle_force_1"] == pytest.approx(1.2 * weak["muscle_force_1"], rel=1e-12)
    assert more["pressure_1"] == pytest.approx(weak["pressure_1"], rel=1e-12)


def test_a_clamped_joint_does_not_move_and_shows_its_torque() -> None:
    held = replace(PAM, seesaw=replace(PAM.seesaw, held_at=0.1))
    truth = simulate_pneumatic(
        held, {"valve_1": stretches(1, 8), "valve_2": stretches(2, 8), "external_torque": 5.0}, seconds(4.0)
    )
    assert (truth["link_position"] == 0.1).all()
    assert (truth["link_velocity"] == 0.0).all()
    assert np.ptp(truth["transmission_torque"]) > 0.5
    assert truth["mode"].max() <= 9.0


def test_an_emptied_muscle_is_survived() -> None:
    # The friction of the tube grows without bound as the pressure nears the outside one; the joint sticks.
    volts = np.append(np.full(100, 5.0), np.full(5901, 0.0))
    truth = simulate_pneumatic(PAM, {"valve_1": volts, "valve_2": volts}, seconds(6.0))
    assert all(np.isfinite(values).all() for values in truth.values())
    assert truth["pressure_1"][-1] == pytest.approx(101300.0, abs=2000.0)


VALVES: dict[str, TorqueInput] = {"valve_1": 5.0, "valve_2": 5.0}


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"valve_1": 5.0}, "'valve_2' is missing"),
        ({**VALVES, "motor_torque": 1.0}, "no input 'motor_torque'"),
        ({**VALVES, "valve_1": np.ones(3)}, "one value per sample"),
        ({**VALVES, "valve_1": float("nan")}, "not finite"),
    ],
)
def test_bad_inputs_are_refused(inputs: dict[str, TorqueInput], message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        simulate_pneumatic(PAM, inputs, seconds(0.1))


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (np.zeros(3), "starts from"),
        (np.array([0.0, 0.0, -1.0, 4e5]), "starts from"),
        (np.array([0.9, 0.0, 4e5, 4e5]), "volume would not be positive"),
    ],
)
def test_bad_starts_are_refused(start: Array, message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        simulate_pneumatic(PAM, VALVES, seconds(0.1), start=start)


def test_a_motion_beyond_the_volumes_is_reported() -> None:
    with pytest.raises(SimulationError, match=r"after 0\.\d+ s the joint leaves the range of its model"):
        simulate_pneumatic(PAM, {**VALVES, "external_torque": lambda t: 400.0 * t}, seconds(1.0))


def test_impossible_units_are_reported() -> None:
    tiny = replace(PAM, seesaw=replace(PAM.seesaw, inertia=4e-14))
    with pytest.raises(SimulationError, match="units"):
        simulate_pneumatic(tiny, VALVES, seconds(0.1))
    with pytest.raises(SimulationError, match="two samples"):
        simulate_pneumatic(PAM, VALVES, np.zeros(1))
    with pytest.raises(SimulationError, match="at least one step"):
        simulate_pneumatic(PAM, VALVES, seconds(0.1), steps=0)


def test_a_log_of_pressures_and_voltages_is_bound_in_si_but_not_estimated(tmp_path: Path) -> None:
    log = tmp_path / "pam.csv"
    rows = [f"{0.001 * k:.3f},{0.1 * k:.1f},0.5,{300 + k},250,5.5,{5000 + k}" for k in range(20)]
    log.write_text("\n".join(["time [s],angle [deg],torque [N*m],p1 [kPa],p2 [kPa],u1 [V],u2 [mV]", *rows]))
    channels = {
        "link_position": "angle",
        "torque_sensor": "torque",
        "pressure_2": "p2",
        "valve_1": "u1",
        "valve_2": "u2",
    }
    signals = "\n".join(f'{role} = "{channel}"' for role, channel in channels.items())
    offset = 'pressure_1 = { channel = "p1", offset = "2 kPa" }'
    joint = Rig.from_toml(f'preset = "pam"\n[joint.pam.signals]\n{signals}\n{offset}\n').joints["pam"]
    bound = bind([read(log)], "pam", joint, [*channels, "pressure_1"]).roles
    assert bound["pressure_1"] == pytest.approx(298e3 + 1e3 * np.arange(20))
    assert bound["pressure_2"] == pytest.approx(250e3)
    assert bound["valve_2"] == pytest.approx(5.0 + 1e-3 * np.arange(20))
    assert bound["link_position"] == pytest.approx(np.deg2rad(0.1 * np.arange(20)))
    assert choose("pam", joint, "auto", {}).name == "pam-ukf"
    with pytest.raises(OtherKindError):
        choose("pam", joint, "direct", {})
