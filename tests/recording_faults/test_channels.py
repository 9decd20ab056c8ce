"""Faults that a channel shows by itself, and what looks like one and is none."""

from pathlib import Path

import numpy as np
import pytest

from vsalog.checks import sensor
from vsalog.checks.channel import channel_findings, samples_per_knot, wraps
from vsalog.core.recording import Channel, Recording, Stream
from vsalog.core.signals import JointSignals
from vsalog.rig import Rig

PERIOD = 2e-3
T = np.arange(10_000) * PERIOD
STEP = 2.0 * np.pi / 40_000
SWING = 0.9 * np.sin(2.3 * T) + 0.2 * np.sin(7.1 * T)
RNG = np.random.default_rng(3)
RIG = """
[joint.j]
kind = "elastic"
[joint.j.signals]
link_position = "q"
"""


def read_by_encoder(x, step=STEP):
    return step * np.round(x / step)


def findings_of(values, unit="rad"):
    stamps = (T * 1e9).astype(np.int64)
    channel = Channel("q", stamps, values, unit, "log", "float64")
    recording = Recording(Path("log.csv"), "csv", {"q": channel}, {"log": Stream("log", "", T.size, "column")})
    ((name, joint),) = Rig.from_toml(RIG).joints.items()
    return {finding.code: finding for finding in channel_findings([recording], name, joint)}


def passing(values, role="link_position", step=STEP):
    starts = np.zeros(T.size, dtype=bool)
    starts[0] = True
    stamps = (T * 1e9).astype(np.int64)
    roles = {role: values}
    signals = JointSignals("j", PERIOD, stamps, T, roles, starts, np.zeros(T.size, np.int32), resolution={role: step})
    return {finding.code: finding for finding in sensor.passing(signals)}


@pytest.mark.parametrize("each", [2, 3, 7, 20])
def test_a_channel_that_was_interpolated_says_between_how_many_samples(each):
    noisy = SWING + 1e-3 * RNG.standard_normal(T.size)
    assert samples_per_knot(np.interp(T, T[::each], noisy[::each])) == each
    assert findings_of(np.interp(T, T[::each], noisy[::each]))["signal.interpolated"].value == each


@pytest.mark.parametrize(
    "sound",
    [
        SWING + 1e-3 * RNG.standard_normal(T.size),
        read_by_encoder(SWING),
        read_by_encoder(SWING, 0.01),
        read_by_encoder(0.3 * T),  # an even speed: steps recur, and are no knots
        read_by_encoder(np.where(T % 4.0 < 2.0, SWING, 0.5)),
        SWING,
        np.repeat(SWING[::5], 5),
    ],
)
def test_what_was_measured_is_not_interpolated(sound):
    assert samples_per_knot(sound) == 0


def test_an_encoder_that_wraps_is_noted_in_any_unit():
    turning = 1.7 * T
    assert findings_of(np.mod(turning, 2.0 * np.pi))["encoder.wrapped"].value == np.floor(turning[-1] / (2.0 * np.pi))
    assert findings_of(np.degrees(np.mod(turning, 2.0 * np.pi)), "deg")["encoder.wrapped"].severity == "info"
    assert "encoder.wrapped" not in findings_of(turning)
    assert wraps(np.where(T > 9.0, 6.0, 0.0), 2.0 * np.pi) == 1


def test_whole_numbers_in_radians_are_counts():
    assert "encoder.counts" in findings_of(np.round(4096 * SWING / (2.0 * np.pi)))
    assert "encoder.counts" not in findings_of(np.round(SWING))
    assert "encoder.counts" not in findings_of(read_by_encoder(SWING))


def test_a_position_that_was_cut_off_is_found():
    cut = np.clip(SWING, -0.7, 0.8)
    assert passing(read_by_encoder(cut))["sensor.clipped"].value > 0.01


@pytest.mark.parametrize(
    "sound",
    [
        SWING,
        np.sin(2.0 * T),
        # To an end of the range and a rest there, as a drive goes: evenly faster, evenly slower.
        np.interp(
            np.minimum(T % 4.0, 2.0), *(lambda s: (2.0 * s, 3.0 * s**2 - 2.0 * s**3))(np.linspace(0.0, 1.0, 400))
        ),
    ],
)
def test_what_turns_by_itself_was_not_cut_off(sound):
    assert "sensor.clipped" not in passing(read_by_encoder(sound))


def test_a_position_that_stood_still_and_jumped_was_frozen():
    frozen = read_by_encoder(SWING)
    frozen[3000:3400] = frozen[3000]
    found = passing(frozen)["sensor.frozen"]
    assert found.evidence["begin"] == pytest.approx(3000 * PERIOD)
    assert found.evidence["end"] == pytest.approx(3399 * PERIOD)
    assert found.value == pytest.approx(abs(frozen[3400] - frozen[3399]))
    rests = read_by_encoder(np.where(T < 6.0, 0.0, 1.0 - np.cos(np.maximum(T - 6.0, 0.0))))
    assert "sensor.frozen" not in passing(rests)


NOISY = SWING + 0.02 * RNG.standard_normal(T.size)


def test_noise_that_was_cut_off_piles_up_at_the_end():
    plateau = np.where(np.sin(2.0 * T) > 0.0, 0.5, -0.5) + 0.02 * RNG.standard_normal(T.size)
    for values in (plateau, read_by_encoder(plateau, 1e-3), NOISY):
        high = float(np.quantile(values, 0.85))
        assert passing(np.minimum(values, high), "motor_torque", 0.0)["sensor.saturated"].evidence["end"] == "highest"
        assert "sensor.saturated" not in passing(values, "motor_torque", 0.0)


def test_a_magnitude_s_turn_at_zero_is_no_saturation():
    for values in (np.abs(NOISY), read_by_encoder(np.abs(NOISY), 6.5e-3)):
        assert "sensor.saturated" not in passing(values, "motor_torque", 0.0)


def test_a_joint_that_sticks_where_it_turns_was_not_cut_off():
    """At an even speed between turns, at each of which it rests for a while; the turns are some encoder steps apart."""
    tops = STEP * 4000 * np.array([1.0, 0.9995, 1.0, 0.9995, 0.9995, 1.0, 0.9995, 1.0, 0.9995, 0.9995])
    corners = np.column_stack((np.zeros(10), np.zeros(10), tops, tops)).ravel()
    moving = np.interp(T, np.arange(40) * 0.5, corners)
    assert "sensor.clipped" not in passing(read_by_encoder(moving))
    assert "sensor.clipped" in passing(read_by_encoder(np.clip(1.05 * moving, 0.1 * tops[0], 0.9 * tops[0])))


def test_an_encoder_that_rests_and_goes_on_by_one_step_was_not_stuck():
    rests = np.where(T < 13.0, 0.0, STEP)
    assert "sensor.frozen" not in passing(rests)


def test_slow_motion_over_an_encoder_s_steps_is_found_to_be_interpolated():
    slow = read_by_encoder(0.002 * np.sin(0.7 * T))
    assert samples_per_knot(np.interp(T, T[::6], slow[::6])) == 6
    assert samples_per_knot(slow) == 0
