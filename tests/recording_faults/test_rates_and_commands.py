"""A velocity against the derivative of its position, and a commanded position against the measured one, as `inspect` has them."""

from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from benchmarks.recording_faults import found_in
from vsalog.core.recording import Channel, Recording, Stream
from vsalog.inspection.joint_faults import joint_faults
from vsalog.rig.guess import guess_roles

pytestmark = pytest.mark.share(2)

PERIOD = 2e-3
T = np.arange(10_000) * PERIOD
STAMPS = (T * 1e9).astype(np.int64)
STEP = 2.0 * np.pi / 8192
SERVO = signal.TransferFunction([30.0**2], [1.0, 2.0 * 0.8 * 30.0, 30.0**2])
"""A position loop of 30 rad/s: it lags by half a tenth of a second."""


def joint(seed, drive_delay=0.0, lag=0.0):
    """Return what a servo is reported, and does, and what its encoder and its driver's filter of a lag say of that."""
    rng = np.random.default_rng(seed)
    told = sum(
        rng.uniform(0.1, 0.4) * np.sin(w * T + rng.uniform(0.0, 6.0))
        for w in (0.9, 2.3, 4.1, 7.7, *(11.0, 13.0)[:seed])
    )
    acting = np.interp(T - drive_delay, T, told)
    _, q, _ = signal.lsim(SERVO, acting, T)
    rate = np.gradient(q, PERIOD)
    if lag:
        _, rate, _ = signal.lsim(signal.TransferFunction([1.0], [lag, 1.0]), rate, T)
    noisy = rate + 2e-3 * np.random.default_rng(seed + 1).standard_normal(T.size)
    return {"position_command": told, "position": STEP * np.round(q / STEP), "velocity": noisy}


def recorded(**joints):
    """Return a log of joints; of one alone the channels have no joint in their names."""
    columns = {f"{field}[{name}]": x for name, its in joints.items() for field, x in its.items()}
    units = {"position": "rad", "position_command": "rad", "velocity": "rad/s"}
    channels = {
        f"/state.{name}": Channel(f"/state.{name}", STAMPS, x, units[name.partition("[")[0]], "/state", "float64")
        for name, x in columns.items()
    }
    return Recording(Path("log.csv"), "csv", channels, {"/state": Stream("/state", "", T.size, "column")})


def late(x, by):
    return np.interp(T - by, T, x)


FAULTS = {
    "velocity in degrees": ("velocity", np.degrees, "signal.unit", "link_velocity"),
    "velocity in turns a minute": ("velocity", lambda v: v * 30.0 / np.pi, "signal.unit", "link_velocity"),
    "velocity of the rotor": ("velocity", lambda v: 100.0 * v, "signal.scale", "link_velocity"),
    "velocity turned": ("velocity", np.negative, "signal.sign", "link_velocity"),
    "velocity late": ("velocity", lambda v: late(v, 0.04), "signal.late", "link_velocity"),
    "command in degrees": ("position_command", np.degrees, "signal.unit", "commanded_position"),
    "command turned": ("position_command", np.negative, "signal.sign", "commanded_position"),
    "command after the motion": ("position_command", lambda r: late(r, 0.2), "signal.late", "commanded_position"),
    "position in degrees": ("position", np.degrees, "signal.unit", "link_position"),
    "position turned": ("position", np.negative, "signal.sign", "link_position"),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_of_a_rate_or_a_command_is_named_where_it_is(kind):
    field, spoil, code, role = FAULTS[kind]
    its = joint(1)
    log = recorded(elbow={**its, field: spoil(its[field])})
    (finding,) = [one for one in joint_faults(log, guess_roles(log)) if one.code.startswith("signal.")]
    assert finding.code == code
    # Of two that are late the drive, which may be as slow as it likes, does not tell which.
    assert finding.part == role or (kind == "velocity late" and finding.part == "link_position or link_velocity")


@pytest.mark.parametrize("sound", [joint(1), joint(2, drive_delay=0.08), joint(1, lag=0.03), joint(2, 0.05, 0.01)])
def test_a_servo_that_is_slow_and_a_velocity_that_is_filtered_have_no_fault(sound):
    assert found_in(recorded(elbow=sound)) == []


@pytest.mark.parametrize("field", ["position_command", "position", "velocity"])
def test_channels_of_two_joints_that_are_exchanged_are_named(field):
    a, b = joint(1), joint(2)
    log = recorded(elbow={**a, field: b[field]}, wrist={**b, field: a[field]})
    assert found_in(log) == ["signal.joints_exchanged"]
    assert found_in(recorded(elbow=a, wrist=b)) == []


def test_positions_and_velocities_before_a_gear_are_one_fault():
    its = joint(1)
    log = recorded(elbow={**its, "position": 90.0 * its["position"], "velocity": 90.0 * its["velocity"]})
    (finding,) = [one for one in joint_faults(log, guess_roles(log)) if one.code.startswith("signal.")]
    assert finding.code == "signal.scale"
    assert finding.evidence["factor"] in (pytest.approx(90.0, rel=0.05), pytest.approx(1.0 / 90.0, rel=0.05))


def test_a_command_that_covers_a_part_of_the_log_hides_nothing_else():
    its = joint(1)
    log = recorded(elbow={**its, "velocity": -its["velocity"]})
    name = "/state.position_command[elbow]"
    told = log.channels[name]
    for part in (slice(0, 2000), slice(None, None, 1000)):
        few = Channel(name, told.stamps[part], told.values[part], "rad", "/commands", "float64")
        streams = {**log.streams, "/commands": Stream("/commands", "", few.values.size, "column")}
        assert found_in(Recording(log.path, "csv", {**log.channels, name: few}, streams)) == ["signal.sign"]
