"""Joints that are commanded a position: the drive's loop, the motion it plans, and replays of what was commanded."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.integrate import solve_ivp

from tests.command_line import vsalog_run
from vsalog.core.errors import RigError, SimulationError
from vsalog.effects.drive import planned
from vsalog.rig import Rig
from vsalog.simulation import simulate
from vsalog.simulation.scenario import Scenario

RIG = """
[joint.a]
kind = "rigid"
[joint.a.motor]
inertia = 0.03
damping = 0.1
{motor}
[joint.a.drive]
kind = "position-servo"
{drive}
[joint.a.signals]
commanded_position = {{ channel = "cmd", unit = "rad" }}
link_position = {{ channel = "q", unit = "rad" }}
"""
PERIOD = 0.02


def rig_of(drive="kp = 20.0\nkd = 0.6", motor=""):
    return Rig.from_toml(RIG.format(drive=drive, motor=motor)).file


def moved(rig, command, **options):
    time = np.arange(command.size) * PERIOD
    played = simulate(rig, {"a": {"commanded_position": command}}, time[-1], period=PERIOD, ideal=True, **options)
    return time, played.joints["a"].truth


def steps(count=150, seed=0):
    return np.repeat(np.random.default_rng(seed).uniform(-0.5, 0.5, 1 + count // 25), 25)[:count]


def by_hand(command, kp, kd, ki=0.0, limit=np.inf, delay=0.0, coulomb=0.0, plan=None, resolution=0.0, h=1e-4):
    """The same joint by small explicit steps, its loop once a millisecond."""
    q, v, total, out = command[0], 0.0, 0.0, []
    per_tick, per_sample = round(1e-3 / h), round(PERIOD / h)
    for k in range(command.size):
        out.append(q)
        for s in range(per_sample):
            if s % per_tick == 0:
                tick = k * per_sample // per_tick + s // per_tick
                r, w = (
                    (command[max(int((tick * 1e-3 - delay) / PERIOD + 1e-6), 0)], 0.0) if plan is None else plan[tick]
                )
                seen = q if resolution == 0.0 else round(q / resolution) * resolution
                wanted = kp * (r - seen) + kd * (w - v) + ki * total
                torque = float(np.clip(wanted, -limit, limit))
                total += (r - seen) * 1e-3 if torque == wanted else 0.0
            load = torque - 0.1 * v
            if v != 0.0 or abs(load) > coulomb:
                new = v + h * (load - coulomb * np.sign(v if v != 0.0 else load)) / 0.03
                v = 0.0 if new * v < 0.0 else new
                q += h * v
    return np.array(out)


def test_a_step_is_that_of_a_damped_oscillator():
    command = np.r_[0.0, np.full(99, 0.3)]
    rig = rig_of("kp = 20.0\nkd = 0.6\nperiod = '0.1 ms'")
    time, truth = moved(rig, command)
    after = time[time >= PERIOD]
    free = solve_ivp(
        lambda _, x: [x[1], (20.0 * (0.3 - x[0]) - 0.7 * x[1]) / 0.03],
        (PERIOD, after[-1]), [0.0, 0.0], t_eval=after, rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    # The loop looks every 0.1 ms, and holds its torque meanwhile: late by half of that.
    assert np.max(np.abs(truth["link_position"][time >= PERIOD] - free.y[0])) < 0.3 * 0.05e-3 * np.sqrt(20.0 / 0.03)
    assert np.array_equal(truth["commanded_position"], command)


@pytest.mark.parametrize(
    ("drive", "known"),
    [
        ("ki = 8.0", {"ki": 8.0}),
        ("torque_limit = 0.8", {"limit": 0.8}),
        ("torque_limit = 0.8\nki = 8.0", {"ki": 8.0, "limit": 0.8}),
        ("delay = 0.033", {"delay": 0.033}),
        ("resolution = 0.01", {"resolution": 0.01}),
    ],
)
def test_each_part_of_the_loop_acts_as_written_by_hand(drive, known):
    command = steps()
    _, truth = moved(rig_of(f"kp = 20.0\nkd = 0.6\n{drive}"), command)
    expected = by_hand(command, 20.0, 0.6, **known)
    assert np.max(np.abs(truth["link_position"] - expected)) < (0.01 if "resolution" in drive else 1e-3)
    plain = by_hand(command, 20.0, 0.6)
    assert np.std(expected - plain) > 5.0 * np.std(truth["link_position"] - expected)


def test_dry_friction_leaves_an_error_that_the_integral_removes():
    motor, command = "friction = { coulomb = 0.5 }", np.r_[0.0, np.full(399, 0.3)]
    _, without = moved(rig_of("kp = 20.0\nkd = 4.0", motor), command)
    _, integrated = moved(rig_of("kp = 20.0\nkd = 4.0\nki = 40.0", motor), command)
    # It creeps until the loop holds no more than friction does.
    assert 0.3 - without["link_position"][-1] == pytest.approx(0.5 / 20.0, rel=0.05)
    assert abs(0.3 - integrated["link_position"][-1]) < 0.2 * 0.5 / 20.0


@pytest.mark.parametrize(("speed", "acceleration"), [(np.inf, 40.0), (2.0, 40.0), (2.0, np.inf)])
def test_a_planned_step_takes_the_time_of_a_trapezoid(speed, acceleration):
    distance, period = 0.7, 1e-3
    position, velocity = planned(np.r_[0.0, np.full(2000, distance)], period, speed, acceleration)
    top = min(speed, np.sqrt(acceleration * distance))
    needed = distance / top + (top / acceleration if np.isfinite(acceleration) else 0.0)
    arrived = int(np.argmax(position > distance - 1e-4)) * period
    assert arrived == pytest.approx(needed, abs=0.05 * needed)
    assert np.max(velocity) == pytest.approx(top, rel=0.03)
    step = acceleration * period**2 if np.isfinite(acceleration) else 1e-12
    assert np.max(position) <= distance + step
    assert abs(position[-1] - distance) < 1e-6
    if np.isfinite(acceleration):
        assert np.max(np.abs(np.diff(velocity))) <= acceleration * period * (1.0 + 1e-9)


def test_a_planned_motion_is_what_the_loop_follows():
    command = steps()
    ticks = np.repeat(command, 20)
    plan = list(zip(*planned(ticks, 1e-3, 3.0, 30.0), strict=True))
    _, truth = moved(rig_of("kp = 20.0\nkd = 0.6\nspeed_limit = 3.0\nacceleration_limit = 30.0"), command)
    assert np.max(np.abs(truth["link_position"] - by_hand(command, 20.0, 0.6, plan=plan))) < 1e-3


def test_an_elastic_joint_is_commanded_at_its_motor():
    text = RIG.format(drive="kp = 20.0\nkd = 0.6", motor="").replace('"rigid"', '"elastic"')
    text += (
        "[joint.a.transmission]\ntype = 'linear'\nstiffness = 50.0\n[joint.a.link]\ninertia = 0.01\ndamping = 0.05\n"
    )
    time, truth = moved(Rig.from_toml(text).file, np.r_[0.0, np.full(499, 0.3)])
    assert truth["motor_position"][-1] == pytest.approx(0.3, abs=1e-3)
    assert truth["link_position"][-1] == pytest.approx(0.3, abs=1e-3)
    early = time < 0.2
    assert np.max(np.abs(truth["deflection"][early])) > 1e-3


def test_a_replay_follows_the_recorded_command(tmp_path):
    rig = tmp_path / "servo.toml"
    drive = "kp = 20.0\nkd = 0.6\ndelay = 0.03\nacceleration_limit = 40.0"
    rig.write_text(RIG.format(drive=drive, motor="friction = { coulomb = 0.05 }"))
    made = vsalog_run("simulate", rig, "--rate", "50", "-o", tmp_path / "log.mcap", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    found = {}
    for name, change in (("same", []), ("other", ["--actual", "joint.a.drive.acceleration_limit=8"])):
        done = vsalog_run(
            "simulate",
            "--replay",
            tmp_path / "log.mcap",
            *change,
            "-o",
            tmp_path / f"{name}.mcap",
            "--json",
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
        found[name] = json.loads(done.stdout)["joints"]["a"]
    off = {name: joint["rms_error"]["link_position"] for name, joint in found.items()}
    assert found["same"]["driven"] == {"commanded_position": "torque"}
    assert off["same"] < 1e-3 < 10.0 * off["same"] < off["other"]


def test_a_log_of_a_command_and_an_encoder_is_replayed(tmp_path):
    """Nothing but a table of two columns, as of a hobby servo."""
    command = np.repeat(steps(), 1)
    position = by_hand(command, 20.0, 0.6, coulomb=0.05)
    time = np.arange(command.size) * PERIOD
    pq.write_table(pa.table({"time": time, "cmd": command, "q": position}), tmp_path / "log.parquet")
    rig = tmp_path / "servo.toml"
    rig.write_text(RIG.format(drive="kp = 20.0\nkd = 0.6", motor="friction = { coulomb = 0.05 }"))
    done = vsalog_run(
        "simulate", rig, "--replay", tmp_path / "log.parquet", "-o", tmp_path / "r.mcap", "--json", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["joints"]["a"]["rms_error"]["link_position"] < 2e-3


def test_a_position_needs_a_drive_and_a_drive_one_input():
    rig = rig_of()
    without = Rig.from_toml('[joint.a]\nkind = "rigid"\n[joint.a.motor]\ninertia = 1.0').file
    with pytest.raises(SimulationError, match="commanded_position"):
        simulate(without, {"a": {"commanded_position": 0.1}}, 1.0)
    part = "[{ type = 'constant', value = 0.1 }]"
    both = f"[joint.a]\ncommanded_position = {part}\nmotor_torque = {part}"
    with pytest.raises(SimulationError, match="same motor"):
        Scenario.from_toml(both).inputs(rig)
    with pytest.raises(RigError, match="kp"):
        rig_of("kd = 0.6")
    with pytest.raises(RigError, match="position-servo"):
        Rig.from_toml(RIG.format(drive="kp = 1.0", motor="").replace('"position-servo"', '"velocity"'))


@pytest.mark.parametrize(("log", "least"), [("chirp_sweep", 3.0), ("multisine", 1.0)])
def test_a_real_servo_plans_its_motion(tmp_path, log, least):
    """An SO-101 arm: without the limit of acceleration, the loop that fits best is off three times as much in a fast sweep."""
    folder = Path(__file__).parents[2] / "sample_logs" / "so101_servo"
    plain = {
        "drive.acceleration_limit": "1e6", "drive.kp": "209", "drive.kd": "0", "drive.delay": "0",
        "motor.damping": "17.3", "motor.friction.coulomb": "2.26",
    }  # fmt: skip
    changes = [word for key, value in plain.items() for word in ("--set", f"joint.rotation.{key}={value}")]
    off = []
    for more in ([], changes):
        done = vsalog_run(
            "simulate", folder / "so101.rig.toml", "--replay", folder / log, *more, "-o", "r.mcap", "--force",
            "--json", cwd=tmp_path,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        off.append(json.loads(done.stdout)["joints"]["rotation"]["rms_error"]["link_position"])
    assert off[1] > least * off[0]
    assert off[0] < 0.01


def velocity_rig():
    text = RIG.format(drive="kp = 20.0\nkd = 0.6", motor="")
    return Rig.from_toml(text + 'commanded_velocity = { channel = "vel", unit = "rad/s" }\n').file


def test_a_commanded_velocity_is_fed_forward():
    """With ṙ the loop lags less; ramps are followed as τ = kp (r − θ) + kd (ṙ − θ̇) has it: kp (r − θ) = D θ̇."""
    time = np.arange(300) * PERIOD
    given = {"commanded_position": 0.5 * time, "commanded_velocity": np.full(time.size, 0.5)}
    played = simulate(velocity_rig(), {"a": given}, time[-1], period=PERIOD, ideal=True)
    q = played.joints["a"].truth["link_position"]
    # Held, the command is on average half a sample behind.
    assert 0.5 * (time[-1] - 0.5 * PERIOD) - q[-1] == pytest.approx(0.1 * 0.5 / 20.0, abs=0.5 * PERIOD * 0.5)
    alone = simulate(rig_of(), {"a": {"commanded_position": 0.5 * time}}, time[-1], period=PERIOD, ideal=True)
    lag = 0.5 * time[-1] - alone.joints["a"].truth["link_position"][-1]
    assert lag == pytest.approx((0.1 + 0.6) * 0.5 / 20.0 + 0.25 * PERIOD, rel=0.1)


def test_a_velocity_alone_is_followed_from_where_the_joint_was():
    time = np.arange(300) * PERIOD
    velocity = np.where(time < 3.0, 0.4, -0.2)
    played = simulate(
        velocity_rig(), {"a": {"commanded_velocity": velocity}}, time[-1], period=PERIOD, ideal=True,
        start={"a": np.array([0.7, 0.0])},
    )  # fmt: skip
    truth = played.joints["a"].truth
    assert truth["link_velocity"][140] == pytest.approx(0.4, abs=1e-3)
    assert truth["link_velocity"][-1] == pytest.approx(-0.2, abs=1e-3)
    assert truth["link_position"][-1] == pytest.approx(0.7 + 0.4 * 3.0 - 0.2 * (time[-1] - 3.0), abs=0.01)


def test_a_replay_is_driven_by_a_commanded_velocity(tmp_path):
    rig, scenario = tmp_path / "rig.toml", tmp_path / "s.toml"
    text = RIG.format(drive="kp = 20.0\nkd = 0.6", motor="").replace("commanded_position", "commanded_velocity")
    for old, new in (
        ('"cmd", unit = "rad"', '"/cmd.data", unit = "rad/s"'),
        ('"q"', '"/q.data", resolution = "1 mrad"'),
    ):
        text = text.replace(old, new)
    rig.write_text(text)
    scenario.write_text(
        'name = "v"\nduration = "8 s"\nperiod = "5 ms"\n'
        '[[joint.a.commanded_velocity]]\ntype = "sine"\namplitude = 1.0\nfrequency = "0.5 Hz"\n'
    )
    done = vsalog_run("simulate", rig, "--scenario", scenario, "-o", "log.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = vsalog_run("simulate", rig, "--replay", "log.mcap", "-o", "again.mcap", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["joints"]["a"]["rms_error"]["link_position"] < 0.01
    done = vsalog_run("diagnose", "log.mcap", "--rig", rig, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["verdict"].startswith("consistent")
