"""Whatever a rig lacks, what it has predicts something: benches, joints without their link, motors without their inertia."""

import re

import numpy as np
import pytest
from msgspec.structs import replace
from restated import recorded
from written_out import ELASTIC, Truth, log, motion, signals

from vsalog.core.errors import SimulationError
from vsalog.diagnosis.run import Options, diagnose
from vsalog.residuals.channels import channels_of
from vsalog.residuals.windows import begun, player_of, shoot, windows_of
from vsalog.rig import Rig

pytestmark = pytest.mark.share(6)

PERIOD, SECONDS = 2e-3, 6.0
LINKLESS = re.sub(r"\[joint\.arm\.link\][^[]*", "", ELASTIC)
LIGHT = ELASTIC.replace("inertia = 0.02\n", "")
BENCH = re.sub(r"\[joint\.arm\.motor\][^[]*", "", LINKLESS)
BENCH = BENCH.replace('link_position = "link position"\n', 'deflection = "deflection"\n')
CHAIN = """
[chain]
[[chain.link]]
joint = "arm"
length = 0.3
mass = 1.0
centre = [-0.15, 0.0, 0.0]
inertia = [0.01, 0.01, 0.01]
"""
ALL = ("motor_position", "link_position", "motor_torque", "torque_sensor")
# What the rig has, what is recorded, and what a simulation then answers with.
SITUATIONS = {
    "bench": (BENCH, ("deflection", "torque_sensor"), {"torque_sensor"}),
    "bench with two encoders": (
        BENCH.replace('deflection = "deflection"', 'link_position = "link position"'),
        ("motor_position", "link_position", "torque_sensor"),
        {"torque_sensor"},
    ),
    "no link": (LINKLESS, ALL, {"motor_position", "torque_sensor"}),
    "chain": (ELASTIC + CHAIN, ALL, {"motor_position", "torque_sensor"}),
    "no link and no torque sensor": (
        LINKLESS.replace('torque_sensor = "torque sensor"\n', 'deflection = "deflection"\n'),
        ("motor_position", "link_position", "motor_torque", "deflection"),
        {"motor_position", "deflection"},
    ),
    "no link, deflection instead of its encoder": (
        LINKLESS.replace('link_position = "link position"', 'deflection = "deflection"'),
        ("motor_position", "deflection", "motor_torque", "torque_sensor"),
        {"motor_position", "torque_sensor"},
    ),
    "no link and no encoder of it": (LINKLESS, ("motor_position", "motor_torque", "torque_sensor"), {"motor_position"}),
    "no inertia of the motor": (LIGHT, ALL, {"link_position", "torque_sensor"}),
}


def said_of(truth, roles, seed=0):
    time, said = log(truth, duration=SECONDS, period=PERIOD, seed=seed)
    said["deflection"] = said["link_position"] - said["motor_position"]
    return time, {role: said[role] for role in roles}


def laid(folder, truth, rig, roles):
    recorded(folder, *said_of(truth, roles), rig)
    recorded(folder, *said_of(truth, roles, 1), rig, name="held")
    return folder / "log.csv", folder / "held.csv"


@pytest.mark.every(3)
@pytest.mark.parametrize("situation", SITUATIONS)
def test_a_sound_log_is_predicted_to_its_noise(tmp_path, situation):
    rig, roles, answered = SITUATIONS[situation]
    document = diagnose(*laid(tmp_path, Truth(), rig, roles), Options()).diagnosis
    assert document.verdict == "consistent as far as checked"
    codes = [finding.code for finding in document.findings]
    unchecked = codes.count("diagnosis.equation_unchecked") + codes.count("diagnosis.rig_lacks")
    assert unchecked == 3 - len(document.equations)
    assert {e.signal for e in document.simulation_error} == answered
    for error in document.simulation_error:
        assert 0.6 * error.noise_floor < error.rmse < 1.4 * error.noise_floor, error
    assert "diagnosis.not_simulated" not in codes


# One that each can notice.
SOFT = Truth(stiffness=13.0, cubic=162.5)
RUBS = Truth(damping=0.09)
HIDDEN = {
    situation: (RUBS, "motor.viscous_friction")
    if situation.endswith("no encoder of it")
    else (SOFT, "transmission.stiffness")
    for situation in SITUATIONS
}


@pytest.mark.every(3)
@pytest.mark.parametrize("situation", SITUATIONS)
def test_what_is_wrong_has_a_gain_on_the_held_out_log(tmp_path, situation):
    (rig, roles, answered), (truth, cause) = SITUATIONS[situation], HIDDEN[situation]
    document = diagnose(*laid(tmp_path, truth, rig, roles), Options()).diagnosis
    assert cause in (document.causes[0].cause, *document.causes[0].indistinguishable_from)
    gains = [g for g in document.gain.signals if "stiffness" not in g.signal]
    assert document.gain.holdout
    assert {g.signal for g in gains} == answered
    assert max(g.reduction for g in gains) > 0.5
    for gain in gains:
        assert gain.rmse_after < 1.5 * gain.noise_floor, gain


def test_a_prescribed_link_moves_as_it_did():
    """From the true state of the motor, with the true torque: the residual is what the sensors added."""
    _, said = said_of(Truth(), ALL)
    moved = motion(Truth(), SECONDS, PERIOD, 0)[1]
    said["motor_torque"] = moved["motor_torque"][0]
    joint = next(iter(Rig.from_toml(LINKLESS).joints.values()))
    windows = windows_of(joint, channels_of(signals(said, PERIOD)), False)
    first = windows.spans[:, 0]
    states = np.stack([moved[r][k][first] for r in ("link_position", "motor_position") for k in (0, 1)], axis=-1)
    errors = shoot(joint, windows, states).errors["motor_position"]
    inside = np.isfinite(errors)
    added = said["motor_position"] - moved["motor_position"][0]
    # The link's encoder has steps of 2e-4 rad, and moves the motor by what its filter leaves of them.
    assert np.sqrt(np.mean((errors - added)[inside] ** 2)) < 1e-4
    assert set(player_of(joint, windows.channels).free(states)) == {2, 3}


def test_a_bench_follows_its_loop_through_the_whole_log():
    """Slip elements remember where they were pulled: windows that begin in the middle have it right, too."""
    time, said = said_of(Truth(), ("deflection",))
    phi, slip, torque = said["deflection"], 0.0, np.zeros(time.size)
    for k in range(1, time.size):
        slip = float(np.clip(slip + 8.0 * (phi[k] - phi[k - 1]), -0.2, 0.2))
        torque[k] = 12.0 * phi[k] + 150.0 * phi[k] ** 3 + slip
    rig = BENCH.replace("cubic = 150.0", "cubic = 150.0\nslip = [{ stiffness = 8.0, limit = 0.2 }]")
    joint = next(iter(Rig.from_toml(rig).joints.values()))
    bound = signals({"deflection": phi, "torque_sensor": torque}, PERIOD)
    windows = windows_of(joint, channels_of(bound), False).part([4, 7])
    shot = begun(joint, windows)
    assert np.sqrt(np.nanmean(shot.errors["torque_sensor"] ** 2)) < 0.02
    assert player_of(joint, windows.channels).free(shot.states) == {}


PRESETS = {
    ("vsa2", "link"): {"motor_position_1", "motor_position_2", "torque_sensor_1", "torque_sensor_2"},
    ("vsa2", "motor_1.inertia"): {"motor_position_2", "link_position", "torque_sensor_1", "torque_sensor_2"},
    ("awas", "link"): {"motor_position", "torque_sensor"},
    ("awas", "secondary_motor"): {"motor_position", "link_position", "torque_sensor"},
}


@pytest.mark.every(2)
@pytest.mark.parametrize(("preset", "lacks"), PRESETS)
def test_other_devices_that_lack_a_part_are_predicted_to_their_noise(tmp_path, request, preset, lacks):
    rig = Rig.preset(preset)
    ((name, joint),) = rig.joints.items()
    part, _, key = lacks.partition(".")
    changed = replace(joint, **{part: replace(getattr(joint, part), **{key: None}) if key else None})
    path = tmp_path / "rig.toml"
    path.write_text(Rig(replace(rig.file, joint={name: changed}), "lacking").to_toml(), encoding="utf-8")
    logs = request.config.rootpath / "sample_logs"
    document = diagnose(logs / f"{preset}_exp1.mcap", None, Options(rig=path)).diagnosis
    # A rig without a second motor has no equation of it.
    assert document.verdict == ("consistent" if lacks == "secondary_motor" else "consistent as far as checked")
    assert {e.signal for e in document.simulation_error} == PRESETS[preset, lacks]
    for error in document.simulation_error:
        assert 0.7 * error.noise_floor < error.rmse < 1.3 * error.noise_floor, error


def test_a_real_bench_has_a_gain_in_each_of_its_runs(request):
    """A foot on a dynamometer: deflection and torque, and nothing else."""
    log = request.config.rootpath / "sample_logs" / "desr_foot" / "desr_foot.mat"
    document = diagnose(log, None, Options()).diagnosis
    assert [e.signal for e in document.simulation_error] == 9 * ["torque_sensor"]
    assert all(0.0 < e.noise_floor < e.rmse for e in document.simulation_error)


def test_a_deflection_alone_predicts_nothing():
    _, said = said_of(Truth(), ("deflection",))
    joint = next(iter(Rig.from_toml(BENCH).joints.values()))
    with pytest.raises(SimulationError, match="no deflection is recorded whose torque a sensor measures"):
        windows_of(joint, channels_of(signals(said, PERIOD)), False)
