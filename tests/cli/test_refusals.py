"""Bad input gets one clear line on stderr, exit code 2, and leaves nothing behind."""

import os

import numpy as np
import pytest
from knee import RIG, write_log

pytestmark = pytest.mark.share(3)


def test_the_bench_itself_works(run, bench):
    done = run("estimate", "log.csv", cwd=bench)
    assert done.returncode == 0, done.stderr


def test_a_log_that_is_not_there(refused, bench):
    assert "nowhere.mcap" in refused("estimate", "nowhere.mcap", cwd=bench)


def test_an_empty_file(refused, bench):
    (bench / "log.csv").write_bytes(b"")
    assert "empty" in refused("estimate", "log.csv", cwd=bench)


def test_a_file_of_another_kind(refused, bench):
    (bench / "log.mcap").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8)
    message = refused("estimate", "log.mcap", cwd=bench)
    assert "log.mcap" in message


def test_a_channel_that_is_text(refused, bench):
    write_log(bench / "log.csv", tau=["idle"] * 3000)
    message = refused("estimate", "log.csv", cwd=bench)
    assert "'tau'" in message
    assert "text" in message


def test_a_missing_channel_and_what_may_have_been_meant(refused, bench):
    (bench / "rig.toml").write_text(RIG.replace('"theta"', '"thetta"'))
    assert "did you mean 'theta'" in refused("estimate", "log.csv", cwd=bench)


def test_a_unit_that_does_not_fit(refused, bench):
    write_log(bench / "log.csv", header="time [s],theta [m],tau [N·m],q [rad],sensor [N·m]")
    message = refused("estimate", "log.csv", cwd=bench)
    assert "theta" in message
    assert "'m'" in message


def test_a_unit_in_the_rig_that_does_not_fit(refused, bench):
    (bench / "rig.toml").write_text(RIG.replace("inertia = 0.1", 'inertia = "3 N*m"'))
    assert "joint.knee.motor.inertia" in refused("estimate", "log.csv", cwd=bench)


def test_a_negative_inertia(refused, bench):
    (bench / "rig.toml").write_text(RIG.replace("inertia = 0.1", "inertia = -0.1"))
    message = refused("estimate", "log.csv", cwd=bench)
    assert "joint.knee.motor.inertia" in message
    assert "-0.1" in message


def test_two_channels_for_one_role(refused, bench):
    (bench / "rig.toml").write_text(RIG.replace('"theta"', '["theta", "q"]'))
    assert "motor_position" in refused("estimate", "log.csv", cwd=bench)


def test_one_channel_for_two_roles(refused, bench):
    (bench / "rig.toml").write_text(RIG.replace('"q"', '"theta"'))
    assert "theta" in refused("estimate", "log.csv", cwd=bench)


def test_a_key_that_is_not_one(refused, bench):
    (bench / "rig.toml").write_text(RIG.replace("inertia", "intertia"))
    message = refused("estimate", "log.csv", cwd=bench)
    assert "intertia" in message
    assert "inertia" in message


def test_a_log_shorter_than_the_window(refused, bench):
    write_log(bench / "log.csv", rows=40)
    message = refused("estimate", "log.csv", "-e", "qr-rls", cwd=bench)
    assert "40 samples" in message
    assert "window" in message


def test_a_rig_without_inertia(refused, bench):
    (bench / "rig.toml").write_text(RIG.replace("inertia = 0.1", ""))
    message = refused("estimate", "log.csv", "-e", "residual-rls", cwd=bench)
    assert "[joint.knee.motor] inertia" in message
    assert "qr-rls" in message


def test_a_role_that_is_missing(refused, bench):
    (bench / "rig.toml").write_text(RIG.replace('link_position = "q"', ""))
    assert "link_position" in refused("estimate", "log.csv", cwd=bench)


def test_no_second_position_at_all(refused, tmp_path):
    """A robot's JointState has one position per joint: what is missing is reported, joint by joint names are shown."""
    t = np.arange(500) * 0.01
    rows = [f"{a:.3f},{np.sin(a):.6f},{np.cos(a):.6f}" for a in t]
    (tmp_path / "log.csv").write_text("\n".join(["time,arm_0.position,arm_0.effort", *rows]))
    message = refused("estimate", "log.csv", cwd=tmp_path)
    assert "a role is missing" in message
    assert "motor_position" in message


def test_no_torque_at_all(refused, tmp_path):
    t = np.arange(500) * 0.01
    rows = [f"{a:.3f},{np.sin(a):.6f},{np.cos(a):.6f}" for a in t]
    (tmp_path / "log.csv").write_text("\n".join(["time,motor_position,link_position", *rows]))
    message = refused("estimate", "log.csv", cwd=tmp_path)
    assert "a role is missing" in message
    assert "torque" in message


def test_no_time_column(refused, bench):
    t = np.arange(500)
    rows = [f"{np.sin(0.01 * a):.6f},{np.cos(0.01 * a):.6f},{0.5 * np.sin(0.01 * a):.6f},{a % 7}" for a in t]
    (bench / "log.csv").write_text("\n".join(["theta,tau,q,sensor", *rows]))
    assert "--rate" in refused("estimate", "log.csv", cwd=bench)


def test_a_time_column_that_runs_backwards(refused, run, bench):
    t = np.arange(3000) * 1e-3
    write_log(bench / "log.csv", time=np.concatenate((t[:5], t[::-1][5:])))
    lines = (bench / "log.csv").read_text().splitlines()
    (bench / "log.csv").write_text("\n".join([*lines[:1], "# a remark", *lines[1:]]))
    message = refused("estimate", "log.csv", cwd=bench)
    assert "'time' runs backwards at line 9" in message  # header and remark, and five rows that are in order
    assert "no time column" not in message
    assert "'time' runs backwards at line 9" in run("inspect", "log.csv", cwd=bench).stdout
    assert run("estimate", "log.csv", "--rate", "1000", cwd=bench).returncode == 0


TEXTS = {
    "prose": "A licence, that is\n1, a grant\nto all, who\nread 2, of it, and 3\nsay so, or\nnot, so\n" * 9,
    "json": '{\n "a": 1,\n "b": "text, more",\n "c": [\n  "d", "e"\n ],\n "f": true, "g": 2\n}\n',
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_text_with_a_few_numbers_is_no_table(refused, tmp_path, name):
    (tmp_path / "log").write_text(TEXTS[name])
    for command in ("inspect", "estimate"):
        assert "no table" in refused(command, "log", cwd=tmp_path)


def test_the_metadata_of_a_bag_is_no_log(refused, tmp_path):
    text = "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n    - a_0.mcap\n  message_count: 3\n"
    (tmp_path / "metadata.yaml").write_text(text)
    assert "name the folder" in refused("estimate", "metadata.yaml", cwd=tmp_path)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_stretches_without_numbers_are_left_out_and_said(run, bench, value):
    t = np.arange(3000) * 1e-3
    torque = [value if 1000 <= k < 1100 else str(2.0 * np.sin(6.0 * a)) for k, a in enumerate(t)]
    write_log(bench / "log.csv", tau=torque)
    done = run("estimate", "log.csv", cwd=bench)
    assert done.returncode == 0, done.stderr
    assert "100 of 3000 samples of motor_torque" in done.stderr


def test_a_channel_of_nothing_but_nan(refused, bench):
    write_log(bench / "log.csv", tau=["nan"] * 3000)
    message = refused("estimate", "log.csv", cwd=bench)
    assert "tau" in message


def test_a_joint_that_stands_still(run, bench):
    """Constant signals tell nothing: the trace is there, and says so on every row."""
    import pyarrow.parquet as pq

    write_log(bench / "log.csv", theta=[0.1] * 3000, q=[0.1] * 3000, tau=[0.0] * 3000)
    done = run("estimate", "log.csv", cwd=bench)
    assert done.returncode == 0, done.stderr
    assert "never changes" in done.stderr
    assert not pq.read_table(bench / "log.stiffness.parquet")["excited"].to_numpy().any()


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["-e", "residual-rsl"], "did you mean 'residual-rls'"),
        (["-e", "residual-rls", "--tune", "bandwith=3"], "did you mean 'bandwidth'"),
        (["-e", "residual-rls", "--tune", "bandwidth=fast"], "--tune bandwidth=fast"),
        (["-e", "residual-rls", "--tune", "bandwidth=-1"], "--tune bandwidth=-1"),
        (["--tune", "bandwidth"], "NAME=VALUE"),
        (["--tune", "window=1e300"], "window"),
        (["--tune", "window=1e9"], "window"),
        (["--tune", "window=1e308"], "window"),
        (["--tune", "window=1e-4"], "--tune window=SECONDS to 0.006 s"),
        (["-e", "residual-rls", "--tune", "window=1e-4"], "--tune window=SECONDS to 0.006 s"),
        (["-e", "direct", "--tune", "window=1e-4"], "--tune window=SECONDS to 0.004 s"),
        (["--tune", "filter=kinematic", "--tune", "settle=1e300"], "settle"),
        (["--joint", "kne"], "did you mean 'knee'"),
        (["--set", "joint.knee.motor.inertia=heavy"], "inertia"),
        (["--set", "setpoint=3"], "no joint of the rig has a set-point"),
        (["--rate", "0"], "--rate"),
        (["--rig", "vsa3"], "did you mean 'vsa2'"),
        (["-o", "nowhere/out.parquet"], "nowhere"),
        (["-o", "log.csv"], "is the log itself"),
        (["-o", "trace.csv"], "trace.parquet"),
        (["--figures", "figures.svg"], "figures.svg/"),
        (["--mcap", "log.csv"], "is the log itself"),
    ],
)
def test_options_that_cannot_be(refused, bench, options, said):
    assert said in refused("estimate", "log.csv", *options, cwd=bench)


@pytest.mark.parametrize("command", ["diagnose", "validate"])
def test_a_folder_with_the_name_of_a_page(refused, bench, command):
    logs = ["log.model.toml"] if command == "validate" else []
    message = refused(command, *logs, "log.csv", "-o", "page.html", cwd=bench)
    assert "--report page.html" in message
    assert not (bench / "page.html").exists()


def test_an_observer_that_never_settles(refused, simulate, tmp_path):
    """Its poles lie on the edge of stability: none of the frequencies that are tried has a covariance."""
    assert simulate("kuka-kr15", "--duration", "0.5", "-o", "arm.mcap", cwd=tmp_path)[0] == 0
    message = refused("estimate", "arm.mcap", "-e", "acceleration-observer", "--tune", "damping=1e-9", cwd=tmp_path)
    assert "no observer's noise can be determined" in message
    assert "damping" in message
    message = refused("estimate", "arm.mcap", "-e", "acceleration-observer", "--tune", "frequency=2", cwd=tmp_path)
    assert "ask for a higher frequency" in message


@pytest.mark.every(2)
@pytest.mark.parametrize("estimator", ["residual-rls", "qr-rls", "direct"])
@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        ("basis.deflection_scale", "1e-30", "deflection_scale"),
        ("basis.deflection_scale", "1e-60", "deflection_scale"),
        ("signals.link_position", '{ channel = "q", offset = 1e200 }', "'q'"),
        ("signals.link_position", '{ channel = "q", resolution = 1e200 }', "resolution"),
        ("motor.inertia", "1e300", "inertia"),
        ("motor.damping", "1e300", "damping"),
    ],
)
def test_magnitudes_that_cannot_be(refused, bench, estimator, key, value, named):
    if key.startswith("motor") and estimator != "residual-rls":
        pytest.skip("the motor's parameters are not used")
    message = refused("estimate", "log.csv", "-e", estimator, "--set", f"joint.knee.{key}={value}", cwd=bench)
    assert named in message
    assert "Warning" not in message


def test_numbers_that_run_out_of_range_are_not_a_matter_for_warnings(run, bench):
    for setting in ("joint.knee.motor.inertia=1e29", "joint.knee.motor.inertia=1e-300"):
        done = run("estimate", "log.csv", "-e", "residual-rls", "--set", setting, "--tune", "p0=1e300", cwd=bench)
        assert done.returncode == 0, done.stderr
        assert "Warning" not in done.stderr


def test_a_prior_too_small_for_a_number(run, bench):
    options = ("-e", "direct", "--tune", "solver=qr", "--tune", "p0=1e-300", "--tune", "c=1e-300")
    assert run("estimate", "log.csv", *options, cwd=bench).returncode == 0


def test_no_log_at_all(run, tmp_path):
    assert run("estimate").returncode == 2


def test_hostile_names_do_not_reach_the_terminal_or_the_disk(run, tmp_path):
    """A joint's name is text from a file: no escape sequence is printed, no path is made of it."""
    write_log(tmp_path / "log.csv")
    name = "../../\\u001b[31mevil[bold]"
    (tmp_path / "rig.toml").write_text(RIG.replace("[joint.knee", f'[joint."{name}"'))
    done = run("estimate", "log.csv", "--mcap", "out.mcap")
    assert "\x1b[31mevil" not in done.stdout + done.stderr
    assert {p.name for p in tmp_path.iterdir()} <= {
        "log.csv",
        "rig.toml",
        "log.stiffness.parquet",
        "log.model.toml",
        "out.mcap",
    }


def test_what_is_no_file_is_not_overwritten(refused, bench):
    os.mkfifo(bench / "pipe")
    assert "not a file" in refused("estimate", "log.csv", "-o", "pipe", cwd=bench)


def test_results_appear_together_or_not_at_all(run, bench):
    """The model cannot be written: then there is no trace either."""
    (bench / "out.model.toml").mkdir()
    done = run("estimate", "log.csv", "-o", "out.parquet", cwd=bench)
    assert done.returncode == 2
    assert not (bench / "out.parquet").exists()
    assert not list(bench.glob(".*"))
