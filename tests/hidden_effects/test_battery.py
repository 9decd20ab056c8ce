"""The battery as it is run, on a few cases: made, diagnosed, scored; and how it deals with what cannot be diagnosed."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.hidden_effects.battery import SHARES, diagnose, judge, lay_out
from tests.hidden_effects.cases import Plan, make_case, write_case
from tests.hidden_effects.devices import DEVICES
from tests.hidden_effects.generate import KINDS

ROOT = Path(__file__).parents[2]
OPTIONS = [
    "--seed",
    "2",
    "--cases",
    "1",
    "--kind",
    "single",
    "--kind",
    "clean",
    "--device",
    "elastic",
    "--workers",
    "1",
    "--quick",
]


def battery(out, *more):
    command = [sys.executable, "-m", "tests.hidden_effects.battery", "--out", str(out), *OPTIONS, *more]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=500)


def test_a_battery_lays_out_all_kinds_and_devices():
    found = lay_out(500, 1, tuple(DEVICES), KINDS)
    assert 480 <= len(found) <= 520
    kinds = {p.name.split("-")[0] for p in found}
    assert kinds == set(KINDS) == set(SHARES)
    assert sum(SHARES.values()) == pytest.approx(1.0)


def test_what_is_hidden_is_found(tmp_path):
    done = battery(tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "battery.json").read_text())
    numbers = {n["what"]: n["value"] for n in found["numbers"]}
    assert numbers["command failed"] == 0.0
    assert numbers["clean log: anything named"] == 0.0
    assert sorted(c["case"] for c in found["cases"]) == ["clean-0000", "single-0000"]
    for case in found["cases"]:
        assert case["seconds"] > 0.0
        assert case["first"] or not case["hidden"] or min(case["sizes"]) < 5.0, case
    assert (tmp_path / "battery.md").read_text() in done.stdout
    again = battery(tmp_path, "--score")
    assert again.returncode == 0, again.stderr
    assert json.loads((tmp_path / "battery.json").read_text()) == found


def test_a_case_that_cannot_be_diagnosed_is_counted_not_hidden(tmp_path):
    folder = write_case(make_case(Plan("single-0000", "elastic", 3, ("motor.inertia",))), tmp_path)
    (folder / "rig.toml").write_text("name = 3\n")
    took, problem = diagnose(folder)
    assert took > 0.0
    assert problem.startswith("failed")
    (folder / "diagnosis" / "run.json").write_text(json.dumps({"seconds": took, "problem": problem}))
    (outcome,) = judge([folder], tmp_path / "sealed")
    assert outcome.failed
    assert not outcome.first
    assert judge([tmp_path / "not there"], tmp_path / "sealed") == []
