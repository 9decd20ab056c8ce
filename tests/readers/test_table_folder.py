"""Folders of tables that were recorded together."""

import numpy as np
import pytest
from command_line import vsalog_run

from vsalog.core.errors import ReadError
from vsalog.readers import open_reader, read
from vsalog.rig.guess import guess_roles

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
    (first,) = (joint for name, joint in joints.items() if name.lower() == "rotation")
    assert first.roles["commanded_position"].channel == "control.positions[Rotation]"
    assert first.roles["link_position"].channel == "state_motor.positions[Rotation]"
    assert first.roles["motor_torque"].channel == "state_motor.torques[Rotation]"


def test_tables_with_the_same_columns_are_recordings_of_their_own(folder):
    (folder / "state_motor.csv").write_text((folder / "control.csv").read_text())
    with pytest.raises(ReadError, match=r"control\.csv, state_motor\.csv"):
        open_reader(folder)


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
    for joint in ("rotation", "pitch", "wrist_roll"):
        assert f"{joint}: driven by commanded_position" in done.stdout + done.stderr
