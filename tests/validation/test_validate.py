"""`vsalog validate` as a user runs it: on the samples, on hidden effects, on what cannot be judged."""

import json
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import tomli_w

from tests.validation.conftest import SAMPLES, call
from vsalog.core.dependence import INTERVALS
from vsalog.core.document_schema import document_schema, schema_text
from vsalog.rig.load import preset_text
from vsalog.validation import document

pytestmark = pytest.mark.share(5)

DOCS = Path(__file__).parents[2] / "docs"
SEA2 = SAMPLES / "sea_exp2.bag"


def judged(model, *logs, options=(), folder):
    result = call("validate", model, *logs, "-o", folder, "--no-modalities", "--force", *options, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def joint_of(report, log=0):
    return report["logs"][log]["joints"][0]


def main_score(joint):
    part = joint["transmissions"][-1]
    return part["comparisons"][0]


def simulated(folder, name, *options):
    log = folder / f"{name}.mcap"
    result = call("simulate", "sea", "--scenario", "sea-exp2", "--seed", "5", "--truth", *options, "-o", log)
    assert result.exit_code == 0, result.output
    return log


def test_the_awas_model_holds_in_the_second_experiment(models, tmp_path):
    report = judged(models["awas"], SAMPLES / "awas_exp2.mcap", folder=tmp_path)
    joint = joint_of(report)
    assert joint["verdict"] == "holds"
    score = main_score(joint)
    assert score["reference"] == "sensor"
    assert score["inside"]["nrmse"]["value"] <= 2.0
    # Deflections twice as large: some of them lie outside the region, and are judged apart.
    assert score["outside"]["samples"] > 500
    assert score["inside"]["samples"] + score["outside"]["samples"] < 10_001
    assert report["model_logs"].keys() == {"awas_exp1.mcap"}
    (part,) = joint_of(report)["transmissions"]
    assert [over["on"] for over in part["errors"]] == ["deflection", "speed", "setpoint"]
    for over in part["errors"]:
        assert len(over["bins"]) == INTERVALS
        assert all(
            b[name]["low"] <= b[name]["value"] <= b[name]["high"] for b in over["bins"] for name in ("rmse", "bias")
        )
    jsonschema.Draft202012Validator(document_schema(document)).validate(report)
    assert json.loads((tmp_path / "report.json").read_text()) == report
    assert (tmp_path / "report.html").stat().st_size > 10_000


def test_all_three_devices_and_their_modalities(models, tmp_path):
    result = call("validate", models["vsa2"], SAMPLES / "vsa2_exp2.mcap", "-o", tmp_path, "--json")
    joint = joint_of(json.loads(result.stdout))
    assert joint["verdict"] == "holds"
    assert [t["transmission"] for t in joint["transmissions"]] == ["1", "2", "total"]
    for part in joint["transmissions"]:
        assert [m["modality"] for m in part["modalities"]] == ["MODEL", "SENSOR", "RESIDUAL"]


def test_the_true_stiffness_of_a_simulation_is_judged_too(models, tmp_path):
    report = judged(models["sea"], simulated(tmp_path, "truth"), folder=tmp_path)
    truth = next(c for c in joint_of(report)["transmissions"][0]["comparisons"] if c["reference"] == "truth")
    assert truth["quantity"] == "stiffness"
    assert truth["inside"]["nrmse"]["value"] < 3.0
    stiffness = joint_of(report)["stiffness"]
    assert (stiffness["verdict"], stiffness["reference"]) == ("holds", "truth")
    assert stiffness["reason"]["value"] == pytest.approx(np.sqrt(100.0 * truth["inside"]["msrep"]["value"]))


def test_a_stiffness_that_is_not_the_true_one_fails_where_a_nominal_one_leaves_it_open(models, tmp_path):
    softer = ("--actual", "joint.sea.transmission.stiffness=200")
    joint = joint_of(judged(models["sea"], simulated(tmp_path, "softer", *softer), folder=tmp_path))
    assert (joint["verdict"], joint["stiffness"]["verdict"]) == ("fails", "fails")
    other = ("--set", "joint.sea.transmission.stiffness=200")
    joint = joint_of(judged(models["sea"], SEA2, options=other, folder=tmp_path))
    assert (joint["verdict"], joint["stiffness"]["verdict"]) == ("holds", "undecided")
    out = call("validate", models["sea"], SEA2, "-o", tmp_path, "--no-modalities", "--force", *other).stdout
    assert "torque holds" in out
    assert "stiffness undecided" in out


def test_a_model_and_a_log_that_were_exchanged_are_taken_for_what_they_are(models, tmp_path):
    report = judged(models["sea"], SEA2, folder=tmp_path)
    assert judged(SEA2, models["sea"], folder=tmp_path) == report
    several = judged(SAMPLES / "sea_exp1.csv", SEA2, models["sea"], folder=tmp_path)
    assert [log["log"] for log in several["logs"]] == ["sea_exp1.csv", "sea_exp2.bag"]
    # A rig is no model.
    assert call("validate", SEA2, SAMPLES / "sea_exp1.rig.toml", "-o", tmp_path, "--force").exit_code == 2


def codes(findings):
    return [finding["code"] for finding in findings]


# Hidden effect → setting, what the error depends on, and the code of that.
SENSORS, SPRING = "joint.sea.signals.", "joint.sea.transmission."
TOLD = {
    "torque sensor drifts": (SENSORS + "torque_sensor.drift=0.03", "time", "error.drift_of_torque"),
    "link encoder drifts": (SENSORS + "link_position.drift=0.001", "zero over time", "error.drift_of_encoder"),
    "motor encoder drifts": (SENSORS + "motor_position.drift=-0.001", "zero over time", "error.drift_of_encoder"),
    "encoder offset": (SENSORS + "link_position.offset=0.005", "zero", "error.deflection_zero"),
    "eccentric encoder": (SENSORS + "link_position.eccentricity={amplitude=0.003}", "position", "error.position"),
    "encoder scale": (SENSORS + "link_position.gain=1.02", "position", "error.position"),
    "late encoder": (SENSORS + "link_position.delay=0.005", "late", "error.late_encoder"),
    "coarse torque sensor": (SENSORS + "torque_sensor.resolution=2", "resolution", "error.resolution"),
    "backlash": (SPRING + "backlash=0.01", "gap", "error.backlash"),
    "wide backlash": (SPRING + "backlash=0.03", "gap", "error.backlash"),
    "softening": (SPRING + "drift=-0.02", "gain over time", "error.drift_of_gain"),
    "stiffening": (SPRING + "drift=0.02", "gain over time", "error.drift_of_gain"),
    "asymmetry": (SPRING + "asymmetry=0.1", "side", "error.asymmetry"),
    "another asymmetry": (SPRING + "asymmetry=-0.1", "side", "error.asymmetry"),
    "cubic": (SPRING + "added_cubic=500", "deflection", "error.spring_shape"),
    "slipping springs": (SPRING + "slip=[{stiffness=20,limit=0.3}]", "direction", "error.friction"),
}


@pytest.mark.every(3)
@pytest.mark.parametrize("name", TOLD)
def test_the_leading_finding_is_the_hidden_effect(name, models, tmp_path):
    setting, on, code = TOLD[name]
    joint = joint_of(judged(models["sea"], simulated(tmp_path, "log", "--actual", setting), folder=tmp_path))
    first = joint["transmissions"][0]["dependence"][0]
    assert (first["on"], first["code"]) == (on, code)
    assert first["share"] > 0.9
    reason = next(r for r in joint["reasons"] if r["code"].startswith("error."))
    assert (reason["code"], reason["value"]) == (code, first["share"])
    assert first["words"] in " ".join(joint["sentences"])


def test_noise_is_no_cause(models, tmp_path):
    log = simulated(tmp_path, "noisy", "--actual", SENSORS + "torque_sensor.noise=1.5")
    joint = joint_of(judged(models["sea"], log, folder=tmp_path))
    assert joint["transmissions"][0]["dependence"] == []
    assert main_score(joint)["inside"]["nrmse"]["low"] > 5.0
    assert joint["verdict"] == "undecided"  # the noise hides whether the model holds
    assert codes(joint["reasons"])[2] == "error.noise"
    log = simulated(tmp_path, "coarse", "--actual", SENSORS + "torque_sensor.resolution=2")
    assert joint_of(judged(models["sea"], log, folder=tmp_path))["verdict"] == "undecided"


def test_one_sensor_for_both_transmissions_judges_their_sum(models, tmp_path):
    rig = tmp_path / "sum.rig.toml"
    text = preset_text("vsa2").split("torque_sensor_1 = ")[0]
    rig.write_text(text + 'torque_sensor = { channel = "/joint_torque.effort[both]", noise = "1 N*mm" }\n')
    log = tmp_path / "sum.mcap"
    assert call("simulate", rig, "--scenario", "vsa2-exp2", "--seed", "3", "-o", log).exit_code == 0
    joint = joint_of(judged(models["vsa2"], log, folder=tmp_path))
    assert joint["verdict"] == "holds"
    assert joint["reasons"][0]["part"] == "total"
    assert (joint["findings"][0]["code"], joint["findings"][0]["part"]) == ("validation.sum_only", "1 and 2")
    actual = ("--actual", "joint.vsa2.transmission_1.stiffness=0.6")
    assert call("simulate", rig, "--scenario", "vsa2-exp2", *actual, "-o", log, "--force").exit_code == 0
    assert joint_of(judged(models["vsa2"], log, folder=tmp_path))["verdict"] == "fails"


def test_an_error_of_many_spans_is_not_printed_in_digits(models, tmp_path):
    """A model beyond its region: powers of the deflection grow without end."""
    model = tomllib.loads(models["sea"].read_text())
    model["joint"]["sea"]["transmission"][0]["coefficients"] = [0.0, 0.0, 0.0, 1e4]
    model["joint"]["sea"]["transmission"][0]["region"] = [[-0.02], [0.02]]
    path = tmp_path / "steep.model.toml"
    path.write_text(tomli_w.dumps(model))
    result = call("validate", path, SEA2, "-o", tmp_path, "--no-modalities")
    reasons = joint_of(json.loads((tmp_path / "report.json").read_text()))["reasons"]
    (outside,) = (r for r in reasons if r["code"] == "validation.outside_region")
    assert outside["evidence"]["nrmse"] > 1000.0
    assert "e+0" not in result.stdout.split("transmission")[0]
    (line,) = [line for line in result.stdout.splitlines() if "outside" in line and "sensor" in line]
    assert "> 1000" in line
    page = (tmp_path / "report.html").read_text()
    assert "&gt; 1000</td>" in page


HIDDEN = {
    "gain": (["--actual", "joint.sea.signals.torque_sensor.gain=1.3"], "torque", "error.gain"),
    "offset": (["--actual", "joint.sea.signals.torque_sensor.offset=0.5"], "offset", "error.offset"),
    "sign": (["--actual", "joint.sea.signals.torque_sensor.sign=-1"], "torque", "error.sign"),
    "spring": (
        ["--actual", "joint.sea.transmission.stiffness=5", "--actual", "joint.sea.transmission.cubic=4500"],
        "deflection",
        "error.spring_shape",
    ),
    "hysteresis": (["--actual", "joint.sea.transmission.bouc_wen={torque=0.6, width=0.004}"], "direction", "error.friction"),
    "damping": (["--actual", "joint.sea.transmission.damping=2.5"], "velocity", "error.velocity"),
}  # fmt: skip


@pytest.mark.every(2)
@pytest.mark.parametrize("name", HIDDEN)
def test_a_hidden_effect_fails_and_is_named(name, models, tmp_path):
    options, on, code = HIDDEN[name]
    joint = joint_of(judged(models["sea"], simulated(tmp_path, name, *options), folder=tmp_path))
    assert joint["verdict"] == "fails"
    told = joint["transmissions"][0]["dependence"]
    assert on in [d["on"] for d in told[:2]]
    assert code in codes(told[:2])
    assert code in codes(joint["reasons"]) or on == "deflection"


def test_another_device_is_refused_or_fails(models, tmp_path):
    result = call("validate", models["awas"], SEA2, "-o", tmp_path)
    assert result.exit_code == 2
    assert "no joint 'awas'" in result.stderr
    other = tmp_path / "two.rig.toml"
    other.write_text('preset = "vsa2"\n[joint.sea]\nkind = "antagonistic"\n')
    result = call("validate", models["sea"], SAMPLES / "vsa2_exp2.mcap", "--rig", other, "-o", tmp_path)
    assert result.exit_code == 2
    assert "2 transmissions" in result.stderr
    assert not (tmp_path / "report.json").exists()


def test_a_wrong_gear_ratio_fails(models, tmp_path):
    rig = tmp_path / "gear.rig.toml"
    rig.write_text(
        'preset = "sea"\n[joint.sea.motor]\ngear_ratio = 50\n[joint.sea.signals]\n'
        'motor_position = { channel = "/joint_states.position[motor]", side = "rotor" }\n'
    )
    log = tmp_path / "gear.mcap"
    assert call("simulate", rig, "--scenario", "sea-exp2", "-o", log).exit_code == 0
    assert joint_of(judged(models["sea"], log, folder=tmp_path))["verdict"] == "holds"
    wrong = judged(models["sea"], log, options=("--set", "joint.sea.motor.gear_ratio=46"), folder=tmp_path)
    assert joint_of(wrong)["verdict"] == "fails"
    assert "gear ratio" in " ".join(joint_of(wrong)["sentences"])


def test_without_a_torque_sensor_the_residual_judges_and_that_is_reported(models, tmp_path):
    rig = tmp_path / "blind.rig.toml"
    rig.write_text(
        '[joint.sea]\nkind = "elastic"\n[joint.sea.motor]\ninertia = 0.08\ndamping = 0.4\n[joint.sea.signals]\n'
        'motor_position = "/joint_states.position[motor]"\nlink_position = "/joint_states.position[link]"\n'
        'motor_torque = "/joint_states.effort[motor]"\n'
    )
    joint = joint_of(judged(models["sea"], SEA2, options=("--rig", rig), folder=tmp_path))
    assert joint["verdict"] == "holds"
    assert joint["transmissions"][0]["judged_on"] == "residual"
    assert joint["findings"][0]["code"] == "validation.judged_by_residual"
    assert joint["reasons"][0]["evidence"]["reference"] == "residual"


def test_a_computed_torque_validates_nothing(tmp_path):
    t = np.arange(4000) * 2e-3
    q = 0.3 * np.sin(2 * t)
    phi = 0.02 * np.sin(5 * t)
    log = tmp_path / "computed.csv"
    rows = np.column_stack((t, q, q - phi, -40.0 * phi))
    np.savetxt(
        log, rows, delimiter=",", header="time [s],q [rad],theta [rad],effort [N·m]", comments="", encoding="utf-8"
    )
    (tmp_path / "computed.rig.toml").write_text(
        '[joint.j]\nkind = "elastic"\n[joint.j.signals]\n'
        'link_position = "q"\nmotor_position = "theta"\ntorque_sensor = "effort"\n'
    )
    assert call("estimate", log, "-o", tmp_path).exit_code == 0
    joint = joint_of(judged(tmp_path / "computed.model.toml", log, folder=tmp_path))
    assert joint["verdict"] == "cannot be judged"
    assert "-40" in joint["not_independent"]
    assert codes(joint["reasons"]) == ["torque.computed"]
    result = call(
        "validate", tmp_path / "computed.model.toml", log, "-o", tmp_path, "--max-nrmse", "50", "--no-modalities"
    )
    assert result.exit_code == 3


def test_the_log_the_model_was_learnt_from_is_no_second_experiment(models, tmp_path):
    joint = joint_of(judged(models["sea"], SAMPLES / "sea_exp1.csv", folder=tmp_path))
    assert joint["verdict"] == "cannot be judged"
    assert codes(joint["reasons"]) == ["validation.own_log"]


def test_a_log_that_is_given_twice_is_reported_to_be(models, tmp_path):
    log = simulated(tmp_path, "again")
    (tmp_path / "copy.mcap").write_bytes(log.read_bytes())
    report = judged(models["sea"], log, tmp_path / "copy.mcap", folder=tmp_path)
    assert "validation.same_log" not in codes(joint_of(report, 0)["findings"])
    first = joint_of(report, 1)["findings"][0]
    assert first["code"] == "validation.same_log"
    assert first["evidence"] == {"log": "copy.mcap", "same_as": "again.mcap"}


def test_thresholds_set_the_exit_code(models, tmp_path):
    arguments = ("validate", models["sea"], SEA2, "-o", tmp_path, "--no-modalities")
    assert call(*arguments, "--max-nrmse", "5", "--max-msrep", "5").exit_code == 0
    missed = call(*arguments, "--max-nrmse", "0.01")
    assert missed.exit_code == 3
    assert "missed" in missed.stdout


def test_several_logs_make_one_report(models, tmp_path):
    report = judged(models["sea"], SEA2, simulated(tmp_path, "again"), folder=tmp_path)
    assert [log["log"] for log in report["logs"]] == ["sea_exp2.bag", "again.mcap"]
    assert all(joint_of(report, i)["verdict"] == "holds" for i in (0, 1))


def test_the_foot_fitted_at_four_settings_holds_at_five_others(tmp_path):
    """desr_foot: the dynamometer's compliance and the torque's offset come from the rig; the loop is reported."""
    source = SAMPLES / "desr_foot"
    head, *runs = (source / "desr_foot.rig.toml").read_text().split("[[joint.ankle.run]]")
    for name, kept in (("fit", ("x00", "x20", "x30", "x40")), ("val", ("x10", "x25", "x33", "x35", "x45"))):
        chosen = "".join(f"[[joint.ankle.run]]{r}" for r in runs if any(f'"{k}"' in r for k in kept))
        (tmp_path / f"{name}.rig.toml").write_text(head + chosen)
    log = source / "desr_foot.mat"
    assert call("estimate", log, "--rig", tmp_path / "fit.rig.toml", "-o", tmp_path).exit_code == 0
    options = ("--rig", tmp_path / "val.rig.toml")
    joint = joint_of(judged(tmp_path / "desr_foot.model.toml", log, options=options, folder=tmp_path))
    score = main_score(joint)
    assert score["inside"]["nrmse"]["value"] < 5.0
    assert score["outside"]["samples"] > 1000  # 45 mm
    assert "validation.whole_cycles_only" in codes(joint["findings"])
    assert "validation.own_log" not in codes(joint["reasons"])


def test_a_stiffness_that_is_not_judged_is_said_to_be(models, tmp_path):
    done = call("validate", models["sea"], simulated(tmp_path, "again"), "--rig", "sea", "-o", tmp_path / "known")
    assert "stiffness not judged" not in done.stdout
    unknown = "joint.sea.transmission={type='unknown'}"
    words = ("validate", models["sea"], SEA2, "--rig", "sea", "--set", unknown, "-o", tmp_path / "unknown")
    done = call(*words)
    assert done.exit_code == 0, done.stderr
    assert "stiffness not judged" in done.stdout
    (log,) = json.loads((tmp_path / "unknown" / "report.json").read_text())["logs"]
    assert log["joints"][0]["stiffness"] is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nothing.model.toml", SEA2), "cannot be read"),
        ((SEA2, SEA2), "is a log, no model"),
        (("MODEL", "nothing.mcap"), "there is no such file"),
        (("MODEL", SEA2, "--joint", "elbow"), "the model has no joint 'elbow'"),
        (("MODEL", SAMPLES / "vsa2_exp2.mcap", "--rig", "sea"), "there is no channel"),
    ],
)
def test_refusals(arguments, words, models, tmp_path):
    given = [models["sea"] if a == "MODEL" else a for a in arguments]
    result = call("validate", *given, "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert words in result.stderr
    assert not list((tmp_path / "out").glob("*"))


def test_the_schema_file_is_up_to_date():
    assert (DOCS / "report.schema.json").read_text(encoding="utf-8") == schema_text(document), (
        "run: python -m docs.make_schemas"
    )


def test_a_small_error_with_a_wrong_gain_does_not_hold(models, tmp_path):
    """15 % too much torque is less than 5 % of its span, and another spring all the same."""
    log = simulated(tmp_path, "louder", "--actual", "joint.sea.signals.torque_sensor.gain=1.15")
    joint = joint_of(judged(models["sea"], log, folder=tmp_path))
    assert main_score(joint)["inside"]["nrmse"]["value"] < 5.0
    assert joint["verdict"] == "fails"
    (off,) = (r["value"] for r in joint["reasons"] if r["code"] == "validation.gain_off")
    assert off == pytest.approx(1.15, abs=1e-3)
    assert joint["transmissions"][0]["gain"] == pytest.approx(1.15, abs=1e-3)
