"""By how much numbers change together that a log tells in combination only."""

from types import SimpleNamespace

import numpy as np
import pytest

from vsalog.identification.identifiability import combinations


def unknown(deviation, low):
    """A number that is its unknown times a deviation, from a lower end of the unknown on."""
    return SimpleNamespace(
        value=lambda x: 3.0 + deviation * x, slope=lambda x: deviation, bounds=(low, np.inf), usual=lambda x: 1.0
    )


@pytest.mark.parametrize("end", [-1e9, -3.0 / 0.5])
def test_a_number_at_the_end_of_its_range_changes_by_a_part_of_its_interval(end):
    """Two unknowns with a correlation near one, both as uncertain as before the log: they change by the same."""
    first, second = unknown(1.0, -1e9), unknown(0.5, end)
    at_end = end > -1e6
    fit = SimpleNamespace(
        unknowns=(first, second),
        values=np.array([0.0, -6.0 if at_end else 2.0]),
        covariance=np.array([[1.0, 0.999], [0.999, 1.0]]),
        information=1e3 * np.eye(2),
        half_widths=np.array([2.0, 2.0]),
    )
    ((members, changes),) = combinations(fit)
    # By 1 % of 3 is by 0.03 of an unknown; that is 0.015 of the second number, which is 4, or has a half-width of 1.
    wanted = 1.5 if at_end else 0.015 / 4.0 * 100.0
    assert dict(zip(members, changes, strict=True))[1] / dict(zip(members, changes, strict=True))[0] == pytest.approx(
        wanted
    )
