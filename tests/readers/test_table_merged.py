"""Tables that several logs were merged into: each fills its own rows and leaves the others' blank."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from finding_codes import codes, values_of

from vsalog.readers import read

MS = 10**6
POS = np.arange(600.0)
TIMES, VALUES = {"pos": 10 * np.arange(600)}, {"pos": POS}


@pytest.fixture(params=["csv", "parquet", "parquet with NaN"])
def joined(request, tmp_path):
    """Read tables of times [ms] and columns below one another."""

    def joined(*tables):
        names = list(dict.fromkeys(name for table in tables for name in table))
        blanks = [np.full(len(table["time [ms]"]), np.nan) for table in tables]
        columns = {n: np.concatenate([t.get(n, b) for t, b in zip(tables, blanks, strict=True)]) for n in names}
        if request.param == "csv":
            rows = zip(*(column.tolist() for column in columns.values()), strict=True)
            lines = (",".join("" if cell != cell else f"{cell}" for cell in row) for row in rows)
            (tmp_path / "log").write_text("\n".join([",".join(names), *lines]) + "\n")
        else:
            columns = {n: pa.array(c, from_pandas=request.param == "parquet") for n, c in columns.items()}
            pq.write_table(pa.table(columns), tmp_path / "log")
        return read(tmp_path / "log")

    return joined


def table(name, **others):
    return {"time [ms]": TIMES[name], name: VALUES[name], **others}


def check(recording, name):
    assert recording.channel(name).values.tolist() == VALUES[name].tolist()
    assert recording.channel(name).stamps.tolist() == (TIMES[name] * MS).tolist()
    dropped = {"recording.copies_dropped", "recording.conflicts_dropped"}
    assert not (dropped | {"clock.restarts", "clock.log_appended"}) & {*codes(recording)}


def test_rows_that_take_turns_keep_the_values_of_either(joined):
    """Once they were sorted by time, rows of one time are those of both."""
    rows = {"time [ms]": 10 * np.repeat(np.arange(600), 2)}
    rows["pos"] = np.where(np.arange(1200) % 2 == 0, np.repeat(POS, 2), np.nan)
    rows["tau"] = np.where(np.arange(1200) % 2 == 1, np.repeat(POS, 2), np.nan)
    recording = joined(rows)
    check(recording, "pos")
    assert recording.channel("tau").values.tolist() == POS.tolist()
    assert recording.channel("tau").stamps.tolist() == (TIMES["pos"] * MS).tolist()


def test_a_sensor_that_begins_late_is_of_the_same_table(joined):
    late = np.where(np.arange(600) < 300, np.nan, POS)
    recording = joined(table("pos", late=late))
    check(recording, "pos")
    assert np.array_equal(recording.channel("late").values, late, equal_nan=True)
    assert recording.findings == ()


def test_the_same_columns_once_more_are_put_behind(joined):
    recording = joined(table("pos", empty=np.full(600, np.nan)), table("pos", empty=np.full(600, np.nan)))
    assert recording.channel("pos").values.tolist() == [*POS, *POS]
    assert (np.diff(recording.channel("pos").stamps) > 0).all()
    assert values_of(recording, "clock.log_appended") == [1]
