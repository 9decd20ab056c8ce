"""The region that is reported as covered: what was learnt counts a delay later, however a log is cut."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.estimators.region import Region

DELAY = 7


def covered(phi, c=None, use=None, block=None, region=None):
    """Whether each sample is in what was known by then, and the region at the end."""
    region = Region.behind(DELAY) if region is None else region
    use = np.ones(phi.size, dtype=bool) if use is None else use
    flags = []
    for first in range(0, phi.size, block or phi.size):
        part = slice(first, first + (block or phi.size))
        here = None if c is None else c[part]
        region, inside = region.block(phi[part], here, use[part], phi[part], here)
        flags.append(inside)
    return np.concatenate(flags), region


def told_by_hand(phi, c, use):
    """The same, sample by sample, with lists."""
    flags = []
    for k in range(phi.size):
        inside = True
        for values in (phi, c):
            known = [values[i] for i in range(max(k - DELAY + 1, 0)) if use[i]]
            if not known:
                inside = False
                continue
            low, high = min(known), max(known)
            margin = 0.05 * (high - low) + 1e-9 * max(abs(low), abs(high))
            inside = inside and low - margin <= values[k] <= high + margin
        flags.append(inside)
    return np.array(flags)


def test_what_is_learnt_counts_a_delay_later():
    phi = np.repeat([0.0, 1.0], 20)
    inside, region = covered(phi)
    np.testing.assert_array_equal(
        inside, np.r_[np.zeros(DELAY), np.ones(20 - DELAY), np.zeros(DELAY), np.ones(20 - DELAY)]
    )
    assert region.samples == 40


def test_the_model_knows_all_that_was_learnt():
    _, region = covered(np.arange(20.0))
    assert region.phi == (0.0, 19.0 - DELAY)
    assert region.vertices() == ((0.0,), (19.0,))
    assert region.whole().phi == (0.0, 19.0)
    assert region.whole().whole().phi == (0.0, 19.0)
    inside, _ = covered(np.array([19.0, 0.0]), use=np.zeros(2, dtype=bool), region=region.whole())
    assert inside.all()


def test_what_is_not_learnt_never_counts():
    phi = np.repeat([0.0, 1.0, 0.0], 20)
    inside, region = covered(phi, use=phi == 0.0)
    assert not inside[20:40].any()
    assert inside[40:].all()
    assert region.whole().phi == (0.0, 0.0)


def test_nothing_is_covered_before_anything_was_learnt():
    inside, region = covered(np.zeros(5), use=np.zeros(5, dtype=bool))
    assert not inside.any()
    assert region.whole().vertices() == ()


@pytest.mark.parametrize("block", [1, 3, DELAY, 64])
@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.booleans()), min_size=1, max_size=60))
def test_a_log_may_be_cut_anywhere(block, samples):
    phi, c = (np.array([s[i] for s in samples]) for i in (0, 1))
    use = np.array([s[2] for s in samples])
    inside, region = covered(phi, c, use, block)
    np.testing.assert_array_equal(inside, told_by_hand(phi, c, use))
    assert region.samples == use.sum()
    if use.any():
        assert region.whole().phi == (phi[use].min(), phi[use].max())
        assert region.whole().c == (c[use].min(), c[use].max())
