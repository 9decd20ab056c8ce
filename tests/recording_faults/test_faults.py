"""Faults that are put into sample logs are named, and sound logs have none. The battery is `benchmarks/recording_faults.py`."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.recording_faults import NAMES, found_in, roles_of
from tests.recording_faults.inject import exchanged, injected, on_other_clock, with_values
from vsalog.binding.joint import bind, offered_roles
from vsalog.checks.fault_search import exchanged_between, faults_of
from vsalog.checks.recording_faults import findings_of, log_findings
from vsalog.core.resolution import step_of
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM
from vsalog.inspection.joint_faults import joint_faults
from vsalog.readers import read
from vsalog.rig.find import find_rig
from vsalog.rig.guess import guess_roles

pytestmark = pytest.mark.share(7)


@pytest.fixture(scope="module")
def sea(samples):
    """The sample in SI: faults are put into radians and newton metres."""
    log = read(samples / "sea_exp1.csv")
    for name, channel in log.channels.items():
        factor, unit = (np.pi / 180.0, "rad") if channel.unit == "deg" else (1e-3, "N*m")
        values = factor * channel.values
        log = replace(log, channels={**log.channels, name: replace(channel, values=values, unit=unit)})
    return log


@pytest.fixture(scope="module")
def vsa2(samples):
    return read(samples / "vsa2_exp1.mcap")


def signals_of(recording, samples, log="sea_exp1.csv"):
    ((name, joint),) = find_rig(samples / log, recording.rig_text).joints.items()
    return bind([recording], name, joint, list(offered_roles(joint)))


def faulty(recording, seed=1):
    return list(injected(recording, roles_of(recording), np.random.default_rng(seed)))


@pytest.mark.parametrize("kind", sorted(set(NAMES) - {"exchanged"}))
def test_every_kind_is_named_in_every_channel(sea, kind):
    logs = [one for one in faulty(sea) if one.kind == kind]
    assert logs
    for one in logs:
        assert NAMES[kind] & set(found_in(one.recording)), (kind, one.role)


@pytest.mark.parametrize(
    "factors",
    [{"torque_sensor": -1.0}, {"motor_position": -1.0}, {"motor_position": -60.0, "torque_sensor": -1.0},
     {"link_position": -1.0}],
    ids=str,
)  # fmt: skip
def test_what_the_guess_says_is_not_reported_again(sea, factors):
    names, log = roles_of(sea)["joint"], sea
    for role, factor in factors.items():
        log = with_values(log, names[role], factor * sea.channels[names[role]].values)
    assert list(joint_faults(log, guess_roles(log))) == []


def test_a_motor_in_degrees_may_be_one_before_a_gear(sea):
    name = roles_of(sea)["joint"]["motor_position"]
    log = with_values(sea, name, np.degrees(sea.channels[name].values))
    guess = guess_roles(log)
    assert guess.joints[0].roles["motor_position"].side == "rotor"
    assert [finding.code for finding in joint_faults(log, guess)] == ["signal.unit"]


def test_raw_counts_are_compared_to_no_other_channel(sea):
    names, log = roles_of(sea)["joint"], sea
    for role, turn in (("motor_position", 50 * 4096), ("link_position", 65536)):
        log = with_values(log, names[role], np.round(sea.channels[names[role]].values * turn / (2.0 * np.pi)))
        bare = replace(log.channels[names[role]], unit=None)
        log = replace(log, channels={**log.channels, bare.name: bare})
    log = with_values(log, names["torque_sensor"], -sea.channels[names["torque_sensor"]].values)
    guess = guess_roles(log)
    assert [one.code for one in guess.joints[0].findings].count("guess.raw_counts") == 2
    assert list(joint_faults(log, guess)) == []


def test_a_current_with_its_unit_in_the_log_is_no_torque(sea):
    torque = sea.channels[roles_of(sea)["joint"]["motor_torque"]]
    current = replace(torque, name="motor current", unit="A", values=0.4 * torque.values)
    kept = {name: channel for name, channel in sea.channels.items() if channel is not torque}
    log = replace(sea, channels={**kept, current.name: current})
    guess = guess_roles(log)
    assert guess.joints[0].roles["motor_torque"].is_current
    assert list(joint_faults(log, guess)) == []


def test_a_delay_that_looks_like_a_sign_is_named_in_spite_of_the_guess(samples):
    log = read(samples / "awas_exp1.mcap")
    name = roles_of(log)["joint"]["motor_position"]
    late = with_values(
        log, name, np.concatenate((np.full(40, log.channels[name].values[0]), log.channels[name].values[:-40]))
    )
    guess = guess_roles(late)
    assert guess.joints[0].roles["torque_sensor"].sign == -1
    found = [finding.code for finding in joint_faults(late, guess)]
    assert "signal.late" in found
    assert "signal.sign" not in found


def test_exchanged_motors_are_named(vsa2):
    for one in faulty(vsa2):
        if one.kind == "exchanged":
            (finding,) = joint_faults(one.recording, guess_roles(one.recording))
            assert finding.code == "signal.exchanged"
            assert finding.part == one.role.replace(" ", " and ")


@pytest.mark.parametrize("role", ["torque_sensor", "motor_torque"])
def test_gravity_that_was_taken_out_leaves_no_other_fault(samples, role):
    """Of a spring that a set-point stiffens, whose equation has several free columns."""
    signals = signals_of(read(samples / "awas_exp1.mcap"), samples, "awas_exp1.mcap")
    torque, q = signals.roles[role], signals.roles["link_position"]
    less = torque - 0.6 * np.ptp(torque) * np.sin(q)
    found = faults_of(replace(signals, roles={**signals.roles, role: less}))
    assert [(one.fault.kind, one.fault.roles) for one in found] == [("gravity", (role,))]


@pytest.mark.parametrize(
    "log", ["sea_exp1.csv", "sea_exp2.bag", "vsa2_exp1.mcap", "vsa2_exp2.mcap", "awas_exp1.mcap", "awas_exp2.mcap"]
)
def test_sound_logs_have_no_faults(samples, log):
    assert found_in(read(samples / log)) == []


@pytest.mark.parametrize("log", ["sea_exp1.csv", "sea_exp2.bag", "vsa2_exp1.mcap", "awas_exp1.mcap"])
def test_a_gap_is_no_fault(samples, log):
    signals = signals_of(read(samples / log), samples, log)
    torn = signals[:4000].joined(signals[4600:])
    starts = torn.starts.copy()
    starts[4000] = True
    torn = replace(torn, starts=starts)
    assert list(findings_of(torn)) == []


def test_numbers_of_a_fault_are_those_that_were_put_in(sea, samples):
    rig = roles_of(sea)["joint"]
    torque, q = sea.channels[rig["torque_sensor"]], sea.channels[rig["link_position"]]
    period = float(np.median(np.diff(torque.stamps))) * 1e-9

    def only(recording):
        (found,) = findings_of(signals_of(recording, samples))
        return found

    late = np.concatenate((np.full(20, torque.values[0]), torque.values[:-20]))
    assert only(with_values(sea, torque.name, late)).value == pytest.approx(20 * period, abs=0.5 * period)
    drift = only(on_other_clock(sea, q.name, 1.002))
    assert (drift.code, drift.part, drift.unit) == ("signal.clock_rate", "link_position", "ppm")
    assert drift.value == pytest.approx(2000.0, rel=0.05)
    scaled = only(with_values(sea, torque.name, 14.0 * torque.values))
    assert scaled.code == "signal.scale"
    assert 1.0 / scaled.evidence["factor"] == pytest.approx(14.0, rel=0.02)
    assert {*scaled.part.split(" or ")} >= {"motor_torque"}
    degrees = only(with_values(sea, q.name, np.degrees(q.values)))
    assert degrees.evidence["factor"] == pytest.approx(180.0 / np.pi)
    for finding in (drift, scaled, degrees):
        assert finding.evidence["p_value"] < FALSE_ALARM
        assert finding.evidence["left"] < 0.5


def test_two_faults_are_found_one_after_the_other(sea, samples):
    names = roles_of(sea)["joint"]
    both = with_values(sea, names["torque_sensor"], np.abs(sea.channels[names["torque_sensor"]].values))
    both = with_values(both, names["link_position"], -sea.channels[names["link_position"]].values)
    found = {one.fault.kind: one.fault.roles for one in faults_of(signals_of(both, samples))}
    assert found == {"unsigned": ("torque_sensor",), "sign": ("link_position",)}


def test_a_torque_that_never_reverses_is_no_magnitude(sea, samples):
    names = roles_of(sea)["joint"]
    torque, push = sea.channels[names["torque_sensor"]], 5.0
    loaded = with_values(sea, names["torque_sensor"], torque.values + push)
    assert "torque.unsigned" not in {finding.code for finding in findings_of(signals_of(loaded, samples))}


def test_channels_of_two_joints_are_separated(vsa2, samples):
    one = signals_of(vsa2, samples, "vsa2_exp1.mcap")
    # The other joint of the machine goes the same way at other times.
    other = replace(one, roles={role: values[::-1].copy() for role, values in one.roles.items()})
    other = replace(other, roles={**other.roles, **{r: v[::-1] for r, v in one.roles.items()}})
    assert exchanged_between({"a": one, "b": other}) is None


def test_noise_alone_is_reported_once_in_a_thousand_at_most():
    """Joints whose channels are noise and smooth motion of their own: no equation holds, and nothing explains that."""
    rng = np.random.default_rng(5)
    assert [faults_of(unrelated(rng)) for _ in range(6)] == [[]] * 6


def unrelated(rng):
    """Return a joint of which each channel is a motion of its own."""
    t = np.arange(6000) * 2e-3
    roles = {}
    for role in ("link_position", "motor_position", "torque_sensor", "motor_torque"):
        parts = [rng.standard_normal() * np.sin(rng.uniform(1.0, 9.0) * t + rng.uniform(0.0, 6.0)) for _ in range(5)]
        roles[role] = np.sum(parts, axis=0) + 1e-3 * rng.standard_normal(t.size)
    starts = np.zeros(t.size, dtype=bool)
    starts[0] = True
    return JointSignals("j", 2e-3, (t * 1e9).astype(np.int64), t, roles, starts, np.zeros(t.size, np.int32))


def codes(found):
    """Return the codes of all findings anywhere in a command's JSON."""

    def within(part):
        if isinstance(part, dict):
            yield from (part["code"],) if "code" in part else ()
            part = list(part.values())
        for one in part if isinstance(part, list) else ():
            yield from within(one)

    assert found.stdout, found.stderr
    return set(within(json.loads(found.stdout)))


def test_every_command_reports_a_magnitude(samples, tmp_path, run):
    lines = (samples / "sea_exp1.csv").read_text().splitlines()
    at = next(i for i, name in enumerate(lines[0].split(",")) if "torque sensor" in name)
    rows = [line.split(",") for line in lines[1:3001]]
    unsigned = [",".join([*row[:at], row[at].lstrip("-"), *row[at + 1 :]]) for row in rows]
    (tmp_path / "log.csv").write_text("\n".join([lines[0], *unsigned]) + "\n")
    (tmp_path / "log.rig.toml").write_text((samples / "sea_exp1.rig.toml").read_text())
    estimate = run("estimate", samples / "sea_exp1.csv", "-o", tmp_path / "sound.parquet", "--json")
    assert "torque.unsigned" not in codes(estimate)
    model = tmp_path / "sound.model.toml"
    assert "torque.unsigned" in codes(run("inspect", "log.csv", "--json"))
    assert "torque.unsigned" in codes(run("estimate", "log.csv", "--json"))
    assert "torque.unsigned" in codes(run("diagnose", "log.csv", "--json"))
    assert "torque.unsigned" in codes(run("validate", model, "log.csv", "--json"))


def test_the_torques_of_a_real_servo_are_found_to_be_magnitudes(samples):
    log = read(samples / "so101_servo" / "chirp_sweep")
    found = list(joint_faults(log, guess_roles(log)))
    magnitudes = [finding for finding in found if finding.code == "torque.unsigned"]
    assert len({finding.joint for finding in magnitudes}) == 6
    assert {finding.part for finding in magnitudes} == {"motor_torque"}


def test_the_units_of_a_real_gripper_s_position_and_velocity_are_found_to_differ(samples):
    """Its position is a part of its range, its velocity in rad/s: one encoder step and one step in a period say so."""
    log = read(samples / "so101_servo" / "chirp_sweep")
    guess = guess_roles(log)
    roles = {joint.name: joint.roles for joint in guess.joints}
    # The other joints are of the same servos, and report radians.
    step = {name: step_of(log.channels[its["link_position"].channel].values) for name, its in roles.items()}
    (found,) = [finding for finding in joint_faults(log, guess) if finding.code == "signal.scale"]
    assert (found.joint, "link_velocity" in found.part) == ("Jaw", True)
    assert found.evidence["factor"] == pytest.approx(step["Elbow"] / step["Jaw"], rel=0.05)


def test_exchanging_twice_is_nothing(vsa2):
    a, b = sorted(vsa2.channels)[:2]
    again = exchanged(exchanged(vsa2, a, b), a, b)
    np.testing.assert_array_equal(again.channels[a].values, vsa2.channels[a].values)


def test_logs_of_other_setpoints_are_held_by_themselves(samples):
    """As one, four seconds of each make a torque that leads by 9 ms: a spring of two stiffnesses."""
    logs = [samples / "awas_exp1.mcap", samples / "awas_exp2.mcap"]
    recordings = [read(log, None, "auto", None, "1", "5") for log in logs]
    ((name, joint),) = find_rig(logs[0], recordings[0].rig_text).joints.items()
    assert log_findings(recordings, name, joint) == []
    broken = recordings[1]
    torque = joint.signals.motor_torque.channel
    values = -broken.channels[torque].values
    turned = replace(broken, channels={**broken.channels, torque: replace(broken.channels[torque], values=values)})
    assert {(f.code, f.log) for f in log_findings([recordings[0], turned], name, joint)} == {
        ("signal.sign", "awas_exp2.mcap")
    }
