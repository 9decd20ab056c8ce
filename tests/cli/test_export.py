"""`vsalog export` as a user runs it: what is written, what is reported, and what is refused."""

from xml.etree import ElementTree as ET

import pytest

from vsalog.rig.load import preset_text


@pytest.fixture
def export(command):
    """Run `vsalog export ARGS` in a folder; returns exit code, stdout and stderr."""
    return lambda *args, cwd: command("export", *args, cwd=cwd)


def test_a_model_goes_to_stdout_and_what_to_know_of_it_to_stderr(run, tmp_path):
    done = run("export", "sea", "--to", "mjcf", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert ET.fromstring(done.stdout).tag == "mujoco"
    assert "stdout: MJCF of sea" in done.stderr
    assert "control sea_motor: the motor's torque [N·m]" in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_file_is_written_whole_and_kept(export, tmp_path):
    (tmp_path / "rig.toml").write_text(preset_text("sea"))
    assert export("rig.toml", "--to", "mjcf", "-o", "sea.xml", cwd=tmp_path)[:2] == (0, "")
    written = (tmp_path / "sea.xml").read_text()
    assert ET.fromstring(written).tag == "mujoco"
    assert "of rig.toml." in written
    code, out, err = export("sea", "--to", "mjcf", "-o", "sea.xml", cwd=tmp_path)
    assert (code, out) == (2, "")
    assert "sea.xml: exists already; --force overwrites it" in err
    assert (tmp_path / "sea.xml").read_text() == written
    assert export("sea", "--to", "urdf", "--unsupported", "comment", "-o", "sea.xml", "--force", cwd=tmp_path)[0] == 0
    assert ET.parse(tmp_path / "sea.xml").getroot().tag == "robot"


def test_the_rig_is_never_written_over(export, tmp_path):
    (tmp_path / "rig.toml").write_text(preset_text("sea"))
    code, _, err = export("rig.toml", "--to", "mjcf", "-o", "rig.toml", "--force", cwd=tmp_path)
    assert code == 2
    assert "is an input" in err
    assert (tmp_path / "rig.toml").read_text() == preset_text("sea")


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("se", "--to", "mjcf"), "there is no rig file 'se', did you mean 'sea'?"),
        (("missing.toml", "--to", "mjcf"), "there is no rig file 'missing.toml'"),
        (("sea", "--to", "mjcf", "-o", "nowhere/sea.xml"), "the folder nowhere does not exist"),
        (("sea", "--to", "mjcf", "-o", "/dev/null"), "is a device, not a file"),
        (("sea", "--to", "mjcf", "-o", "/dev/null", "--force"), "is a device, not a file"),
        (("sea",), "--to"),
        (("sea", "--to", "sdf"), "sdf"),
        (("sea", "--to", "mjcf", "--set", "joint.sea.motor.mass=1"), "mass"),
        (("sea", "--to", "urdf"), "joint.sea.transmission: URDF has no springs between bodies"),
        (("pam", "--to", "mjcf"), "joint.pam: it is moved by compressed air"),
        (
            ("sea", "--to", "mjcf", "-o", "a.xml", "--set", "joint.sea.link.contact=[{start=1,duration=1,torque=2}]"),
            "joint.sea.link.contact: MJCF does not support it ('--unsupported comment' leaves it out)",
        ),
    ],
)
def test_what_is_refused(export, tmp_path, args, words):
    code, out, err = export(*args, cwd=tmp_path)
    assert (code, out) == (2, "")
    assert words in err
    assert not list(tmp_path.iterdir())


def test_what_is_left_out_stands_in_the_file_and_on_the_terminal(export, tmp_path):
    keys = ("--set", "joint.sea.transmission.drift=0.1", "--set", "joint.sea.motor.torque_step=0.1")
    code, out, err = export("sea", "--to", "mjcf", "--unsupported", "comment", *keys, cwd=tmp_path)
    assert code == 0
    for key in ("joint.sea.transmission.drift", "joint.sea.motor.torque_step"):
        assert f"left out: {key}: MJCF does not support it" in out
        assert f"left out: {key}: MJCF does not support it" in err
