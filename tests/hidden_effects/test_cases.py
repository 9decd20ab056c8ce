"""Cases as they lie on disk: what a diagnosis may see, what is sealed, and that a seed makes a case."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.hidden_effects.cases import VARIANTS, NotVisibleError, Plan, make_case, write_case
from tests.hidden_effects.devices import DEVICES
from tests.hidden_effects.effects import EFFECTS, OUTSIDE, SCORED_OUTSIDE
from tests.hidden_effects.generate import KINDS, plans
from tests.hidden_effects.rig_file import CHANNELS
from vsalog.readers import read
from vsalog.rig.load import Rig

pytestmark = pytest.mark.share(5)

ROOT = Path(__file__).parents[2]
MECHANICAL = ("transmission.stiffness", "motor.viscous_friction")
HIDDEN = {"pneumatic": ("pneumatic.force_gain", "sensor.torque_offset")}
# The catalogue.
DESIGN = """
motor.inertia motor.viscous_friction motor.coulomb_friction motor.stribeck_friction motor.load_dependent_friction motor.cogging
motor.torque_constant motor.torque_offset motor.torque_delay transmission.stiffness transmission.nonlinearity
transmission.asymmetry transmission.damping transmission.hysteresis transmission.backlash transmission.stiffness_drift
link.inertia link.payload link.gravity link.viscous_friction link.coulomb_friction link.contact sensor.torque_gain
sensor.torque_offset sensor.torque_drift sensor.torque_delay sensor.torque_not_independent sensor.encoder_offset
sensor.encoder_scale sensor.encoder_eccentricity sensor.clock_skew pneumatic.leak pneumatic.orifice_area pneumatic.valve_offset
pneumatic.pressure_offset pneumatic.force_gain pneumatic.muscle_friction
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("cases")
    for device in DEVICES:
        write_case(make_case(Plan(device, device, 5, HIDDEN.get(device, MECHANICAL), sizes=(5.0, 30.0))), out)
    return out


@pytest.mark.every(2)
@pytest.mark.parametrize("device", DEVICES)
def test_the_log_and_the_nominal_rig_are_what_vsalog_reads(folder, device):
    rig = Rig.load(folder / device / "rig.toml")
    (joint,) = rig.file.joint.values()
    assert type(joint).__name__.lower().startswith(device)
    for name in ("log.parquet", "holdout.parquet"):
        table = pq.read_table(folder / device / name)
        assert table.column_names[0] == "time"
        time = table["time"].to_numpy()
        assert time[0] == 0.0
        assert 19.9 < time[-1] < 30.1
        assert np.allclose(np.diff(time), time[1])
        assert set(table.column_names[1:]) <= set(CHANNELS.values())
        recording = read(folder / device / name)
        assert set(table.column_names[1:]) <= set(recording.channels)


def test_the_hold_out_is_another_movement(folder):
    log, again = (
        pq.read_table(folder / "elastic" / f"{n}.parquet")["link angle"].to_numpy() for n in ("log", "holdout")
    )
    n = min(log.size, again.size)
    assert abs(np.corrcoef(log[:n], again[:n])[0, 1]) < 0.7


def test_nothing_of_the_truth_lies_next_to_the_log(folder):
    for device in DEVICES:
        assert {p.name for p in (folder / device).iterdir()} == {"log.parquet", "holdout.parquet", "rig.toml"}
        sealed = json.loads((folder / "sealed" / f"{device}.json").read_text())
        assert [e["cause"] for e in sealed["effects"]] == list(HIDDEN.get(device, MECHANICAL))
        text = (folder / device / "rig.toml").read_text()
        for effect in sealed["effects"]:
            assert all(repr(v) not in text for v in effect["parameters"].values())
            assert 4.5 <= effect["size"] <= 33.0


def test_a_seed_makes_a_case_and_another_makes_another():
    plan = Plan("x", "elastic", 9, ("motor.inertia",))
    one, same = make_case(plan), make_case(plan)
    other = make_case(Plan("x", "elastic", 10, ("motor.inertia",)))
    assert one.truth == same.truth
    for role, values in one.log.items():
        np.testing.assert_array_equal(values, same.log[role])
    assert one.truth["effects"] != other.truth["effects"]


@pytest.mark.parametrize("roles", VARIANTS)
def test_roles_that_are_left_out_are_in_neither_log_nor_rig(roles, tmp_path):
    case = make_case(Plan("x", "elastic", 3, ("motor.inertia",), roles=roles))
    assert not set(VARIANTS[roles]) & set(case.log)
    text = (write_case(case, tmp_path) / "rig.toml").read_text()
    assert all(f"\n{role} =" not in text for role in VARIANTS[roles])


def test_a_clean_case_hides_nothing():
    truth = make_case(Plan("clean-0", "elastic", 3)).truth
    assert truth["effects"] == []
    assert truth["outside"] is None


def test_what_cannot_be_seen_is_refused():
    with pytest.raises(NotVisibleError, match=r"link\.payload"):
        make_case(Plan("x", "serial", 3, ("link.payload",)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_battery_has_every_cause_that_applies(kind):
    found = plans(kind, 400, 1)
    assert len({p.name for p in found}) == 400
    assert {p.device for p in found} == set(DEVICES)
    causes = {c for p in found for c in p.causes}
    if kind in ("single", "pair"):
        assert causes == set(EFFECTS)
    if kind == "outside":
        assert {p.outside for p in found} == set(OUTSIDE) == set(SCORED_OUTSIDE)
    assert all(len(p.causes) == 2 for p in found) or kind != "pair"
    assert found != plans(kind, 400, 2)


def test_every_cause_of_the_catalogue_can_be_hidden():
    assert set(DESIGN.split()) == set(EFFECTS)


def test_the_generator_knows_nothing_of_vsalog():
    code = "import sys, tests.hidden_effects.generate; print([m for m in sys.modules if m.startswith('vsalog')])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "[]", done.stderr


def test_the_command_writes_cases(tmp_path):
    command = [
        sys.executable,
        "-m",
        "tests.hidden_effects.generate",
        "--out",
        str(tmp_path / "b"),
        "--cause",
        "motor.inertia",
    ]
    command += ["--device", "elastic", "--cases", "1", "--workers", "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("1 cases in")
    assert (tmp_path / "b" / "motor.inertia-elastic-0" / "log.parquet").exists()
