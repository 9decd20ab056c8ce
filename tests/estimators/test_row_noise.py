"""The noise of averaged rows: what two equations have in common, against generalised least squares with the true covariance."""

import numpy as np
import pytest

from vsalog.estimators.box_rows import BoxRows, box_block, box_start
from vsalog.estimators.row_noise import RowNoise

COUNT, SIZE = 6000, 5


def rows_of(values, missing=()):
    """Boxes in one run with a regressor and what it adds up to, some of them missing."""
    keep = ~np.isin(np.arange(len(values)), missing)
    first = np.r_[True, ~keep[:-1]][keep]
    return BoxRows(values[keep], (SIZE * np.arange(len(values)) + 2)[keep], first, SIZE)


def common(seed=0):
    """Two noises that share one: the second has half of it as it was a box before."""
    rng = np.random.default_rng(seed)
    shared = rng.normal(size=COUNT + 1)
    return shared[1:] + 0.3 * rng.normal(size=COUNT), 0.5 * shared[:-1] + 0.2 * rng.normal(size=COUNT)


def white(noises, missing=()):
    boxes = [rows_of(noises[0][:, None]), rows_of(noises[1][:, None], missing)]
    residuals = [part.rows[:, 0] for part in boxes]
    level = [np.ones(len(part.rows)) for part in boxes]
    first = RowNoise.fitted(residuals[0], boxes[0], level[0], [])
    second = RowNoise.fitted(residuals[1], boxes[1], level[1], [(residuals[0], boxes[0])])
    before = [(boxes[0].rows, boxes[0])]
    return (
        first.whitened(boxes[0].rows, boxes[0], level[0], [])[:, 0],
        second.whitened(boxes[1].rows, boxes[1], level[1], before)[:, 0],
        second,
    )


def test_what_equations_share_is_counted_once():
    one, two, noise = white(common())
    assert np.std(one) == pytest.approx(1.0, abs=0.03)
    assert np.std(two) == pytest.approx(1.0, abs=0.03)
    for lag in range(-3, 4):
        pairs = one[3 + lag : COUNT - 3 + lag] @ two[3 : COUNT - 3] / COUNT
        assert abs(pairs) < 4.0 / COUNT**0.5
    # Given the other noise at all times, what is left has the variance of the conditional distribution.
    assert noise.left.rest.deviation[-1] ** 2 == pytest.approx(0.2**2 + 0.25 * 0.09 / 1.09, rel=0.1)


def test_equations_that_share_nothing_stay_as_they_are():
    rng = np.random.default_rng(1)
    noises = rng.normal(size=COUNT), 2.0 * rng.normal(size=COUNT)
    _, two, noise = white(noises)
    np.testing.assert_allclose(np.abs(noise.shared), 0.0, atol=4.0 * 2.0 / COUNT**0.5)
    np.testing.assert_allclose(two, noises[1] / 2.0, atol=0.15)


def test_rows_without_their_neighbours_have_noise_of_their_own():
    noises = common()
    _, two, noise = white(noises, missing=range(1000, 4000))
    assert len(two) == COUNT - 3000
    assert np.std(two) == pytest.approx(1.0, abs=0.05)
    boxes = rows_of(noises[1][:, None])
    level = np.ones(len(boxes.rows))
    alone = noise.whitened(boxes.rows, boxes, level, [(np.empty((0, 1)), rows_of(np.empty((0, 1))))])[:, 0]
    np.testing.assert_allclose(alone, noise.alone.whitened(boxes.rows, boxes.first, level)[:, 0])


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_noise_that_the_stiffness_multiplies_is_weighed_by_it(share):
    """The deflection's noise is multiplied by the stiffness, the torque's is not; outliers do not look like either."""
    rng = np.random.default_rng(2)
    stiffness = 1.0 + 4.0 * np.sin(np.arange(COUNT) / 7.0) ** 2
    steepness = stiffness**2 / np.mean(stiffness**2)
    noise = np.sqrt(1.0 - share) * rng.normal(size=COUNT) + np.sqrt(share * steepness) * rng.normal(size=COUNT)
    noise[::500] *= 30.0
    boxes = rows_of(noise[:, None])
    fit = RowNoise.fitted(noise, boxes, steepness, [])
    assert fit.alone.share == pytest.approx(share, abs=0.05)
    white = np.abs(fit.whitened(boxes.rows, boxes, steepness, [])[:, 0])
    steep = steepness > 1.0
    assert np.median(white[steep]) == pytest.approx(np.median(white[~steep]), rel=0.1)


def test_boxes_are_averages_on_a_grid_that_begins_with_a_run():
    values = np.arange(23.0)[:, None]
    use, starts = np.ones(23, dtype=bool), np.zeros(23, dtype=bool)
    use[6], starts[[0, 17]] = False, True
    whole = box_block(box_start(1), values, use, starts, 5)
    cut = box_start(1)
    for part in (slice(0, 7), slice(7, 8), slice(8, 23)):
        cut = box_block(cut, values[part], use[part], starts[part], 5)
    for found in (whole.whole, cut.whole):
        np.testing.assert_array_equal(found.rows[:, 0], [2.0, 12.0, 19.0])
        np.testing.assert_array_equal(found.place, [2, 12, 19])
        np.testing.assert_array_equal(found.first, [True, True, True])
