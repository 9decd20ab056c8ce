"""`vsalog init` and `vsalog inspect` as a person or a program meets them."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from command_line import vsalog_run
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rig_logs import DEFLECTION, LINK, MOTOR, MOTOR_TORQUE, TIME, TORQUE, recording, table, write_csv

from vsalog.cli import cli
from vsalog.core.finding import Finding
from vsalog.core.resolution import noise_of, step_of
from vsalog.inspection.document import Inspection, LogReport
from vsalog.inspection.run import clock_of, inspect_recording
from vsalog.report.inspect import inspection_document
from vsalog.report.terminal import console_for, print_document
from vsalog.rig import Rig
from vsalog.rig.guess import guess_roles
from vsalog.rig.schema import AntagonisticJoint, ElasticJoint, SerialJoint
from vsalog.rig.template import preset_template, rig_template, toml_string

pytestmark = pytest.mark.share(2)

COLUMNS = {"motor_position": MOTOR, "link_position": LINK, "motor_current": MOTOR_TORQUE, "effort": TORQUE}


@pytest.fixture
def log(tmp_path):
    return write_csv(tmp_path / "exp1.csv", COLUMNS)


def vsalog(*arguments, cwd="."):
    return vsalog_run(*arguments, cwd=cwd)


def test_init_prints_a_rig_that_loads(log):
    done = CliRunner().invoke(cli, ["init", str(log)])
    assert done.exit_code == 0
    joint = Rig.from_toml(done.stdout).joints["joint"]
    assert isinstance(joint, ElasticJoint)
    assert joint.signals.motor_position == "motor_position"
    assert "# inertia = " in done.stdout
    assert "# torque_constant = " in done.stdout
    assert "90 %: its name contains motor and position" in done.stdout


def test_init_writes_a_file_once(log, tmp_path):
    target = tmp_path / "rig.toml"
    first = vsalog("init", log, "-o", target)
    assert (first.returncode, first.stdout) == (0, "")
    assert "vsalog estimate" in first.stderr
    assert "motor_position (90 %): its name contains motor and position" in first.stderr
    before = target.read_text()
    again = vsalog("init", log, "-o", target)
    assert again.returncode == 2
    assert "--force" in again.stderr
    assert target.read_text() == before
    assert vsalog("init", log, "-o", target, "--force").returncode == 0


def test_init_from_a_preset_takes_the_channels_from_the_log(log):
    done = CliRunner().invoke(cli, ["init", str(log), "--preset", "sea"])
    assert done.exit_code == 0
    joint = Rig.from_toml(done.stdout).joints["sea"]
    assert isinstance(joint, ElasticJoint)
    assert joint.signals.link_position == "link_position"
    assert joint.motor.inertia == 0.08


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("init", "nowhere.mcap"), "nowhere.mcap"),
        (("init", "{log}", "--preset", "vsa3"), "did you mean 'vsa2'"),
        (("init", "{log}", "-o", "no/such/folder/rig.toml"), "does not exist"),
        (("init", "{still}"), "no channel looks like a joint's position"),
        (("init", "{log}", "--rate", "fast"), "--rate"),
        (("init",), "LOG"),
        (("inspect",), "LOG"),
        (("inspect", "nowhere.mcap"), "nowhere.mcap"),
        (("inspect", "{log}", "--time", "moon"), "--time"),
    ],
)
def test_what_cannot_be_done_ends_in_2_with_nothing_on_stdout(arguments, message, log, tmp_path):
    still = write_csv(tmp_path / "still.csv", {"temperature": LINK})
    filled = [a.format(log=log, still=still) for a in arguments]
    done = vsalog(*filled, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_addresses_of_files_here(log, tmp_path):
    other = log.with_name("a b#.csv")
    other.write_bytes(log.read_bytes())
    for address in (f"file://{log}", f"file://localhost{log}", other.as_uri()):
        done = vsalog("inspect", address, "--json")
        assert done.returncode == 0, done.stderr
        (report,) = json.loads(done.stdout)["logs"]
        assert report["path"] == str(other if "%" in address else log)


def test_an_unreadable_log_does_not_hide_the_others(log, tmp_path):
    nowhere, empty = tmp_path / "nowhere.csv", tmp_path / "empty.csv"
    empty.write_text("")
    alone = vsalog("inspect", log)
    done = vsalog("inspect", nowhere, log, empty, log)
    assert done.returncode == 2
    assert done.stdout == f"{alone.stdout}\n{alone.stdout}"
    assert [line.split(": ")[:2] for line in done.stderr.splitlines()] == [
        ["vsalog", str(nowhere)],
        ["vsalog", str(empty)],
    ]


def test_unreadable_logs_stand_in_the_document(log, tmp_path):
    nowhere = tmp_path / "nowhere.csv"
    done = vsalog("inspect", nowhere, log, "--json")
    assert done.returncode == 2
    document = json.loads(done.stdout)
    assert [report["path"] for report in document["logs"]] == [str(log)]
    (one,) = document["unreadable"]
    assert one["path"] == str(nowhere)
    assert done.stderr == f"vsalog: {one['error']}\n"
    assert json.loads(vsalog("inspect", log, "--json").stdout)["unreadable"] == []


def test_runs_and_their_unknown_unit_stand_in_the_template():
    columns = {f"tests.x{n}.{f}": v for n in (10, 20) for f, v in (("angle", DEFLECTION), ("torque", TORQUE))}
    log = recording(columns, absolute=False, kind="matlab")
    text = rig_template(log, guess_roles(log))
    joint = Rig.from_toml(text).joints["joint"]
    assert isinstance(joint, SerialJoint)
    assert [(run.name, run.setpoint) for run in joint.run] == [("x10", 10.0), ("x20", 20.0)]
    assert 'its unit is unknown: write "10 mm"' in text


def test_a_preset_whose_channels_the_log_has_is_left_as_it_is():
    from vsalog.simulation import vsa2_experiment

    log = vsa2_experiment(duration=1.0).recording()
    text = preset_template(log, guess_roles(log), "vsa2")
    rig = Rig.from_toml(text)
    assert isinstance(rig.joints["vsa2"], AntagonisticJoint)
    assert rig.file == Rig.preset("vsa2").file
    assert "as in the preset" in text


HOSTILE = st.text(min_size=1, max_size=30)


@given(HOSTILE, HOSTILE, HOSTILE)
def test_hostile_names_still_give_a_rig_that_loads(joint, motor, stream):
    columns = {f"/{stream}.position[{joint}_motor]": MOTOR[:64], f"/{stream}.position[{joint}_link]": LINK[:64]}
    columns[f"{motor} motor_position"] = MOTOR[:64]
    log = recording(columns)
    guess = guess_roles(log)
    if guess.joints:
        Rig.from_toml(rig_template(log, guess))
    Rig.from_toml(preset_template(log, guess, "sea"))


@given(st.text())
def test_any_text_survives_as_a_toml_string(text):
    import tomllib

    assert tomllib.loads(f"x = {toml_string(text)}")["x"] == text


def report_of(log):
    return inspect_recording(log, guess_roles(log))


def printed(log, width, terminal=True):
    console = Console(
        width=width, force_terminal=terminal, color_system=None, highlight=False, emoji=False, markup=False
    )
    with console.capture() as capture:
        print_document(inspection_document(Inspection((report_of(log),))), console)
    return capture.get()


def test_inspect_json_is_one_document(log):
    import msgspec

    done = CliRunner().invoke(cli, ["inspect", str(log), str(log), "--json"])
    assert done.exit_code == 0
    document = msgspec.json.decode(done.stdout, type=Inspection)
    assert len(document.logs) == 2
    (stream,) = document.logs[0].streams
    assert stream.rate == pytest.approx(500.0)
    channels = {c.name: c for c in stream.channels}
    role = channels["motor_position"].role
    assert role is not None
    assert (role.joint, role.role) == ("joint", "motor_position")
    assert json.loads(done.stdout)["logs"][0]["has_rig"] is False


def test_inspect_in_a_pipe_cuts_nothing_off(tmp_path):
    name = "a_very_long_name_" * 12 + "motor_position"
    log = write_csv(tmp_path / "long.csv", {name: MOTOR, "link_position": LINK})
    done = CliRunner().invoke(cli, ["inspect", str(log)])
    assert done.exit_code == 0
    assert any(name in line and "always" not in line for line in done.stdout.splitlines())
    assert "…" not in done.stdout.replace(" … ", "")


def test_inspect_on_a_narrow_terminal_keeps_every_character():
    log = table({"motor_position": MOTOR, "link_position_with_a_long_name": LINK})
    text = printed(log, 40)
    assert all(len(line) <= 40 for line in text.splitlines())
    assert "link_position_with_a_long_name" in text
    assert "step" in text or "noise" in text


def test_names_cannot_disturb_the_terminal():
    name = "[bold red]x\x1b[31m\nmotor_position"
    for width in (40, 200):
        text = printed(table({name: MOTOR, "link_position": LINK}), width)
        assert "\x1b[31m" not in text
        assert "[boldred]x�" in "".join(text.split())


def test_inspect_tells_what_is_wrong_with_a_log():
    columns = {
        "motor_position": MOTOR.copy(),
        "link_position": np.round(LINK / 0.001) * 0.001,
        "dead": np.zeros(TIME.size),
    }
    columns["motor_position"][:40] = np.nan
    log = table(columns, findings=(Finding(code="recording.rows_unreadable", value=12),), unread={"comment": "text"})
    text = printed(log, 200)
    assert "always 0" in text
    assert "1 %" in text
    assert "0.001" in text
    assert "warning: 12 rows of the database cannot be read" in text
    assert "not read: comment: text" in text
    report = report_of(log)
    assert isinstance(report, LogReport)
    by_name = {c.name: c for c in report.streams[0].channels}
    assert by_name["dead"].constant
    assert by_name["motor_position"].nan_share == pytest.approx(0.01)
    assert by_name["link_position"].resolution == pytest.approx(0.001)


def test_a_pipe_gets_a_console_that_breaks_no_line():
    assert console_for().width > 1000


def test_clocks():
    stamps = np.arange(0, 10_000_000_000, 1_000_000, dtype=np.int64)
    even = clock_of(stamps)
    assert (even.rate, even.jitter, even.gaps, even.longest_gap) == (1000.0, 0.0, 0, 0.0)
    holes = np.delete(stamps, slice(100, 400))
    gap = clock_of(np.delete(holes, slice(1000, 1010)))
    assert (gap.gaps, gap.longest_gap) == (2, pytest.approx(0.301))
    assert np.isnan(clock_of(stamps[:1]).rate)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_noise_and_resolution(scale):
    rng = np.random.default_rng(1)
    smooth = np.sin(TIME)
    assert noise_of(scale * (smooth + 0.01 * rng.standard_normal(TIME.size))) == pytest.approx(0.01 * scale, rel=0.1)
    assert step_of(scale * (smooth + 0.01 * rng.standard_normal(TIME.size))) is None
    assert step_of(scale * np.round(smooth / 0.002) * 0.002) == pytest.approx(0.002 * scale)
    assert step_of((scale * np.round(smooth / 0.002) * 0.002).astype(np.float32).astype(float)) == pytest.approx(
        0.002 * scale, rel=1e-3
    )
    assert noise_of(np.zeros(100)) is None
    assert noise_of(np.full(100, np.nan)) is None
    assert step_of(np.empty(0)) is None
