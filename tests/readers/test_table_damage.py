"""Text tables of which bytes have changed, or that were cut off: what is damaged is local, or it is reported."""

from __future__ import annotations

import gzip
import os
import zlib
from contextlib import suppress

import numpy as np
import pytest
from finding_codes import codes

from vsalog.core.errors import ReadError
from vsalog.readers import read
from vsalog.readers.tables.source import open_text, read_beginning

pytestmark = pytest.mark.share(2)

ROWS = 300
PLACES = int(os.environ.get("VSALOG_DAMAGE_PLACES", "30"))


def text(separator, comma, quoted):
    rng = np.random.default_rng(7)
    x, y = rng.standard_normal(ROWS), np.round(rng.standard_normal(ROWS), 4)
    lines = [["time [s]", "x [rad]", "y"]]
    lines += [[f"{i}.125", repr(a), repr(b)] for i, (a, b) in enumerate(zip(x.tolist(), y.tolist(), strict=True))]
    if comma:
        lines = [[cell.replace(".", ",") for cell in line] for line in lines]
    if quoted:
        lines = [[f'"{cell}"' for cell in line] for line in lines]
    return "".join(separator.join(line) + "\n" for line in lines).encode()


def samples(path):
    recording = read(path)
    found = {
        name: dict(zip(c.stamps.tolist(), c.values.tolist(), strict=True)) for name, c in recording.channels.items()
    }
    return found, [one.code for one in recording.findings]


def wrong(found, sound):
    """Return how many samples, NaN aside, are others than the log's."""
    return sum(
        not np.isnan(value) and sound[name].get(stamp) != value
        for name in found.keys() & sound.keys()
        for stamp, value in found[name].items()
    )


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("separator", "comma", "quoted"), [(",", False, False), (";", True, False), (",", True, True), (" ", False, False)]
)
def test_a_changed_byte_changes_one_row(tmp_path, separator, comma, quoted):
    """Text has no checksum: a digit may become another. It must not touch any other row."""
    raw = text(separator, comma, quoted)
    path = tmp_path / "log"
    path.write_bytes(raw)
    sound, said = samples(path)
    assert [len(values) for values in sound.values()] == [ROWS, ROWS]
    rng = np.random.default_rng(3)
    header = raw.index(b"\n") + 1
    for place in rng.integers(header, len(raw), PLACES).tolist():
        bad = bytearray(raw)
        bad[place] ^= int(rng.integers(1, 256))
        path.write_bytes(bad)
        found, said = samples(path)
        assert found.keys() == sound.keys(), place
        assert wrong(found, sound) <= 2, place
        lost = max(ROWS - len(values) for values in found.values())
        # Line ends may be quoted: the row in which a quote is missing runs on to the next quote, which is reported.
        assert lost <= 3 or {"table.stray_quotes", "table.lines_skipped"} & {*said}, place
        assert lost == 0 or said, place


def test_of_a_table_that_was_cut_off_all_whole_rows_are_read(tmp_path):
    raw = text(",", False, False)
    path = tmp_path / "log"
    path.write_bytes(raw)
    sound, _ = samples(path)
    for end in np.random.default_rng(4).integers(400, len(raw), PLACES).tolist():
        path.write_bytes(raw[:end])
        found, _ = samples(path)
        whole = raw[:end].count(b"\n") - 1
        for name, values in found.items():
            assert list(values.items())[:whole] == list(sound[name].items())[:whole]
            assert len(values) <= whole + 1


def ahead(bad):
    """Return what comes out of a compressed file ahead of its damage, byte by byte."""
    stream, out = zlib.decompressobj(31), b""
    with suppress(zlib.error):
        for byte in bad:
            out += stream.decompress(bytes([byte]))
    return out


@pytest.mark.every(2)
@pytest.mark.parametrize("cut", [False, True])
@pytest.mark.parametrize("separator", [",", " "])
def test_of_a_damaged_compressed_table_all_is_read_that_comes_out(tmp_path, cut, separator):
    plain = text(separator, False, False)
    raw = gzip.compress(plain)
    path = tmp_path / "log"
    path.write_bytes(raw)
    sound, said = samples(path)
    assert said == []
    rng = np.random.default_rng(5)
    for place in rng.integers(10, len(raw), 100).tolist():  # not the head, whose name and time have no checksum
        bad = bytearray(raw)
        if cut:
            del bad[place:]
        else:
            bad[place] ^= int(rng.integers(1, 256))
        path.write_bytes(bad)
        out = ahead(bad)
        rows = out.count(b"\n") - 1
        with open_text(path) as file:
            assert read_beginning(file, 2**20) == out
        try:
            found, said = samples(path)
        except ReadError:
            assert rows < 3 or not cut  # what comes out changed may be no table
            continue
        assert any(code.startswith("compressed.") for code in said), place
        if cut:
            assert [len(values) for values in found.values()] == [rows, rows]
            assert not wrong(found, sound)


def test_a_compressed_file_of_several_parts_with_zeros_behind(tmp_path):
    raw, path = text(",", False, False), tmp_path / "log"
    parts = raw[:1000], raw[1000:1001], b"", raw[1001:]
    path.write_bytes(b"".join(map(gzip.compress, parts)) + bytes(100_000))
    found, said = samples(path)
    path.write_bytes(raw)
    assert said == []
    assert found == samples(path)[0]
    path.write_bytes(gzip.compress(raw) + b"no more")
    damaged, said = samples(path)
    assert damaged == found
    assert any(code.startswith("compressed.") for code in said)


def test_nothing_is_read_behind_a_changed_byte_of_a_compressed_table(tmp_path):
    """From there on what comes out of it is made up of pieces of other rows."""
    lines = [f"{i / 100:.3f},{np.sin(i / 50):.4f},{i}" for i in range(20_000)]
    raw = bytearray(gzip.compress("\n".join(["time,pos,tau", *lines, ""]).encode(), mtime=0))
    path = tmp_path / "log.csv.gz"
    cut = 0
    for place in range(len(raw) // 4, len(raw) - 16, len(raw) // 9):
        changed = raw.copy()
        changed[place] ^= 4
        path.write_bytes(changed)
        log = read(path)
        pos = log.channels["pos"]
        assert np.nanmax(np.abs(pos.values)) <= 9.9999
        assert pos.stamps[-1] <= 200 * 10**9
        cut += bool({"compressed.rows_left_out", "compressed.rows_doubtful"} & {*codes(log)})
        assert any(code.startswith("compressed.") for code in codes(log))
    assert cut > 1


def test_an_odd_line_of_a_sound_compressed_table_ends_nothing(tmp_path):
    lines = [f"{i / 100:.3f},{i}" for i in range(2000)]
    lines[1000] = "10.000,5,7,8"
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress("\n".join(["time,pos", *lines, ""]).encode()))
    assert len(read(path).channels["pos"].values) == 1999


@pytest.mark.parametrize(("end", "rows"), [("5.0,1.2", 50), ("5.0,", 50), ("5.0,1.2500", 51), ("5.0,1.2\n", 51)])
def test_a_last_number_that_was_cut_off_is_left_out(tmp_path, end, rows):
    """1.2 would be no wonder, but all others have four decimals, and lines have ends."""
    path = tmp_path / "log.csv"
    path.write_text("time,pos\n" + "".join(f"{i / 10},{i / 16:.4f}\n" for i in range(50)) + end)
    log = read(path)
    assert len(log.channels["pos"].values) == rows
    assert ("table.last_line_left_out" in codes(log)) == (rows == 50)


def test_a_last_line_without_end_stays_where_numbers_are_of_any_length(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,pos\n" + "\n".join(f"{i / 10},{i}" for i in range(52)))
    assert len(read(path).channels["pos"].values) == 52


@pytest.mark.parametrize("hole", [300, 5000])
def test_a_hole_of_zeros_costs_a_line(tmp_path, hole):
    """Power failed while blocks of the file were not yet written."""
    path = tmp_path / "log.csv"
    text = "time,pos\n" + "".join(f"{i / 10},{i}\n" for i in range(200))
    path.write_bytes(text[:700].encode() + bytes(hole) + text[700:].encode())
    assert len(read(path).channels["pos"].values) == 199


@pytest.mark.parametrize(
    ("cells", "last", "whole"),
    [
        ([0.1234567, 0.25, 2.5, 12.0, 1e-3], "0.5", False),  # or 0.5123
        ([0.1234567, 0.25, 2.5], "0.7654321", True),
        ([0.1234567, 0.25, 2.5], "1.12345678", True),
        ([1e-5, 0.5, 2.5], "1.2345", False),  # or 1.2345e-05
        ([998, 999, 1000], "1001", True),
        ([998, 999, 1000], "10", False),
        ([0, 1], "1", True),
        ([0, 1, 10], "1", False),
        ([0.5, -1.25, 3.0], "-", False),
        (["up", "up", "down"], "do", False),
        (["0,25", "0,5", "1,125"], "0,375", True),
        (["0,25", "0,5", "1,125"], "0,37", False),
        (["1.2345", "12.3456", "3.4567"], "12.345", False),
        (["1.50e+00", "2.75e-01"], "3.25e-0", False),
        (["1.50e+00", "2.75e-01"], "3.25e-02", True),
    ],
)
@pytest.mark.parametrize("kind", ["plain", "gz", "latin-1", "blanks"])
def test_a_last_line_without_end_is_whole_where_its_last_number_cannot_be_longer(tmp_path, cells, last, whole, kind):
    """A row that is left out is one sample, half a number is another one; those of programs that end no last line mostly stay."""
    separator = " " if kind == "blanks" else ";"
    rows = [separator.join(map(str, (k / 4, -7, cells[k % len(cells)]))) for k in range(60)]
    text = "\n".join(
        [separator.join(["time", "q", "µ" if kind == "latin-1" else "x"]), *rows, separator.join(["15.0", "8", last])]
    )
    data = text.encode("latin-1" if kind == "latin-1" else "utf-8")
    (tmp_path / "log.csv").write_bytes(gzip.compress(data) if kind == "gz" else data)
    log = read(tmp_path / "log.csv")
    assert len(log.channel("q").values) == 60 + whole
    assert ("table.last_line_left_out" in codes(log)) != whole


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("cut", [b"9.9,\xc3", b"9\xc3", b"\xc3", b"9.9,7,\xe2\x82"])
@pytest.mark.parametrize("below", [b"", b"\n99.0,7,word\n"])
def test_a_row_that_ends_within_a_letter_is_left_out(tmp_path, cut, below):
    """And one like it amid the others, where two programs wrote into one file."""
    rows = "time,x,remark\n" + "".join(f"{i / 10},{i},Zähler{i}\n" for i in range(90))
    (tmp_path / "log").write_bytes(rows.encode() + cut + below)
    log = read(tmp_path / "log")
    assert log.channel("x").values.tolist()[:90] == list(range(90))
    assert not below or log.channel("x").stamps[-1] == 99 * 10**9
    assert len(log.findings) == (1 if len(cut) < 6 or not below else 0)


@pytest.mark.parametrize("changed", [False, True])
def test_a_compressed_log_without_its_end(tmp_path, changed):
    """Its end would tell of bytes that have changed: from the first row on that does not fit, rows may be made up."""
    rng = np.random.default_rng(5)
    numbers = rng.standard_normal(20_000)
    rows = "".join(f"{i / 1000:.3f},{x:.6f},{i}\n" for i, x in enumerate(numbers.tolist()))
    packed = gzip.compress(f"time,x,number\n{rows}".encode())
    for _ in range(10):
        end = int(rng.integers(len(packed) // 2, len(packed) - 10))
        data = bytearray(packed[:end])
        if changed:
            data[end - int(rng.integers(5000, 20_000))] ^= 1 << int(rng.integers(8))
        (tmp_path / "log").write_bytes(data)
        log = read(tmp_path / "log")
        found = log.channel("number")
        others = int(np.count_nonzero(found.stamps != found.values * 10**6))
        assert others <= 5 * changed
        assert {"compressed.truncated", "compressed.rows_doubtful"} & {*codes(log)}
        assert changed or found.values.size > 0.98 * 20_000 * end / len(packed)
