"""The filter of a link: how soon it doubts itself, and when it is given up."""

import numpy as np
import pytest

from vsalog.filters.link_ekf import LinkNoise, LinkState, estimate_link, link_start

NOISE = LinkNoise(position=1e-3, torque=1e-9, velocity=1e-9, mobility=1.0, decay=1.0, wander=0.0, first_mobility=1.0)


def test_one_innovation_of_ten_deviations_makes_the_first_variances_five_times_as_large():
    """As one of a hundred squares next to twenty of one: (20 + 100) / 21 = 5.7."""
    position = np.array([0.0, 10.0 * 2.0**0.5 * NOISE.position])
    excess = estimate_link(link_start(NOISE), position, np.zeros(2), 1e-3, NOISE, 1000.0)[2]
    assert 4.0 < excess[1] < 8.0


@pytest.mark.parametrize(("times", "known"), [(2.0, True), (3.0, True), (4.0, False)])
def test_a_filter_that_lost_its_way_a_fourth_time_is_given_up(times, known):
    start = link_start(NOISE)
    state = LinkState(start.x, start.P, np.array([0.0, 1.0, 0.0, times, 20.0]))
    excess = estimate_link(state, np.zeros(3), np.zeros(3), 1e-3, NOISE, 1000.0)[2]
    assert np.isfinite(excess).all() == known
