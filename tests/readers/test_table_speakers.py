"""Long tables, in which the rows of several joints alternate."""

from __future__ import annotations

import numpy as np
import pytest

from vsalog.readers import read

N = 400


def long_table(path, column, names, stamp, header="time"):
    rows = [(stamp(i), names[i % len(names)], 1000 * (i % len(names)) + i // len(names)) for i in range(N)]
    path.write_text(f"{header},{column},pos\n" + "".join(f"{t},{name},{pos}\n" for t, name, pos in rows))
    return read(path)


@pytest.mark.parametrize(
    ("column", "names"), [("joint", ["a", "b"]), ("motor_id", ["1", "2", "3", "4"]), ("label", ["x y", "b"])]
)
@pytest.mark.parametrize("together", [True, False])
def test_each_has_a_stream_of_its_own(tmp_path, column, names, together):
    """Read as one signal they would jump to and fro, or all but one be dropped as duplicates."""
    count = len(names)
    log = long_table(tmp_path / "log.csv", column, names, lambda i: i // count / 100 if together else i / 1000)
    assert list(log.channels) == [f"pos[{name}]" for name in names]
    for k, name in enumerate(names):
        np.testing.assert_array_equal(log.channels[f"pos[{name}]"].values, 1000 * k + np.arange(N // count))
        begin = 0 if together else k * 10**6
        assert log.channels[f"pos[{name}]"].stamps[0] == begin
    assert any(f"column '{column}' says whose values a row holds" in note for note in log.notes)


def test_one_channel_can_be_wanted(tmp_path):
    long_table(tmp_path / "log.csv", "joint", ["a", "b"], lambda i: i // 2 / 100)
    log = read(tmp_path / "log.csv", ["pos[b]"])
    assert list(log.channels) == ["pos[b]"]


def test_each_clock_begins_anew_at_midnight_by_itself(tmp_path):
    def stamp(i):
        seconds = 86_399 + i // 2 / 100
        return f"{int(seconds // 3600) % 24:02d}:{int(seconds // 60) % 60:02d}:{seconds % 60:06.3f}"

    log = long_table(tmp_path / "log.csv", "joint", ["a", "b"], stamp)
    for channel in log.channels.values():
        assert channel.stamps[-1] - channel.stamps[0] == pytest.approx((N // 2 - 1) * 10**7, abs=10**6)


@pytest.mark.parametrize("column", ["mode", "joint"])
def test_words_that_stay_for_long_name_nobody(tmp_path, column):
    """They say what the machine was doing; so do those of each row at random."""
    rows = "".join(f"{i / 100},{'idle' if i % 100 < 50 else 'run'},{i}\n" for i in range(N))
    (tmp_path / "log.csv").write_text(f"time,{column},pos\n{rows}")
    assert list(read(tmp_path / "log.csv").channels) == ["pos"]


def test_a_number_that_alternates_is_a_signal(tmp_path):
    rows = "".join(f"{i / 100},{i % 2},{i}\n" for i in range(N))
    (tmp_path / "log.csv").write_text(f"time,watchdog,pos\n{rows}")
    assert list(read(tmp_path / "log.csv").channels) == ["watchdog", "pos"]
