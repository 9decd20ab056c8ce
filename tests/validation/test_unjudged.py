"""What a log cannot tell is reported as it is, and never called good."""

import csv
import json
import shutil
import sys
import tomllib

import pytest
import tomli_w

from tests.validation.conftest import SAMPLES, call


def joint_of(model, log, folder, *options):
    result = call("validate", model, log, "-o", folder, "--no-modalities", "--json", *options)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)["logs"][0]["joints"][0]


def table(folder, change, rows=2000):
    with (SAMPLES / "sea_exp1.csv").open(encoding="utf-8") as file:
        heading, *lines = list(csv.reader(line for line in file if not line.startswith("#")))
    sensor = next(i for i, name in enumerate(heading) if "sensor" in name)
    log = folder / "cut.csv"
    with log.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([heading, *(change(i, line, sensor) for i, line in enumerate(lines[:rows]))])
    shutil.copy(SAMPLES / "sea_exp1.rig.toml", folder / "cut.rig.toml")
    return log


def stuck(_, line, sensor):
    return [*line[:sensor], "0.0", *line[sensor + 1 :]]


def holes(i, line, _):
    return [line[0], *("" for _ in line[1:])] if i % 30 < 24 else line


@pytest.mark.parametrize(
    ("change", "rows", "code", "samples"),
    [
        (stuck, 2000, "validation.reference_constant", None),
        (lambda _i, line, _s: line, 60, "validation.too_few_samples", 10),
        (lambda _i, line, _s: line, 130, "validation.too_few_samples", 80),
        (holes, 2000, "validation.nothing_filtered", None),
    ],
)
def test_why_nothing_is_judged(change, rows, code, samples, models, tmp_path):
    joint = joint_of(models["sea"], table(tmp_path, change, rows), tmp_path)
    assert joint["verdict"] == "cannot be judged"
    (reason,) = joint["reasons"]
    assert (reason["code"], reason["severity"], reason["value"]) == (code, "invalidates", samples)


def test_a_sensor_that_is_stuck_for_a_while_is_found(models, tmp_path):
    """What it says before is the model's; the whole error is of the stretch in which it says one and the same."""

    def half(i, line, sensor):
        return [*line[:sensor], "0.5", *line[sensor + 1 :]] if i >= 2500 else line

    joint = joint_of(models["sea"], table(tmp_path, half, 5000), tmp_path)
    first = joint["transmissions"][0]["dependence"][0]
    assert first["on"] == "stuck"
    assert first["share"] > 0.99
    assert first["evidence"]["first"] == pytest.approx(5.0)
    assert joint["reasons"][2]["code"] == "error.sensor_stuck"


def test_a_log_that_is_too_short_is_refused_without_advice_that_leads_nowhere(models, tmp_path):
    for rows, words in ((29, "29 samples, but validating filters over 51"), (1, "has one sample;")):
        log = table(tmp_path, lambda _i, line, _s: line, rows)
        result = call("validate", models["sea"], log, "-o", tmp_path / "out")
        assert result.exit_code == 2
        assert words in result.stderr
        assert "--tune" not in result.stderr


@pytest.mark.parametrize("limit", ["nan", "inf", "-1"])
@pytest.mark.parametrize("option", ["--max-nrmse", "--max-msrep"])
def test_a_threshold_is_a_finite_number(option, limit, models, tmp_path):
    result = call("validate", models["sea"], SAMPLES / "sea_exp2.bag", "-o", tmp_path / "out", option, limit)
    assert result.exit_code == 2
    assert not (tmp_path / "out").exists()


def test_figures_without_matplotlib_are_refused_before_anything_is_done(models, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    out = tmp_path / "out"
    for arguments in (("validate", models["sea"], SAMPLES / "sea_exp2.bag"), ("estimate", SAMPLES / "sea_exp1.csv")):
        result = call(*arguments, "-o", out, "--figures", out / "figures")
        assert result.exit_code == 2
        assert "pip install matplotlib" in result.stderr
        assert not out.exists()


def test_a_joint_does_not_hold_by_one_of_its_two_transmissions(models, tmp_path):
    model = tomllib.loads(models["vsa2"].read_text())
    model["joint"]["vsa2"]["transmission"][0]["region"] = [[10.0], [11.0]]
    path = tmp_path / "far.model.toml"
    path.write_text(tomli_w.dumps(model))
    joint = joint_of(path, SAMPLES / "vsa2_exp2.mcap", tmp_path)
    assert joint["verdict"] == "cannot be judged"
    (reason,) = joint["reasons"]
    assert (reason["code"], reason["part"]) == ("validation.part_unjudged", "1")


def test_nothing_that_is_read_is_written_over(models, tmp_path):
    log = tmp_path / "report.html"
    log.write_bytes((SAMPLES / "vsa2_exp2.mcap").read_bytes())
    before = log.read_bytes()
    for arguments in (("compare", log, "--report", log), ("validate", models["vsa2"], log, "-o", tmp_path)):
        result = call(*arguments)
        assert result.exit_code == 2
        assert "is an input" in result.stderr
        assert log.read_bytes() == before


def test_a_report_is_not_written_by_half(models, tmp_path):
    (tmp_path / "file").write_text("")
    out = tmp_path / "out"
    result = call(
        "validate",
        models["sea"],
        SAMPLES / "sea_exp2.bag",
        "-o",
        out,
        "--no-modalities",
        "--figures",
        tmp_path / "file",
    )
    assert result.exit_code == 2
    assert not list(out.glob("*"))


def test_what_is_implausible_of_the_signals_is_reported_here_too(models, tmp_path):
    """The torque sensor ends at 0.2 N·m, as one does that is saturated."""

    def saturated(_i, line, sensor):
        return [*line[:sensor], str(min(float(line[sensor]), 200.0)), *line[sensor + 1 :]]

    joint = joint_of(models["sea"], table(tmp_path, saturated, 4000), tmp_path)
    assert "sensor.saturated" in [finding["code"] for finding in joint["findings"]]
