"""The weak prior that the recursions begin with: it must not decide what the data determine, and is reported if it does."""

import json
from types import SimpleNamespace

import msgspec
import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run

from vsalog.core.precision import ROUNDING
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import device_of
from vsalog.estimators.methods import direct, qr_rls, residual_rls
from vsalog.estimators.tuning import LEAST_USUAL, usual_regressor
from vsalog.perturbations import prior
from vsalog.perturbations.prior import WEAKER, weaker
from vsalog.perturbations.trials import Subject
from vsalog.rig import Rig

pytestmark = pytest.mark.share(3)

ROLES = ("motor_position", "link_position", "setpoint", "motor_torque")


def usual(phi, c, **basis):
    """What the basis of the AwAS, in radians and millimetres, usually reaches where φ and c reach these."""
    changes = {f"joint.awas.basis.{name}": str(value) for name, value in basis.items()}
    spec = Rig(Rig.preset("awas").file, "awas").with_settings(changes).file.joint["awas"]
    values = {
        "motor_position": [0.0, 0.0],
        "link_position": [0.0, phi],
        "setpoint": [0.0, c],
        "motor_torque": [0.0, 0.0],
    }
    roles = {role: np.array(values[role]) for role in ROLES}
    time = np.array([0.0, 1e-3])
    signals = JointSignals("awas", 1e-3, (time * 1e9).astype(np.int64), time, roles, time == 0.0, np.zeros(2, np.int32))
    return usual_regressor(device_of("awas", spec, roles), signals)


def test_the_set_points_powers_count_by_their_geometric_mean():
    """The largest odd power of φ, the first, times 1, r and r², with r in millimetres."""
    assert usual(0.5, 4e-3) == pytest.approx(np.prod([0.5, 0.5 * 4.0, 0.5 * 16.0]) ** (1.0 / 3.0))
    assert usual(2.0, 4e-3) == pytest.approx(2.0**11 * 4.0)


def test_functions_that_are_alike_count_as_they_are():
    assert usual(0.5, 0.004, deflection_scale=0.5, setpoint_scale=0.004) == pytest.approx(1.0)


def test_powers_that_are_millions_of_times_smaller_do_not_take_the_digits():
    assert usual(0.5, 1e3) == pytest.approx(LEAST_USUAL * 0.5 * 1e12)


@pytest.fixture
def awas(tmp_path):
    """Simulate a machine; return supported estimates of it, how far they are off, and the findings by code."""

    def estimated(estimator, *actual, change=None, tuned=()):
        log = ("simulate", "awas", *actual, "--truth", "--force", "-o", "log.parquet")
        assert vsalog_run(*log, cwd=tmp_path).returncode == 0
        if change is not None:
            change(tmp_path / "log.parquet")
        asked = ("-e", estimator, *tuned, "--force", "-o", "trace.parquet", "--json")
        done = vsalog_run("estimate", "log.parquet", *asked, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        truth = pq.read_table(tmp_path / "log.parquet").to_pandas().set_index("stamp")["/truth/stiffness.data"]
        trace = pq.read_table(tmp_path / "trace.parquet").to_pandas().set_index("stamp")
        trace = trace[(trace["transmission"] == "1") & trace["excited"]]
        assert len(trace) > 0.5 * len(truth)
        found = {finding["code"]: finding for finding in json.loads(done.stdout)["joints"][0]["findings"]}
        return trace, np.abs(trace["stiffness"] - truth.reindex(trace.index)), found

    return estimated


def reversed_set_point(log):
    """Turn the sign of the set-point round, in a log that says otherwise."""
    table, name = pq.read_table(log), "/joint_states.position[secondary_motor]"
    turned = table.set_column(table.column_names.index(name), name, pc.negate(table[name]))
    pq.write_table(turned.replace_schema_metadata(table.schema.metadata), log)


def wrong(trace, off):
    """Return of how much the stiffness is off by 5 % and by three deviations."""
    return np.mean((off > 0.05 * trace["stiffness"]) & (off > 3.0 * trace["stiffness_std"]))


@pytest.mark.every(3)
@pytest.mark.parametrize("estimator", ["residual-rls", "algebraic", "direct"])
def test_a_lever_that_begins_elsewhere_is_no_matter(awas, estimator):
    """The rig says 100 mm; with r from 90 mm the stiffness still is a polynomial of the basis, if not r² alone.

    By a prior that took the largest function for the usual one 24 % of what was supported was off by 5 to 17 %, with 1 % claimed.
    """
    trace, off, found = awas(estimator, "--actual", "joint.awas.lever.start='90 mm'")
    assert wrong(trace, off) < 0.01
    assert np.median(off / trace["stiffness"]) < 0.01
    assert "prior.holds_back" not in found


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("estimator", "solver"),
    [("residual-rls", ()), ("algebraic", ()), ("direct", ()), ("direct", ("--tune", "solver=qr"))],
)
def test_a_set_point_of_reversed_sign_is_reported_and_with_what_is_advised_it_is_no_matter(awas, estimator, solver):
    """The stiffness is a polynomial of the reversed set-point, too, whose coefficients are far larger.

    By the prior alone 36 % of what was supported was off by up to 39 %, with 1.5 % claimed.
    """
    trace, off, found = awas(estimator, change=reversed_set_point, tuned=solver)
    assert wrong(trace, off) < 0.005
    advised = f"p0={found['prior.holds_back']['evidence']['p0']:.2g}"
    trace, off, found = awas(estimator, change=reversed_set_point, tuned=(*solver, "--tune", advised))
    assert wrong(trace, off) < 0.005
    assert np.median(off / trace["stiffness"]) < 0.01
    assert "prior.holds_back" not in found


def subject_of(method, **tuned):
    t = 1e-3 * np.arange(4000)
    phi = 0.1 * np.sin(3.0 * t)
    roles = {"motor_position": 0.0 * t, "link_position": phi, "torque_sensor": 30.0 * phi, "motor_torque": -30.0 * phi}
    signals = JointSignals("sea", 1e-3, (t * 1e9).astype(np.int64), t, roles, t == 0.0, np.zeros(t.size, np.int32))
    own, tuning = device_of("sea", Rig.preset("sea").file.joint["sea"], roles), method.TUNING(**tuned)
    return Subject(method, own, signals, tuning, method.build(own, signals, tuning))


@pytest.mark.parametrize("method", [direct, residual_rls])
def test_the_trial_has_a_weaker_prior_but_not_so_weak_that_digits_are_lost(method):
    subject = subject_of(method)
    p0, c = subject.fold.derived["p0"], subject.tuning.c
    found = weaker(subject)
    assert found.p0 > 100.0 * p0
    assert found.p0 == pytest.approx(min(WEAKER * p0, 1.0 / (ROUNDING * c * usual_regressor(*subject[1:3]) ** 2)))
    assert found.window == subject.fold.derived["window"]


def test_where_there_is_no_prior_or_a_weak_one_nothing_is_tried():
    assert weaker(subject_of(direct, p0=1e30)) is None
    assert weaker(subject_of(qr_rls, p0=np.inf)) is None


class Tuned(msgspec.Struct):
    """Of a recursion."""

    p0: float | None = None
    window: int | None = None


def weakened(monkeypatch, room):
    """The prior of a trial, of a prior of one and where rounding leaves room for one that is so much larger."""
    monkeypatch.setattr(prior, "usual_regressor", lambda *_: (1.0 / (ROUNDING * room)) ** 0.5)
    subject = SimpleNamespace(
        tuning=Tuned(),
        fold=SimpleNamespace(derived={"p0": 1.0}),
        device=SimpleNamespace(transmissions=(1,)),
        signals=None,
    )
    found = weaker(subject)
    return None if found is None else found.p0


@pytest.mark.parametrize(("room", "found"), [(1e9, 1e4), (120.0, 120.0), (90.0, None)])
def test_a_trial_s_prior_is_a_hundred_times_as_wide_or_ten_times_where_there_is_no_more_room(monkeypatch, room, found):
    assert weakened(monkeypatch, room) == (found and pytest.approx(found))
