"""What sensors make of the truth, effect by effect, and that binding finds the truth again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from vsalog.binding.joint import bind, offered_roles
from vsalog.core.errors import SimulationError
from vsalog.effects.eccentricity import Eccentricity
from vsalog.estimation.joint import choose
from vsalog.mechanics.kinematics import chain_motion, specific_force
from vsalog.rig import Rig
from vsalog.rig.schema import (
    Accelerometer,
    Chain,
    ChainLink,
    ElasticJoint,
    Lever,
    Motor,
    RigFile,
    SerialJoint,
    SerialSignals,
    Signal,
    SingleSignals,
)
from vsalog.simulation.experiment import Experiment, JointRecord, sample_stamps
from vsalog.simulation.sensors import sense

Array = NDArray[np.float64]

COUNT = 20_001
T = np.arange(COUNT) * 1e-3
Q = np.sin(2.0 * T) + 0.1 * T
THETA = Q - 0.1 * np.sin(5.0 * T)
TORQUE = np.where(np.sin(T) > 0.0, 2.0, -1.0)  # held, with jumps
TRUTH = {
    "link_position": Q,
    "link_velocity": 2.0 * np.cos(2.0 * T) + 0.1,
    "link_acceleration": -4.0 * np.sin(2.0 * T),
    "motor_position": THETA,
    "motor_torque": TORQUE,
    "deflection": Q - THETA,
    "flexibility_torque": 20.0 * (Q - THETA),
    "transmission_torque": 20.0 * (Q - THETA) + 0.3 * np.cos(5.0 * T),
    "external_torque": np.zeros(COUNT),
}


def rig_of(**signals: Any) -> RigFile:
    return RigFile(joint={"j": ElasticJoint(signals=SingleSignals(**signals))})


def record(seed: int = 0, ideal: bool = False, **signals: Any) -> JointRecord:
    return sense({"j": TRUTH}, rig_of(**signals), T, seed, ideal)["j"]


def experiment(seed: int = 0, ideal: bool = False, **signals: Any) -> Experiment:
    rig = rig_of(**signals)
    return Experiment("e", rig, 1e-3, sample_stamps(COUNT, 1e-3), T, sense({"j": TRUTH}, rig, T, seed, ideal))


def channel(**keys: Any) -> Signal:
    return Signal(channel="/a.data", **keys)


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({}, Q),
        ({"gain": 1.1}, 1.1 * Q),
        ({"offset": 0.3}, Q + 0.3),
        ({"drift": -0.02}, Q - 0.02 * T),
        ({"eccentricity": Eccentricity(amplitude=0.03, phase=0.5)}, Q + 0.03 * np.sin(Q + 0.5)),
        ({"delay": 0.0042}, np.sin(2.0 * np.maximum(T - 0.0042, 0.0)) + 0.1 * np.maximum(T - 0.0042, 0.0)),
        ({"delay": -0.0042}, np.sin(2.0 * np.minimum(T + 0.0042, 20.0)) + 0.1 * np.minimum(T + 0.0042, 20.0)),
        ({"gain": 2.0, "offset": 1.0, "drift": 0.1, "sign": -1, "side": "rotor"}, 2.0 * Q + 1.0 + 0.1 * T),
    ],
)
def test_each_systematic_effect_is_the_stated_formula_and_stays_in_ideal_sensors(
    keys: dict[str, Any], expected: Array
) -> None:
    for ideal in (False, True):
        np.testing.assert_allclose(
            record(ideal=ideal, link_position=channel(**keys)).measured["link_position"], expected
        )


def test_steps_are_rounded_to_the_nearest() -> None:
    found = record(link_position=channel(resolution=0.01))
    values = found.measured["link_position"]
    assert found.resolution["link_position"] == 0.01
    np.testing.assert_allclose(values / 0.01, np.round(values / 0.01), atol=1e-9)
    assert np.abs(values - Q).max() <= 0.005 + 1e-12
    assert not np.signbit(values[values == 0.0]).any()


def test_noise_is_gaussian_and_of_the_stated_size() -> None:
    noise = record(torque_sensor=channel(noise=0.05)).measured["torque_sensor"] - TRUTH["transmission_torque"]
    assert np.std(noise) == pytest.approx(0.05, rel=0.02)
    assert abs(np.mean(noise)) < 4.0 * 0.05 / COUNT**0.5
    assert np.mean(np.abs(noise) < 0.05) == pytest.approx(0.6827, abs=0.015)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.03


def test_ideal_sensors_have_no_noise_no_steps_no_jitter_and_lose_nothing() -> None:
    rough = channel(noise=0.1, resolution=0.1, jitter=1e-4, dropped=0.5, offset=0.2)
    found = record(ideal=True, link_position=rough)
    np.testing.assert_array_equal(found.measured["link_position"], Q + 0.2)
    assert (found.late, found.kept, found.resolution) == ({}, {}, {"link_position": 0.0})


def test_a_torque_sensor_feels_what_is_transmitted_with_damping_and_hysteresis() -> None:
    found = record(
        torque_sensor="/t.data", motor_torque="/m.data", link_acceleration="/a.data", external_torque="/e.data"
    )
    np.testing.assert_array_equal(found.measured["torque_sensor"], TRUTH["transmission_torque"])
    for role in ("motor_torque", "link_acceleration", "external_torque"):
        np.testing.assert_array_equal(found.measured[role], TRUTH[role])


def test_held_torques_are_not_made_to_overshoot_by_a_delay() -> None:
    late = record(motor_torque=channel(delay=0.0037)).measured["motor_torque"]
    assert late.min() == -1.0
    assert late.max() == 2.0


def test_a_sensor_more_or_less_does_not_change_the_others() -> None:
    noisy = {
        role: Signal(channel=f"/{role}.data", noise=0.1, jitter=1e-5, dropped=0.1)
        for role in ("link_position", "torque_sensor")
    }
    alone, both = record(link_position=noisy["link_position"]), record(**noisy)
    for found in ("measured", "late", "kept"):
        np.testing.assert_array_equal(getattr(alone, found)["link_position"], getattr(both, found)["link_position"])
    torque = both.measured["torque_sensor"] - TRUTH["transmission_torque"]
    assert abs(np.corrcoef(torque, both.measured["link_position"] - Q)[0, 1]) < 0.03


def test_joints_have_noise_of_their_own_and_seeds_matter() -> None:
    joint = ElasticJoint(signals=SingleSignals(link_position=channel(noise=0.1)))
    rig = RigFile(joint={"a": joint, "b": joint})
    found = sense({"a": TRUTH, "b": TRUTH}, rig, T, 3, False)
    a, b = (found[name].measured["link_position"] for name in "ab")
    assert abs(np.corrcoef(a - Q, b - Q)[0, 1]) < 0.03
    again, other = (sense({"a": TRUTH}, rig, T, seed, False)["a"].measured["link_position"] for seed in (3, 4))
    np.testing.assert_array_equal(a, again)
    assert not np.array_equal(a, other)


def test_a_deflection_is_the_difference_of_what_two_encoders_count() -> None:
    encoders = {
        "link_position": Signal(channel="/q.data", resolution=0.01),
        "motor_position": Signal(channel="/m.data", resolution=0.002),
    }
    found = record(deflection="/d.data", **encoders).measured
    np.testing.assert_allclose(found["deflection"], found["link_position"] - found["motor_position"], atol=1e-15)
    own = record(deflection=Signal(channel="/d.data", resolution=0.05), **encoders).measured["deflection"]
    np.testing.assert_allclose(own, np.round((Q - THETA) / 0.05) * 0.05, atol=1e-12)
    np.testing.assert_array_equal(
        record(ideal=True, deflection="/d.data", **encoders).measured["deflection"], Q - THETA
    )


def test_a_set_point_is_an_angle_or_a_lever_arm_as_its_unit_says() -> None:
    angle = 3.0 * np.sin(T)
    truth = {
        "link_position": Q,
        "secondary_position": angle,
        "lever_arm": 0.1 - 4e-4 * angle,
        "secondary_torque": TORQUE,
    }
    joint = SerialJoint(
        lever=Lever(start=0.1, travel=4e-4), secondary_motor=Motor(gear_ratio=23.0), signals=SerialSignals()
    )

    def recorded(unit: str, **keys: Any) -> Array:
        signals = SerialSignals(setpoint=Signal(channel="/s.data", unit=unit, **keys), secondary_torque="/t.data")
        rig = RigFile(
            joint={"j": SerialJoint(lever=joint.lever, secondary_motor=joint.secondary_motor, signals=signals)}
        )
        played = Experiment("e", rig, 1e-3, sample_stamps(COUNT, 1e-3), T, sense({"j": truth}, rig, T, 0, False))
        np.testing.assert_array_equal(played.measured["secondary_torque"], TORQUE)
        return played.recording().channels["/s.data"].values

    np.testing.assert_allclose(recorded("deg", side="rotor", offset=0.1), np.degrees(23.0 * (angle + 0.1)))
    np.testing.assert_allclose(recorded("mm", offset=0.002), 102.0 - 0.4 * angle)


def test_jitter_and_losses_are_those_of_the_message() -> None:
    played = experiment(
        link_position=Signal(channel="/joint_states.position[link]", jitter=1e-4),
        motor_position=Signal(channel="/joint_states.position[motor]", dropped=0.1),
        torque_sensor=Signal(channel="/torque.data", noise=0.1),
    )
    log = played.recording(truth=True)
    link, motor = (log.channels[f"/joint_states.position[{name}]"] for name in ("link", "motor"))
    assert link.stamps is motor.stamps
    assert np.diff(link.stamps).min() > 0
    assert link.stamps.size / COUNT == pytest.approx(0.9, abs=0.01)
    nearest = np.round((link.stamps - 1_767_225_600_000_000_000) / 1e6)
    off = (link.stamps - 1_767_225_600_000_000_000) * 1e-9 - nearest * 1e-3
    assert np.std(off) == pytest.approx(1e-4, rel=0.03)
    # The values are those of the time that was meant.
    np.testing.assert_array_equal(link.values, Q[nearest.astype(int)])
    np.testing.assert_array_equal(motor.values, THETA[nearest.astype(int)])
    assert log.streams["/joint_states"].count == link.stamps.size
    for name in ("/torque.data", "/truth/deflection.data"):
        np.testing.assert_array_equal(log.channels[name].stamps, played.stamps)


def test_stamps_stay_in_order_however_much_they_are_off() -> None:
    stamps = experiment(link_position=channel(jitter=0.05)).recording().channels["/a.data"].stamps
    assert stamps.size == COUNT
    assert np.diff(stamps).min() > 0


def test_all_samples_may_be_lost() -> None:
    assert experiment(link_position=channel(dropped=1.0)).recording().channels["/a.data"].values.size == 0


def test_two_joints_share_the_clock_of_a_topic_and_name_their_truth() -> None:
    def joint(name: str, jitter: float) -> ElasticJoint:
        return ElasticJoint(
            signals=SingleSignals(link_position=Signal(channel=f"/joint_states.position[{name}]", jitter=jitter))
        )

    rig = RigFile(joint={"a": joint("a", 1e-4), "b": joint("b", 0.0)})
    played = Experiment(
        "e", rig, 1e-3, sample_stamps(COUNT, 1e-3), T, sense({"a": TRUTH, "b": TRUTH}, rig, T, 0, False)
    )
    log = played.recording(truth=True)
    assert log.channels["/joint_states.position[a]"].stamps is log.channels["/joint_states.position[b]"].stamps
    assert {"/truth/a/deflection.data", "/truth/b/deflection.data"} <= set(log.channels)
    assert played.joint == "a"
    assert played.measured is played.joints["a"].measured


def test_two_joints_cannot_have_one_channel() -> None:
    joint = ElasticJoint(signals=SingleSignals(link_position="/a.data"))
    rig = RigFile(joint={"a": joint, "b": joint})
    records = sense({"a": TRUTH, "b": TRUTH}, rig, T, 0, False)
    with pytest.raises(SimulationError, match=r"joint 'b': /a\.data is recorded of another joint already"):
        Experiment("e", rig, 1e-3, sample_stamps(COUNT, 1e-3), T, records).recording()


def test_what_there_is_no_truth_of_is_not_recorded() -> None:
    truth = {name: values for name, values in TRUTH.items() if name != "motor_torque"}
    rig = rig_of(motor_torque="/m.data", link_position="/q.data")
    assert list(sense({"j": truth}, rig, T, 0, False)["j"].measured) == ["link_position"]


ARM = Chain(
    link=(
        ChainLink(joint="a", length=0.4, twist=1.0),
        ChainLink(
            joint="b", length=0.3, accelerometer=Accelerometer(position=(-0.1, 0.0, 0.02), orientation=(0.1, 0.2, 0.3))
        ),
    )
)


def test_an_accelerometer_of_the_chain_reads_specific_force() -> None:
    axes = {f"accelerometer_{axis}": Signal(channel=f"/imu.{axis}", offset=0.01) for axis in "xyz"}
    rig = RigFile(joint={"a": ElasticJoint(), "b": ElasticJoint(signals=SingleSignals(**axes))}, chain=ARM)
    found = sense({"a": TRUTH, "b": TRUTH}, rig, T, 0, True)["b"].measured
    moved = (np.stack([TRUTH[f"link_{what}"]] * 2, axis=-1) for what in ("position", "velocity", "acceleration"))
    mounting = ARM.link[1].accelerometer
    assert mounting is not None
    expected = specific_force(chain_motion(ARM, *moved)[1], mounting, ARM.gravity) + 0.01
    np.testing.assert_allclose(np.stack([found[role] for role in axes], axis=-1), expected)


@pytest.mark.parametrize("chain", [None, Chain(link=(ChainLink(joint="other"),)), Chain(link=(ChainLink(joint="j"),))])
def test_an_accelerometer_needs_to_be_told_where_it_sits(chain: Chain | None) -> None:
    rig = RigFile(
        joint={"j": ElasticJoint(signals=SingleSignals(accelerometer_x="/x.data")), "other": ElasticJoint()},
        chain=chain,
    )
    with pytest.raises(SimulationError, match=r"joint 'j' has an accelerometer.*\[\[chain.link\]\]"):
        sense({"j": TRUTH, "other": TRUTH}, rig, T, 0, False)


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(SimulationError, match="seed -1"):
        record(seed=-1, link_position="/q.data")


SMALL = 2001
WAVE = np.sin(2.0 * T[:SMALL])


@settings(max_examples=60, deadline=None)
@given(
    role=st.sampled_from(
        ["motor_position", "link_position", "deflection", "motor_torque", "torque_sensor", "external_torque"]
    ),
    gain=st.floats(0.5, 2.0),
    offset=st.floats(-5.0, 5.0),
    drift=st.floats(-1.0, 1.0),
    delay=st.floats(-0.05, 0.05),
    amplitude=st.floats(0.0, 0.3),
    phase=st.floats(-4.0, 4.0),
    sign=st.sampled_from([1, -1]),
    side=st.sampled_from(["joint", "rotor"]),
    unit=st.sampled_from([0, 1, 2]),
)
def test_binding_finds_the_truth_again(
    role: str,
    gain: float,
    offset: float,
    drift: float,
    delay: float,
    amplitude: float,
    phase: float,
    sign: Any,
    side: Any,
    unit: int,
) -> None:
    """What is left is the interpolation back onto the other channel's clock: x″ T² / 8 = 5e-7, more where a gain is small."""
    angle = "torque" not in role
    disc = Eccentricity(amplitude=amplitude, phase=phase) if angle and amplitude > 0.0 else None
    units = ["rad", "deg", "mrad"] if angle else ["N·m", "N·mm", "A" if role == "motor_torque" else "mNm"]
    systematic: dict[str, Any] = {"gain": gain, "offset": offset, "drift": drift, "delay": delay, "eccentricity": disc}
    signal = Signal(channel="/x.data", unit=units[unit], sign=sign, side=side, **systematic)
    other = "link_position" if role != "link_position" else "motor_position"
    signals = SingleSignals(**{role: signal, other: "/y.data"})
    rig = RigFile(joint={"j": ElasticJoint(motor=Motor(gear_ratio=50.0, torque_constant=0.1), signals=signals)})
    truth = {role if role != "torque_sensor" else "transmission_torque": WAVE, other: WAVE}
    time = T[:SMALL]
    played = Experiment("e", rig, 1e-3, sample_stamps(SMALL, 1e-3), time, sense({"j": truth}, rig, time, 0, False))
    bound = bind([played.recording()], "j", rig.joint["j"], (role, other))
    # Where the sensor would have had to look before the first or beyond the last sample, it saw the first or the last.
    inside = (bound.time > abs(delay) + 0.002) & (bound.time < time[-1] - abs(delay) - 0.002)
    assert np.count_nonzero(inside) > SMALL * 0.9
    np.testing.assert_allclose(bound.roles[role][inside], bound.roles[other][inside], atol=3e-6)


def test_roles_that_no_estimator_reads_are_offered_but_not_asked_for() -> None:
    extra = {role: f"/{role}.data" for role in ("external_torque", "link_acceleration", "accelerometer_x")}
    known = {role: f"/{role}.data" for role in ("motor_position", "link_position", "motor_torque")}
    joint = ElasticJoint(motor=Motor(inertia=0.1), signals=SingleSignals(**known, **extra))
    choice = choose("j", joint, "auto", {})
    assert set(extra) <= set(offered_roles(joint))
    assert set(choice.roles) == set(known)
    truth = {name: values for name, values in TRUTH.items() if name not in extra}
    rig = RigFile(joint={"j": ElasticJoint(signals=SingleSignals(**known))})
    log = Experiment("e", rig, 1e-3, sample_stamps(COUNT, 1e-3), T, sense({"j": truth}, rig, T, 0, False)).recording()
    assert set(bind([log], "j", joint, choice.roles).roles) == set(known)


def test_a_noisy_log_binds_to_the_truth_within_noise_and_steps() -> None:
    step, noise = 1e-3, 2e-3
    systematic = 'unit = "deg", gain = 1.02, offset = "3 deg", drift = 0.001, delay = 0.002'
    disc = "eccentricity = { amplitude = 0.02, phase = 0.3 }"
    rest = f"noise = {noise}, resolution = {step}, jitter = 2e-5, dropped = 0.01"
    rig = Rig.from_toml(
        '[joint.j]\nkind = "elastic"\n[joint.j.signals]\nmotor_position = "/m.data"\n'
        f'link_position = {{ channel = "/q.data", {systematic}, {disc}, {rest} }}'
    ).file
    played = Experiment("e", rig, 1e-3, sample_stamps(COUNT, 1e-3), T, sense({"j": TRUTH}, rig, T, 5, False))
    bound = bind([played.recording()], "j", rig.joint["j"], ("link_position", "motor_position"))
    index = np.round(bound.time / 1e-3).astype(int)
    error = bound.roles["link_position"] - Q[index]
    # Noise and rounding, over a gain less eccentricity of at least 1; jitter adds 2 rad/s · 20 µs.
    allowed = np.hypot(noise, step / 12**0.5) + 4e-5
    assert np.nanstd(error) < 1.05 * allowed
    assert abs(np.nanmean(error)) < 5.0 * allowed / COUNT**0.5
    # Of two samples in a row that are lost neither is known.
    assert np.isnan(error).mean() < 5.0 * 0.01**2
    assert bound.resolution["link_position"] == pytest.approx(step / 1.02)
