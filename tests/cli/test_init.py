"""`vsalog init` as somebody meets it who has a log and nothing else: the rig is of use, and the gaps are asked for."""

import os
import pty
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from command_line import vsalog_run

from vsalog.cli import cli
from vsalog.rig import Rig

pytestmark = pytest.mark.share(4)

TIME = np.arange(0.0, 6.0, 0.005)
THETA = 0.5 * np.sin(2.1 * TIME) + 0.1 * np.sin(7.3 * TIME)
PHI = 0.04 * np.sin(3.1 * TIME) + 0.02 * np.sin(11.0 * TIME)
STIFFNESS, INERTIA = 120.0, 0.05
TORQUE = STIFFNESS * PHI
ACCELERATION = -0.5 * 2.1**2 * np.sin(2.1 * TIME) - 0.1 * 7.3**2 * np.sin(7.3 * TIME)
DRIVE = INERTIA * ACCELERATION - TORQUE + 0.02 * np.random.default_rng(3).standard_normal(TIME.size)


def counts(angle, turn, gear=1.0):
    return np.round(angle * gear * turn / (2.0 * np.pi))


LOGS = {
    "sensor": {"theta_m": THETA, "theta_l": THETA + PHI, "torque_sensor": TORQUE, "i_q [A]": DRIVE / 3.0},
    "current": {"theta_m": THETA, "theta_l": THETA + PHI, "i_q [A]": DRIVE / 3.0},
    "positions": {"theta_m": THETA, "theta_l": THETA + PHI},
    "position": {"position": THETA},
    "torque": {"position": THETA, "torque": INERTIA * ACCELERATION + 0.1 * THETA},
    "serial": {"theta_m": THETA, "theta_l": THETA + PHI, "stiffness_setpoint": 0.3 + 0.1 * PHI},
    "antagonists": {"motor_1_pos": THETA, "motor_2_pos": -THETA, "link_pos": PHI},
}
COUNTED = {
    "Enc1 [counts]": counts(THETA, 4096, 50.0), "Enc2": counts(THETA + PHI, 65536), "LoadCell (Nm)": TORQUE,
    "Iq_meas [A]": DRIVE / 50.0 / 0.06,
}  # fmt: skip


def write(folder, columns):
    path = folder / "exp1.csv"
    rows = np.column_stack([TIME, *columns.values()])
    np.savetxt(path, rows, delimiter=",", header=",".join(["t", *columns]), comments="", fmt="%.9g")
    return path


def commands_in(text):
    """Return the commands that `init` names, as words."""
    return [match.split() for match in re.findall(r"'vsalog ([^']*)'", text)]


@pytest.mark.parametrize(
    ("log", "command"),
    [
        ("sensor", "estimate"), ("positions", "simulate"), ("position", "simulate"), ("torque", "identify"),
        ("serial", "simulate"), ("antagonists", "simulate"),
    ],
)  # fmt: skip
def test_the_command_that_init_names_can_use_the_rig_as_it_is(log, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, LOGS[log])
    made = CliRunner().invoke(cli, ["init", "exp1.csv", "-o", "my.toml"])
    assert made.exit_code == 0, made.output
    (words,) = commands_in(made.stderr)
    assert words[0] == command
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize("preset", [[], ["--preset", "sea"]])
@pytest.mark.parametrize("given", [[], ["--rate", "200", "--end", "5"]])
def test_the_command_that_init_names_reads_a_log_without_a_time(preset, given, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    columns = {"motor_position": THETA, "link_position": THETA + PHI, "motor_torque": DRIVE, "torque_sensor": TORQUE}
    rows = np.column_stack(list(columns.values()))
    np.savetxt("exp1.csv", rows, delimiter=",", header=",".join(columns), comments="")
    made = CliRunner().invoke(cli, ["init", "exp1.csv", "-o", "my.toml", *preset, *given])
    (words,) = commands_in(made.stderr)
    rate = words[words.index("--rate") + 1]
    assert rate == ("200.0" if given else "HZ")
    assert ("--end" in words) == bool(given)
    done = CliRunner().invoke(cli, ["200" if word == "HZ" else word for word in words])
    assert done.exit_code == 0, done.output


def test_the_stiffness_is_found_up_to_the_torque_constant_where_a_current_is_all(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, LOGS["current"])
    made = CliRunner().invoke(cli, ["init", "exp1.csv", "-o", "my.toml"])
    (words,) = commands_in(made.stderr)
    assert words == ["identify", "exp1.csv", "--rig", "my.toml"]
    assert CliRunner().invoke(cli, [*words, "-o", "found.toml"]).exit_code == 0
    joint = Rig.load(Path("found.toml")).joints["joint"]
    assert joint.transmission.stiffness == pytest.approx(STIFFNESS / 3.0, rel=0.03)
    assert joint.motor.inertia == pytest.approx(INERTIA / 3.0, rel=0.1)
    assert joint.motor.torque_constant == 1.0


def test_counts_are_refused_until_it_is_known_how_many_make_a_turn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log = write(tmp_path, COUNTED)
    made = vsalog_run("init", log, "-o", "my.toml", cwd=tmp_path)
    assert made.returncode == 0
    for key in (
        "signals.motor_position.side",
        "signals.torque_sensor.sign",
        "signals.motor_position.counts_per_turn",
        "signals.link_position.counts_per_turn",
        "motor.gear_ratio",
    ):
        assert f"joint.joint.{key}" in made.stderr
    for rig in (["--rig", "my.toml"], []):
        refused = vsalog_run("estimate", log, *rig, cwd=tmp_path)
        assert refused.returncode == 2
        assert "counts_per_turn = 4096" in refused.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["exp1.csv", "my.toml"]


RNG = np.random.default_rng(11)
GEARED = {
    "motor_pos [rad]": -50.0 * THETA + 1e-3 * RNG.standard_normal(TIME.size), "link_pos [rad]": THETA + PHI,
    "torque_sensor [N*m]": TORQUE + 0.01 * RNG.standard_normal(TIME.size),
}  # fmt: skip


def test_a_gear_ratio_from_the_log_is_proposed_and_never_written_as_a_datum(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log = write(tmp_path, GEARED)
    made = vsalog_run("init", log, "-o", "my.toml", cwd=tmp_path)
    assert tomllib.loads((tmp_path / "my.toml").read_text())["joint"]["joint"].get("motor", {}) == {}
    assert "# gear_ratio = 50 " in (tmp_path / "my.toml").read_text()
    for rig in (["--rig", "my.toml"], []):
        refused = vsalog_run("estimate", log, *rig, cwd=tmp_path)
        assert refused.returncode == 2
        assert "gear_ratio" in refused.stderr
    (words,) = commands_in(made.stderr)
    assert words[-1] == "joint.joint.motor.gear_ratio=50"
    done = CliRunner().invoke(cli, [*words, "-o", "found.parquet", "--estimator", "direct"])
    assert done.exit_code == 0, done.output
    stiffness = pq.read_table("found.parquet")["stiffness"].to_numpy()
    assert np.nanmedian(stiffness) == pytest.approx(STIFFNESS, rel=0.01)


def test_a_ratio_without_a_whole_number_is_asked_for_without_a_proposal(tmp_path):
    log = write(
        tmp_path, {"motor_pos": 50.3 * THETA, **{k: v for k, v in GEARED.items() if "link" in k or "sensor" in k}}
    )
    made = vsalog_run("init", log, cwd=tmp_path)
    assert not any("--set" in words for words in commands_in(made.stderr))
    assert "joint.joint.motor.gear_ratio" in made.stderr
    code, text, prompts = asked(tmp_path, write(tmp_path, GEARED), ["", ""])
    assert code == 0
    assert "[50]" in prompts
    assert tomllib.loads(text)["joint"]["joint"]["motor"]["gear_ratio"] == 50


@pytest.mark.parametrize("preset", [[], ["--preset", "sea"]])
def test_a_table_without_a_header_gets_a_rig_that_lists_its_columns(preset, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log = write(tmp_path, {"a": THETA, "b": THETA + PHI, "c": TORQUE})
    log.write_text("".join(log.read_text().splitlines(keepends=True)[1:]))
    made = CliRunner().invoke(cli, ["init", "exp1.csv", "-o", "my.toml", *preset])
    assert made.exit_code == 0, made.output
    rig = tmp_path / "my.toml"
    (words,) = commands_in(made.stderr)
    assert "fill" in made.stderr
    assert CliRunner().invoke(cli, words).exit_code != 0
    text = rig.read_text()
    assert re.findall(r'^# channel = "(\w+)" .* to ', text, re.MULTILINE) == ["column_1", "column_2", "column_3"]
    for role, column in (("motor_position", 1), ("link_position", 2), ("torque_sensor", 3)):
        text, filled = re.subn(f'^# {role} = "…"', f'{role} = "column_{column}"', text, flags=re.MULTILINE)
        assert filled == 1
    rig.write_text(text)
    done = CliRunner().invoke(cli, [*words, "--estimator", "direct", "-o", "found.parquet"])
    assert done.exit_code == 0, done.output
    assert np.nanmedian(pq.read_table("found.parquet")["stiffness"].to_numpy()) == pytest.approx(STIFFNESS, rel=0.01)


def test_an_estimate_without_a_rig_takes_no_numbers_to_begin_with(tmp_path):
    refused = vsalog_run("estimate", write(tmp_path, LOGS["current"]), cwd=tmp_path)
    assert refused.returncode == 2
    assert "motor_torque" in refused.stderr


def asked(folder, log, answers):
    """Run `init --ask` on a terminal of its own and answer; return the exit code, stdout and stderr."""
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "vsalog", "init", str(log), "--ask"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    with subprocess.Popen(
        command, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=folder, env=environment
    ) as process:
        os.write(ours, "".join(f"{answer}\n" for answer in answers).encode())
        out, err = process.communicate(timeout=60)
    os.close(ours)
    os.close(theirs)
    return process.returncode, out.decode(), err.decode()


@pytest.mark.parametrize("sign", [1, -1])
def test_ask_takes_the_sign_from_the_log_once_the_scales_are_answered(sign, tmp_path):
    log = write(tmp_path, {**COUNTED, "LoadCell (Nm)": sign * TORQUE})
    code, text, prompts = asked(tmp_path, log, ["4096", "65536", "rotor", "50", "0.06", ""])
    assert code == 0, prompts
    sensor = "LoadCell" if sign == 1 else {"channel": "LoadCell", "sign": -1}
    assert tomllib.loads(text)["joint"]["joint"]["signals"]["torque_sensor"] == sensor
    assert "sign of" not in prompts
    assert "'Enc1'" not in prompts.partition("joint joint")[2]


def test_ask_fills_the_gaps_and_asks_again_for_what_cannot_be(tmp_path):
    log = write(tmp_path, COUNTED)
    # A word, a negative number, another unit and what is no choice are asked for again; an empty line leaves the gap.
    answers = ["many", "-3", "4096", "65536", "shaft", "rotor", "50", "0.06 N*m", "60 mNm/A", ""]
    code, text, prompts = asked(tmp_path, log, answers)
    assert code == 0, prompts
    joint = tomllib.loads(text)["joint"]["joint"]
    assert joint["motor"] == {"gear_ratio": 50, "torque_constant": "60 mNm/A"}
    assert joint["signals"]["motor_position"] == {"channel": "Enc1", "counts_per_turn": 4096, "side": "rotor"}
    assert joint["signals"]["link_position"] == {"channel": "Enc2", "counts_per_turn": 65536}
    assert joint["signals"]["motor_torque"] == "Iq_meas"
    assert joint["signals"]["torque_sensor"] == "LoadCell"
    assert prompts.count("counts per turn of 'Enc1'") == 3
    # Behind the gear its ratio does not matter; with these counts no torque follows the deflection, so its sign is asked for.
    code, text, prompts = asked(tmp_path, log, ["4096", "65536", "joint", "", "2", "1"])
    assert code == 0
    assert "gear ratio" not in prompts.partition("joint joint")[0]
    assert tomllib.loads(text)["joint"]["joint"]["signals"]["motor_position"] == {
        "channel": "Enc1",
        "counts_per_turn": 4096,
    }
    assert "# torque_sensor" not in text
    code, text, _ = asked(tmp_path, log, ["", "", "", "", "", ""])
    assert code == 0
    for line in (
        '# motor_position = { channel = "Enc1", counts_per_turn = 4096, side = "rotor" }',
        '# torque_sensor = { channel = "LoadCell", sign = -1 }',
    ):
        assert line in text
    assert tomllib.loads(text)["joint"]["joint"]["signals"]["link_position"] == {"channel": "Enc2", "unit": "counts"}


@pytest.mark.parametrize("extra", [[], ["--preset", "sea"]])
def test_ask_without_a_terminal_or_with_a_preset_is_refused(extra, tmp_path):
    done = vsalog_run("init", write(tmp_path, COUNTED), "--ask", *extra, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "--ask" in done.stderr
