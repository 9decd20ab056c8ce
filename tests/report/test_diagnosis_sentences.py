"""What a diagnosis says first: of what is there, and no gain where none is told."""

import pytest
from diagnosis_evidence import found_cause

from vsalog.diagnosis.document import Gain, Unexplained
from vsalog.diagnosis.words import sentences

NOTHING_LEFT = Unexplained(fraction=0.0, where=None, depends_on=())


def gain(reduction, low, high):
    return Gain(
        joint="j", signal="link_position", unit="rad", rmse_before=1.0, rmse_after=1.0 - reduction, noise_floor=0.1,
        reduction=reduction, ci95=(low, high),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("verdict", "spoken_of"), [("explained", True), ("partly explained", True), ("unexplained", False)]
)
def test_the_extended_rig_is_spoken_of_where_one_is_written(verdict, spoken_of):
    first = sentences(verdict, [found_cause()], [gain(0.5, 0.4, 0.6)], "the held-out log", NOTHING_LEFT, 1, True)[0]
    assert ("extended rig" in first) is spoken_of
    assert "50 %" in first


def test_a_gain_whose_interval_holds_none_is_no_gain():
    for low, high in ((-0.01, 0.02), (0.0, 0.0)):
        first = sentences(
            "partly explained", [found_cause()], [gain(0.001, low, high)], "the held-out log", NOTHING_LEFT, 1, True
        )[0]
        assert "no different" in first
