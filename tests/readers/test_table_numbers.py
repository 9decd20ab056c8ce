"""Numbers in tables as spreadsheets, old programs and people write them: thousands, decimal commas, units behind them."""

from __future__ import annotations

import csv
import io
import random

import pytest
from finding_codes import codes, found

from vsalog.readers import read

S = 10**9
NUMBERS = [0.5, 2037.0, -12345.25, 1.0, 999.875, 1234567.5, -4.0, 20480.0, 3.125]


@pytest.fixture
def table(tmp_path):
    """Read a text as a table."""

    def table(text):
        path = tmp_path / "log.csv"
        path.write_text(text, encoding="utf-8")
        return read(path)

    return table


def written(rows, separator):
    out = io.StringIO()
    csv.writer(out, delimiter=separator, lineterminator="\n").writerows(rows)
    return out.getvalue()


def grouped(number, apart, mark):
    """Write a number by Python's own grouping, with other signs."""
    text = f"{number:,.3f}".rstrip("0").removesuffix(".")
    return text.translate({ord(","): apart, ord("."): mark})


@pytest.mark.parametrize(
    ("apart", "mark"), [(".", ","), (",", "."), ("'", "."), ("’", ","), (" ", ","), ("\u00a0", ","), ("\u202f", ".")]
)
@pytest.mark.parametrize("separator", [";", ",", "\t"])
def test_thousands_in_any_notation(table, apart, mark, separator):
    rows = [[f"0{mark}{i + 1}", grouped(number, apart, mark)] for i, number in enumerate(NUMBERS)]
    recording = table(written([["time", "x"], *rows], separator))
    assert recording.channel("x").values.tolist() == NUMBERS
    assert recording.channel("x").stamps.tolist() == [(i + 1) * S // 10 for i in range(len(NUMBERS))]


def marks_in(recording):
    found_marks = found(recording, "table.marks_in_numbers")
    return [(one.part, *(one.evidence[name] for name in ("mark", "cell", "read_as"))) for one in found_marks]


@pytest.mark.parametrize(("apart", "mark"), [(".", ","), (",", ".")])
def test_whole_thousands_are_told_by_the_columns_beside_them(table, apart, mark):
    """2.037 is 2037 where all else has decimal commas, and 2,037 is where all else has points."""
    numbers = [2000 + 37 * i for i in range(9)]
    rows = [[f"0{mark}{i}", grouped(n, apart, mark), f"{i}{mark}25"] for i, n in enumerate(numbers)]
    recording = table(written([["time", "a", "b"], *rows], ";"))
    assert recording.channel("a").values.tolist() == numbers
    assert recording.channel("b").values.tolist() == [i + 0.25 for i in range(9)]
    assert recording.channel("a").stamps.tolist() == [i * S // 10 for i in range(9)]
    assert marks_in(recording) == [("a", apart, f"2{apart}000", "setting thousands apart")]


def test_thousands_that_come_late_in_a_column_of_a_table_with_decimal_commas(table):
    text = "time;a\n" + "".join(f"{i},5;{i * 3:,}\n".replace(",", ".").replace(".5;", ",5;") for i in range(1000))
    recording = table(text)
    assert recording.channel("a").values.tolist() == [3 * i for i in range(1000)]
    assert marks_in(recording) == [("a", ".", "1.002", "setting thousands apart")]


def test_points_instead_of_decimal_commas_are_no_thousands(table):
    """Where all numbers have decimals, 100.000 is 100: the clock would jump a thousandfold."""
    times = [f"{i / 10:.3f}".replace(".", "," if i < 600 else ".") for i in range(1200)]
    recording = table("time;a\n" + "".join(f"{time};{i}\n" for i, time in enumerate(times)))
    assert recording.channel("a").stamps.tolist() == [i * S // 10 for i in range(1200)]
    assert marks_in(recording) == [("time", ".", "60.000", "a decimal mark, for every number ahead has one")]


def test_a_column_with_points_in_a_table_with_commas(table):
    """Three digits behind a zero are no thousands."""
    text = "time;a;b\n" + "".join(f"{i},5;0.{125 + i};{i},25\n" for i in range(9))
    recording = table(text)
    assert recording.channel("a").values.tolist() == [float(f"0.{125 + i}") for i in range(9)]
    assert recording.channel("b").values.tolist() == [i + 0.25 for i in range(9)]
    assert "table.mixed_decimal_marks" in codes(recording)


def test_three_decimals_where_nothing_tells(table):
    recording = table("time;a\n" + "".join(f"{i};1,{234 + i}\n" for i in range(9)))
    assert recording.channel("a").values.tolist() == [float(f"1.{234 + i}") for i in range(9)]
    assert "table.decimal_commas" in codes(recording)


@pytest.mark.parametrize(
    ("unit", "gap"), [("Nm", " "), ("rad", ""), ("°", ""), ("%", " "), ("m/s^2", " "), ("N·m", "\u00a0")]
)
@pytest.mark.parametrize("mark", [".", ","])
def test_units_behind_numbers(table, unit, gap, mark):
    texts = [f"{number}{gap}{unit}" for number in ["-1.5e3", *(f"{i}.5" for i in range(299))]]
    rows = "".join(f"{i / 100:.2f} s;{text}\n" for i, text in enumerate(texts))
    recording = table("time;x\n" + rows.replace(".", mark))
    channel = recording.channel("x")
    assert channel.unit == unit
    assert channel.values.tolist() == [-1500, *(i + 0.5 for i in range(299))]
    assert channel.stamps.tolist() == [i * S // 100 for i in range(300)]
    units = [(one.part, one.evidence["cells"]) for one in found(recording, "table.unit_in_cells")]
    assert units == [("time", "s"), ("x", unit)]


def test_the_unit_of_the_cells_is_nearer_than_the_headers(table):
    recording = table("time [s],x [Nm]\n" + "".join(f"0.{i},{i} mNm\n" for i in range(1, 9)))
    assert recording.channel("x").unit == "mNm"
    assert [one.evidence["header"] for one in found(recording, "table.unit_in_cells")] == ["'Nm'"]
    assert table("time [s],x [Nm]\n" + "".join(f"0.{i},{i} Nm\n" for i in range(1, 9))).findings == ()


def test_units_that_differ_make_no_signal(table):
    recording = table("time,x,y\n" + "".join(f"0.{i},{i} {'rad' if i % 2 else 'deg'},{i}\n" for i in range(1, 9)))
    assert list(recording.channels) == ["y"]
    assert recording.unread["x"] == "its numbers have units that are not all the same: 'rad', 'deg'"


def test_another_unit_far_down_is_no_number(table):
    rows = [f"{i}.5,{i} Nm\n" for i in range(400)]
    rows[300] = "300.5,300 mNm\n"
    recording = table("time,x\n" + "".join(rows))
    values = recording.channel("x").values
    assert values[299:302].tolist() == pytest.approx([299, float("nan"), 301], nan_ok=True)
    assert found(recording, "table.cells_without_number")[0].evidence["first"].startswith("300 m")


def test_one_cell_with_a_unit_is_a_damaged_one(table):
    rows = [f"{i}.5,{i}\n" for i in range(50)]
    rows[20] = "20.5,20 m\n"
    recording = table("time,x\n" + "".join(rows))
    assert recording.channel("x").unit is None
    assert recording.channel("x").values[19:22].tolist() == pytest.approx([19, float("nan"), 21], nan_ok=True)


def test_exponents_of_fortran_and_minus_signs_that_are_no_hyphens(table):
    values = [random.Random(i).uniform(-1e3, 1e3) for i in range(9)]
    rows = "".join(f"  0.{i}D+00  {v:.17E}  {v:+.3f}\n" for i, v in enumerate(values))
    recording = table("  time  x  y\n" + rows.replace("E", "D").replace("-", "−").replace("D−", "D-"))
    assert recording.channel("x").values.tolist() == values
    assert recording.channel("y").values.tolist() == [round(v, 3) for v in values]
    assert recording.channel("x").stamps.tolist() == [i * S // 10 for i in range(9)]


def test_decimal_commas_between_blanks(table):
    recording = table("time x y\n" + "".join(f"0,{i} {100 + i},5 -1,{i}\n" for i in range(9)))
    assert recording.channel("x").values.tolist() == [100.5 + i for i in range(9)]
    assert recording.channel("y").values.tolist() == [-float(f"1.{i}") for i in range(9)]
    assert recording.channel("x").stamps.tolist() == [i * S // 10 for i in range(9)]


def test_whole_numbers_beyond_53_bits_are_told(table):
    recording = table("time,enc,large\n" + "".join(f"{i / 10},{2**60 + i},1.5e300\n" for i in range(50)))
    (rounded,) = recording.findings
    assert (rounded.code, rounded.part) == ("table.numbers_rounded", "enc")
    assert rounded.evidence["number"] == str(2**60 + 1)
