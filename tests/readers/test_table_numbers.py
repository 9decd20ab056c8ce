"""Numbers in tables: decimal commas, damaged cells, whole numbers that are too large."""

from __future__ import annotations

import pytest
from finding_codes import codes

from vsalog.readers import read

S = 10**9


@pytest.fixture
def table(tmp_path):
    """Read a text as a table."""

    def table(text):
        path = tmp_path / "log.csv"
        path.write_text(text, encoding="utf-8")
        return read(path)

    return table


def test_three_decimals_where_nothing_tells(table):
    recording = table("time;a\n" + "".join(f"{i};1,{234 + i}\n" for i in range(9)))
    assert recording.channel("a").values.tolist() == [float(f"1.{234 + i}") for i in range(9)]
    assert "table.decimal_commas" in codes(recording)


def test_one_cell_with_a_unit_is_a_damaged_one(table):
    rows = [f"{i}.5,{i}\n" for i in range(50)]
    rows[20] = "20.5,20 m\n"
    recording = table("time,x\n" + "".join(rows))
    assert recording.channel("x").unit is None
    assert recording.channel("x").values[19:22].tolist() == pytest.approx([19, float("nan"), 21], nan_ok=True)


def test_decimal_commas_between_blanks(table):
    recording = table("time x y\n" + "".join(f"0,{i} {100 + i},5 -1,{i}\n" for i in range(9)))
    assert recording.channel("x").values.tolist() == [100.5 + i for i in range(9)]
    assert recording.channel("y").values.tolist() == [-float(f"1.{i}") for i in range(9)]
    assert recording.channel("x").stamps.tolist() == [i * S // 10 for i in range(9)]


def test_whole_numbers_beyond_53_bits_are_reported(table):
    recording = table("time,enc,large\n" + "".join(f"{i / 10},{2**60 + i},1.5e300\n" for i in range(50)))
    (rounded,) = recording.findings
    assert (rounded.code, rounded.part) == ("table.numbers_rounded", "enc")
    assert rounded.evidence["number"] == str(2**60 + 1)
