"""`vsalog reproduce deluca2007`: what is reported of the observer holds, and a row's tuning gives its number."""

import numpy as np
import pytest

from vsalog.reproduce import deluca2007
from vsalog.reproduce.measure import Setting, Study, estimate, with_noise
from vsalog.simulation import simulate
from vsalog.simulation.scenario import Scenario


def motion(rig):
    """Play a second of the preset's motion."""
    return simulate(rig, Scenario.find(deluca2007.SCENARIO, rig).inputs(rig), 1.0, ideal=True)


@pytest.fixture(scope="module")
def result():
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(deluca2007, "_motion", motion)
        yield deluca2007.observer(Study((101,)))


def test_every_statement_holds(result):
    said = [row for row in result.rows if row.compare == "holds"]
    assert [row.place for row in said] == ["Theorem 1", "Remark 1", "Fig. 2", "Fig. 2"]
    for row in said:
        assert row.verdict == "holds", row.ours
    assert float(said[0].ours) == pytest.approx(250.0, rel=0.02)


def test_a_row_s_tuning_gives_its_number(result):
    row = next(r for r in result.rows if "torsion" in r.quantity)
    assert row.tune == {"frequency": 250.0}
    (experiment,) = with_noise(motion(deluca2007.Rig.preset("kuka-kr15").file), [101])
    found = estimate(experiment, Setting("", row.estimator, row.tune), "axis1")["total"]["deflection"]
    off = found - experiment.joints["axis1"].truth["deflection"]
    assert row.ours.median == pytest.approx(np.sqrt(np.nanmean(off**2)))
    assert 0.0 < row.ours.median < 1e-5
