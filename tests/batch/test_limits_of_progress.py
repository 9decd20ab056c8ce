"""How often a batch without a terminal says how far it is."""

import pytest

from vsalog.report import progress


@pytest.mark.parametrize(("seconds", "lines"), [(20.0, 0), (40.0, 1)])
def test_a_line_is_printed_after_half_a_minute(monkeypatch, capsys, seconds, lines):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    shown = progress.BatchProgress()
    shown.begin([1, 1])
    now[0] = seconds
    shown.add(1, False, "")
    assert len(capsys.readouterr().err.splitlines()) == lines


def test_what_is_left_shrinks_while_something_is_under_way(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    shown = progress.BatchProgress("item")
    shown.begin([1000, 1000])
    now[0] = 10.0
    shown.add(1000, False, "")
    for seconds, left in ((10.0, "10 s left"), (14.0, "6 s left"), (30.0, "0 s left")):
        now[0] = seconds
        shown.now("the second")
        assert left in shown._words()
        assert shown._words().endswith("the second")
