"""What a diagnosis says first: of what is there, and no gain where none is reported."""

import pytest
from diagnosis_evidence import diagnosis, found_cause

from vsalog.diagnosis.document import Gain, Gains
from vsalog.report.diagnosis_sentences import account


def gain(reduction, low, high):
    return Gain(
        joint="j", signal="link_position", unit="rad", rmse_before=1.0, rmse_after=1.0 - reduction, noise_floor=0.1,
        reduction=reduction, ci95=(low, high),
    )  # fmt: skip


def told(verdict, of):
    """Return the first sentence."""
    gains = Gains(holdout=True, where="the held-out log", signals=(of,))
    return account(diagnosis(verdict=verdict, causes=(found_cause(),), gain=gains))[0]


@pytest.mark.parametrize(
    ("verdict", "spoken_of"), [("explained", True), ("partly explained", True), ("unexplained", False)]
)
def test_the_extended_rig_is_spoken_of_where_one_is_written(verdict, spoken_of):
    first = told(verdict, gain(0.5, 0.4, 0.6))
    assert ("extended rig" in first) is spoken_of
    assert "50 %" in first


def test_a_gain_whose_interval_holds_none_is_no_gain():
    for low, high in ((-0.01, 0.02), (0.0, 0.0)):
        first = told("partly explained", gain(0.001, low, high))
        assert "no different" in first
