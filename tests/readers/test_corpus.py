"""Files of others that readers once did not read: what can be read of them is, and no error is vsalog's own."""

import os
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from finding_codes import codes, values_of
from scipy.io import savemat

from vsalog.core.errors import ReadError
from vsalog.readers import read
from vsalog.readers.reading import open_reader

CORPUS = Path(__file__).parent / "corpus"


@pytest.mark.parametrize(
    ("name", "channels", "told"),
    [
        ("empty_group_test", ["id", "optional_data"], []),
        ("latin1_time", ["x"], ["clock.times_unreadable"]),
        ("parquet_column_num_values_mismatch", ["x", "n"], ["recording.column_damaged"]),
        ("text_is_no_utf8", [], []),
    ],
)
def test_what_can_be_read_is(name, channels, told):
    log = read(CORPUS / f"{name}.parquet")
    assert list(log.channels) == channels
    assert [code for code in codes(log) if code in told] == told


def test_what_cannot_be_read_is_refused():
    with pytest.raises(ReadError, match="'b'"):
        read(CORPUS / "column_path_is_a_number.parquet", rate=100.0)


def test_numbers_of_many_digits_are_read_at_once(tmp_path):
    """The square of their number of digits would take minutes."""
    path = tmp_path / "digits.csv"
    path.write_text("time [s],x\n" + "".join(f"{k},{'7' * 20_000}\n" for k in range(40)), encoding="utf-8")
    assert list(read(path).channels) == ["x"]


@pytest.mark.parametrize("line", [f"t:301{' ' * 2**20}x:1", f"t{' ' * 2**20}", f"t:301,x:{' ' * 2**20}y"])
def test_blanks_within_a_line_are_passed_over_at_once(tmp_path, line):
    """The square of their number would take minutes."""
    path = tmp_path / "log.txt"
    path.write_text("".join(f"t:{k / 100},x:{k}\n" for k in range(300)) + line + "\n", encoding="utf-8")
    np.testing.assert_array_equal(read(path).channel("x").values[:300], np.arange(300.0))


@pytest.mark.parametrize("line", ["# paused", "# x,time", "time,x", "y,z"])
def test_lines_of_words_are_passed_over_however_many_they_are(tmp_path, line):
    path = tmp_path / "log.csv"
    rows = "".join(f"{k / 100},{k}\n" for k in range(300))
    path.write_text("time,x\n" + rows + (line + "\n") * 20_000, encoding="utf-8")
    log = read(path)
    np.testing.assert_array_equal(log.channel("x").values, np.arange(300.0))
    if line == "# paused":
        assert values_of(log, "table.remarks") == [20_000]


def test_a_table_may_become_shorter_while_it_is_read(tmp_path):
    """As where its writer begins again; the process would die of a file that is mapped."""
    path = tmp_path / "log.csv"
    rows = "".join(f"{k / 1000},{k}\n" for k in range(1_000_000))
    path.write_text("time [s],x\n" + rows, encoding="utf-8")
    blocks = open_reader(path).blocks({"x"})
    values = [next(blocks).columns["x"]]
    os.truncate(path, 2**20)
    values += [block.columns["x"] for block in blocks]
    read = np.concatenate(values)
    assert 1000 < read.size <= 1_000_000
    np.testing.assert_array_equal(read[:-1], np.arange(read.size - 1))


@pytest.mark.parametrize("where", ["scipy/io/matlab/tests/data/*.mat", "pyarrow/tests/data/parquet/*.parquet"])
def test_what_libraries_test_themselves_with_is_read_or_refused(where):
    """Where they are installed with their tests."""
    files = sorted(Path(np.__file__).parents[1].glob(where))
    for file in files:
        with suppress(ReadError):
            read(file)


def test_two_fields_of_one_name(tmp_path):
    """As scipy's tests/data/nasty_duplicate_fieldnames.mat: the second one has another name."""
    savemat(
        tmp_path / "log",
        {"s": {"time": np.arange(5) / 10, "xa": np.arange(5.0), "xb": np.arange(5.0)}},
        appendmat=False,
    )
    raw = (tmp_path / "log").read_bytes().replace(b"xb\0", b"xa\0")
    (tmp_path / "log").write_bytes(raw)
    assert len(read(tmp_path / "log").channels) == 2
