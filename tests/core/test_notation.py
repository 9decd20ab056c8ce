"""Numbers for people."""

import pytest

from vsalog.core.notation import digits_apart, number


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (149.997, 150.002, ("149.997", "150.002")),
        (1.0, 2.0, ("1", "2")),
        (0.79987, 0.79991, ("0.79987", "0.79991")),
        (5.0, 5.0, ("5", "5")),
        (0.0, float("inf"), ("0", "–")),
    ],
)
def test_the_ends_of_an_interval_can_be_told_apart(low, high, shown):
    digits = digits_apart(low, high)
    assert (number(low, digits), number(high, digits)) == shown
