"""`vsalog simulate --replay` as a user runs it: a rig on a log's own inputs, measured next to simulated."""

import hashlib

import numpy as np
import pytest
from knee import lay

from vsalog.binding.joint import bind
from vsalog.readers import open_reader, read
from vsalog.rig import Rig
from vsalog.rig.find import find_rig

pytestmark = pytest.mark.share(2)

RIG = """
[joint.elbow]
kind = "elastic"
motor = { inertia = 0.01, damping = 0.05 }
transmission = { type = "linear", stiffness = 5 }
link = { inertia = 0.02, damping = 0.02, gravity_torque = 1 }

[joint.elbow.signals]
motor_position = { channel = "theta", unit = "deg", sign = -1, offset = "3 deg", resolution = "0.01 deg" }
link_position = { channel = "q", unit = "deg", gain = 1.02 }
motor_torque = { channel = "tau", unit = "N·mm" }
torque_sensor = { channel = "sensor", unit = "N*m" }
"""


@pytest.fixture
def bench(tmp_path, done):
    """A folder with rig.toml, a log of it that any table program could have written, and no rig in or next to the log."""
    (tmp_path / "rig.toml").write_text(RIG)
    done("rig.toml", "--duration", "4", "--rate", "500", "-o", "log.csv", cwd=tmp_path)
    (tmp_path / "log.rig.toml").unlink()
    return tmp_path


def test_a_log_s_own_rig_is_simulated_on_its_own_inputs(done, simulate, samples, tmp_path):
    code, out, err = simulate("--replay", samples / "vsa2_exp1.mcap", "--window", "200 ms", cwd=tmp_path)
    assert (code, out) == (0, "")
    assert "driven by motor_torque_1, motor_torque_2; started 101 times" in err
    assert [p.name for p in tmp_path.iterdir()] == ["vsa2_exp1-replay.mcap"]
    log = read(tmp_path / "vsa2_exp1-replay.mcap")
    measured, simulated = (log.channels[f"/{kind}/link_position.data"].values for kind in ("measured", "simulated"))
    original = read(samples / "vsa2_exp1.mcap").channels["/joint_states.position[link]"]
    np.testing.assert_array_equal(measured, original.values)
    np.testing.assert_array_equal(log.channels["/simulated/stiffness_total.data"].stamps, original.stamps)
    # An encoder of 4059 pulses, whose rounding also spoils the speed that each window begins with.
    step = 2.0 * np.pi / 4059
    assert 0.1 * step < np.sqrt(np.mean((simulated - measured) ** 2)) < 2.0 * step


def test_measured_and_simulated_are_in_si_on_the_joint_s_side(done, bench):
    document = done("--replay", "log.csv", "-o", "again.csv", "--json", cwd=bench)
    log = read(bench / "again.csv")
    spread = document["joints"]["elbow"]["spread"]
    for role, most in (("motor_position", 2e-3), ("link_position", 2e-3), ("torque_sensor", 2e-3)):
        measured, simulated = (log.channels[f"/{kind}/{role}.data"] for kind in ("measured", "simulated"))
        assert measured.unit == simulated.unit == ("N*m" if "torque" in role else "rad")
        off = simulated.values - measured.values
        rms = document["joints"]["elbow"]["rms_error"][role]
        assert rms == pytest.approx(np.sqrt(np.mean(off**2)))
        assert rms < most * spread[role]
    assert document["joints"]["elbow"]["driven"] == {"motor_torque": "torque"}


@pytest.mark.parametrize("output", ["a.mcap", "a.bag", "a.csv", "a.parquet", "a/"])
def test_the_new_log_carries_a_rig_that_fits_it(output, done, bench):
    """What its rig binds is what the first rig binds of the first log."""
    done("--replay", "log.csv", "-o", output, cwd=bench)
    rig = find_rig(bench / output, open_reader(bench / output).rig_text)
    roles = ["motor_position", "link_position", "motor_torque", "torque_sensor"]
    first = bind([read(bench / "log.csv")], "elbow", Rig.load(bench / "rig.toml").joints["elbow"], roles)
    again = bind([read(bench / output)], "elbow", rig.joints["elbow"], roles)
    for role in roles:
        np.testing.assert_array_equal(again.roles[role], first.roles[role])
        assert again.resolution[role] == pytest.approx(first.resolution[role]), role
    assert rig.joints["elbow"].transmission == Rig.load(bench / "rig.toml").joints["elbow"].transmission


def test_a_rig_that_is_named_goes_before_the_log_s(done, bench):
    (bench / "stiff.toml").write_text(RIG.replace("stiffness = 5", "stiffness = 9"))
    for args in (("stiff.toml",), ("--set", "joint.elbow.transmission.stiffness=9")):
        done(*args, "--replay", "log.csv", "-o", "a.mcap", cwd=bench)
        log = read(bench / "a.mcap")
        np.testing.assert_allclose(log.channels["/simulated/stiffness.data"].values, 9.0)
        assert Rig.from_toml(log.rig_text).joints["elbow"].transmission.stiffness == 9.0
    done("--actual", "joint.elbow.transmission.stiffness=9", "--replay", "log.csv", "-o", "a.mcap", cwd=bench)
    log = read(bench / "a.mcap")
    np.testing.assert_allclose(log.channels["/simulated/stiffness.data"].values, 9.0)
    assert Rig.from_toml(log.rig_text).joints["elbow"].transmission.stiffness == 5.0


def test_a_friction_that_the_rig_lacks_shows_until_it_is_reported(done, bench):
    friction = "joint.elbow.motor.friction.coulomb=0.1"
    done("rig.toml", "--actual", friction, "--duration", "4", "-o", "real.mcap", cwd=bench)
    errors = []
    for told in ((), ("--set", friction)):
        document = done("--replay", "real.mcap", "--window", "0.5", *told, "--json", cwd=bench)
        errors.append(document["joints"]["elbow"]["rms_error"]["motor_position"])
    assert errors[0] > 10.0 * errors[1]


def test_a_motor_without_a_recorded_torque_moves_as_recorded(simulate, bench):
    rig = "".join(line for line in RIG.splitlines(keepends=True) if not line.startswith("motor_torque"))
    (bench / "rig.toml").write_text(rig)
    code, _, err = simulate("--replay", "log.csv", cwd=bench)
    assert code == 0, err
    assert "driven by the measured motor_position" in err
    assert "motor_position:" not in err.replace("by the measured motor_position", "")


def test_joints_of_a_chain_and_their_names(done, tmp_path):
    done("vsa2-2r", "--duration", "1", "--ideal", "-o", "a.bag", cwd=tmp_path)
    document = done("--replay", "a.bag", "--json", cwd=tmp_path)
    log = read(tmp_path / "a-replay.mcap")
    for joint in ("shoulder", "elbow"):
        found = document["joints"][joint]
        assert found["rms_error"]["link_position"] < 1e-2 * found["spread"]["link_position"]
        assert f"/simulated/{joint}/link_position.data" in log.channels
        assert f"/measured/{joint}/link_position.data" in log.channels


def test_a_sensor_that_the_log_lacks_is_left_out_unless_the_replay_needs_it(done, simulate, bench):
    lines = (bench / "log.csv").read_text().splitlines()
    (bench / "log.csv").write_text("\n".join(line.rpartition(",")[0] for line in lines) + "\n")
    assert "sensor" not in (bench / "log.csv").read_text()
    document = done("--replay", "log.csv", "--json", cwd=bench)
    assert set(document["joints"]["elbow"]["rms_error"]) == {"motor_position", "link_position"}
    (bench / "log.csv").write_text("\n".join(line.rpartition(",")[0] for line in lines).replace("tau", "tua") + "\n")
    code, _, err = simulate("--replay", "log.csv", cwd=bench)
    assert code == 2
    assert "there is no channel 'tau', did you mean 'tua'?" in err


def test_a_page_shows_each_signal_as_measured_and_simulated(done, simulate, bench):
    again = ("--replay", "log.csv")
    done("rig.toml", *again, "-o", "one.csv", "--report", "page.html", cwd=bench)
    page = (bench / "page.html").read_text()
    assert page.count('class="plot"') == 4
    assert hashlib.sha256((bench / "log.csv").read_bytes()).hexdigest() in page
    assert "inertia" in page
    # A page of the same log is replaced, another file is not.
    done("rig.toml", *again, "-o", "two.csv", "--report", "page.html", cwd=bench)
    code, _, err = simulate("rig.toml", *again, "-o", "three.csv", "--report", "log.csv", cwd=bench)
    assert (code, "is an input" in err) == (2, True)
    assert not (bench / "three.csv").exists()


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("--replay", "nowhere.csv"), "nowhere.csv: there is no such file"),
        (("--replay", "lost/log.csv"), "no rig was found in or next to log.csv"),
        (("--replay", "rig.toml"), "rig.toml"),
        (("sea", "--replay", "log.csv"), "there is no channel"),
        (("vsa3", "--replay", "log.csv"), "did you mean 'vsa2'"),
        (("pam", "--replay", "log.csv"), "joint 'pam' is pneumatic"),
        (("--replay", "log.csv", "-o", "log.csv"), "is read by the simulation"),
        (("--replay", "log.csv", "-o", "log.txt"), "no log format has the suffix"),
        (("--replay", "log.csv", "--window", "1 ms"), "shorter than two samples"),
        (("--replay", "log.csv", "--window", "0"), "not a time longer than zero"),
        (("--replay", "log.csv", "--scenario", "sines"), "--scenario does nothing with --replay"),
        (("--replay", "log.csv", "--truth"), "--truth does nothing with --replay"),
        (("--replay", "log.csv", "--seed", "0"), "--seed does nothing with --replay"),
        (("rig.toml", "--window", "1"), "--window does nothing without --replay"),
    ],
)
def test_what_cannot_be_replayed_is_refused(args, words, simulate, bench):
    (bench / "lost").mkdir()
    (bench / "lost" / "log.csv").write_bytes((bench / "log.csv").read_bytes())
    before = {p: p.read_bytes() for p in bench.rglob("*") if p.is_file()}
    code, out, err = simulate(*args, cwd=bench)
    assert (code, out) == (2, "")
    assert words in err
    assert {p: p.read_bytes() for p in bench.rglob("*") if p.is_file()} == before


def test_a_rigid_joint_that_nothing_drives_is_refused(simulate, tmp_path):
    lay(tmp_path)
    rig = 'kind = "rigid"\nmotor = { inertia = 0.1 }\nsignals = { motor_position = "theta"'
    (tmp_path / "rigid.toml").write_text(f"[joint.knee]\n{rig} }}\n")
    code, out, err = simulate("rigid.toml", "--replay", "log.csv", "-o", "out.mcap", cwd=tmp_path)
    assert (code, out) == (2, "")
    assert "motor_torque" in err
    assert not (tmp_path / "out.mcap").exists()
    (tmp_path / "rigid.toml").write_text(f'[joint.knee]\n{rig}, motor_torque = "tau" }}\n')
    code, _, err = simulate("rigid.toml", "--replay", "log.csv", "-o", "out.mcap", cwd=tmp_path)
    assert code == 0, err
