"""The weak prior that the recursions begin with: it shall not decide what the data can tell."""

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run

from vsalog.estimators.device import device_of
from vsalog.estimators.tuning import LEAST_USUAL, usual_regressor
from vsalog.rig import Rig
from vsalog.signals import JointSignals

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


@pytest.mark.parametrize("estimator", ["residual-rls", "algebraic", "direct"])
def test_a_lever_that_begins_elsewhere_is_no_matter(tmp_path, estimator):
    """The rig says 100 mm; with r from 90 mm the stiffness still is a polynomial of the basis, if not r² alone.

    By a prior that took the largest function for the usual one 24 % of what was supported was off by 5 to 17 %, with 1 % claimed.
    """
    log = ("simulate", "awas", "--actual", "joint.awas.lever.start='90 mm'", "--truth", "-o", "log.parquet")
    assert vsalog_run(*log, cwd=tmp_path).returncode == 0
    assert vsalog_run("estimate", "log.parquet", "-e", estimator, "-o", "trace.parquet", cwd=tmp_path).returncode == 0
    truth = pq.read_table(tmp_path / "log.parquet").to_pandas().set_index("stamp")["/truth/stiffness.data"]
    trace = pq.read_table(tmp_path / "trace.parquet").to_pandas().set_index("stamp")
    trace = trace[(trace["transmission"] == "1") & trace["excited"]]
    off = np.abs(trace["stiffness"] - truth.reindex(trace.index))
    assert len(trace) > 0.5 * len(truth)
    assert np.mean((off > 0.05 * trace["stiffness"]) & (off > 3.0 * trace["stiffness_std"])) < 0.01
    assert np.median(off / trace["stiffness"]) < 0.01
