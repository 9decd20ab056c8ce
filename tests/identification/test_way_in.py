"""From a log and `init` to identified numbers, unedited; of elastic drives with known numbers."""

import json

import pytest
from command_line import vsalog_run
from elastic_drive import DAMPING, INERTIA, elastic_drive, write_log

from vsalog.rig import Rig

pytestmark = pytest.mark.share(3)


def identified(folder, *options):
    done = vsalog_run("identify", "log.csv", "--rig", "rig.toml", *options, "-o", "found.toml", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    return {n["key"]: n for n in found["numbers"]}, [f["code"] for f in found["findings"]]


def begun(folder, columns, *leave):
    write_log(folder / "log.csv", columns, leave)
    done = vsalog_run("init", "log.csv", "-o", "rig.toml", cwd=folder)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_what_init_writes_leads_to_the_true_numbers(tmp_path, friction):
    begun(tmp_path, elastic_drive(100.0, friction, 8.0), "torque_sensor")
    numbers, codes = identified(tmp_path)
    truth = {"motor.inertia": INERTIA, "motor.damping": DAMPING, "transmission.stiffness": 100.0}
    truth |= {"motor.friction.coulomb": friction} if friction else {}
    assert numbers.keys() == truth.keys()
    for key, true in truth.items():
        # 95 % intervals of several numbers: twice their width holds all of them in all but one log of many.
        assert abs(numbers[key]["value"] - true) <= numbers[key]["high"] - numbers[key]["low"], key
        assert numbers[key]["value"] == pytest.approx(true, rel=0.04)
    assert "identification.misfit" not in codes


def test_a_rig_far_from_a_log_with_friction_leads_there_too(tmp_path):
    """Without its equations the fit ended at a stiffness of 140 with an interval of 0.4."""
    begun(tmp_path, elastic_drive(100.0, 0.5, 8.0), "torque_sensor")
    rig = (tmp_path / "rig.toml").read_text()
    lines = [
        'inertia = "0.55 kg*m^2"' if line.startswith("inertia") else
        'stiffness = "150 N*m/rad"' if line.startswith("stiffness") else line
        for line in rig.splitlines()
    ]  # fmt: skip
    (tmp_path / "rig.toml").write_text("\n".join(lines))
    numbers, _ = identified(tmp_path)
    assert numbers["transmission.stiffness"]["value"] == pytest.approx(100.0, rel=0.02)
    assert numbers["motor.friction.coulomb"]["value"] == pytest.approx(0.5, rel=0.02)


CURRENT = """
[joint.j]
kind = "elastic"
[joint.j.motor]
inertia = 0.06
damping = 0.1
torque_constant = {constant}
[joint.j.transmission]
type = "linear"
stiffness = 120.0
[joint.j.signals]
motor_position = "motor_position"
motor_torque = {{ channel = "motor_torque", unit = "{unit}" }}
link_position = "link_position"
"""


def test_an_unknown_torque_constant_leaves_the_stiffness_as_unknown(tmp_path):
    columns = elastic_drive(100.0, 0.0, 6.0)
    columns["motor_torque"] /= 0.07
    write_log(tmp_path / "log.csv", columns)
    (tmp_path / "rig.toml").write_text(CURRENT.format(constant='"0.08 N*m/A ± 20%"', unit="A"))
    numbers, _ = identified(tmp_path)
    assert numbers["motor.torque_constant"]["determined"] == "in combination"
    for key, true in {"transmission.stiffness": 100.0, "motor.inertia": INERTIA, "motor.damping": DAMPING}.items():
        assert numbers[key]["low"] < true < numbers[key]["high"]
        assert numbers[key]["high"] / numbers[key]["low"] == pytest.approx(1.2**2, rel=0.2)
    # Of a recorded torque it has no effect.
    (tmp_path / "rig.toml").write_text(CURRENT.format(constant='"0.08 N*m/A ± 20%"', unit="N*m"))
    numbers, _ = identified(tmp_path, "--force")
    assert "motor.torque_constant" not in numbers


@pytest.fixture(scope="module")
def reversed_current(tmp_path_factory):
    """A log whose current is reversed in the rig of the true joint."""
    folder = tmp_path_factory.mktemp("reversed")
    columns = elastic_drive(100.0, 0.0, 3.0)
    columns["motor_torque"] /= -0.07
    write_log(folder / "log.csv", columns)
    (folder / "rig.toml").write_text(CURRENT.format(constant='"0.07 N*m/A ± 0"', unit="A"))
    return folder


def test_a_reversed_current_invalidates_all_numbers(reversed_current):
    """A wrong sign makes stiffness and inertia wrong, with narrow intervals."""
    done = vsalog_run(
        "identify", "log.csv", "--rig", "rig.toml", "--report", "page.html", "--figures", "drawn", cwd=reversed_current
    )
    assert done.returncode == 0, done.stderr
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("invalid: "))
    assert "motor_torque has the wrong sign" in line
    assert "'sign = -1'" in line
    assert "j: invalid" in done.stdout.splitlines()
    page = (reversed_current / "page.html").read_text(encoding="utf-8")
    assert "&#39;sign = -1&#39;" in page
    for shown in (done.stdout, page.partition("Provenance")[0]):
        assert "transmission.stiffness" not in shown
        assert "95 % interval" not in shown
        assert "in the written rig they are unchanged" in shown
    assert not list((reversed_current / "drawn").glob("*.svg"))
    written = Rig.load(reversed_current / "identified.rig.toml").joints["j"]
    assert (written.motor.inertia, written.transmission.stiffness) == (0.06, 120.0)


def test_a_reversed_current_leaves_no_number_in_json_until_its_sign_is_stated(reversed_current):
    command = "identify", "log.csv", "--rig", "rig.toml", "-o", "found.toml", "--json", "--force"
    found = json.loads(vsalog_run(*command, cwd=reversed_current).stdout)
    assert not any(found[part] for part in ("numbers", "combinations", "errors", "correlations"))
    assert [(f["code"], f["joint"], f["severity"]) for f in found["findings"]] == [("signal.sign", "j", "invalidates")]
    done = vsalog_run(*command, "--set", "joint.j.signals.motor_torque.sign=-1", cwd=reversed_current)
    found = json.loads(done.stdout)
    assert "signal.sign" not in [f["code"] for f in found["findings"]]
    (stiffness,) = (n["value"] for n in found["numbers"] if n["key"] == "transmission.stiffness")
    assert stiffness == pytest.approx(100.0, rel=0.04)
