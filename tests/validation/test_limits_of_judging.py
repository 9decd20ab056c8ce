"""What is judged, and what not: powers of a model, torques near zero, gaps and loops, long logs."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import msgspec
import numpy as np
import pytest

from vsalog.core.model import BasisSpec
from vsalog.validation import run
from vsalog.validation.frozen import _basis_fault
from vsalog.validation.joint import STIFFNESS, TORQUE, _compare
from vsalog.validation.signatures import loops

T = np.arange(2000) * 1e-2
PHI = 0.1 * np.sin(2 * np.pi * 0.31 * T) + 0.05 * np.sin(2 * np.pi * 1.3 * T)


@pytest.mark.parametrize("key", ["powers", "setpoint_order"])
def test_powers_above_a_hundred_are_refused(key):
    for power, sound in ((100, True), (101, False)):
        value = (1, power) if key == "powers" else power
        basis = BasisSpec(**{"powers": (1,), key: value})
        assert (_basis_fault(SimpleNamespace(basis=basis)) is None) is sound


@pytest.mark.parametrize(("quantity", "small", "counted"), [(TORQUE, 0.04, 1), (TORQUE, 0.07, 2), (STIFFNESS, 0.04, 2)])
def test_relative_errors_of_torques_below_a_twentieth_of_the_largest_mean_nothing(quantity, small, counted):
    """Half of the values are small, and off by a half of them."""
    measured = np.repeat([2.0, 2.0 * small], 500)
    predicted = np.repeat([2.0, 3.0 * small], 500)
    found = _compare(quantity, "sensor", predicted, measured, np.ones(1000, dtype=bool)).inside.msrep.value
    assert found == pytest.approx(100.0 * (0.0 if counted == 1 else 0.5**2 / 2.0))


def left_by(effect, columns):
    """The part of an effect's squares that columns leave."""
    return np.sum((effect - columns @ np.linalg.lstsq(columns, effect, rcond=None)[0]) ** 2) / np.sum(effect**2)


@pytest.mark.parametrize("share", [0.01, 0.014, 0.057, 0.113, 0.226, 0.32])
def test_a_loop_of_any_width_leaves_less_than_a_tenth(share):
    """A spring that slips, from a hundredth to a third of the deflection's span."""
    state, slipping = 0.0, []
    for step in np.diff(PHI, prepend=0.0) / (share * np.ptp(PHI)):
        state = float(np.clip(state + step, -1.0, 1.0))
        slipping.append(state)
    found = loops(PHI, np.arange(PHI.size))
    assert min(left_by(np.array(slipping), column[:, None]) for column in found.values()) < 0.1


@pytest.mark.parametrize(("samples", "estimated"), [(290_000, True), (310_000, False)])
def test_logs_of_more_than_three_hundred_thousand_samples_are_not_estimated_unless_asked(
    monkeypatch, samples, estimated
):
    class Told(msgspec.Struct):
        findings: tuple = ()

    doubts = []
    for name in ("_check_fit", "_roles", "_read", "bind", "device_of", "implausible", "judge", "log_findings", "pick_joints",
                 "prepare", "replace", "side_by_side", "truth_channels"):  # fmt: skip
        monkeypatch.setattr(run, name, MagicMock())
    monkeypatch.setattr(
        run, "joint_report", lambda judged, signals, modalities, found, own: doubts.extend(found) or Told()
    )
    run.device_of.return_value.pneumatic = None
    run.prepare.return_value.signals.__len__.return_value = samples
    file = MagicMock()
    file.joint = {"arm": MagicMock()}
    file.joint["arm"].basis.branches = False
    log = SimpleNamespace(name="long.mcap")
    run._judge_log(file, MagicMock(), log, MagicMock(), run.Options(), lambda _: None, lambda _: None)
    assert run.side_by_side.called is estimated
    assert [f.code for f in doubts] == ([] if estimated else ["validation.modalities_skipped"])
