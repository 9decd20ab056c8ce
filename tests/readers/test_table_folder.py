"""Folders of tables that were recorded together."""

import json
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run

from vsalog.core.errors import ReadError
from vsalog.effects.drive import PositionServo
from vsalog.readers import open_reader, read
from vsalog.readers.sampling import read_sample
from vsalog.rig.guess import guess_roles
from vsalog.rig.load import Rig
from vsalog.rig.schema import RigidJoint

pytestmark = pytest.mark.share(2)

T = np.arange(400) * 0.02
NAMES = ["Rotation", "Pitch", "Wrist_Roll"]


def lists(columns):
    return [f'"[{", ".join(f"{x:.6f}" for x in row)}]"' for row in np.stack(columns, axis=1)]


def write(path, head, *columns):
    rows = (",".join(cells) for cells in zip(*columns, strict=True))
    path.write_text("\n".join([head, *rows]) + "\n")


@pytest.fixture
def folder(tmp_path):
    """As a teleoperation of hobby servos writes it: commands and states apart, a list per cell, microseconds."""
    log = tmp_path / "sweep"
    log.mkdir()
    asked = [0.3 * np.sin((2 + k) * T) for k in range(3)]
    found = [0.3 * np.sin((2 + k) * (T - 0.05)) for k in range(3)]
    stamps = [f"{x:.3f}" for x in T * 1e6]
    write(log / "control.csv", "type,timestamp,positions", ["CONTROL"] * 400, stamps, lists(asked))
    write(
        log / "state_motor.csv", "type,timestamp,positions,torques", ["STATE"] * 400, stamps, lists(found), lists(found)
    )
    (log / "event.csv").write_text("type,timestamp,event\nEVENT,0,BEGIN\nEVENT,5.01,MOTION\n")
    (log / "joint_list.txt").write_text("\n".join(NAMES) + "\n")
    return log


def test_a_folder_is_one_log_with_named_elements(folder):
    recording = read(folder)
    assert set(recording.streams) == {"control", "state_motor"}
    assert set(recording.channels) == {f"control.positions[{n}]" for n in NAMES} | {
        f"state_motor.{field}[{n}]" for field in ("positions", "torques") for n in NAMES
    }
    values = recording.channels["control.positions[Pitch]"].values
    assert np.allclose(values, 0.3 * np.sin(3 * T), atol=1e-6)
    assert recording.channels["control.positions[Pitch]"].stamps[1] == 20_000_000


def test_some_channels_of_it_can_be_read(folder):
    recording = read(folder, {"control.positions[Pitch]"})
    assert list(recording.channels) == ["control.positions[Pitch]"]


def test_without_names_elements_are_numbered(folder):
    (folder / "joint_list.txt").unlink()
    assert "control.positions[2]" in read(folder).channels


@pytest.mark.parametrize("lines", ["Rotation\nPitch\n", "a\na\nb\n", "../x\ny\nz\n", "\x1b[31m\ny\nz\n"])
def test_lines_that_are_no_names_of_these_elements_name_nothing(folder, lines):
    (folder / "joint_list.txt").write_text(lines)
    assert "control.positions[2]" in read(folder).channels


def test_joints_are_guessed_from_commands_and_states(folder):
    joints = {joint.name: joint for joint in guess_roles(read(folder)).joints}
    assert len(joints) == 3
    first = joints["Rotation"]
    assert first.roles["commanded_position"].channel == "control.positions[Rotation]"
    assert first.roles["link_position"].channel == "state_motor.positions[Rotation]"
    assert first.roles["motor_torque"].channel == "state_motor.torques[Rotation]"


def table(path, stamps, head="time,angle,torque"):
    write(
        path, head, [f"{x:.6f}" for x in stamps], *[[f"{x:.4f}" for x in np.sin(T[: len(stamps)] + k)] for k in (0, 1)]
    )


@pytest.mark.parametrize(
    ("names", "heads"),
    [
        (("slow.csv", "fast.csv"), ("time,angle,torque", "time,angle,torque")),
        (("exp1.csv", "exp2.csv"), ("time,angle,torque", "time,angle,current")),
    ],
)
@pytest.mark.parametrize("step", [0.02, 1 / 60])
def test_even_clocks_from_zero_do_not_make_experiments_one_recording(tmp_path, names, heads, step):
    """Each run of a program begins with the same times, also where they are rounded to milliseconds."""
    for name, head in zip(names, heads, strict=True):
        table(tmp_path / name, np.round(np.arange(400) * step, 3), head)
    with pytest.raises(ReadError) as caught:
        open_reader(tmp_path)
    assert all(name in str(caught.value) for name in names)


def test_tables_alike_are_one_recording_where_their_clocks_show_it(tmp_path):
    """Two arms with a table each: the same late steps, or dates of the same minute."""
    late = np.cumsum(0.02 + 1e-4 * np.random.default_rng(0).integers(0, 9, 400))
    for k, stamps in enumerate((late, 1.76e9 + T, 1.76e9 + T + 0.004)):
        folder = tmp_path / str(k)
        folder.mkdir()
        table(folder / "left.csv", stamps)
        table(folder / "right.csv", 1.76e9 + T if k == 2 else stamps)
        assert set(read(folder).streams) == {"left", "right"}
    table(tmp_path / "0" / "right.csv", np.cumsum(0.02 + 1e-4 * np.random.default_rng(1).integers(0, 9, 400)))
    table(tmp_path / "1" / "right.csv", 1.76e9 + 3600 + T)
    for k in (0, 1):
        with pytest.raises(ReadError):
            read(tmp_path / str(k))


def test_clocks_of_one_name_have_one_unit(folder):
    """A temperature each second: its steps alone would be milliseconds, of nanoseconds."""
    seconds = np.arange(9.0)
    write(
        folder / "heat.csv", "timestamp,temperature", [f"{x * 1e6:.0f}" for x in seconds], [f"{x:.1f}" for x in seconds]
    )
    alone = read(folder / "heat.csv").channel("temperature").stamps
    assert alone[-1] - alone[0] != 8_000_000_000
    assert np.array_equal(read(folder).channels["heat.temperature"].stamps, seconds.astype(int) * 1_000_000_000)


def test_a_date_and_a_count_of_one_name_keep_their_units(folder):
    table(folder / "clock.csv", 1.76e9 + T, "timestamp,angle,torque")
    assert read(folder, {"control.positions[Pitch]"}).channels["control.positions[Pitch]"].stamps[1] == 20_000_000
    with pytest.raises(ReadError, match="different times"):
        read(folder)


def test_tables_of_one_stem_keep_their_names(folder):
    pq.write_table(pa.table({"timestamp": T * 1e6, "current": np.sin(T)}), folder / "control.parquet")
    found = read(folder)
    assert {"control.csv", "control.parquet", "state_motor"} == set(found.streams)
    assert "control.parquet.current" in found.channels


@pytest.mark.parametrize("names", [["joint 1", "joint 2", "joint 3"], ["É", "b.c", "d-e"]])
def test_names_may_look_like_a_table(folder, names):
    (folder / "joint_list.txt").write_text("\n".join(names) + "\n")
    assert f"control.positions[{names[2]}]" in read(folder).channels


def test_two_lists_of_names_name_nothing(folder):
    (folder / "motors.txt").write_text("a\nb\nc\n")
    assert "control.positions[2]" in read(folder).channels


def test_prose_is_no_warning(folder):
    (folder / "README.txt").write_text("An arm, by hand.\nIt moved.\n")
    recording = read(folder)
    assert "README.txt" in recording.unread
    assert "recording.file_left_out" not in {f.code for f in recording.findings}


def test_a_folder_with_other_logs_is_no_recording(folder):
    (folder / "arm.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(99))
    with pytest.raises(ReadError, match=r"arm\.bag"):
        open_reader(folder)


def test_a_part_of_the_time(folder):
    part = read(folder, start=2.0, end=4.0)
    stamps = part.channels["state_motor.torques[Pitch]"].stamps
    assert (stamps[0], stamps[-1]) == (2_000_000_000, 4_000_000_000)


def test_a_large_folder_is_sampled(folder, monkeypatch):
    monkeypatch.setattr("vsalog.readers.sampling.LOOK_BYTES", 30_000)
    monkeypatch.setattr("vsalog.readers.sampling.GLANCE_BYTES", 1_000)
    (folder / "more.csv").write_bytes(b"\x00\x01\x02" * 50_000)
    recording, sample = read_sample(folder)
    assert sample is not None
    assert 0 < recording.streams["state_motor"].count < 400
    assert "control.positions[Pitch]" in recording.channels


def test_tables_of_different_times_are_no_recording(folder):
    stamps = [f"{x:.3f}" for x in (T + 100.0) * 1e6]
    write(folder / "control.csv", "type,timestamp,positions", ["CONTROL"] * 400, stamps, lists([T, T, T]))
    with pytest.raises(ReadError, match="different times"):
        read(folder)


def test_a_folder_without_tables_is_refused(tmp_path):
    (tmp_path / "notes.md").write_text("nothing")
    done = vsalog_run("inspect", tmp_path, cwd=tmp_path)
    assert done.returncode == 2
    assert str(tmp_path.name) in done.stderr


def test_a_broken_table_is_left_out_and_reported(folder):
    (folder / "more.csv").write_bytes(b"\x00\x01\x02" * 50)
    recording = read(folder)
    assert "recording.file_left_out" in {f.code for f in recording.findings}
    assert "control.positions[Pitch]" in recording.channels


def test_commands_take_a_folder(folder):
    done = vsalog_run("inspect", folder, cwd=folder.parent)
    assert done.returncode == 0, done.stderr
    assert "commanded_position" in done.stdout
    rig = folder.parent / "rig.toml"
    done = vsalog_run("init", folder, "-o", rig, cwd=folder.parent)
    assert done.returncode == 0, done.stderr
    done = vsalog_run("simulate", rig, "--replay", folder, "-o", "r.mcap", cwd=folder.parent)
    assert done.returncode == 0, done.stderr
    for joint in NAMES:
        assert f"{joint}: driven by commanded_position" in done.stdout + done.stderr


def test_a_real_arm_becomes_six_joints(tmp_path):
    """The files of an SO-101 as its program wrote them: a rig whose joints are simulated."""
    arm = ["Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw"]
    log = Path(__file__).parents[2] / "sample_logs" / "so101_servo" / "multisine"
    done = vsalog_run("init", log, "-o", "rig.toml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"vsalog identify {log}" in done.stderr  # no stiffness is estimated of joints with one encoder
    rig = Rig.load(tmp_path / "rig.toml")
    assert list(rig.joints) == arm
    for name, joint in rig.joints.items():
        assert isinstance(joint, RigidJoint)
        assert isinstance(joint.drive, PositionServo)
        assert joint.signals.commanded_position == f"control.positions[{name}]"
        assert joint.signals.link_position == f"state_motor.positions[{name}]"
        assert joint.signals.motor_torque == f"state_motor.torques[{name}]"
    done = vsalog_run("simulate", "rig.toml", "--replay", log, "-o", "r.mcap", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert list(json.loads(done.stdout)["joints"]) == arm


def test_a_real_arm_is_on_one_clock():
    """Whole numbers of its stamps in the text: microseconds, 40 s of them from the program's start."""
    recording = read(Path(__file__).parents[2] / "sample_logs" / "so101_servo" / "chirp_sweep")
    control, state = (
        recording.channels[name].stamps for name in ("control.positions[Jaw]", "state_motor.torques[Jaw]")
    )
    assert np.array_equal(control, state)
    assert control.size == 1994
    assert 80.0 <= control[0] * 1e-9 < control[-1] * 1e-9 < 120.0


@pytest.mark.parametrize("held", [True, False])
def test_a_joint_that_is_told_to_stand_still_may_stand_still(folder, held):
    """An encoder that never changes is a joint that is held, or one that does not work where the command moves."""
    still, moved = np.full(len(T), 0.25), 0.3 * np.sin(3 * T)
    stamps = [f"{x:.3f}" for x in T * 1e6]
    for name, second in (("control", still if held else moved), ("state_motor", still)):
        columns = lists([moved, second, moved])
        write(folder / f"{name}.csv", "type,timestamp,positions", ["ROW"] * 400, stamps, columns)
    (folder / "state_motor.csv").write_text(
        (folder / "state_motor.csv").read_text().replace("positions", "measured_positions")
    )
    pitch = next(joint for joint in guess_roles(read(folder)).joints if joint.name == "Pitch")
    assert pitch.roles["commanded_position"].channel == "control.positions[Pitch]"
    assert ("link_position" in pitch.roles) == held


def test_a_repaired_folder_holds_the_same_numbers(folder):
    done = vsalog_run("inspect", folder, "--repair", "sound.mcap", cwd=folder.parent)
    assert done.returncode == 0, done.stderr
    sound = read(folder.parent / "sound.mcap").channels["/state_motor/torques/Pitch.data"]
    before = read(folder).channels["state_motor.torques[Pitch]"]
    assert np.array_equal(sound.values, before.values)
    assert np.array_equal(sound.stamps, before.stamps)


def test_names_of_files_are_no_control_characters(folder):
    """Nor do pipes, links in circles and folders that are called like tables stop a command."""
    (folder / "control.csv").rename(folder / os.fsdecode(b"con\xff\x1b[2Jtrol.csv"))
    (folder / "bad\n\x1b.csv").write_bytes(b"\0\1" * 99)
    (folder / "empty.csv").touch()
    (folder / "loop.csv").symlink_to("loop.csv")
    os.mkfifo(folder / "pipe.csv")
    (folder / "folder.csv").mkdir()
    assert all(name.isprintable() for name in read(folder).channels)
    done = vsalog_run("inspect", folder, cwd=folder.parent)
    assert done.returncode == 0, done.stderr
    assert all(character.isprintable() or character == "\n" for character in done.stdout + done.stderr)
