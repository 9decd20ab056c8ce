"""How a number of ours is told to be the printed one."""

import pytest

from vsalog.reproduce.rows import Row, Spread


@pytest.mark.parametrize(
    ("ours", "verdict"), [(99.2, "better"), (99.7, "as printed"), (100.3, "as printed"), (100.8, "worse")]
)
def test_what_differs_by_half_of_the_last_printed_digit_is_as_printed(ours, verdict):
    row = Row(item="x", paper="p", place="1", quantity="q", printed=100.0, ours=Spread(ours, ours, ours, 1))
    assert row.verdict == verdict
