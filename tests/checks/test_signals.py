"""Findings about signals that are possible and not plausible, and none where nothing is wrong."""

from pathlib import Path

import numpy as np
import pytest

from vsalog.binding.joint import bind, offered_roles
from vsalog.checks.signals import signal_findings
from vsalog.core.finding_texts import sentence
from vsalog.core.recording import Channel, Recording
from vsalog.estimators.device import device_of
from vsalog.readers import read
from vsalog.rig import Rig
from vsalog.rig.find import find_rig
from vsalog.rig.load import presets
from vsalog.simulation.run import Options, prepare


def recording(**channels):
    """channels: name → (seconds, values)."""
    made = {}
    for key, (seconds, values) in channels.items():
        stamps = 1_700_000_000_000_000_000 + np.round(seconds * 1e9).astype(np.int64)
        made[key] = Channel(key, stamps, np.asarray(values, dtype=float), None, key, "float64")
    return Recording(Path("log.csv"), "csv", made, {})


T = np.arange(8000) * 1e-3
RIG = """
[joint.elbow]
kind = "elastic"
[joint.elbow.signals]
link_position = "q"
motor_position = "theta"
torque_sensor = "tau"
"""
STEP = 1e-4


def counted(x):
    return np.round(x / STEP) * STEP


def channels(*, counts=True):
    """A joint of 50 N·m/rad that swings by ±0.8 rad and gives way by ±0.06 rad."""
    rng = np.random.default_rng(1)
    tau = 3.0 * np.sin(5.0 * T) * np.cos(0.7 * T)
    q = 0.8 * np.sin(1.5 * T)
    theta = q - tau / 50.0
    if counts:
        q, theta = counted(q), counted(theta)
    else:
        q, theta = q + rng.normal(0.0, 3e-4, T.size), theta + rng.normal(0.0, 3e-4, T.size)
    return {"q": q, "theta": theta, "tau": tau + rng.normal(0.0, 0.01, T.size)}


def found(made, rig=RIG):
    ((name, joint),) = Rig.from_toml(rig).joints.items()
    signals = bind([recording(**{k: (T, v) for k, v in made.items()})], name, joint, tuple(offered_roles(joint)))
    findings = signal_findings(device_of(name, joint, signals.roles), signals)
    assert all(sentence(finding).startswith("joint 'elbow': ") for finding in findings)
    return findings


def one(made, rig=RIG):
    (finding,) = found(made, rig)
    assert finding.joint == "elbow"
    return finding


def codes(made):
    return {finding.code for finding in found(made)}


@pytest.mark.parametrize("counts", [True, False])
def test_nothing_is_reported_of_a_sound_log(counts):
    assert found(channels(counts=counts)) == ()


def test_an_encoder_whose_zero_is_off():
    made = channels()
    made["theta"] = made["theta"] + 0.7
    finding = one(made)
    assert (finding.code, finding.part) == ("encoder.zero", "link_position − motor_position")
    assert finding.value == pytest.approx(-0.7, abs=0.002)


def test_a_smaller_offset_shows_where_the_torque_is_centred():
    made = channels()
    made["theta"] = made["theta"] + 0.1
    assert one(made).code == "encoder.zero"
    made["tau"] = made["tau"] + 2.0
    assert found(made) == ()


def test_a_zero_is_not_suspected_under_a_weight():
    made = channels()
    made["theta"] = made["theta"] - 0.7
    made["tau"] = made["tau"] + 35.0
    assert found(made) == ()


def test_a_sign():
    made = channels()
    made["theta"] = -made["theta"]
    finding = one(made)
    assert finding.code == "encoder.sign"
    assert finding.value == pytest.approx(-1.0, abs=0.1)


def test_a_motor_and_a_link_that_swing_against_one_another_are_no_sign():
    made = channels()
    made["theta"] = made["q"] * -0.4
    assert "encoder.sign" not in codes(made)


@pytest.mark.parametrize(("part", "reported"), [(0.6, False), (0.75, True)])
def test_a_sign_leaves_less_than_half_of_either_motion(part, reported):
    """Of q and −part·q the sum is (1 − part) q, two thirds and one third of the smaller one."""
    made = channels()
    made["theta"] = made["q"] * -part
    assert ("encoder.sign" in codes(made)) == reported


@pytest.mark.parametrize(("far", "reported"), [(80.0, False), (150.0, True)])
def test_a_hundred_radians_are_no_joints(far, reported):
    made = channels()
    turned = far * T / T[-1]
    found_codes = codes({**made, "q": made["q"] + turned, "theta": made["theta"] + turned})
    assert ("encoder.unit" in found_codes) == reported


@pytest.mark.parametrize(("part", "reported"), [(0.15, False), (0.25, True)])
def test_an_encoder_is_stuck_where_the_other_one_moves_a_fifth_of_its_range(part, reported):
    """A triangle wave that moves by that part of its range in the 1.2 s in which the link's encoder stands still."""
    phase = T * part / 1.2
    theta = np.abs(phase % 2.0 - 1.0)
    noise = np.random.default_rng(5).normal(0.0, 3e-4, (2, T.size))
    q = theta + noise[0]
    # Well inside a sweep.
    begin = int(np.argmin(np.abs(phase - 1.3)))
    q[begin : begin + 1200] = q[begin]
    assert ("encoder.stuck" in codes({"q": q, "theta": theta + noise[1], "tau": channels()["tau"]})) == reported


def test_degrees():
    made = channels()
    finding = one({**made, "q": np.rad2deg(made["q"]), "theta": np.rad2deg(made["theta"])})
    assert (finding.code, finding.part) == ("encoder.deflection_unit", "link_position − motor_position")
    assert finding.value == pytest.approx(np.rad2deg(0.12), rel=0.05)
    far = {**made, "q": np.rad2deg(2.0 * made["q"]), "theta": np.rad2deg(2.0 * made["theta"])}
    assert {(f.code, f.part) for f in found(far)} == {
        ("encoder.deflection_unit", "link_position − motor_position"),
        ("encoder.unit", "link_position"),
        ("encoder.unit", "motor_position"),
    }


def test_a_gear_ratio():
    made = channels()
    finding = one({**made, "theta": 30.0 * made["theta"]})
    assert finding.code == "encoder.deflection_unit"
    assert 46.0 < finding.value < 48.0


@pytest.mark.parametrize(("end", "sign"), [("highest", 1.0), ("lowest", -1.0)])
def test_a_saturated_sensor(end, sign):
    made = channels()
    made["tau"] = sign * np.minimum(sign * made["tau"], 2.0)
    finding = one(made)
    assert (finding.code, finding.part) == ("sensor.saturated", "torque_sensor")
    assert (finding.evidence["end"], finding.evidence["at"]) == (end, 2.0 * sign)
    assert finding.value == pytest.approx(np.mean(made["tau"] == 2.0 * sign), abs=0.02)


@pytest.mark.parametrize("role", ["link_position", "motor_position"])
def test_a_rest_at_the_end_of_the_range_is_no_saturation(role):
    made = channels()
    name = "q" if role == "link_position" else "theta"
    made[name] = np.minimum(made[name], 0.5)
    assert "sensor.saturated" not in codes(made)


@pytest.mark.parametrize("counts", [True, False])
@pytest.mark.parametrize(("name", "role"), [("q", "link_position"), ("theta", "motor_position")])
def test_an_encoder_that_is_stuck(name, role, counts):
    made = channels(counts=counts)
    made[name][2000:2700] = made[name][2000]
    finding = one(made)
    assert (finding.code, finding.part) == ("encoder.stuck", role)
    assert (finding.evidence["begin"], finding.evidence["end"]) == pytest.approx((2.0, 2.699))


def test_a_torque_that_is_stuck():
    made = channels()
    made["tau"][3000:5500] = made["tau"][2999]
    finding = one(made)
    assert (finding.code, finding.part) == ("torque.stuck", "torque_sensor")
    assert (finding.evidence["begin"], finding.evidence["end"]) == pytest.approx((2.999, 5.499))


def test_a_torque_of_a_few_levels_is_coarse_neither_stuck_nor_lost():
    made = channels()
    made["tau"] = np.round(made["tau"])
    finding = one(made)
    assert (finding.code, finding.value, finding.evidence["step"]) == ("torque.coarse", 7, 1.0)
    made["tau"] = 0.1 * np.round(channels()["tau"] / 0.1)
    assert found(made) == ()


@pytest.mark.parametrize(
    ("name", "role"), [("q", "link_position"), ("theta", "motor_position"), ("tau", "torque_sensor")]
)
def test_a_slower_sensor_s_values_repeated(name, role):
    made = channels()
    made[name] = np.repeat(made[name][::10], 10)
    (slow,) = (f for f in found(made) if f.code == "sensor.repeated")
    assert (slow.part, slow.value) == (role, 10)
    assert slow.evidence["rate"] == pytest.approx(100.0)
    made[name] = np.repeat(channels()[name][::4], 4)
    assert "sensor.repeated" in codes(made)
    made[name] = np.repeat(channels()[name][::2], 2)
    assert "sensor.repeated" not in codes(made)


def test_a_coarse_encoder_at_an_even_speed_repeats_nothing():
    made = channels()
    ramp = np.round(T / 0.004) * 0.001
    made["q"], made["theta"] = made["q"] + ramp, made["theta"] + ramp
    assert "sensor.repeated" not in codes(made)
    made["q"], made["theta"] = ramp, ramp - 1e-3 * np.round(channels()["tau"] / 0.05)
    assert "sensor.repeated" not in codes(made)


def test_a_torque_that_rests_between_its_steps_is_not_stuck():
    """Steps of 0.1 N·m hide the noise: the torque stays where it is, in motion and at rest."""
    made = channels()
    made["tau"] = 0.1 * np.round(made["tau"] / 0.1)
    for values in made.values():
        values[3000:5500] = values[2999]
    assert not [finding for finding in found(made) if finding.part == "torque_sensor"]


def test_a_torque_without_noise_that_is_stuck_while_the_spring_gives_way():
    made = channels()
    tau = np.round(3.0 * np.sin(5.0 * T) * np.cos(0.7 * T) / 0.05) * 0.05
    assert found(made | {"tau": tau}) == ()
    tau[2000:2900] = tau[2000]
    finding = one(made | {"tau": tau})
    assert finding.code == "torque.stuck_while_moving"
    assert (finding.evidence["begin"], finding.evidence["end"]) == pytest.approx((1.998, 2.899))


def test_a_small_torque_in_noise_reads_zero_now_and_then():
    made = channels()
    noise = np.random.default_rng(3).normal(0.0, 0.02, T.size)
    assert found(made | {"tau": np.round((0.03 * np.sin(5.0 * T) + noise) / 0.0067) * 0.0067}) == ()


def test_packets_that_were_lost_and_read_as_zero():
    made = channels()
    lost = np.random.default_rng(3).random(T.size) < 0.02
    made["tau"][lost] = 0.0
    finding = one(made)
    assert finding.code == "torque.dropouts"
    # Where the torque passes zero itself nothing separates them.
    assert 0.6 * lost.sum() < finding.value <= lost.sum()


def test_a_torque_that_passes_zero_in_steps_has_lost_nothing():
    made = channels()
    made["tau"] = 0.05 * np.round(made["tau"] / 0.05)
    assert found(made) == ()


def test_friction_that_holds_the_link_while_the_spring_winds_up_is_no_stuck_encoder():
    made = channels()
    held = 0.8 * np.sin(1.5 * np.minimum(T, 4.0))
    made["q"] = counted(np.where(T < 4.0, held, held[-1]))
    made["theta"] = counted(np.where(T < 4.0, made["theta"], held[-1] - 0.05 * np.sin(5.0 * (T - 4.0))))
    assert found(made) == ()


@pytest.mark.parametrize(("preset", "ideal"), [*((name, False) for name in presets()), ("sea", True), ("vsa2", True)])
def test_no_preset_gives_a_false_alarm(preset, ideal, tmp_path):
    job = prepare(preset, Options(duration=3.0, ideal=ideal, output=str(tmp_path / "x.mcap")))
    log = job.run()
    for name, joint in job.believed.joint.items():
        if joint.__class__.__name__ == "RigidJoint":
            continue
        signals = bind([log], name, joint, tuple(offered_roles(joint)))
        assert signal_findings(device_of(name, joint, signals.roles, job.believed), signals) == ()
        assert "recording.outliers" not in {finding.code for finding in signals.findings}


LOGS = [
    "desr_foot/desr_foot.mat",
    "awas_exp1.mcap",
    "awas_exp2.mcap",
    "sea_exp1.csv",
    "sea_exp2.bag",
    "vsa2_exp1.mcap",
    "vsa2_exp2.mcap",
]


@pytest.mark.parametrize("log", LOGS)
def test_no_sample_log_gives_a_false_alarm(log, samples):
    path = samples / log
    recording_of = read(path)
    rig: Rig | None = find_rig(path, recording_of.rig_text)
    assert rig is not None
    for name, joint in rig.joints.items():
        roles = tuple(r for r in offered_roles(joint))
        signals = bind([recording_of], name, joint, roles)
        assert signal_findings(device_of(name, joint, signals.roles, rig.file), signals) == ()
        assert "recording.outliers" not in {finding.code for finding in signals.findings}


def test_a_sensor_that_is_saturated_at_both_ends_is_found_at_both():
    made = channels()
    made["tau"] = np.clip(made["tau"], -2.0, 2.0)
    assert {(f.code, f.evidence["end"]) for f in found(made)} == {
        ("sensor.saturated", "highest"),
        ("sensor.saturated", "lowest"),
    }
