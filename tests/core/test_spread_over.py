"""Samples spread over a log: at most 2¹⁸ or up to twice as many, from its beginning to its end."""

import numpy as np
import pytest

from vsalog.core.resolution import spread_over


@pytest.mark.parametrize(("count", "step"), [(1000, 1), (2**18, 1), (2**19 - 1, 1), (2**19, 2), (2**20, 4)])
def test_a_longer_signal_is_thinned(count, step):
    found = spread_over(np.arange(float(count)))
    assert found[1] == step
    assert found[-1] >= count - step
