"""What sensors and drives do, undone: against the closed forms of what they did, derivatives included."""

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.optimize import brentq
from written_out import ELASTIC, joint_of, signals

from vsalog.diagnosis.causes.base import with_part, with_signal
from vsalog.effects.delay import shifted
from vsalog.effects.eccentricity import Eccentricity
from vsalog.residuals.channels import Channels
from vsalog.residuals.sensing import (
    at_joint,
    bare,
    motors_of,
    sensor_reading,
    sensors_as_written,
    true_roles,
    whole_delays,
)
from vsalog.rig import Rig

PERIOD = 2e-3
TIME = np.arange(1500) * PERIOD
W = 2 * np.pi * 1.3


def wave(t, order=0, w=W):
    """0.8 sin(w t + 0.4) or one of its derivatives."""
    return 0.8 * w**order * np.sin(w * t + 0.4 + order * np.pi / 2)


def values(t, scale=1.0):
    return scale * np.stack([wave(t, k) for k in range(3)])


def perfect(**roles):
    """Channels that passed a filter without loss."""
    raw = {role: v[0] for role, v in roles.items()}
    starts = signals(raw, PERIOD).starts
    return Channels(PERIOD, TIME, roles, raw, starts, {}, 9, {})


def undone(joint, **roles):
    return true_roles(joint, perfect(**roles))


@pytest.mark.parametrize("gain", [1.0, 0.9, -1.3])
def test_gain_offset_and_drift(gain):
    joint = with_signal(joint_of(), "torque_sensor", gain=gain, offset=0.3, drift=0.02)
    m = gain * values(TIME)
    m[0] += 0.3 + 0.02 * TIME
    m[1] += 0.02
    found = undone(joint, torque_sensor=m)["torque_sensor"]
    np.testing.assert_allclose(found, values(TIME), atol=1e-10)


@pytest.mark.parametrize("delay", [3.4e-3, -1.1e-3, 6e-3])
def test_delay(delay):
    joint = with_signal(joint_of(), "link_position", delay=delay)
    found = undone(joint, link_position=values(TIME - delay))["link_position"]
    inside = slice(10, -10)
    # Between samples the straight line between two is taken: off by at most an eighth of curvature times T².
    for order in range(3):
        most = PERIOD**2 / 8 * 0.8 * W ** (order + 2)
        assert np.abs(found[order] - wave(TIME, order))[inside].max() <= most * 1.01


def test_eccentricity_with_gain():
    """m = g x + a sin(x + α): the oracle solves for x sample by sample, and has the derivatives by the chain rule forwards."""
    amplitude, phase, gain = 0.05, 0.7, 1.02
    joint = with_signal(joint_of(), "link_position", gain=gain, eccentricity=Eccentricity(amplitude, phase))
    x, dx, ddx = values(TIME)
    m = np.stack(
        [
            gain * x + amplitude * np.sin(x + phase),
            (gain + amplitude * np.cos(x + phase)) * dx,
            (gain + amplitude * np.cos(x + phase)) * ddx - amplitude * np.sin(x + phase) * dx**2,
        ]
    )
    found = undone(joint, link_position=m)["link_position"]
    roots = [
        brentq(lambda u, y=y: gain * u + amplitude * np.sin(u + phase) - y, -3, 3, xtol=1e-14) for y in m[0][::100]
    ]
    np.testing.assert_allclose(found[0][::100], roots, atol=1e-8)
    np.testing.assert_allclose(found, [x, dx, ddx], atol=1e-6 * W**2)


def test_all_of_a_sensor_at_once():
    disc = Eccentricity(0.03, -0.2)
    joint = with_signal(joint_of(), "motor_position", gain=0.97, offset=0.1, drift=-0.01, delay=4e-3, eccentricity=disc)
    x = wave(TIME - 4e-3)
    m = 0.97 * x + 0.1 - 0.01 * TIME + 0.03 * np.sin(x - 0.2)
    stacked = np.stack([m, np.gradient(m, TIME), np.gradient(np.gradient(m, TIME), TIME)])
    found = undone(joint, motor_position=stacked)["motor_position"]
    for order, tolerance in enumerate([1e-6, 2e-3, 2e-2]):
        np.testing.assert_allclose(found[order][20:-20], wave(TIME, order)[20:-20], atol=tolerance * W**order)


def test_a_sensor_simulated_is_a_sensor_undone():
    """`true_roles` is the inverse of `sensor_reading`."""
    disc = Eccentricity(0.03, -0.2)
    joint = with_signal(joint_of(), "motor_position", gain=0.97, offset=0.1, drift=-0.01, delay=4e-3, eccentricity=disc)
    m = sensor_reading(joint, "motor_position", {"motor_position": wave(TIME)}, TIME)
    stacked = np.stack([m, np.gradient(m, TIME), np.gradient(np.gradient(m, TIME), TIME)])
    found = undone(joint, motor_position=stacked)["motor_position"]
    np.testing.assert_allclose(found[0][20:-20], wave(TIME)[20:-20], atol=1e-6)


def test_what_acts_on_a_motor_is_later_and_other_than_what_is_recorded():
    joint = with_part(joint_of(), "motor", torque_gain=1.2, torque_offset=-0.1, torque_delay=4e-3)
    expected = 1.2 * wave(TIME - 5e-3) - 0.1
    found = true_roles(joint, perfect(motor_torque=values(TIME)), hold=1e-3)["motor_torque"]
    np.testing.assert_allclose(found[0][10:], expected[10:], atol=1e-4)
    np.testing.assert_allclose(found[1][10:], 1.2 * wave(TIME - 5e-3, 1)[10:], atol=1e-3)


def test_a_deflection_measured_over_a_second_spring_in_series():
    joint = joint_of(
        ELASTIC.replace('link_position = "link position"', 'deflection = { channel = "d", series_stiffness = 40.0 }')
    )
    torque = values(TIME, 2.0)
    found = undone(joint, deflection=values(TIME) + torque / 40.0, torque_sensor=torque)["deflection"]
    np.testing.assert_allclose(found, values(TIME), atol=1e-9)


@pytest.mark.parametrize("samples", [0.0, 2.0, -3.0, 1.25, -0.5])
def test_shifted_cubics_are_found_later(samples):
    at = np.linspace(-1.0, 1.0, 50)
    step = at[1] - at[0]
    cubics = [np.polynomial.Polynomial(c) for c in ([1.0, 3.0], [0.3, -1.0, 2.0], [0.5, 0.0, -1.0, 4.0])]
    found = shifted(np.stack([c(at) for c in cubics]), samples)
    inner = np.stack([c(at + samples * step) for c in cubics])[:, 5:-5]
    np.testing.assert_allclose(found[:, 5:-5], inner, atol=1e-12)


def test_half_a_sample_takes_little_off_what_swings_at_a_twentieth_of_the_rate():
    swing = np.stack([np.sin(2.0 * np.pi * np.arange(200.0) / 20.0 + phase) for phase in (0.0, 1.0, 2.0)])
    later = np.stack([np.sin(2.0 * np.pi * (np.arange(200.0) + 0.5) / 20.0 + phase) for phase in (0.0, 1.0, 2.0)])
    np.testing.assert_allclose(shifted(swing, 0.5)[:, 5:-5], later[:, 5:-5], atol=3e-4)


def test_a_bare_joint_has_perfect_sensors_and_drives_but_keeps_its_channels():
    joint = with_signal(joint_of(), "torque_sensor", gain=2.0, offset=1.0, drift=0.1, delay=1e-3)
    joint = with_part(joint, "motor", torque_gain=1.2, torque_offset=0.1, torque_delay=1e-3)
    plain = bare(joint)
    assert plain.motor == replace(joint.motor, torque_gain=1.0, torque_offset=0.0, torque_delay=0.0)
    assert plain.signals.torque_sensor.channel == "torque sensor"
    assert (plain.signals.torque_sensor.gain, plain.signals.torque_sensor.offset) == (1.0, 0.0)
    assert plain.transmission == joint.transmission


def test_rotors_are_reflected():
    awas = Rig.preset("awas").joints["awas"]
    assert motors_of(awas) == ("motor", "secondary_motor")
    there = at_joint(awas)
    assert there.motor.inertia == pytest.approx(2.3e-5 * 50**2)
    assert there.secondary_motor.damping == pytest.approx(0.0141 * 23**2)
    assert at_joint(there) == there


def test_sensors_that_count_are_reported_in_the_joints_units_and_written_as_they_count():
    disc = Eccentricity(3.0, 0.2)
    joint = with_signal(joint_of(), "link_position", gain=100.0, offset=5.0, drift=0.5, eccentricity=disc, delay=2e-3)
    there = at_joint(joint)
    told = there.signals.link_position
    assert (told.gain, told.offset, told.drift, told.delay) == (1.0, 0.05, 0.005, 2e-3)
    assert told.eccentricity == Eccentricity(0.03, 0.2)
    assert sensors_as_written(there, joint) == joint.signals
    found = with_signal(with_signal(there, "link_position", gain=1.02, offset=0.07), "torque_sensor", offset=0.1)
    back = sensors_as_written(found, joint)
    assert back.link_position.gain == pytest.approx(102.0)
    assert back.link_position.offset == pytest.approx(7.0)
    assert back.link_position.eccentricity == disc
    assert back.torque_sensor.offset == pytest.approx(0.1)
    assert back.motor_position == joint.signals.motor_position


@pytest.mark.parametrize(("samples", "whole"), [(-0.3, -1), (-0.2, 0), (0.7, 0), (0.8, 1), (1.7, 1)])
def test_a_whole_sample_is_counted_from_three_quarters_of_it_on(samples, whole):
    """What is early by less than a quarter is on time."""
    joint = with_signal(joint_of(), "link_position", delay=samples * PERIOD)
    assert whole_delays(joint, PERIOD) == ({"link_position": whole} if whole else {})
