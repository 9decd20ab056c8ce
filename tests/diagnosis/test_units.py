"""Everything is reported in the joint's units, whatever the rig states of how a role is recorded."""

import numpy as np
import pytest
from restated import COUNTS, POSITIONS, TORQUES, changes, recorded
from written_out import ELASTIC, Truth, log

from vsalog.diagnosis.run import Options, diagnose
from vsalog.residuals.channels import channels_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.sensing import at_joint
from vsalog.residuals.system import build_system
from vsalog.residuals.windows import shoot, windows_of

pytestmark = pytest.mark.share(2)

SECONDS = 4.0
GEARED = ELASTIC.replace("damping = 0.05", "damping = 0.05\ngear_ratio = 10.0")
RIGS = {
    "": GEARED,
    "deflection": GEARED.replace('link_position = "link position"', 'deflection = "deflection"'),
}
ROLES = ("motor_position", "link_position", "deflection", "torque_sensor", "motor_torque")
CASES = [pytest.param(role, way, id=f"{role}-{name}") for role, name, way in changes(ROLES)]


def said_of(truth, role="", seed=0):
    time, said = log(truth, duration=SECONDS, seed=seed)
    if role == "deflection":
        said["deflection"] = said.pop("link_position") - said["motor_position"]
    return time, said


def looked_at(folder, role="", change=None):
    """The equations of a sound log, and the errors of its windows from the measured states."""
    kind = "deflection" if role == "deflection" else ""
    folder.mkdir()
    signals, joint = recorded(folder, *said_of(Truth(), kind), RIGS[kind], role if change else "", change)
    joint, channels = at_joint(joint), channels_of(signals)
    system = build_system(joint, channels.thinned(), balance_for(joint), 1e-3)
    windows = windows_of(joint, channels, True)
    return joint, system, shoot(joint, windows, np.zeros((len(windows.spans), 4)))


@pytest.mark.every(3)
@pytest.mark.parametrize(("role", "way"), CASES)
def test_equations_and_noise_are_those_of_the_plain_rig(tmp_path, role, way):
    joint, plain, before = looked_at(tmp_path / "plain", role)
    changed, system, after = looked_at(tmp_path / "changed", role, way)
    assert system.names == plain.names
    assert system.units == plain.units
    # A second draw of the noise is as large as the first to so much.
    np.testing.assert_allclose(system.deviation, plain.deviation, rtol=0.15)
    ours, theirs = system.averaged(changed), plain.averaged(joint)
    rows = np.intersect1d(system.time.round(6), plain.time.round(6), return_indices=True)[1:]
    both = (system.weights[rows[0]] > 0.0) & (plain.weights[rows[1]] > 0.0)
    assert np.count_nonzero(both) > 0.7 * both.size
    # A delay moves the samples of one role against the others', and a bell that loses a sample at a reversal moves a little.
    off = np.where(both, (ours[rows[0]] - theirs[rows[1]]) / plain.deviation, 0.0)
    assert np.quantile(np.abs(off), 0.98) < 0.2
    for name, error in before.errors.items():
        size = np.sqrt(np.nanmean(error**2))
        assert np.sqrt(np.nanmean(after.errors[name] ** 2)) == pytest.approx(size, rel=0.02), name


def counted(role):
    ways = TORQUES if "torque" in role else POSITIONS
    return ways["counts"]


WRONG = {
    "sensor.encoder_offset": (Truth(), "link_position", {"offset": 100.0 / COUNTS + 0.04}),
    "sensor.torque_offset": (Truth(offset=0.2), "torque_sensor", {"offset": -50.0 / 300.0 + 0.2}),
    "sensor.torque_gain": (Truth(gain=1.1), "torque_sensor", {"gain": 1.1}),
    "sensor.torque_delay": (Truth(delay=6e-3), "torque_sensor", {"delay": 6e-3}),
    "transmission.stiffness": (Truth(stiffness=13.2, cubic=165.0), "motor_position", {"factor": 1.1}),
}


@pytest.mark.every(3)
@pytest.mark.parametrize("cause", WRONG)
def test_what_is_found_next_to_counts_is_reported_in_the_joints_units(tmp_path, cause):
    truth, role, expected = WRONG[cause]
    time, said = said_of(truth)
    if cause == "sensor.encoder_offset":
        said["link_position"] = said["link_position"] + 0.04
    recorded(tmp_path, time, said, GEARED, role, counted(role))
    outcome = diagnose(tmp_path / "log.csv", None, Options())
    document = outcome.diagnosis
    first = next(c for c in document.causes if c.cause == cause)
    for name, value in expected.items():
        number = first.parameters[name]
        assert abs(number.value - value) < max(4 * number.std, 0.01 * abs(value)), name
    for error in document.simulation_error:
        assert error.noise_floor < 0.05, error
    # The rig counts as it did, and has what was found in these counts.
    path = tmp_path / "extended.rig.toml"
    path.write_text(outcome.extended.to_toml(), encoding="utf-8")
    again = diagnose(tmp_path / "log.csv", None, Options(rig=path)).diagnosis
    assert not again.causes
