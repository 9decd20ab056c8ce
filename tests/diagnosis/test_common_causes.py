"""Causes that two parts have in common: one number for both where both have it, two where they differ."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from tests.hidden_effects.cases import Plan, make_case, write_case
from vsalog.cli import cli
from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.diagnosis.common_causes import common_sites, scales
from vsalog.diagnosis.linear import clash
from vsalog.rig import Rig

pytestmark = pytest.mark.share(2)


def site(part, start, name="value", **options):
    """A cause that puts its number into a dictionary."""
    return Site("motor.inertia", part, (Parameter(name, "1", start, 1e-3),), lambda j, v: j | {part: v[0]}, **options)


def test_a_common_cause_changes_both_by_one_factor():
    (both,) = common_sites([site("motor_1", 0.02), site("motor_2", 0.05), site("link", 1.0)])
    changed = both.apply({}, [0.03])
    assert changed == {"motor_1": pytest.approx(0.03), "motor_2": pytest.approx(0.075)}
    np.testing.assert_allclose(scales(both.members), [[1.0], [2.5]])
    assert both.parts == {"motor_1", "motor_2"}


def test_what_both_lack_is_the_same_number():
    (both,) = common_sites([site("motor_1", 0.0), site("motor_2", 0.0)])
    assert both.apply({}, [0.2]) == {"motor_1": 0.2, "motor_2": 0.2}


@pytest.mark.parametrize(
    "pair",
    [
        (site("motor_1", 0.02), site("motor_2", 0.0)),
        (site("motor_1", 0.02), site("motor_2", 0.02, name="other")),
        (site("motor_1", 0.02, transient=True), site("motor_2", 0.02, transient=True)),
        (site("motor_1", 0.02), site("link", 0.02)),
    ],
    ids=["one lacks it", "other numbers", "happens once", "no pair"],
)
def test_what_two_parts_cannot_share_is_none(pair):
    assert common_sites(pair) == []


def test_a_common_cause_stands_with_neither_of_its_own():
    one, other = site("motor_1", 0.02), site("motor_2", 0.05)
    (both,) = common_sites([one, other])
    assert clash(both, one)
    assert clash(other, both)
    assert not clash(one, other)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The log of an antagonistic machine that is as its rig states."""
    case = make_case(Plan("clean", "antagonistic", seed=11))
    return write_case(case, tmp_path_factory.mktemp("common"))


def with_springs(text, factors):
    """The rig with springs that are softer by factors."""
    lines, factor = [], 1.0
    for line in text.splitlines():
        for suffix, f in factors.items():
            if line.startswith("[") and line.endswith(f".transmission{suffix}]"):
                factor = f
        if line.startswith("[") and "transmission" not in line:
            factor = 1.0
        key, _, value = line.partition(" = ")
        scaled = key in {"stiffness", "cubic", "spring_stiffness"} and factor != 1.0
        lines.append(f"{key} = {float(value) / factor!r}" if scaled else line)
    return "\n".join(lines)


@pytest.mark.every(2)
@pytest.mark.parametrize(("factors", "common"), [((1.07, 1.07), True), ((1.07, 0.95), False)])
def test_springs_that_are_both_stiffer_have_one_factor(log, tmp_path, factors, common):
    rig = tmp_path / "rig.toml"
    rig.write_text(
        with_springs((log / "rig.toml").read_text(encoding="utf-8"), dict(zip(("_1", "_2"), factors, strict=True)))
    )
    assert Rig.load(rig)
    arguments = ["diagnose", str(log / "log.parquet"), "--rig", str(rig), "-o", str(tmp_path), "--json"]
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code == 0
    causes = [c for c in json.loads(done.stdout)["causes"] if c["material"]]
    assert {(c["cause"], c["part"]) for c in causes} == {
        ("transmission.stiffness", "transmission_1"), ("transmission.stiffness", "transmission_2"),
    }  # fmt: skip
    for cause in causes:
        expected = factors[int(cause["part"][-1]) - 1]
        assert cause["parameters"]["factor"]["value"] == pytest.approx(expected, rel=3e-3)
        other = {"transmission_1": "transmission_2", "transmission_2": "transmission_1"}[cause["part"]]
        assert cause["common_with"] == ([other] if common else [])
