"""`vsalog diagnose` as a user runs it: files, exit codes, refusals; and that an extended rig leaves nothing to be found."""

import json
import re

import jsonschema
import msgspec
import numpy as np
import pytest
from written_out import ELASTIC, ROLES, Truth, log, write_csv

from vsalog.cli import _run
from vsalog.core.document_schema import document_schema
from vsalog.diagnosis import document as document_module
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.document import Diagnosis
from vsalog.diagnosis.joint import HELD_OUT
from vsalog.rig import Rig

pytestmark = pytest.mark.share(4)

FILES = ["diagnosis.html", "diagnosis.json", "extended.rig.toml"]
WRONG = Truth(damping=0.08)


def lay(folder, truth=None, name="exp1", seed=0, rig=ELASTIC, duration=6.0, roles=ROLES):
    """Write a log and its rig into a folder."""
    folder.mkdir(exist_ok=True)
    time, said = log(truth or Truth(), duration=duration, seed=seed, roles=roles)
    write_csv(folder / f"{name}.csv", time, said)
    (folder / f"{name}.rig.toml").write_text(rig, encoding="utf-8")
    return folder / f"{name}.csv"


@pytest.fixture
def call(monkeypatch, capsys):
    """Run `vsalog diagnose` in this process in a folder; returns exit code, stdout and stderr."""

    def call(*args, cwd):
        monkeypatch.chdir(cwd)
        monkeypatch.setattr("sys.argv", ["vsalog", "diagnose", *map(str, args)])
        code = _run()
        return code, *capsys.readouterr()

    return call


@pytest.fixture(scope="module")
def wrong(tmp_path_factory):
    """A joint with more motor friction than in its rig, diagnosed with a held-out log; the folder and the output."""
    folder = tmp_path_factory.mktemp("wrong")
    lay(folder, WRONG)
    lay(folder, WRONG, "exp2", seed=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("sys.argv", ["vsalog", "diagnose", "exp1.csv", "--holdout", "exp2.csv", "-o", "out"])
        assert _run() == 0
    return folder


@pytest.fixture(scope="module")
def document(wrong):
    return json.loads((wrong / "out" / "diagnosis.json").read_text(encoding="utf-8"))


def test_the_document_is_what_its_schema_says(document):
    jsonschema.validate(document, document_schema(document_module))
    msgspec.convert(document, Diagnosis)


def test_the_cause_is_named_with_its_numbers_and_what_to_do(document):
    assert document["verdict"] == "explained"
    (cause,) = document["causes"]
    assert (cause["cause"], cause["joint"], cause["part"]) == ("motor.viscous_friction", "arm", "motor")
    damping = cause["parameters"]["damping"]
    assert damping["unit"] == "N*m*s/rad"
    assert abs(damping["value"] - WRONG.damping) < 4 * damping["std"] < 0.01
    assert cause["confidence"] > 0.9
    assert cause["error_removed"] > 0.95
    assert cause["how_to_confirm"] == catalogue()[cause["cause"]].confirm
    assert cause["reference"]
    assert len(document["sentences"]) == 2
    assert document["unexplained"]["fraction"] < 0.05


def test_the_gain_is_measured_on_the_other_log_and_reaches_the_noise(document):
    gain = document["gain"]
    assert gain["holdout"] is True
    assert document["holdout"] == "exp2.csv"
    simulated = [g for g in gain["signals"] if "stiffness" not in g["signal"]]
    assert {g["signal"] for g in simulated} == {"motor_position", "link_position", "torque_sensor"}
    for signal in simulated:
        assert signal["rmse_after"] < 1.2 * signal["noise_floor"], signal
        low, high = signal["ci95"]
        assert low <= signal["reduction"] <= high
        assert signal["reduction"] == pytest.approx(1 - signal["rmse_after"] / signal["rmse_before"])
    motor = next(g for g in simulated if g["signal"] == "motor_position")
    assert motor["reduction"] > 0.8


def test_errors_stand_next_to_their_noise(document):
    equations = {e["equation"]: e for e in document["equations"]}
    assert set(equations) == {"motor", "transmission", "link"}
    assert equations["motor"]["rms_before"] > 3 * equations["motor"]["noise"]
    for equation in equations.values():
        assert equation["rms_after"] < 1.3 * equation["noise"]
    assert {e["signal"] for e in document["simulation_error"]} == {"motor_position", "link_position", "torque_sensor"}


def test_the_extended_rig_is_the_rig_with_the_cause_in_it_and_nothing_else(wrong, document):
    extended, plain = Rig.load(wrong / "out" / "extended.rig.toml"), Rig.load(wrong / "exp1.rig.toml")
    joint, before = extended.joints["arm"], plain.joints["arm"]
    assert joint.motor.damping == pytest.approx(document["causes"][0]["parameters"]["damping"]["value"])
    assert msgspec.structs.replace(joint, motor=before.motor) == before
    assert msgspec.structs.replace(joint.motor, damping=before.motor.damping) == before.motor


def test_with_the_extended_rig_nothing_is_wrong(wrong, call):
    """On the log it was learnt from, and on the other."""
    for name in ("exp1.csv", "exp2.csv"):
        code, out, err = call(name, "--rig", "out/extended.rig.toml", "-o", "again", "--force", "--json", cwd=wrong)
        assert code == 0, err
        found = json.loads(out)
        assert (found["verdict"], found["causes"]) == ("consistent", [])
        assert not (wrong / "again" / "extended.rig.toml").exists()


def test_the_extended_rig_simulates_and_estimates(wrong, run):
    rig = wrong / "out" / "extended.rig.toml"
    assert run("simulate", rig, "--duration", "1", "-o", "played.mcap", cwd=wrong).returncode == 0
    assert run("estimate", "exp2.csv", "--rig", rig, cwd=wrong).returncode == 0
    assert (wrong / "exp2.stiffness.parquet").exists()


def test_what_a_cause_does_to_the_estimated_stiffness_is_what_it_does_to_the_torque_that_is_read(tmp_path, call):
    """A sensor's stiffness grows by its gain, whatever else there is; the link is in no equation of either estimate."""
    truth = Truth(gain=0.9, link_damping=0.06)
    lay(tmp_path, truth)
    lay(tmp_path, truth, "exp2", seed=1)
    code, out, err = call("exp1.csv", "--holdout", "exp2.csv", "-o", "out", "--json", cwd=tmp_path)
    assert code == 0, err
    changes = {c["cause"]: c["stiffness_change"] for c in json.loads(out)["causes"]}
    assert changes == {
        "sensor.torque_gain": pytest.approx(1 - truth.gain, abs=0.005),
        "link.viscous_friction": pytest.approx(0, abs=1e-6),
    }


def test_the_page_opens_offline(wrong):
    page = (wrong / "out" / "diagnosis.html").read_text(encoding="utf-8")
    assert "motor.viscous_friction" in page
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=\"https?://", page)


def test_a_clean_log_is_consistent(tmp_path, call):
    lay(tmp_path)
    code, out, err = call("exp1.csv", "--fail-on-cause", cwd=tmp_path)
    assert code == 0, err
    assert "consistent" in out
    assert (tmp_path / "diagnosis.json").exists()
    assert not (tmp_path / "extended.rig.toml").exists()


def test_a_cause_can_fail_a_pipeline_and_json_is_one_document(wrong, call):
    """Exit code 3, with all files written; run again, the same comes out to the last digit."""
    printed = []
    for k in range(2):
        code, out, _ = call("exp1.csv", "--fail-on-cause", "--json", "-o", f"run{k}", cwd=wrong)
        assert code == 3
        printed.append(json.loads(out))
        assert sorted(p.name for p in (wrong / f"run{k}").iterdir()) == FILES
        assert printed[k] == json.loads((wrong / f"run{k}" / "diagnosis.json").read_text(encoding="utf-8"))
    assert printed[0] == printed[1]
    assert printed[0]["causes"][0]["cause"] == "motor.viscous_friction"
    assert (printed[0]["gain"]["holdout"], printed[0]["holdout"]) == (False, None)


def refusal(call, folder, *args):
    """What a refused run says; that it is one line, and that nothing is written."""
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*")}
    code, out, err = call(*args, cwd=folder)
    assert code == 2, (out, err)
    assert out == ""
    assert "Traceback" not in err
    assert {p: p.stat().st_mtime_ns for p in folder.rglob("*")} == before
    return err


def test_a_log_without_a_rig_is_refused(tmp_path, call):
    lay(tmp_path)
    (tmp_path / "exp1.rig.toml").unlink()
    assert "vsalog init" in refusal(call, tmp_path, "exp1.csv")


def test_a_log_whose_channels_the_rig_does_not_name_is_refused(tmp_path, call):
    lay(tmp_path, rig=re.sub(r'= "(motor|link|torque) ', r'= "other \1 ', ELASTIC))
    said = refusal(call, tmp_path, "exp1.csv")
    assert "exp1.csv" in said
    assert "vsalog inspect" in said or "other motor position" in said


def test_roles_that_allow_no_equation_are_refused(tmp_path, call):
    """Positions alone: no torque to compare them with."""
    lay(tmp_path, roles=("motor_position", "link_position"), rig=re.sub(r"\[joint\.arm\.link\][^[]*", "", ELASTIC))
    said = refusal(call, tmp_path, "exp1.csv")
    assert "arm" in said
    assert "torque" in said


def test_a_rigid_joint_without_a_torque_is_refused(tmp_path, call):
    lay(tmp_path, rig='[joint.arm]\nkind = "rigid"\n[joint.arm.signals]\nmotor_position = "motor position"\n')
    assert "a rigid one its position" in refusal(call, tmp_path, "exp1.csv")


def test_a_joint_that_the_rig_does_not_have_is_refused(tmp_path, call):
    lay(tmp_path)
    assert "wrist" in refusal(call, tmp_path, "exp1.csv", "--joint", "wrist")


def test_a_held_out_log_without_a_role_is_refused(tmp_path, call):
    lay(tmp_path)
    lay(tmp_path, name="exp2", seed=1, roles=[r for r in ROLES if r != "torque_sensor"])
    said = refusal(call, tmp_path, "exp1.csv", "--holdout", "exp2.csv")
    assert "exp2.csv" in said
    assert "torque_sensor" in said


def test_a_missing_log_is_refused(tmp_path, call):
    assert "nowhere.csv" in refusal(call, tmp_path, "nowhere.csv")


def test_an_output_folder_that_is_a_file_is_refused(tmp_path, call):
    lay(tmp_path)
    (tmp_path / "out").write_text("mine", encoding="utf-8")
    assert "out" in refusal(call, tmp_path, "exp1.csv", "-o", "out")
    assert (tmp_path / "out").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("name", FILES)
def test_an_input_is_never_written_over(tmp_path, call, name):
    """A rig that happens to be called as the output is: refused before anything is written."""
    lay(tmp_path)
    (tmp_path / "exp1.rig.toml").rename(tmp_path / name)
    said = refusal(call, tmp_path, "exp1.csv", "--rig", name)
    assert name in said


def test_the_rig_next_to_a_log_is_never_written_over(tmp_path, call):
    """A log called `extended` has its rig where the extended rig would go."""
    lay(tmp_path, WRONG, name="extended")
    assert "extended.rig.toml" in refusal(call, tmp_path, "extended.csv")
    assert (tmp_path / "extended.rig.toml").read_text(encoding="utf-8") == ELASTIC


@pytest.mark.parametrize("held", [False, True])
def test_a_log_is_never_written_over(tmp_path, call, held):
    lay(tmp_path)
    (tmp_path / "diagnosis.json").write_bytes((tmp_path / "exp1.csv").read_bytes())
    args = ("exp1.csv", "--holdout", "diagnosis.json") if held else ("diagnosis.json", "--rig", "exp1.rig.toml")
    assert "diagnosis.json" in refusal(call, tmp_path, *args)


HOSTILE = "</script><script>alert(1)</script>[bold]../../etc"


def test_a_hostile_name_stays_a_name(tmp_path, call):
    """It is in the page and on the terminal as text only, and no file is called by it."""
    quoted = json.dumps(HOSTILE)
    lay(tmp_path, WRONG, rig=ELASTIC.replace("joint.arm", f"joint.{quoted}"))
    before = set(tmp_path.rglob("*"))
    code, _, err = call("exp1.csv", "--fail-on-cause", cwd=tmp_path)
    assert code == 3, err
    assert sorted(p.name for p in set(tmp_path.rglob("*")) - before) == FILES
    page = (tmp_path / "diagnosis.html").read_text(encoding="utf-8")
    assert "<script>alert(1)" not in page
    document = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert document["causes"][0]["joint"] == HOSTILE
    assert HOSTILE in Rig.load(tmp_path / "extended.rig.toml").joints


def test_a_log_without_a_torque_sensor_and_one_without_a_link_encoder(tmp_path, call):
    """The cause is first, or among those that this log cannot tell it from."""
    for missing in ("torque_sensor", "link_position"):
        folder = tmp_path / missing
        lay(folder, Truth(damping=0.1), roles=[r for r in ROLES if r != missing], seed=3)
        code, out, err = call("exp1.csv", "--json", cwd=folder)
        assert code == 0, err
        first = json.loads(out)["causes"][0]
        assert "motor.viscous_friction" in [first["cause"], *first["indistinguishable_from"]]


def test_a_torque_that_was_computed_is_reported(tmp_path, call):
    """A "sensor" that is a multiple of the motor's torque measures nothing; the rest is diagnosed without it."""
    folder = tmp_path / "computed"
    folder.mkdir()
    time, said = log(duration=6.0)
    said["torque_sensor"] = 1.7 * said["motor_torque"]
    write_csv(folder / "exp1.csv", time, said)
    (folder / "exp1.rig.toml").write_text(ELASTIC, encoding="utf-8")
    code, out, err = call("exp1.csv", "--json", cwd=folder)
    assert code == 0, err
    document = json.loads(out)
    assert document["causes"][0]["cause"] == "sensor.torque_not_independent"
    assert document["causes"][0]["part"] == "torque_sensor"
    assert "transmission" not in {e["equation"] for e in document["equations"]}


def test_a_bench_whose_only_torque_was_computed_is_not_explained(tmp_path, call):
    """Nothing can be checked: nothing is called right, and nothing explained."""
    time, said = log(duration=6.0)
    deflection = said["link_position"] - said["motor_position"]
    table = np.stack([time, deflection, 12.0 * deflection], axis=-1)
    header = "time [s],deflection [rad],torque sensor [N*m]"
    np.savetxt(tmp_path / "exp1.csv", table, fmt="%.17g", delimiter=",", header=header, comments="")
    bench = (
        "[joint.arm]\nkind = 'elastic'\n[joint.arm.transmission]\ntype = 'linear'\nstiffness = 12.0\n"
        "[joint.arm.signals]\ndeflection = 'deflection'\ntorque_sensor = 'torque sensor'\n"
    )
    (tmp_path / "exp1.rig.toml").write_text(bench, encoding="utf-8")
    code, out, err = call("exp1.csv", "--json", cwd=tmp_path)
    assert code == 0, err
    document = json.loads(out)
    assert document["verdict"] == "consistent as far as checked"
    assert [c["cause"] for c in document["causes"]] == ["sensor.torque_not_independent"]
    assert document["gain"]["signals"] == []


def test_a_held_out_log_that_is_too_short_is_named(tmp_path, call):
    lay(tmp_path, WRONG)
    lay(tmp_path, WRONG, "exp2", seed=1, duration=0.5)
    code, out, err = call("exp1.csv", "--holdout", "exp2.csv", "--json", cwd=tmp_path)
    assert code == 0, err
    document = json.loads(out)
    (why,) = (f for f in document["findings"] if f["code"] == "diagnosis.not_simulated")
    assert HELD_OUT in why["evidence"]["reason"]
    assert document["gain"]["signals"] == []


def test_what_is_outside_the_catalogue_is_reported_to_be_unexplained(tmp_path, call):
    """A magnetic detent of the motor at one angle."""
    detent = Truth(extra=lambda t, a, phi: 0.3 * np.exp(-(((a - 0.3) / 0.3) ** 2)))
    lay(tmp_path, detent, seed=6)
    code, out, err = call("exp1.csv", "--json", cwd=tmp_path)
    assert code == 0, err
    document = json.loads(out)
    assert document["verdict"] in ("unexplained", "partly explained")
    assert document["unexplained"]["fraction"] > 0.2
    assert "motor_position" in document["unexplained"]["depends_on"]
    assert document["unexplained"]["curve"]
    assert all(c["confidence"] < 0.9 for c in document["causes"])


def test_the_prosthetic_foot_has_a_loop(tmp_path, call, samples):
    """Recorded: nine settings of a slider, each loaded and unloaded once; its authors: the loop is that of two cams, intended."""
    code, out, err = call(samples / "desr_foot" / "desr_foot.mat", "-o", tmp_path / "foot", "--json", cwd=tmp_path)
    assert code == 0, err
    document = json.loads(out)
    left = document["unexplained"]
    assert document["verdict"] == "unexplained"
    assert left["where"] == "transmission"
    assert left["depends_on"][:2] == ["deflection", "deflection_rate"]
    up, back = ([np.mean([b["mean"] for b in left[key]])] for key in ("curve", "curve_back"))
    assert np.abs(np.subtract(up, back)) > 0.2
    assert "diagnosis.not_simulated" not in [finding["code"] for finding in document["findings"]]
    assert "deflection falling" in (tmp_path / "foot" / "diagnosis.html").read_text(encoding="utf-8")
