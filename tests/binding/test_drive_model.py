"""What the rig states of a motor's torque is undone by binding, and played once by a replay."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from vsalog.binding.joint import bind
from vsalog.cli import cli
from vsalog.core.recording import Channel, Recording
from vsalog.rig import Rig
from vsalog.simulation import simulate, sine, sum_of
from vsalog.simulation.replay import replay

T = np.arange(2000) * 1e-3
TORQUE = 0.8 * np.sin(7.0 * T) + 0.1 * np.cos(31.0 * T)
ROLES = ("motor_position", "motor_torque")
EFFECTS = {"torque_gain": 1.1, "torque_offset": 0.15, "torque_delay": 0.012, "torque_step": 0.01}
MOTOR = "\n".join(f"{k} = {v}" for k, v in EFFECTS.items())


def bound(motor, *, acting=True, torque="tau", values=TORQUE):
    rig = Rig.from_toml(f"""
[joint.j]
kind = "elastic"
[joint.j.motor]
{motor}
[joint.j.signals]
motor_position = "theta"
motor_torque = {torque if torque.startswith("{") else f'"{torque}"'}
""")
    stamps = 10**18 + np.round(T * 1e9).astype(np.int64)
    channels = {n: Channel(n, stamps, v, None, n, "float64") for n, v in (("theta", np.sin(T)), ("tau", values))}
    return bind([Recording(Path("log.csv"), "csv", channels, {})], "j", rig.joints["j"], ROLES, acting=acting)


def test_the_torque_that_acts():
    signals = bound(MOTOR)
    # At time t acts what was recorded 12 samples before; before that, nobody knows.
    np.testing.assert_allclose(signals.time[0], 0.012)
    expected = 1.1 * (np.round(TORQUE / 0.01) * 0.01) + 0.15
    np.testing.assert_allclose(signals.roles["motor_torque"], expected[: len(signals)], rtol=1e-12)
    np.testing.assert_allclose(signals.roles["motor_position"], np.sin(signals.time), rtol=1e-9)
    assert signals.resolution["motor_torque"] == pytest.approx(0.011)
    (acting,) = signals.findings
    assert (acting.code, acting.part) == ("torque.drive_model", "motor_torque")
    assert acting.evidence["made"] == "rounded to 0.01 N·m, times 1.1, +0.15 N·m, 12 ms later"


def test_as_recorded_when_asked_for():
    signals = bound(MOTOR, acting=False)
    np.testing.assert_array_equal(signals.roles["motor_torque"], TORQUE)
    assert signals.findings == ()


def test_a_rotor_s_values_go_through_its_gear():
    motor = 'side = "rotor"\ngear_ratio = 50\ntorque_offset = 2e-3\ntorque_step = 1e-4'
    signals = bound(motor, torque='{ channel = "tau", side = "rotor" }', values=TORQUE / 50.0)
    expected = np.round(TORQUE / 5e-3) * 5e-3 + 0.1
    np.testing.assert_allclose(signals.roles["motor_torque"], expected, rtol=1e-9)


def test_a_torque_that_does_not_change_is_one_too():
    signals = bound("torque_gain = 2.0\ntorque_offset = 0.5", torque="{ constant = 0.25 }")
    np.testing.assert_array_equal(signals.roles["motor_torque"], 1.0)


def test_without_an_effect_the_samples_are_those_of_the_log():
    signals = bound("inertia = 0.1")
    assert signals.findings == ()
    np.testing.assert_array_equal(signals.roles["motor_torque"], TORQUE)


@pytest.mark.parametrize("effect", [*({k: v} for k, v in EFFECTS.items()), EFFECTS], ids=[*EFFECTS, "all"])
def test_a_replay_plays_the_effect_once(effect):
    file = Rig.preset("sea").file
    joint = file.joint["sea"]
    extended = replace(file, joint={"sea": replace(joint, motor=replace(joint.motor, **effect))})
    torque = sum_of(sine(2.0, 0.2), sine(1.0, 1.3))
    played = simulate(extended, {"sea": {"motor_torque": torque}}, 8.0, period=1e-3, ideal=True)
    own = extended.joint["sea"]
    roles = {"motor_position", "link_position", "motor_torque"}
    off = {}
    for acting in (False, True):
        signals = bind([played.recording()], "sea", own, roles, acting=acting)
        again = replay({"sea": own}, {"sea": signals})
        true = np.interp(signals.time, played.time, played.truth["link_position"])
        off[acting] = np.max(np.abs(again.simulated["sea"]["link_position"] - true)) / np.ptp(true)
    # What a delay lets act before the log begins is not in the log; the step's edges are joined by straight lines.
    assert off[False] < (5e-3 if "torque_step" in effect else 2e-3)
    if "torque_step" not in effect or len(effect) > 1:
        assert off[True] > 4.0 * off[False]


def test_the_command_line_gives_the_log_back(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    effects = [f"joint.sea.motor.{k}={v}" for k, v in EFFECTS.items()]
    runner = CliRunner()

    def run(*args):
        done = runner.invoke(cli, ["simulate", *args])
        assert done.exit_code == 0, done.output
        return done

    run("sea", *(a for e in effects for a in ("--set", e)), "--duration", "4", "--ideal", "-o", "log.mcap")
    document = json.loads(run("--replay", "log.mcap", "--json").stdout)["joints"]["sea"]
    for role in ("link_position", "motor_position"):
        assert document["rms_error"][role] < 5e-3 * document["spread"][role]
