"""What is reported of joints, sensors and logs that a method cannot work with, or could work with better."""

import warnings
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import vsalog
from vsalog.core.errors import EstimatorError
from vsalog.estimation.joint import choose, estimate_joint
from vsalog.readers import read
from vsalog.rig import Rig

T = np.arange(4000) * 1e-3
RIG = """
[joint.elbow]
kind = "elastic"
{motor}
[joint.elbow.signals]
{signals}
"""
ROLES = {"link_position": "q", "motor_position": "theta", "torque_sensor": "tau", "motor_torque": "drive"}
INERTIA = "[joint.elbow.motor]\ninertia = 0.01"


def rig_with(*roles, motor=""):
    return RIG.format(motor=motor, signals="\n".join(f'{role} = "{ROLES.get(role, role)}"' for role in roles))


def reason(rig):
    ((name, joint),) = Rig.from_toml(rig).joints.items()
    return choose(name, joint, "auto", {}).reason


@pytest.mark.parametrize(
    ("roles", "motor", "words"),
    [
        (("motor_position",), INERTIA, "motor_torque in the rig would"),
        (("motor_position",), "", "motor_torque in the rig, with the motor's inertia, would"),
        (("deflection",), INERTIA, "motor_torque and motor_position in the rig would"),
        (("deflection", "motor_torque"), INERTIA, "motor_position in the rig would"),
        (("motor_position", "motor_torque"), "", "the motor's inertia is not known"),
    ],
)
def test_auto_names_what_lacks_and_not_what_is_there(roles, motor, words):
    found = reason(rig_with("link_position", "torque_sensor", *roles, motor=motor))
    assert words in found
    lacking = found.partition("; ")[2].partition(" in the rig")[0]
    assert not [role for role in roles if role in lacking]


def test_auto_says_what_one_more_sensor_would_add():
    for name, words in (("pam", "link_position"), ("kuka-kr15", "link_position")):
        rig = Rig.load(name)
        joint, spec = next(iter(rig.joints.items()))
        signals = {role: getattr(spec.signals, role) for role in spec.signals.__struct_fields__}
        bare = type(spec.signals)(**{**signals, "link_position": None})
        changed = type(spec)(**{**{f: getattr(spec, f) for f in spec.__struct_fields__}, "signals": bare})
        assert words in choose(joint, changed, "auto", {}, rig.file).reason
    pam = Rig.load("pam")
    assert "link_position" not in choose("pam", pam.joints["pam"], "auto", {}, pam.file).reason


def test_the_kind_is_refused_before_a_role_is_asked_for():
    rig = Rig.load("vsa2")
    with pytest.raises(EstimatorError, match="two transmissions drive the link") as caught:
        choose("vsa2", rig.joints["vsa2"], "impedance-coupled", {}, rig.file)
    assert "external_torque" not in str(caught.value)


@pytest.fixture
def bench(tmp_path):
    """A log whose torque sensor is dead, and its rig."""
    tau = np.sin(3.0 * T) + 0.3 * np.sin(17.0 * T)
    theta = 0.4 * np.sin(3.0 * T) + 0.1 * np.cos(11.0 * T)
    noise = np.random.default_rng(1).normal(0.0, 1e-5, (2, T.size))
    columns = {"time": T, "q": theta + tau / 40.0 + noise[0], "theta": theta + noise[1], "drive": tau}
    columns["tau"] = np.full(T.size, 0.125)
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    pq.write_table(pa.table({name: x[:0] for name, x in columns.items()}), tmp_path / "empty.parquet")
    (tmp_path / "log.rig.toml").write_text(rig_with(*ROLES, motor=INERTIA))
    return tmp_path


@pytest.mark.parametrize(
    ("estimator", "tune"),
    [("direct", {}), ("grioli-parametric", {}), ("residual-rls", {"modality": "SENSOR"}), ("impedance", {})],
)
def test_a_dead_torque_sensor_is_refused_by_whoever_reads_it(bench, estimator, tune):
    with pytest.raises(
        EstimatorError, match=f"torque_sensor is 0.125 N·m from beginning to end.* and {estimator} takes"
    ):
        vsalog.estimate(bench / "log.parquet", estimator=estimator, tune=tune)


def test_a_dead_torque_sensor_gives_one_line_and_no_warning_of_a_library(refused, bench):
    said = refused("estimate", "log.parquet", "-e", "impedance", cwd=bench)
    assert "torque_sensor is 0.125 N·m from beginning to end" in said
    assert "RuntimeWarning" not in said


def test_a_dead_torque_sensor_is_no_matter_to_others(run, bench):
    done = run("estimate", "log.parquet", "-e", "residual-rls", cwd=bench)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", ["estimate", "diagnose", "compare"])
def test_a_table_without_rows_is_said_to_have_none(refused, bench, command):
    said = refused(command, "empty.parquet", "--rig", "log.rig.toml", cwd=bench)
    assert "without a single row" in said or "has no row" in said
    assert "did you mean" not in said
    assert "there is no channel" not in said


@pytest.mark.parametrize("estimator", ["impedance", "grioli-bicchi"])
def test_no_gain_makes_a_stiffness_certain(samples, estimator):
    (found,) = vsalog.estimate(samples / "sea_exp1.csv", estimator=estimator, tune={"alpha": 1e200})
    for part in found.trace.transmissions.values():
        std = np.asarray(part["stiffness_std"])
        assert np.isfinite(std).any()
        assert not (std == 0.0).any()
        assert not np.asarray(part["excited"])[np.isnan(std)].any()


def test_numbers_out_of_range_leak_no_warning_from_any_part_of_an_estimate(bench):
    """Building the fold, its model and the summary may meet them, not only the steps."""
    recording = read(bench / "log.parquet")
    ((name, joint),) = Rig.from_toml((bench / "log.rig.toml").read_text()).joints.items()
    choice = choose(name, joint, "residual-rls", {})
    met = []

    class Fold:
        def __init__(self, fold):
            self.fold = fold

        def __getattr__(self, key):
            if key in ("model", "findings"):
                met.append(key)
                np.sqrt(np.array([-1.0])) / np.zeros(1)
            return getattr(self.fold, key)

    class Method:
        @staticmethod
        def build(*given):
            met.append("build")
            np.exp(np.array([1e4])) * np.log(np.array([0.0]))
            return Fold(choice.method.build(*given))

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimate_joint([recording], name, joint, replace(choice, method=Method))
    assert set(met) == {"build", "model", "findings"}


def test_a_guessed_torque_before_an_unknown_gear_is_not_said_to_be_used(samples, tmp_path):
    """What is printed of the guess and of the estimator's choice do not contradict each other."""
    head, *rows = (samples / "sea_exp1.csv").read_text(encoding="utf-8").splitlines()
    halved = ((*cells[:2], str(0.5 * float(cells[2])), *cells[3:]) for cells in (row.split(",") for row in rows))
    (tmp_path / "log.csv").write_text("\n".join((head, *map(",".join, halved))), encoding="utf-8")
    with pytest.warns(vsalog.VsalogWarning):
        found = vsalog.estimate(tmp_path / "log.csv", end="5")
    (guessed,) = (finding for finding in found.findings if finding.code == "rig.guessed")
    (joint,) = found.rig.joints.values()
    for role in ("motor_position", "motor_torque", "link_position", "torque_sensor"):
        words = guessed.evidence["roles"].partition(f"{role} = ")[2].partition(")")[0]
        assert ("not used" in words) == (getattr(joint.signals, role) is None) == (role == "motor_torque")
    assert "recorded" not in found[0].reason
