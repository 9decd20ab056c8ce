"""The registry of checks, and what one finding says in place of another."""

import json

import numpy as np
import pytest
from command_line import vsalog_run
from hypothesis import given
from hypothesis import strategies as st

import vsalog
from vsalog.checks import checks
from vsalog.checks.check import OfSignals, without_superseded
from vsalog.core.finding import Finding
from vsalog.core.finding_texts import TEXTS

pytestmark = pytest.mark.share(3)


def test_names_are_unique_and_what_is_superseded_has_a_text():
    assert {check.name for check in checks()} == {
        "cross_check",
        "nominal",
        "recording_faults",
        "residual_shape",
        "signals",
        "standstill",
    }
    for check in checks():
        for code, superseded in check.supersedes.items():
            assert {code, *superseded} <= TEXTS.keys()


@given(st.lists(st.sampled_from("abcd")))
def test_a_finding_says_what_others_would_say_again(codes):
    left = [f.code for f in without_superseded([Finding(code=c) for c in codes], {"a": ("b", "c")})]
    assert left == [c for c in codes if "a" not in codes or c not in ("b", "c")]


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("scale", "estimator"),
    [
        (10.0, "direct"), (1e-3, "direct"), (1000.0, "residual-rls"), (4.0, "direct"), (2.5, "direct"),
        (0.1, "residual-rls"), (1e-3, "residual-rls"), (0.4, "residual-rls"),
    ],
)  # fmt: skip
def test_a_torque_in_another_unit_is_held_against_the_rig_s_spring(tmp_path, scale, estimator):
    assert vsalog_run("simulate", "sea", "--duration", "8 s", "-o", "log.csv", cwd=tmp_path).returncode == 0
    head, *rows = (tmp_path / "log.csv").read_text().splitlines()
    names = head.split(",")
    values = np.array([[float(x or "nan") for x in row.split(",")] for row in rows])
    torques = [i for i, name in enumerate(names) if "torque" in name or "effort" in name]
    assert len(torques) == 2
    values[:, torques] *= scale
    np.savetxt(tmp_path / "scaled.csv", values, "%.17g", ",", header=head, comments="")
    done = vsalog_run("estimate", "scaled.csv", "--rig", "sea", "-e", estimator, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = {f["code"]: f for f in json.loads(done.stdout)["joints"][0]["findings"]}
    sound = 10**-0.5 < scale < 10**0.5
    # A motor's torque that is too small leaves no stiffness to compare.
    code = "motor_torque.scale" if scale < 1.0 and estimator != "direct" else "stiffness.scale"
    assert {c for c in found if c.endswith(".scale")} == (set() if sound else {code})
    if not sound:
        # Where nothing is excited a stiffness is a guess.
        near = 1.0 if scale > 1.0 and estimator != "direct" else 0.2
        assert found[code]["value"] == pytest.approx(scale, rel=near)


def test_a_method_that_reads_no_set_point_is_not_held_against_a_spring_that_needs_one(samples, tmp_path):
    done = vsalog_run("estimate", samples / "awas_exp1.mcap", "-e", "grioli-bicchi", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "stiffness.scale" not in {f["code"] for f in json.loads(done.stdout)["joints"][0]["findings"]}


class Damp:
    name = "damp"

    def __init__(self, part):
        self.part, self.supersedes = part, {}

    def start(self, context):
        return OfSignals([Finding(code="deflection.still", joint="vsa2", part=self.part, severity="invalidates")])


@pytest.mark.parametrize(("part", "dead"), [("1", {"1", "total"}), ("torque_sensor", {"1", "2", "total"})])
def test_nothing_counts_as_excited_where_signals_invalidate_the_estimate(samples, monkeypatch, part, dead):
    monkeypatch.setattr("vsalog.checks.checks", lambda: (Damp(part),))
    (joint,) = vsalog.estimate(samples / "vsa2_exp1.mcap")
    for name, columns in joint.trace.transmissions.items():
        assert columns["excited"].any() == (name not in dead), name
