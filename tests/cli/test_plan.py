"""`vsalog plan`, as a user runs it."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from vsalog.cli import _run
from vsalog.core.document_schema import document_schema
from vsalog.diagnosis import plan_document
from vsalog.diagnosis.isolability import isolations, structure_of
from vsalog.diagnosis.plan import subject_of
from vsalog.readers import read
from vsalog.rig import Rig
from vsalog.simulation.scenario import Scenario

pytestmark = pytest.mark.share(3)

RIG = """
[joint.arm]
kind = "rigid"
[joint.arm.motor]
inertia = 0.02
damping = 0.05
gear_ratio = 10.0
[joint.arm.motor.friction]
coulomb = 0.2
[joint.arm.link]
inertia = 0.05
gravity_torque = 1.5
[joint.arm.signals]
motor_position = { channel = "motor", resolution = 1e-4 }
motor_torque = { channel = "torque", noise = 5e-3 }
"""
# One small sine: a zero of the encoder and one of the torque are nearly one.
SMALL = """
duration = 5.0
period = 2e-3
[joint.arm.motor_servo]
stiffness = 60.0
damping = 4.0
reference = [{ type = "sine", amplitude = 0.1, frequency = 0.5 }]
"""
NO_SENSOR = ("--sensor", "motor_torque")  # it is there
LIMITS = ("--max-torque", "4 N*m", "--max-speed", "0.2 rad/s", "--max-angle", "60 deg")


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run the command line in a folder of its own; returns the exit code and what it prints."""

    def run(*args):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.argv", ["vsalog", *map(str, args)])
        return (_run(), *capsys.readouterr())

    return run


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    (tmp_path / "small.toml").write_text(SMALL, encoding="utf-8")
    return tmp_path


def test_the_motion_that_is_written_plays_keeps_its_limits_and_is_worth_more(run, folder):
    code, out, _ = run("plan", "rig.toml", "--scenario", "small.toml", *LIMITS, *NO_SENSOR, "--json", "-o", "next.toml")
    assert code == 0
    found = json.loads(out)
    Draft202012Validator(document_schema(plan_document)).validate(found)
    (joint,) = found["joints"]
    assert joint["equations"] == ["motor"]
    assert any(c["kind"] == "confused" for c in joint["classes"])
    assert any(c["by_motion"] for c in joint["classes"])
    scenario = tomllib.loads((folder / "next.toml").read_text(encoding="utf-8"))
    assert scenario["duration"] == joint["motion"]["duration"]

    code, _, err = run("simulate", "rig.toml", "--scenario", "next.toml", "--truth", "-o", "log.mcap")
    assert code == 0, err
    truth = read(folder / "log.mcap").channels
    for name, most in (("motor_torque", 4.0), ("link_velocity", 0.2), ("link_position", np.deg2rad(60.0))):
        assert np.max(np.abs(truth[f"/truth/{name}.data"].values)) <= most

    # Played with noise of its own, it separates what it was proposed for.
    rig = Rig.load(folder / "rig.toml")
    again = subject_of(rig, "arm", Scenario.load(folder / "next.toml"), rig.joints["arm"])
    kinds = structure_of(again.problem, again.system)
    named = {c["cause"]: {(r["cause"], r["part"]) for r in c["confused_with"]} for c in joint["causes"]}
    for members in ({(m["cause"], m["part"]) for m in c["members"]} for c in joint["classes"] if c["by_motion"]):
        causes = {key for key in members if key[0] in named and named[key[0]] | {key} == members}
        assert causes
        for one in isolations(again.problem, again.system, causes):
            assert one.visible
            assert not {r.site.key for r in kinds.open(one) if r.probability >= 0.5} & members


SERVO = Path(__file__).parents[2] / "sample_logs" / "so101_servo" / "so101.rig.toml"
SLOW = """
duration = 40.0
period = 0.02
[[joint.rotation.commanded_position]]
type = "sine"
amplitude = 0.12
frequency = 0.1
"""


def test_a_slow_command_hides_a_drives_limit_and_the_proposed_one_tells_it(run, folder):
    """As the real arm's logs do (tests/diagnosis/test_commanded.py): the slow one does not show the limit, the fast one does."""
    (folder / "slow.toml").write_text(SLOW, encoding="utf-8")
    asked = ("plan", SERVO, "--scenario", "slow.toml", "--max-angle", "10 deg")
    code, out, _ = run(*asked, "--max-speed", "3 rad/s", "--json", "-o", "next.toml")
    assert code == 0
    (joint,) = json.loads(out)["joints"]
    limit = [c for c in joint["classes"] if any(m["cause"] == "drive.acceleration_limit" for m in c["members"])]
    assert limit
    assert all(c["kind"] == "confused" and c["by_motion"] for c in limit)
    driven = tomllib.loads((folder / "next.toml").read_text(encoding="utf-8"))["joint"]["rotation"]
    assert set(driven) == {"commanded_position"}
    # Sines by their closed form: within the limits, and fast enough for the drive's limit to matter.
    t = np.linspace(0.0, joint["motion"]["duration"], 10_000)
    sines = [p for p in driven["commanded_position"] if p["type"] == "sine"]
    swing = sum(p["amplitude"] * np.sin(2 * np.pi * p["frequency"] * t + p.get("phase", 0.0)) for p in sines)
    assert np.ptp(swing) <= 2 * np.deg2rad(10.0)
    assert np.max(np.abs(np.gradient(swing, t))) <= 3.0
    # As fast as the judged motion, nothing tells more of it.
    code, out, _ = run(*asked, "--max-speed", "0.1 rad/s", "--json")
    (joint,) = json.loads(out)["joints"]
    assert (code, joint["motion"]) == (0, None)
    code, out, error = run(*asked, "-o", "next.toml")
    assert (code, out) == (2, "")
    assert "--force" in error
    assert joint["no_motion"]


def test_the_terminal_names_classes_and_what_splits_them(run, folder):
    code, out, _ = run(
        "plan", "rig.toml", "--scenario", "small.toml", "--report", "plan.html", "--sensor", "link_position"
    )
    assert code == 0
    assert "link.payload (link)" in out.replace("\n", " ")
    assert "link position" in out
    assert "link.payload" in (folder / "plan.html").read_text(encoding="utf-8")


def test_a_sensor_of_a_unit_that_no_other_one_has_is_judged_with_a_stated_noise_only(run, folder):
    role = "link_acceleration"
    bare = json.loads(run("plan", "rig.toml", "--scenario", "small.toml", "--json", "--sensor", role)[1])
    assert bare["joints"][0]["sensors_tried"] == []
    stated = run("plan", "rig.toml", "--scenario", "small.toml", "--json", "--sensor", f"{role}=0.5 rad/s^2")[1]
    assert json.loads(stated)["joints"][0]["sensors_tried"] == [role]


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("rig.toml", "--sensor", "torque_sensr"), "torque_sensor"),
        (("rig.toml", "--sensor", "torque_sensor=2 m"), "--sensor torque_sensor"),
        (("rig.toml", "--sensor", "torque_sensor=-1"), "--sensor torque_sensor"),
        (("rig.toml", "--max-speed", "0"), "a speed above zero"),
        (("rig.toml", "--max-torque", "3 rad"), "--max-torque"),
        (("rig.toml", "--joint", "leg"), "leg"),
        (("rig.toml", "-o", "rig.toml"), "rig.toml"),
        (("none.toml",), "none.toml"),
    ],
)
def test_what_is_at_fault_ends_with_2_and_writes_nothing(run, folder, args, words):
    before = sorted(folder.iterdir())
    code, out, err = run("plan", *args)
    assert code == 2
    assert words in out + err
    assert sorted(folder.iterdir()) == before
    assert (folder / "rig.toml").read_text(encoding="utf-8") == RIG


def test_a_joint_for_which_nothing_can_be_planned_says_why(run, folder):
    loose = RIG.replace("joint.arm", "joint.leg")
    head, tail = loose.index("[joint.leg.signals]"), loose.index("motor_position")
    assert head < tail
    (folder / "two.toml").write_text(RIG + loose[:head], encoding="utf-8")
    code, out, _ = run("plan", "two.toml", "--scenario", "small.toml", "--json")
    assert code == 0
    arm, leg = json.loads(out)["joints"]
    assert arm["reason"] == ""
    assert leg["reason"]
    assert run("plan", "two.toml", "--joint", "leg", "--scenario", "small.toml")[0] == 2
