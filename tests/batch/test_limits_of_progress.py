"""How often a batch without a terminal says how far it is."""

import pytest

from vsalog.batch import progress
from vsalog.batch.records import Answer, Log


@pytest.mark.parametrize(("seconds", "lines"), [(20.0, 0), (40.0, 1)])
def test_a_line_is_printed_after_half_a_minute(monkeypatch, capsys, seconds, lines):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    logs = [Log(name=f"{k}.csv", where=b"", size=1) for k in range(2)]
    shown = progress.Shown()
    shown.begin(logs)
    now[0] = seconds
    shown.add(logs[0], Answer())
    assert len(capsys.readouterr().err.splitlines()) == lines
