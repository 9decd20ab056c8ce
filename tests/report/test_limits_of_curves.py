"""How finely curves are drawn, and what is drawn as one."""

from types import SimpleNamespace

import numpy as np
import pytest
from reports_evidence import lever_arm_joint

from vsalog.figures.characteristic import characteristic_charts
from vsalog.figures.equation_residuals import _points


def test_a_fifth_power_looks_smooth_between_the_nodes_of_a_surface():
    """Straight lines between them are off by less than a pixel of five hundred."""
    joint = lever_arm_joint()
    charts = characteristic_charts(joint, "1", joint.transmissions["1"])
    (surface,) = (chart.surface for chart in charts if chart.surface is not None)
    nodes = surface.x[surface.x.shape[0] // 2]
    nodes = nodes / np.abs(nodes).max()
    fine = np.linspace(nodes[0], nodes[-1], 10_001)
    assert np.abs(np.interp(fine, nodes, nodes**5) - fine**5).max() < 2.0 / 500.0


@pytest.mark.parametrize(("left", "drawn"), [(0.03, True), (0.08, False)])
def test_a_shape_is_a_line_of_which_all_but_a_twentieth_follows(left, drawn):
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, 4000)
    follows = np.sin(3.0 * x)
    shape = follows + (left / (1.0 - left) * np.mean(follows**2)) ** 0.5 * rng.normal(size=x.size)
    curves, words = _points(x, SimpleNamespace(without=shape, shape=shape, cause="transmission.damping"))
    assert (words == "a line" and curves[1].kind == "line") == drawn
