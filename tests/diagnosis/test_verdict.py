"""Verdicts where nothing is simulated, and what speaks against a diagnosis."""

from types import SimpleNamespace

import pytest

from vsalog.diagnosis.joint import JointDiagnosis, _doubts


@pytest.mark.parametrize(
    ("fraction", "computed", "helps"),
    [(0.4, {}, True), (0.98, {}, True), (1.0, {}, False), (1.0, {"torque_sensor": "of the encoders"}, True)],
)
def test_causes_that_take_nothing_away_explain_no_part_where_nothing_is_simulated(fraction, computed, helps):
    found = SimpleNamespace(gain=None, fraction=fraction, computed=computed)
    assert JointDiagnosis.helps.fget(found) is helps


@pytest.mark.parametrize("settled", [True, False])
def test_a_search_that_did_not_settle_is_reported(settled):
    found = SimpleNamespace(
        name="arm", unchecked=(), standing=None, closed=True, found=(), selection=SimpleNamespace(settled=settled)
    )
    assert [f.code for f in _doubts(found)] == ([] if settled else ["diagnosis.search_unsettled"])
