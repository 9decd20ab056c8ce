"""What an experiment records: sensors, seeds, held inputs, names, refusals."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from vsalog.core.errors import SimulationError
from vsalog.mechanics import stiffness
from vsalog.rig.schema import (
    AntagonisticJoint,
    AntagonisticSignals,
    ElasticJoint,
    LinearTransmission,
    Motor,
    RigFile,
    RigidJoint,
    SerialJoint,
    SerialSignals,
    Signal,
    SingleSignals,
    UnknownTransmission,
)
from vsalog.simulation import (
    Experiment,
    awas_experiment,
    awas_rig,
    elastic_experiment,
    elastic_rig,
    simulate,
    vsa2_experiment,
    vsa2_rig,
)

ALL = [vsa2_experiment, awas_experiment, elastic_experiment]


@pytest.mark.parametrize("run", ALL)
@pytest.mark.parametrize("number", [1, 2])
def test_equal_seeds_give_equal_recordings(run: Callable[..., Experiment], number: int) -> None:
    first, again = run(number, seed=3, duration=1.0), run(number, seed=3, duration=1.0)
    other = run(number, seed=4, duration=1.0)
    for role, values in first.measured.items():
        assert values.tobytes() == again.measured[role].tobytes()
        if "torque" in role:
            assert not np.array_equal(values, other.measured[role])
    for name, values in first.truth.items():
        assert values.tobytes() == other.truth[name].tobytes()


@pytest.mark.parametrize("run", ALL)
def test_ideal_sensors_tell_the_truth(run: Callable[..., Experiment]) -> None:
    played = run(ideal=True, duration=0.5)
    names = {"torque_sensor": "flexibility_torque", "setpoint": "secondary_position"}
    for role, values in played.measured.items():
        stem, suffix = (role[:-2], role[-2:]) if role[-2] == "_" else (role, "")
        np.testing.assert_array_equal(values, played.truth[names.get(stem, stem) + suffix])


@pytest.mark.parametrize(
    ("run", "pulses", "noise"),
    [(vsa2_experiment, 4059, 1e-3), (awas_experiment, 40_000, 0.05), (elastic_experiment, 36_000, 0.02)],
)
def test_sensors_have_the_stated_steps_and_noise(run: Callable[..., Experiment], pulses: int, noise: float) -> None:
    played = run()
    for role, values in played.measured.items():
        if role.startswith(("motor_torque", "torque_sensor")):
            true = played.truth[role.replace("torque_sensor", "flexibility_torque")]
            assert np.std(values - true) == pytest.approx(noise, rel=0.03)
            step = played.resolution[role]
            np.testing.assert_array_equal(values, np.round(values / step) * step)
        elif role != "setpoint":
            step = 2.0 * np.pi / pulses
            assert played.resolution[role] == pytest.approx(step, rel=1e-14)
            assert np.abs(values - played.truth[role]).max() <= step / 2.0 * (1.0 + 1e-9)
            np.testing.assert_allclose(values, np.round(values / step) * step, rtol=1e-14)


def test_noise_of_the_channels_is_independent() -> None:
    played = vsa2_experiment()
    noise = np.array(
        [
            played.measured[role] - played.truth[role.replace("torque_sensor", "flexibility_torque")]
            for role in ("motor_torque_1", "motor_torque_2", "torque_sensor_1", "torque_sensor_2")
        ]
    )
    assert np.abs(np.corrcoef(noise) - np.eye(4)).max() < 0.04


def test_everything_starts_at_rest_at_zero() -> None:
    for run in ALL:
        truth = run(duration=0.1).truth
        for name, values in truth.items():
            if "position" in name or "velocity" in name or "deflection" in name:
                assert values[0] == 0.0


def test_the_experiments_move_as_far_as_they_should() -> None:
    arms = [awas_experiment(n).truth["lever_arm"] for n in (1, 2)]
    assert arms[0].min() == pytest.approx(0.047, abs=0.002)
    assert arms[0].max() == pytest.approx(0.1, abs=1e-6)
    assert 0.047 < arms[1].min() < 0.055
    for n in (1, 2):
        truth = vsa2_experiment(n).truth
        for i in "12":
            assert 0.3 < np.abs(truth[f"deflection_{i}"]).max() < 0.6


def test_drift_scales_torque_and_stiffness_with_time() -> None:
    played = vsa2_experiment(ideal=True, duration=2.0, drift=0.01)
    joint = played.rig.joint["vsa2"]
    nominal = stiffness(joint.transmission_1, played.truth["deflection_1"])  # type: ignore[union-attr]
    np.testing.assert_allclose(played.truth["stiffness_1"], nominal * (0.5 + 0.01 * played.time) / 0.5)


def test_a_plant_that_differs_from_its_rig() -> None:
    played = vsa2_experiment(ideal=True, duration=1.0, inertia=7.5e-3, damping=0.9e-3)
    assert played.rig == vsa2_experiment(duration=0.1).rig
    usual = vsa2_experiment(ideal=True, duration=1.0)
    assert not np.array_equal(played.truth["motor_position_1"], usual.truth["motor_position_1"])


def test_a_held_input_acts_from_its_sample_on() -> None:
    # A free inertia pushed by 1 N·m during the second period alone: v = τ T / B from then on.
    joint = ElasticJoint(
        motor=Motor(inertia=2.0),
        transmission=LinearTransmission(stiffness=1e-12),
        link=elastic_rig().joint["sea"].link,
    )
    torque = np.array([0.0, 1.0, 0.0, 0.0])
    truth = simulate(RigFile(joint={"j": joint}), {"j": {"motor_torque": torque}}, 0.3, period=0.1).truth
    np.testing.assert_allclose(truth["motor_velocity"], [0.0, 0.0, 0.05, 0.05], atol=1e-12)
    np.testing.assert_array_equal(truth["motor_torque"], torque)


def test_channels_follow_the_rig_s_signals() -> None:
    rig = awas_rig()
    joint = rig.joint["awas"]
    assert isinstance(joint, SerialJoint)
    signals = msgspec.structs.replace(
        joint.signals,
        motor_torque=Signal(channel="/drive.data", side="rotor", sign=-1),
        motor_position=Signal(channel="/joint_states.position[rotor]", side="rotor", offset=0.2),
        setpoint=0.07,
    )
    renamed = RigFile(joint={"awas": msgspec.structs.replace(joint, signals=signals)})
    played = simulate(renamed, {"awas": {"motor_torque": lambda t: 5.0 * np.sin(t)}}, 0.5)
    channels = played.recording().channels
    np.testing.assert_allclose(channels["/drive.data"].values, -played.measured["motor_torque"] / 50.0)
    np.testing.assert_allclose(
        channels["/joint_states.position[rotor]"].values, (played.truth["motor_position"] + 0.2) * 50.0
    )
    assert not any("secondary" in name for name in channels)


def test_channels_are_in_the_rig_s_units() -> None:
    rig = awas_rig()
    joint = rig.joint["awas"]
    assert isinstance(joint, SerialJoint)
    signals = SerialSignals(
        motor_torque=Signal(channel="current", unit="mA"),
        link_position=Signal(channel="angle", unit="deg"),
        deflection=Signal(channel="twist", unit="mrad"),
        setpoint=Signal(channel="lever", unit="mm"),
    )
    motor = msgspec.structs.replace(joint.motor, torque_constant=0.02)
    recast = RigFile(joint={"awas": msgspec.structs.replace(joint, signals=signals, motor=motor)})
    torques = {"motor_torque": lambda t: 5.0 * np.sin(t), "secondary_torque": lambda t: 50.0 * np.sin(t)}
    played = simulate(recast, {"awas": torques}, 0.5)
    channels, truth = played.recording().channels, played.truth
    assert {name: c.unit for name, c in channels.items()} == {
        "current": "mA",
        "angle": "deg",
        "twist": "mrad",
        "lever": "mm",
    }
    np.testing.assert_allclose(channels["current"].values, truth["motor_torque"] / 50.0 / 0.02 * 1e3)
    np.testing.assert_allclose(channels["angle"].values, np.degrees(truth["link_position"]))
    np.testing.assert_allclose(channels["twist"].values, truth["deflection"] * 1e3)
    np.testing.assert_allclose(channels["lever"].values, truth["lever_arm"] * 1e3)


def test_one_torque_sensor_for_an_antagonistic_joint() -> None:
    rig = vsa2_rig()
    joint = rig.joint["vsa2"]
    assert isinstance(joint, AntagonisticJoint)
    signals = AntagonisticSignals(torque_sensor="/sensor.data", link_position="/q.data")
    played = simulate(
        RigFile(joint={"j": msgspec.structs.replace(joint, signals=signals)}), {"j": {"motor_torque_1": 0.02}}, 0.5
    )
    channels = played.recording().channels
    assert list(channels) == ["/q.data", "/sensor.data"]
    np.testing.assert_array_equal(channels["/sensor.data"].values, played.truth["flexibility_torque_total"])


@pytest.mark.parametrize(
    ("signals", "words"),
    [
        (SingleSignals(link_position="x", motor_position="x"), "another role"),
        (SingleSignals(link_position="{run}.q"), "run"),
        (SingleSignals(motor_torque=Signal(channel="i", unit="A")), "torque_constant"),
    ],
)
def test_signals_that_cannot_be_recorded(signals: SingleSignals, words: str) -> None:
    played = simulate(_elastic(signals=signals), {}, 0.1)
    with pytest.raises(SimulationError, match=words):
        played.recording()


def test_recording_and_truth_have_their_names() -> None:
    recording = vsa2_experiment(duration=0.1).recording(truth=True)
    stamps = recording.channel("/joint_states.position[link]").stamps
    assert stamps.dtype == np.int64
    assert np.all(np.diff(stamps) == 1_000_000)
    assert recording.channel("/joint_torque.effort[transmission_2]").stream == "/joint_torque"
    assert recording.channel("/truth/stiffness_total.data").values.shape == stamps.shape
    assert not any(n.startswith("/truth") for n in vsa2_experiment(duration=0.1).recording().channels)


def _elastic(**changes: object) -> RigFile:
    return RigFile(name="r", joint={"j": msgspec.structs.replace(elastic_rig().joint["sea"], **changes)})


@pytest.mark.parametrize(
    ("rig", "torques", "words"),
    [
        (RigFile(joint={"j": RigidJoint()}), {}, "rigid"),
        (RigFile(name="empty"), {}, "no joint"),
        (_elastic(motor=Motor()), {}, "inertia"),
        (_elastic(link=None), {}, "link"),
        (_elastic(transmission=UnknownTransmission()), {}, "type"),
        (elastic_rig(), {"motor_torque_1": 1.0}, "motor_torque_1"),
        (elastic_rig(), {"motor_torque": np.zeros(3)}, "one value per sample"),
        (elastic_rig(), {"motor_torque": np.nan}, "not finite"),
        (awas_rig(), {"secondary_torque": 1200.0}, "lever arm reaches zero"),
    ],
)
def test_what_cannot_be_simulated_is_reported(rig: RigFile, torques: dict[str, object], words: str) -> None:
    with pytest.raises(SimulationError, match=words):
        simulate(rig, dict.fromkeys(rig.joint, torques), 2.0)  # type: ignore[dict-item]


def test_the_singularity_of_the_four_bar_mechanism_is_reported() -> None:
    with pytest.raises(SimulationError, match="singularity"):
        vsa2_experiment(torques={"motor_torque_1": lambda t: 2.0 + 0.0 * t}, duration=5.0)


def test_unknown_experiment_number() -> None:
    with pytest.raises(SimulationError, match="experiment 7"):
        awas_experiment(7)
