"""Pneumatic joints played in windows, and diagnosed as a user does it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from pam_machine import Bench, joint_of, moved, write
from test_balance_pneumatic import as_rig, signals_of

from vsalog.cli import cli
from vsalog.core.errors import SimulationError
from vsalog.diagnosis.gain import compared
from vsalog.residuals.channels import channels_of
from vsalog.residuals.windows import begun, by_states, in_windows, shoot, windows_of
from vsalog.rig import Rig

pytestmark = pytest.mark.share(2)

ROLES = {"link_position", "torque_sensor", "pressure_1", "pressure_2"}


def true_states(bench: Bench, spans: np.ndarray) -> np.ndarray:
    """Return (ψ, ψ̇, P₁, P₂) [bar] at the windows' beginnings, as scipy has them."""
    x, _ = moved(bench, 8.0, 500.0)
    return x[:, spans[:, 0]].T


def test_windows_begun_with_the_truth_say_what_scipy_says() -> None:
    bench = Bench(gain=(1.1, 0.95), leak=(0.01, 0.0), scale=(1.0, 1.2), valve=(0.2, 0.0), tube=0.5e9)
    channels = channels_of(signals_of(bench))
    windows = windows_of(joint_of(bench), channels, hold=False)
    assert set(windows.roles) == ROLES
    shot = shoot(as_rig(bench), windows, true_states(bench, windows.spans))
    for role in windows.roles:
        inside = windows.window >= 0
        assert np.sqrt(np.mean(shot.errors[role][inside] ** 2)) < 1.2 * channels.noise[role].floor


def test_windows_find_their_own_beginnings() -> None:
    bench = Bench()
    channels = channels_of(signals_of(bench))
    joint = joint_of(bench)
    windows = windows_of(joint, channels, hold=False)
    start = true_states(bench, windows.spans) + np.array([2e-3, 0.0, 0.02, -0.02])
    best = begun(joint, windows, start)
    before, after = (float(np.mean(in_windows(s, windows) ** 2)) for s in (shoot(joint, windows, start), best))
    assert after < 1.3
    assert before > 30.0 * after
    assert best.states[:, 2:] == pytest.approx(true_states(bench, windows.spans)[:, 2:], abs=1e-3)


def test_a_window_depends_on_its_beginning_as_differences_say() -> None:
    bench = Bench()
    joint = msgspec.structs.replace(joint_of(bench), friction=None)
    windows = windows_of(joint, channels_of(signals_of(bench)), hold=False).part([1, 4])
    shot = shoot(joint, windows, true_states(bench, windows.spans))
    J = by_states(joint, windows, shot)
    for i, step in enumerate((1e-4, 1e-2, 1e-3, 1e-3)):
        up, down = (in_windows(shoot(joint, windows, shot.states + s * np.eye(4)[i]), windows) for s in (step, -step))
        slope = (up - down) / (2.0 * step)
        assert J[..., i] == pytest.approx(slope, abs=2e-2 * np.abs(slope).max())


def test_a_seesaw_at_rest_or_clamped_is_not_moved_by_its_beginning() -> None:
    joint = joint_of(Bench())
    windows = windows_of(joint, channels_of(signals_of(Bench())), hold=False).part([0, 3])
    states = true_states(Bench(), windows.spans)
    states[0, 1] = 0.0
    J = by_states(joint, windows, shoot(joint, windows, states))
    assert not J[0, :, 1].any()
    assert J[1, :, 1].any()
    held = joint_of(Bench(held=0.1))
    windows = windows_of(held, channels_of(signals_of(Bench(held=0.1), ("link_position",))), hold=False)
    assert set(windows.roles) == ROLES - {"link_position"}
    shot = begun(held, windows)
    assert float(np.mean(in_windows(shot, windows) ** 2)) < 1.2
    assert not by_states(held, windows, shot)[..., :2].any()


def test_the_right_rig_is_as_good_as_noise_allows_and_the_wrong_one_is_not() -> None:
    bench = Bench(leak=(0.02, 0.0))
    channels = channels_of(signals_of(bench))
    windows = windows_of(joint_of(bench), channels, hold=False)
    gain = compared(joint_of(bench), as_rig(bench), windows)
    assert gain.helps
    assert gain.reduction("pressure_1")[1][0] > 0.8
    for role in windows.roles:
        assert gain.rmse(gain.after, role) < 1.2 * gain.floor[role]


@pytest.mark.parametrize(
    ("without", "said"),
    [
        (("valve_2",), "voltage of valve_2 is not recorded"),
        (("pressure_1", "pressure_2"), "pressure_1 is not recorded, and cannot be determined"),
    ],
)
def test_what_cannot_be_played_is_reported(without: tuple[str, ...], said: str) -> None:
    with pytest.raises(SimulationError, match=said):
        windows_of(joint_of(Bench()), channels_of(signals_of(Bench(), without)), hold=False)


def test_voltages_that_are_held_are_held() -> None:
    # A voltage that steps at a sample: held, it steps there; else it ramps up to there.
    signals = signals_of(Bench())
    stepped = np.where(signals.time < 3.2, 3.0, 5.5)
    signals = replace(signals, roles={**signals.roles, "valve_1": stepped, "valve_2": np.full_like(stepped, 4.0)})
    joint = joint_of(Bench())
    windows = windows_of(joint, channels_of(signals), hold=True).part([5, 6])
    states = true_states(Bench(), windows.spans)
    held, ramped = (shoot(joint, replace(windows, hold=h), states) for h in (True, False))
    off = held.errors["pressure_1"] - ramped.errors["pressure_1"]
    before = signals.time < 3.198
    assert np.nanmax(np.abs(off[before])) == 0.0
    assert np.nanmax(np.abs(off[~before])) > 0.0


def test_a_leak_is_found_in_a_table_and_filled_into_the_rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    bench = Bench(leak=(0.0, 0.015))
    log = write(tmp_path, bench)
    run = CliRunner().invoke(cli, ["diagnose", str(log), "--json"])
    assert run.exit_code == 0, run.output
    found = json.loads(run.stdout)
    assert found["verdict"] == "explained"
    (cause,) = found["causes"]
    assert (cause["cause"], cause["part"]) == ("pneumatic.leak", "muscle_2")
    area = cause["parameters"]["area"]
    assert area["unit"] == "m^2"
    assert abs(area["value"] - 0.015e-6) < 4.0 * area["std"]
    assert {e["side"] for e in found["equations"]} == {"link", "transmission", "pneumatic"}
    extended = Rig.load(tmp_path / "extended.rig.toml").joints["arm"]
    assert extended.muscle_2.leak_area == pytest.approx(area["value"], rel=1e-6)
    assert extended.muscle_1.leak_area == 0.0
    # The extended rig is a rig like any other: with it nothing is wrong.
    again = CliRunner().invoke(cli, ["diagnose", str(log), "--rig", "extended.rig.toml", "--json", "-o", "again"])
    assert again.exit_code == 0, again.output
    assert json.loads(again.stdout)["verdict"] == "consistent"
