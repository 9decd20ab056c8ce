"""Quotes in text tables whose first rows have none."""

from __future__ import annotations

import numpy as np

from vsalog.readers import read

ROWS = 3000


def write(path, header, cell):
    lines = [header, *(f"{i / 1000:.3f},{cell(i)},{i % 7}" for i in range(ROWS))]
    path.write_text("\n".join([*lines, ""]))
    return path


def thousands(i):
    return f'"{i:,}"' if i >= 1000 else str(i)


def test_a_comma_in_quotes_is_no_thousand_among_fractions(tmp_path):
    log = read(write(tmp_path / "log.csv", "time,pos,tau", lambda i: '"1,500"' if i == 2000 else f"{i}.25"))
    assert np.isnan(log.channels["pos"].values[2000])
    assert len(log.channels["tau"].values) == ROWS


def test_a_stray_quote_swallows_no_lines(tmp_path):
    log = read(write(tmp_path / "log.csv", "time,pos,tau", lambda i: f'"{i}' if i in (1000, 2500) else str(i)))
    assert len(log.channels["tau"].values) >= ROWS - 2
