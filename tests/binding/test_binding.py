"""Recordings bound to rigs: units, gears and signs, clocks, rates and gaps."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_coeffs, savgol_filter

from vsalog.binding.grid import after_long_silence, is_even
from vsalog.binding.joint import bind, offered_roles, wanted_channels
from vsalog.core.errors import BindingError, RigError
from vsalog.core.recording import Channel, Recording
from vsalog.rig import Rig


def recording(name="log.csv", **channels):
    """channels: name → (seconds, values) or (seconds, values, unit)."""
    made = {}
    for key, (seconds, values, *unit) in channels.items():
        stamps = 1_700_000_000_000_000_000 + np.round(np.asarray(seconds) * 1e9).astype(np.int64)
        made[key] = Channel(key, stamps, np.asarray(values, dtype=float), unit[0] if unit else None, key, "float64")
    return Recording(Path(name), "csv", made, {})


def joint_of(text):
    rig = Rig.from_toml(text)
    ((name, joint),) = rig.joints.items()
    return name, joint


ELASTIC = """
[joint.j]
kind = "elastic"
[joint.j.motor]
gear_ratio = 50.0
torque_constant = 0.1
[joint.j.signals]
"""


def bound(signals, rec, **options):
    name, joint = joint_of(ELASTIC + signals)
    return bind([rec], name, joint, tuple(offered_roles(joint)), **options)


T = np.arange(1000) * 1e-3


@pytest.mark.parametrize(
    ("signal", "unit", "factor"),
    [
        ('motor_position = "x"', "deg", np.pi / 180.0),
        ('motor_position = { channel = "x", unit = "deg" }', None, np.pi / 180.0),
        ('motor_position = { channel = "x", unit = "rad" }', "deg", 1.0),
        ('motor_position = { channel = "x", side = "rotor" }', None, 1.0 / 50.0),
        ('motor_position = { channel = "x", side = "rotor", sign = -1 }', "deg", -np.pi / 180.0 / 50.0),
        ('motor_torque = "x"', "N·mm", 1e-3),
        ('motor_torque = { channel = "x", side = "rotor" }', None, 50.0),
        ('motor_torque = "x"', "A", 0.1 * 50.0),
        ('motor_torque = "x"', "mA", 1e-3 * 0.1 * 50.0),
        ('link_position = "x"', "mrad", 1e-3),
        ('torque_sensor = { channel = "x", sign = -1 }', None, -1.0),
    ],
)
def test_units_gears_and_signs(signal, unit, factor):
    x = np.sin(T)
    signals = bound(signal, recording(x=(T, x, unit)))
    (values,) = signals.roles.values()
    np.testing.assert_allclose(values, factor * x, rtol=1e-12)
    assert signals.period == pytest.approx(1e-3)


@pytest.mark.parametrize("role", ["motor_position", "motor_velocity", "motor_torque"])
def test_what_is_before_a_gear_of_unknown_ratio_is_refused(role):
    name, joint = joint_of(ELASTIC.replace("gear_ratio = 50.0\n", "") + f'{role} = {{ channel = "x", side = "rotor" }}')
    with pytest.raises(BindingError, match="gear_ratio"):
        bind([recording(x=(T, np.sin(T)))], name, joint, [role])


def test_an_offset_is_subtracted_in_si_after_everything_else():
    signals = bound('motor_position = { channel = "x", unit = "deg", sign = -1, offset = 0.5 }', recording(x=(T, T)))
    np.testing.assert_allclose(signals.roles["motor_position"], -np.deg2rad(T) - 0.5)


SENSOR = '{ channel = "x", gain = 1.02, offset = 0.3, drift = 0.01, eccentricity = { amplitude = 0.02, phase = 1.0 } }'


def test_what_a_sensor_does_is_undone():
    x = np.sin(3.0 * T)
    m = 1.02 * x + 0.3 + 0.01 * T + 0.02 * np.sin(x + 1.0)
    signals = bound(f"motor_position = {SENSOR}", recording(x=(T, m)))
    np.testing.assert_allclose(signals.roles["motor_position"], x, atol=1e-12)


def test_the_drift_counts_from_the_log_s_start():
    late = T + 0.25
    signals = bound(
        'motor_position = { channel = "x", drift = 0.1 }\nlink_position = "y"',
        recording(x=(late, 0.1 * late), y=(T, T)),
    )
    np.testing.assert_allclose(signals.roles["motor_position"], 0.0, atol=1e-12)


@pytest.mark.parametrize("delay", [0.003, 0.0034, -0.0023, 0.2])
def test_a_late_sensor_is_put_back_in_time(delay):
    x = np.sin(3.0 * T)
    signals = bound(
        f'motor_position = {{ channel = "x", delay = {delay} }}\nlink_position = "y"',
        recording(x=(T, np.sin(3.0 * (T - delay))), y=(T, x)),
    )
    # Between samples the position is taken along a straight line: 3² · T² / 8 off.
    np.testing.assert_allclose(signals.roles["motor_position"], signals.roles["link_position"], atol=1.2e-6)
    assert len(signals) >= T.size - abs(delay) / 1e-3 - 2


def test_a_large_eccentricity_converges():
    x = np.linspace(-7.0, 7.0, T.size)
    signals = bound(
        'link_position = { channel = "x", eccentricity = { amplitude = 0.9 } }', recording(x=(T, x + 0.9 * np.sin(x)))
    )
    np.testing.assert_allclose(signals.roles["link_position"], x, atol=1e-11)


def test_a_sample_that_is_no_number_does_not_spoil_the_others():
    x = np.sin(3.0 * T)
    m = 1.02 * x + 0.3 + 0.01 * T + 0.02 * np.sin(x + 1.0)
    m[7:9] = np.nan
    signals = bound(f"motor_position = {SENSOR}", recording(x=(T, m)))
    assert list(np.flatnonzero(np.isnan(signals.roles["motor_position"]))) == [7, 8]
    np.testing.assert_allclose(np.delete(signals.roles["motor_position"], (7, 8)), np.delete(x, (7, 8)), atol=1e-12)


@pytest.mark.parametrize("stated", ["", ", resolution = 0.01"])
def test_the_step_is_that_of_the_sensor_over_its_gain(stated):
    m = np.round((2.0 * np.sin(3.0 * T) + 0.1 * T) / 0.01) * 0.01
    signals = bound(f'link_position = {{ channel = "x", gain = 2, drift = 0.1{stated} }}', recording(x=(T, m)))
    assert signals.resolution["link_position"] == pytest.approx(0.005, rel=1e-6)


@pytest.mark.parametrize(
    ("role", "unit", "like"),
    [
        ("external_torque", "N·mm", 1e-3),
        ("link_acceleration", "deg/s^2", np.pi / 180.0),
        ("accelerometer_x", "mm/s^2", 1e-3),
        ("accelerometer_z", None, 1.0),
    ],
)
def test_roles_that_no_estimator_uses_are_bound_too(role, unit, like):
    signals = bound(f'{role} = {{ channel = "x", sign = -1 }}', recording(x=(T, np.sin(T), unit)))
    np.testing.assert_allclose(signals.roles[role], -like * np.sin(T), rtol=1e-12)


@pytest.mark.parametrize(
    ("unit", "side", "factor"), [("A", "joint", 2.0), ("N·m", "rotor", 20.0), ("N·m", "joint", 1.0)]
)
def test_the_secondary_torque_is_that_of_the_secondary_motor(unit, side, factor):
    name, joint = joint_of(
        '[joint.j]\nkind = "serial"\n[joint.j.motor]\ngear_ratio = 50\n'
        "[joint.j.secondary_motor]\ngear_ratio = 20\ntorque_constant = 0.1\n"
        f'[joint.j.signals]\nsecondary_torque = {{ channel = "x", side = "{side}" }}'
    )
    signals = bind([recording(x=(T, T, unit))], name, joint, ("secondary_torque",))
    np.testing.assert_allclose(signals.roles["secondary_torque"], factor * T)


def test_a_current_needs_a_torque_constant():
    name, joint = joint_of(
        '[joint.j]\nkind = "elastic"\n[joint.j.signals]\nmotor_torque = { channel = "x", unit = "A" }'
    )
    with pytest.raises(BindingError, match="torque_constant"):
        bind([recording(x=(T, T))], name, joint, ("motor_torque",))


def test_an_angle_becomes_the_lever_arm_and_a_length_is_one():
    text = """
[joint.j]
kind = "serial"
[joint.j.lever]
start = 0.1
travel = 4e-4
[joint.j.signals]
setpoint = "x"
deflection = "y"
"""
    name, joint = joint_of(text)
    angle = bind([recording(x=(T, 10.0 * T), y=(T, T))], name, joint, ("setpoint", "deflection"))
    np.testing.assert_allclose(angle.roles["setpoint"], 0.1 - 4e-4 * 10.0 * T)
    name, stated = joint_of(text.replace('setpoint = "x"', 'setpoint = { channel = "x", resolution = 1e-3 }'))
    angle = bind([recording(x=(T, 10.0 * T), y=(T, T))], name, stated, ("setpoint", "deflection"))
    assert angle.resolution["setpoint"] == pytest.approx(4e-7)  # a step of the angle, as a length
    length = bind([recording(x=(T, 80.0 + T, "mm"), y=(T, T))], name, joint, ("setpoint", "deflection"))
    np.testing.assert_allclose(length.roles["setpoint"], (80.0 + T) * 1e-3)


TWO = 'motor_position = "x"\nlink_position = "y"\n'


def test_channels_on_one_clock_are_taken_as_they_are():
    x, y = np.random.default_rng(0).normal(size=(2, 1000))
    signals = bound(TWO, recording(x=(T, x), y=(T, y)))
    np.testing.assert_array_equal(signals.roles["motor_position"], x)
    np.testing.assert_array_equal(signals.roles["link_position"], y)
    assert list(np.flatnonzero(signals.starts)) == [0]


def test_a_slower_channel_is_interpolated_onto_the_faster_grid():
    slow = np.arange(100) * 1e-2
    signals = bound(TWO, recording(x=(T, T), y=(slow, 3.0 * slow)))
    assert signals.period == pytest.approx(1e-3)
    np.testing.assert_allclose(signals.roles["link_position"], 3.0 * signals.time, atol=1e-9)


@pytest.mark.parametrize(("least", "greatest", "even"), [(980, 1020, True), (979, 1000, False), (1000, 1021, False)])
def test_stamps_that_stray_by_a_fiftieth_of_the_period_are_on_the_grid(least, greatest, even):
    assert is_even(least, greatest, 1000) is even


def test_jittered_stamps_are_brought_onto_an_even_grid():
    rng = np.random.default_rng(1)
    jittered = T + rng.uniform(-3e-4, 3e-4, T.size)
    signals = bound(TWO, recording(x=(jittered, np.sin(5 * jittered)), y=(jittered, np.cos(5 * jittered))))
    assert np.ptp(np.diff(signals.stamps)) == 0
    start = jittered[0] + signals.time
    np.testing.assert_allclose(signals.roles["motor_position"], np.sin(5 * start), atol=1e-4)


@pytest.mark.parametrize(("every", "jitter"), [(1, 0.3), (10, 0.0), (3, 0.2)])
def test_noise_of_samples_between_those_of_the_grid_is_that_of_what_was_recorded(every, jitter):
    """Neighbours on the grid share a sample's noise: their differences hide it, and averages over them are as noisy as ever."""
    rng, noise = np.random.default_rng(4), 1e-3
    fast = np.arange(60_000) * 1e-3
    slow = fast[::every] + 1e-3 * every * rng.uniform(-jitter, jitter, fast[::every].size)
    said = np.sin(3 * slow) + noise * rng.normal(size=slow.size)
    signals = bound(TWO, recording(x=(fast, fast), y=(slow, said)), noise=True)
    found = signals.interpolated["link_position"]
    off = signals.roles["link_position"] - np.sin(3e-9 * (signals.stamps - 1_700_000_000_000_000_000))
    assert found.deviation == pytest.approx(noise * every**0.5, rel=0.06)
    inside = slice(100, -100)
    assert found.share * found.deviation == pytest.approx(np.std(off[inside]), rel=0.06)
    filtered = savgol_filter(off, 101, 4)[inside]
    assert found.deviation * np.linalg.norm(savgol_coeffs(101, 4)) == pytest.approx(np.std(filtered), rel=0.1)


def test_noise_of_runs_is_that_of_the_noisiest():
    rng, pieces = np.random.default_rng(5), []
    for name, noise in (("a.csv", 1e-3), ("b.csv", 4e-3)):
        slow = np.arange(2000) * 2e-3
        x = np.sin(slow) + noise * rng.normal(size=slow.size)
        pieces.append(recording(name, x=(np.arange(4000) * 1e-3, np.zeros(4000)), y=(slow, x)))
    name, joint = joint_of(ELASTIC + TWO)
    signals = bind(pieces, name, joint, tuple(offered_roles(joint)), noise=True)
    assert signals.interpolated["link_position"].deviation == pytest.approx(4e-3 * 2**0.5, rel=0.1)


def test_a_gap_splits_the_run_and_nothing_is_bridged():
    keep = (T < 0.4) | (T > 0.45)
    signals = bound(TWO, recording(x=(T[keep], T[keep]), y=(T, T)))
    starts = np.flatnonzero(signals.starts)
    assert starts.size == 2
    assert not ((signals.time > 0.4) & (signals.time < 0.45)).any()
    assert [(f.code, f.value) for f in signals.findings] == [("recording.gaps", 1.0)]


@pytest.mark.parametrize(("missing", "again"), [(25, False), (26, True)])
def test_a_run_begins_again_after_half_a_usual_window_without_a_number(missing, again):
    values = np.where((np.arange(50) >= 10) & (np.arange(50) < 10 + missing), np.nan, 1.0)
    assert after_long_silence({"link_position": values})[0].any() == again


def test_one_lost_sample_is_no_gap():
    keep = np.arange(1000) != 500
    signals = bound(TWO, recording(x=(T[keep], T[keep]), y=(T[keep], T[keep])))
    assert np.count_nonzero(signals.starts) == 1


@pytest.mark.parametrize("slower", [1, 10])
def test_an_empty_cell_is_what_a_missing_row_is(slower):
    x, y = np.sin(3.0 * T), np.cos(2.0 * T[::slower])
    keep = np.arange(y.size) != 50
    empty = np.where(keep, y, np.nan)
    lacking = bound(TWO, recording(x=(T, x), y=(T[::slower][keep], y[keep])))
    signals = bound(TWO, recording(x=(T, x), y=(T[::slower], empty)))
    for role, values in lacking.roles.items():
        np.testing.assert_allclose(signals.roles[role], values, rtol=0.0, atol=1e-15)
    assert np.count_nonzero(signals.starts) == 1
    assert ("recording.not_finite", 1.0) in [(f.code, f.value) for f in signals.findings]


@pytest.mark.parametrize("empty", [False, True])
def test_many_single_lost_samples_do_not_bias_a_motion(empty):
    x = 1.0 + np.sin(40.0 * T)  # a line through neighbours misses (40 T)² / 2 of the amplitude
    keep = np.arange(1000) % 4 != 2
    lacking = (T, np.where(keep, x, np.nan)) if empty else (T[keep], x[keep])
    error = bound(TWO, recording(x=lacking, y=(T, T))).roles["motor_position"] - x
    assert np.count_nonzero(error) == np.count_nonzero(~keep)
    # The error of a cubic through −2, −1, 1 and 2 samples is T⁴ / 6 times the fourth derivative.
    assert np.abs(error[4:-4]).max() == pytest.approx((40.0 * 1e-3) ** 4 / 6.0, rel=0.02)


def test_a_constant_stays_one_where_samples_are_lost():
    x = np.where(np.arange(1000) % 5 == 2, np.nan, 0.1 + 0.2)
    assert np.ptp(bound(TWO, recording(x=(T, x), y=(T, T))).roles["motor_position"]) == 0.0


@pytest.mark.parametrize("empty", [[0], [999], [100, 101], range(100, 130)])
def test_nothing_is_put_where_nothing_is_known(empty):
    x = T.copy()
    x[list(empty)] = np.nan
    signals = bound(TWO, recording(x=(T, x), y=(T, T)))
    assert np.flatnonzero(np.isnan(signals.roles["motor_position"])).tolist() == list(empty)
    assert ("recording.not_finite", len(empty)) in [(f.code, f.value) for f in signals.findings]


def on_a_circle(angle):
    return np.angle(np.exp(1j * angle))


@pytest.mark.parametrize("offset", [0.0, 3.0, np.pi])
@pytest.mark.parametrize("speed", [0.9, 1.05, 2.0, -3.1])
@pytest.mark.parametrize("start", [-3.3, 0.0, 3.05, 3.2])
def test_encoders_that_wrap_on_different_sides_agree_on_the_turn(start, speed, offset):
    """At the beginning, and after a gap in which nobody knows how far they went."""
    t = np.arange(8000) * 1e-3
    t = t[(t < 3.0) | (t > 6.0)]
    phi = 0.1 * np.sin(6.0 * t + 1.0) + offset
    q = start + speed * t
    link, motor = on_a_circle(q), on_a_circle(q - phi)
    motor[100:102] = np.nan
    after = [k + 1 + i for k in np.flatnonzero(np.abs(np.diff(motor)) > 3.0)[-1:] for i in range(2)]
    motor[after] = np.nan  # the jump itself is not seen
    signals = bound('motor_position = "m"\nlink_position = "l"', recording(m=(t, motor), l=(t, link)))
    found = signals.roles["link_position"] - signals.roles["motor_position"]
    there = np.isfinite(found)
    assert np.count_nonzero(~there) == len({100, 101, *after})
    wrong = (found - phi[: found.size])[there]
    np.testing.assert_allclose(wrong, wrong[0], atol=1e-9)
    assert abs(wrong[0] / (2 * np.pi) - round(wrong[0] / (2 * np.pi))) < 1e-9
    assert -np.pi < found[0] <= np.pi


def test_a_turn_of_the_rotor_is_no_turn_of_the_joint():
    """A geared motor's encoder wraps fifty times a turn; a deflection of more than half a turn is then nobody's mistake."""
    t = np.arange(8000) * 1e-3
    theta = on_a_circle(t) / 50.0
    signals = bound(
        'motor_position = { channel = "m", side = "rotor" }\nlink_position = "l"',
        recording(m=(t, on_a_circle(t)), l=(t, 4.0 + 0.01 * t)),
    )
    assert np.ptp(theta) < 0.13
    np.testing.assert_allclose(signals.roles["motor_position"], t / 50.0, atol=1e-12)


def test_clocks_that_never_meet_are_refused():
    with pytest.raises(BindingError, match="no time in common"):
        bound(TWO, recording(x=(T, T), y=(T + 100.0, T)))


@pytest.mark.parametrize(
    ("values", "said"), [(np.full(1000, np.nan), "no finite number"), (np.array([1.0]), "at least two")]
)
def test_channels_that_say_nothing_are_refused(values, said):
    with pytest.raises(BindingError, match=said):
        bound(TWO, recording(x=(T[: values.size], values), y=(T, T)))


def test_a_missing_channel_is_refused_with_the_nearest_name():
    with pytest.raises(BindingError, match="did you mean 'x_motor'"):
        bound('motor_position = "x_moter"', recording(x_motor=(T, T)))


@pytest.mark.parametrize("pulses", [256, 4059, 40_000])
def test_the_step_of_an_encoder_is_found(pulses):
    step = 2.0 * np.pi / pulses
    angle = np.sin(2 * np.pi * 0.7 * T * 5)
    signals = bound(TWO, recording(x=(T, np.round(angle / step) * step), y=(T, T)))
    assert signals.resolution["motor_position"] == pytest.approx(step, rel=1e-6)


@given(log_noise=st.floats(-6.0, -2.0))
def test_a_signal_without_steps_is_given_the_step_of_its_noise(log_noise):
    noise = 10.0**log_noise
    x = np.sin(T) + noise * np.random.default_rng(2).normal(size=T.size)
    signals = bound(TWO, recording(x=(T, x), y=(T, T)))
    assert signals.resolution["motor_position"] == pytest.approx(noise * 12**0.5, rel=0.25)


def test_a_stated_resolution_goes_before_what_the_data_look_like():
    signals = bound('motor_position = { channel = "x", resolution = 0.01 }', recording(x=(T, np.sin(T))))
    assert signals.resolution["motor_position"] == 0.01


RUNS = """
[joint.j]
kind = "serial"
[joint.j.signals]
deflection = "{run}.phi"
torque_sensor = "{run}.tau"
[[joint.j.run]]
name = "a"
setpoint = 0.01
[[joint.j.run]]
name = "b"
setpoint = 0.02
"""


def test_runs_in_one_file_follow_each_other():
    name, joint = joint_of(RUNS)
    rec = recording(**{"a.phi": (T, T), "a.tau": (T, T), "b.phi": (T, 2 * T), "b.tau": (T, T)})
    assert wanted_channels(joint, "log.csv") == {"a.phi", "a.tau", "b.phi", "b.tau"}
    signals = bind([rec], name, joint, ("deflection", "torque_sensor", "setpoint"))
    assert signals.run_names == ("a", "b")
    assert len(signals) == 2000
    np.testing.assert_array_equal(signals.roles["setpoint"], np.repeat([0.01, 0.02], 1000))
    np.testing.assert_array_equal(np.flatnonzero(signals.starts), [0, 1000])


def test_runs_at_different_rates_come_onto_the_slowest_grid():
    name, joint = joint_of(RUNS)
    rec = recording(**{"a.phi": (T, T), "a.tau": (T, T), "b.phi": (1.1 * T, T), "b.tau": (1.1 * T, T)})
    signals = bind([rec], name, joint, ("deflection", "torque_sensor", "setpoint"))
    period = 1.1 * (T[1] - T[0])
    assert signals.period == pytest.approx(period)
    first, second = (signals.run == k for k in range(2))
    np.testing.assert_allclose(np.diff(signals.time[first]), period, rtol=1e-6)
    np.testing.assert_allclose(signals.roles["deflection"][first], signals.time[first], atol=1e-9)
    np.testing.assert_allclose(signals.roles["deflection"][second], signals.time[second] / 1.1, atol=1e-9)


@pytest.mark.parametrize(("ratio", "own"), [(1.0004, True), (1.0006, False), (1.015, False)])
def test_runs_whose_rates_differ_are_reported_in_true_time(ratio, own):
    """By a part in a thousand of a second derivative at most, as much as a filter takes off: 1.5 % would be 3 % of an inertia."""
    name, joint = joint_of(RUNS)
    x = 30.0 * T**2
    rec = recording(**{"a.phi": (T, x), "a.tau": (T, x), "b.phi": (ratio * T, x), "b.tau": (ratio * T, x)})
    signals = bind([rec], name, joint, ("deflection", "torque_sensor", "setpoint"))
    accelerations = [
        np.polyfit(
            signals.period * np.arange(np.sum(signals.run == k)), signals.roles["deflection"][signals.run == k], 2
        )[0]
        for k in range(2)
    ]
    np.testing.assert_allclose(accelerations, [30.0, 30.0 / ratio**2], rtol=1e-3)
    assert np.array_equal(signals.roles["deflection"][signals.run == 0], x) == own


@pytest.mark.parametrize("roles", [("deflection",), ("deflection", "torque_sensor")])
def test_what_gives_way_in_series_is_taken_off(roles):
    """A dynamometer of 500 N·m/rad in series: the angle it turns by is not the joint's."""
    torque = 3.0 * np.sin(4.0 * T)
    true = torque / 40.0
    rec = recording(x=(T, true + torque / 500.0), y=(T, torque))
    name, joint = joint_of(ELASTIC + 'deflection = { channel = "x", series_stiffness = 500 }\ntorque_sensor = "y"\n')
    signals = bind([rec], name, joint, roles)
    np.testing.assert_allclose(signals.roles["deflection"], true, atol=1e-12)
    assert set(signals.roles) == set(roles)
    assert wanted_channels(joint, "log.csv", roles) == {"x", "y"}


def test_a_part_in_series_needs_a_torque_and_a_deflection():
    rec = recording(x=(T, np.sin(T)))
    with pytest.raises(BindingError, match="needs a torque_sensor"):
        bound('deflection = { channel = "x", series_stiffness = 500 }', rec)
    with pytest.raises(RigError, match="only a deflection has a part in series"):
        joint_of(ELASTIC + 'link_position = { channel = "x", series_stiffness = 500 }')


@pytest.mark.parametrize(("said", "taken"), [(0.001, 0.02), (0.02, 0.02), (0.05, 0.05)])
def test_values_that_are_rounded_more_coarsely_than_the_rig_says_have_steps_of_their_own(said, taken):
    x = 0.02 * np.round(np.sin(T) / 0.02)
    signals = bound(f'motor_position = {{ channel = "x", resolution = {said} }}', recording(x=(T, x)))
    assert signals.resolution["motor_position"] == pytest.approx(taken)


def test_held_levels_are_no_steps_of_a_sensor():
    signals = bound('motor_position = { channel = "x", resolution = 0.001 }', recording(x=(T, np.sign(np.sin(T)))))
    assert signals.resolution["motor_position"] == 0.001


@pytest.mark.parametrize(("lost", "phase", "runs"), [(5, 0.0, 1), (25, 0.0, 1), (26, 0.0, 2), (5, 0.0004, 2)])
def test_a_few_lost_rows_are_missing_ones_and_no_gap(lost, phase, runs):
    keep = (np.arange(1000) < 400) | (np.arange(1000) >= 400 + lost)
    moved = T + phase * (np.arange(1000) >= 400)
    signals = bound(TWO, recording(x=(moved[keep], np.sin(T)[keep]), y=(T, np.cos(T))))
    assert np.count_nonzero(signals.starts) == runs
    if runs == 1:
        np.testing.assert_allclose(signals.time, T, rtol=0.0, atol=1e-12)
        np.testing.assert_array_equal(signals.roles["motor_position"], np.where(keep, np.sin(T), np.nan))
        np.testing.assert_array_equal(signals.roles["link_position"], np.cos(T))
