"""What a log cannot tell is said as it is, and never called good."""

import csv
import json
import shutil
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
    return [line[0], *("" for _ in line[1:])] if i % 60 < 10 else line


@pytest.mark.parametrize(
    ("change", "rows", "words"),
    [
        (stuck, 2000, "the torque sensor never changes"),
        (lambda _i, line, _s: line, 60, "fewer than 20 samples"),
        (holes, 2000, "51 samples in a row"),
    ],
)
def test_why_nothing_is_judged(change, rows, words, models, tmp_path):
    joint = joint_of(models["sea"], table(tmp_path, change, rows), tmp_path)
    assert joint["verdict"] == "cannot be judged"
    assert words in " ".join(joint["sentences"])


def test_a_joint_does_not_hold_by_one_of_its_two_transmissions(models, tmp_path):
    model = tomllib.loads(models["vsa2"].read_text())
    model["joint"]["vsa2"]["transmission"][0]["region"] = [[10.0], [11.0]]
    path = tmp_path / "far.model.toml"
    path.write_text(tomli_w.dumps(model))
    joint = joint_of(path, SAMPLES / "vsa2_exp2.mcap", tmp_path)
    assert joint["verdict"] == "cannot be judged"
    assert "of transmission 1 no sample" in joint["sentences"][0]


def test_nothing_that_is_read_is_written_over(models, tmp_path):
    log = tmp_path / "report.html"
    log.write_bytes((SAMPLES / "vsa2_exp2.mcap").read_bytes())
    before = log.read_bytes()
    for arguments in (("compare", log, "--report", log), ("validate", models["vsa2"], log, "-o", tmp_path)):
        result = call(*arguments)
        assert result.exit_code == 2
        assert "is what is read" in result.stderr
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
