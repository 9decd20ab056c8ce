"""Times in tables as people and programs write them, compared with Python's own dates."""

from __future__ import annotations

import re
from datetime import UTC, date, datetime, timedelta
from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path

import numpy as np
import pytest
from finding_codes import codes, values_of

from vsalog.readers import read

S = 10**9
BEGIN = datetime(2024, 3, 13, 23, 59, 57, 500_000, tzinfo=UTC)
STEP = timedelta(milliseconds=250)
ROWS = [BEGIN + i * STEP for i in range(20)]


def nanoseconds(moment):
    return ((moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1)) * 1000


@pytest.fixture
def table(tmp_path):
    """Read lines as a table."""

    def table(*lines, **options):
        path = tmp_path / "log.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return read(path, **options)

    return table


def stamps(recording, channel="x"):
    found = recording.channel(channel)
    assert found.values.tolist() == list(range(len(found.values))), "rows came into another order"
    return found.stamps.tolist()


def since_first(recording):
    found = stamps(recording)
    return [stamp - found[0] for stamp in found]


DATES = [
    "%m/%d/%Y",
    "%d/%m/%Y",
    "%d-%m-%Y",
    "%m/%d/%y",
    "%d/%m/%y",
    "%Y%m%d",
    "%d %b %Y",
    "%d-%b-%Y",
    "%B %d %Y",
    "%d.%m.%y",
    "%Y/%m/%d",
]
TIMES = ["%H:%M:%S.%f", "%I:%M:%S.%f %p", "%I:%M:%S.%f%p"]


@pytest.mark.every(4)
@pytest.mark.parametrize("date", DATES)
@pytest.mark.parametrize("time", TIMES)
@pytest.mark.parametrize("columns", [1, 2])
@pytest.mark.parametrize("padded", [True, False])
def test_dates_across_midnight(table, date, time, columns, padded):
    def cell(moment):
        written = moment.strftime(date), moment.strftime(time)
        if not padded:
            written = tuple(text.removeprefix("0").replace("/0", "/") for text in written)
        return (" " if columns == 1 else ";").join(written)

    header = "Timestamp;x" if columns == 1 else "Date;Time;x"
    recording = table(header, *(f"{cell(moment)};{i}" for i, moment in enumerate(ROWS)))
    assert stamps(recording) == [nanoseconds(moment) for moment in ROWS]
    assert recording.absolute_time
    assert recording.findings == ()


@pytest.mark.parametrize("time", ["%I:%M:%S %p", "%H:%M:%S", "%I:%M %p", "%m/%d/%Y %I:%M:%S %p", "%m/%d/%Y %H:%M"])
def test_times_without_fractions(table, time):
    rows = [BEGIN.replace(microsecond=0, second=0) + timedelta(minutes=i) for i in range(5)]
    written = [f"{moment.strftime(time).lower()},{i}" for i, moment in enumerate(rows)]
    assert since_first(table("time,x", *written)) == [60 * i * S for i in range(5)]


def noon(*hours):
    return [f"{'Time'},x", *(f"{hour},{i}" for i, hour in enumerate(hours))]


def test_noon_and_midnight_of_a_twelve_hour_clock(table):
    found = stamps(
        table(*noon("12:00:00 AM", "1:00:00 AM", "11:59:59 AM", "12:00:00 PM", "1:02:03 PM", "11:00:00 p.m."))
    )
    assert found == [0, 3600 * S, 43199 * S, 43200 * S, (13 * 3600 + 123) * S, 23 * 3600 * S]


@pytest.mark.parametrize(
    ("first", "second", "order", "month", "day"),
    [
        ("3/4/2024", "4/4/2024", "day, month, year", 4, 3),
        ("3/4/2024", "3/5/2024", "month, day, year", 3, 4),
        ("03-04-24", "03-05-24", "month, day, year", 3, 4),
        ("24-03-04", "24-03-05", "year, month, day", 3, 4),
    ],
)
def test_dates_that_could_be_read_in_two_ways_make_the_shortest_log(table, first, second, order, month, day):
    written = [f"{first if moment < ROWS[10] else second},{moment:%H:%M:%S.%f},{i}" for i, moment in enumerate(ROWS)]
    recording = table("Date,Time,x", *written)
    begin = nanoseconds(BEGIN.replace(month=month, day=day))
    assert stamps(recording) == [begin + i * S // 4 for i in range(20)]
    (found,) = (one for one in recording.findings if one.code.startswith("clock.date_order"))
    assert (found.evidence["example"], found.evidence["order"]) == (first, order)


@pytest.mark.parametrize(("written", "month", "day"), [("3/4/2024", 3, 4), ("3-4-2024", 4, 3)])
def test_a_single_date_that_nothing_decides_is_reported(table, written, month, day):
    recording = table("Date,Time,x", *(f"{written},12:00:0{i},{i}" for i in range(5)))
    noon = nanoseconds(datetime(2024, month, day, 12, tzinfo=UTC))
    assert stamps(recording) == [noon + i * S for i in range(5)]
    assert "clock.date_order_unknown" in codes(recording)


def test_a_date_far_behind_the_first_rows_decides(table):
    """The first rows are of 12 March or 3 December; only the next day, deep in the file, tells."""
    begin = datetime(2024, 3, 12, 22, tzinfo=UTC)
    rows = [begin + timedelta(seconds=12 * i) for i in range(1000)]
    recording = table("Date,Time,x", *(f"{m.day}/{m.month}/{m.year},{m:%H:%M:%S},{i}" for i, m in enumerate(rows)))
    assert stamps(recording) == [nanoseconds(moment) for moment in rows]
    assert recording.findings == ()


@pytest.mark.parametrize("date", ["week 11", "45364", "?"])
def test_a_date_that_cannot_be_read_is_reported_and_midnight_passes(table, date):
    recording = table("Date,Time,x", *(f"{date},{moment:%H:%M:%S.%f},{i}" for i, moment in enumerate(ROWS)))
    assert since_first(recording) == [i * S // 4 for i in range(20)]
    assert "clock.dates_unreadable" in codes(recording)
    assert values_of(recording, "clock.restarts") == [1]


def test_a_date_that_stays_that_of_the_begin(table):
    recording = table("Date,Time,x", *(f"2024-03-13,{moment:%H:%M:%S.%f},{i}" for i, moment in enumerate(ROWS)))
    assert stamps(recording) == [nanoseconds(moment) for moment in ROWS]
    assert values_of(recording, "clock.restarts") == [1]


def test_a_date_that_follows_a_sample_late(table):
    dates = [(moment - 2 * STEP).date() for moment in ROWS]
    rows = zip(dates, ROWS, strict=True)
    recording = table("Date,Time,x", *(f"{date},{moment:%H:%M:%S.%f},{i}" for i, (date, moment) in enumerate(rows)))
    assert stamps(recording) == [nanoseconds(moment) for moment in ROWS]


def test_midnights_far_apart_and_late_samples(table):
    """Three days at 40 s a row; around each midnight two samples come in the wrong order, which are sorted as ever."""
    rows = [BEGIN.replace(microsecond=0) + timedelta(seconds=40 * i) for i in range(6000)]
    written = [f"{moment:%H:%M:%S}" for moment in rows]
    falls = [i for i in range(1, 6000) if rows[i].day != rows[i - 1].day]
    for i in falls[1:]:
        written[i - 1], written[i] = written[i], written[i - 1]
    recording = table("time,x", *(f"{text},{i}" for i, text in enumerate(written)))
    found = recording.channel("x").stamps
    assert (found - found[0]).tolist() == [40 * i * S for i in range(6000)]
    assert recording.streams["log"].inversions == len(falls) - 1
    assert values_of(recording, "clock.restarts") == [len(falls)]


def test_a_sample_a_day_is_a_day_apart(table):
    """A step of a day undoes a midnight that was counted, and none was."""
    found = table("time,q\n" + "".join(f"2024-01-{day:02},{day * day % 7}\n" for day in range(1, 13)))
    np.testing.assert_array_equal(np.diff(found.channel("q").stamps), 86_400 * 10**9)


def test_a_gap_of_a_night_is_no_step_back(table):
    recording = table("time,x", *noon("01:00:00", "01:00:01", "23:30:00", "23:30:01")[1:])
    assert since_first(recording) == [0, S, 81_000 * S, 81_001 * S]


def test_minutes_and_seconds_as_spreadsheets_show_them(table):
    recording = table(
        "time,x", *(f"{(3599 + i // 2) // 60 % 60:02d}:{(59 + i // 2) % 60:02d}.{i % 2 * 5},{i}" for i in range(6))
    )
    assert since_first(recording) == [i * S // 2 for i in range(6)]
    assert "clock.minutes_and_seconds" in codes(recording)


def test_hours_beyond_a_day_and_before_the_begin(table):
    assert stamps(table(*noon("-00:00:01.5", "00:00:00", "100:00:00.25"))) == [-3 * S // 2, 0, 360_000 * S + S // 4]


@pytest.mark.parametrize(
    ("header", "unit"),
    [(h, u) for u, hs in {
        60: ["time [min]", "time (min)", "t [minutes]", "time_min", "minutes", "t (min)"],
        3600: ["t (h)", "time [h]", "hours", "Time (hours)", "elapsed_time_h"],
        86400: ["time [d]", "time_days"],
        1: ["seconds", "time [sec]"],
    }.items() for h in hs],
)  # fmt: skip
def test_a_time_in_any_unit(table, header, unit):
    recording = table(f"{header},x", *(f"{i / 8},{i}" for i in range(20)))
    assert stamps(recording) == [i * unit * S // 8 for i in range(20)]
    assert recording.findings == ()


UP = {"switched on": 0.0, "for minutes": 1200.0, "for hours": 18_000.0, "for days": 501_120.0, "today": 1.75e9}
"""How long before a log machines began to count [s]."""


@pytest.mark.parametrize("before", UP)
@pytest.mark.parametrize("rate", [100, 1000, 2000])
@pytest.mark.parametrize("unit", [1, 10**3, 10**6, 10**9])
def test_a_unit_is_guessed_by_size_and_steps(table, before, rate, unit):
    """The size of microseconds since some minutes ago is that of today in seconds."""
    times = [round((UP[before] + i / rate + 1e-4 * (i % 3)) * 10**6) for i in range(500)]
    lines = (f"{(Decimal(time) * unit / 10**6).normalize():f},{i}" for i, time in enumerate(times))
    recording = table("time,x", *lines)
    assert stamps(recording) == [time * 1000 for time in times]
    assert codes(recording) == ([] if before == "today" or unit == 1 else ["clock.unit_by_steps"])


@pytest.mark.parametrize(("name", "count"), [("time", 1), ("time [s]", 0), ("unix_time", 0)])
def test_dates_in_long_steps_are_reported(table, name, count):
    """They may be milliseconds since some weeks ago."""
    recording = table(f"{name},x", *(f"{1_750_000_000 + 2 * i},{i}" for i in range(20)))
    assert since_first(recording) == [2 * i * S for i in range(20)]
    assert [(one.code, one.evidence["otherwise"]) for one in recording.findings] == [
        ("clock.unit_by_size", "time [ms]")
    ] * count


def test_a_unit_of_a_clock_that_is_set_late(table):
    lines = (f"{(1_750_000_000_000 + 10 * i) * (i >= 400)},{i}" for i in range(1000))
    recording = table("time,x", *lines)
    assert recording.channel("x").values.tolist() == list(range(400, 1000))
    assert recording.channel("x").stamps[0] == 1_750_000_004 * S


def test_hours_that_are_not_called_so_are_reported(table):
    recording = table("time,x", *(f"{i / 3.6e6:.12f},{i}" for i in range(20)))
    (found,) = recording.findings
    assert (found.code, found.evidence["read_as"]) == ("clock.unit_by_steps", "seconds")
    assert found.value == pytest.approx(1 / 3.6e6, abs=1e-9)


def test_whole_seconds_are_seconds_where_the_name_says_so(table):
    assert stamps(table("seconds,x", *(f"{i},{i}" for i in range(5)))) == [i * S for i in range(5)]


def test_a_unit_that_is_no_time_is_reported(table):
    recording = table("time [samples],x", *(f"{i},{i}" for i in range(20)))
    assert recording.streams["log"].time_source == "none"
    assert "clock.unit_unknown" in codes(recording)


def test_a_temperature_is_no_clock(table):
    recording = table("T (K),x", *(f"{i + 300},{i}" for i in range(20)))
    assert recording.streams["log"].time_source == "none"
    assert codes(recording) == ["clock.missing"]


def test_a_time_that_cannot_be_read_is_shown(table):
    recording = table("time,x", "first,0", "second,1", "third,2")
    assert "clock.times_unreadable" in codes(recording)


def excel(day):
    return (day - date(1899, 12, 30)).days


def datenum(day):
    return day.toordinal() + 366


@pytest.mark.parametrize("number", [excel, datenum])
def test_days_as_spreadsheets_and_matlab_count_them(table, number):
    midnight = datetime(2024, 3, 13, tzinfo=UTC)
    days = [number(moment.date()) + (moment - midnight) / timedelta(days=1) % 1 for moment in ROWS]
    recording = table("Time,x", *(f"{day:.12f},{i}" for i, day in enumerate(days)))
    for found, moment in zip(stamps(recording), ROWS, strict=True):
        assert found == pytest.approx(nanoseconds(moment), abs=2e-5 * S)
    assert codes(recording) == ["clock.counts_days"]


def test_a_signal_called_data_is_no_clock(table):
    recording = table("data,x", *(f"{i / 10},{i}" for i in range(20)))
    assert recording.streams["log"].time_source == "none"
    assert recording.channel("data").values.tolist() == [i / 10 for i in range(20)]


@pytest.mark.parametrize("time", ["%Y-%m-%d %H:%M:%S", "%m/%d/%Y %I:%M:%S %p", "%H:%M:%S"])
def test_bytes_that_are_no_text_deep_in_a_column_of_times(tmp_path, time):
    """The first rows tell that the file is UTF-8; a damaged cell far behind them costs its own row."""
    begin = datetime(2024, 3, 13, 8, tzinfo=UTC)
    rows = [f"{begin + timedelta(seconds=i):{time}},{i}\n".encode() for i in range(20_000)]
    rows[15_000] = b"\xff" + rows[15_000][1:]
    path = tmp_path / "log.csv"
    path.write_bytes(b"time,x\n" + b"".join(rows))
    recording = read(path)
    channel = recording.channel("x")
    assert channel.values.tolist() == [i for i in range(20_000) if i != 15_000]
    assert ((channel.stamps - channel.stamps[0]) == channel.values * S).all()
    assert values_of(recording, "clock.rows_without_time") == [1]


def examples(row):
    """Return what docs/reference/tables.md gives as examples in a row of its table of dates."""
    text = (Path(__file__).parents[2] / "docs" / "reference" / "tables.md").read_text(encoding="utf-8")
    (line,) = (line for line in text.splitlines() if line.startswith(f"| {row} |"))
    return re.findall(r"`([^`]+)`", line)


@pytest.mark.parametrize("date", examples("year first") + examples("day or month first") + examples("with a name"))
def test_every_date_on_the_page_is_read(table, date):
    written = date if ":" in date or "T12" in date else f"{date} 12:00:00"
    begin = nanoseconds(datetime(2026, 1, 31, 12, tzinfo=UTC))
    assert stamps(table("time;x", f"{written};0"))[0] in (begin, begin + S // 2)


@pytest.mark.parametrize("time", examples("time of day"))
def test_every_time_of_day_on_the_page_is_read(table, time):
    (stamp,) = stamps(table("time;x", f"{time};0"))
    assert stamp in {86399 * S + S // 2, 43201 * S + S // 2, 3598 * S + S // 2, 360_000 * S}


@pytest.mark.parametrize(("unit", "size"), [("us", 10**3), ("ms", 10**6), ("ns", 1)])
def test_a_counter_of_32_bits_that_overflows(table, unit, size):
    rows = [(2**32 - 1000 + 7 * i, i) for i in range(300)]
    recording = table(f"time_{unit},x", *(f"{count % 2**32},{i}" for count, i in rows))
    assert stamps(recording) == [count * size for count, _ in rows]
    assert values_of(recording, "clock.overflows") == [1]


@pytest.mark.parametrize(("epoch", "told"), [(1_700_000_000, False), (1_700_000_000 + 2_082_844_800, True)])
def test_seconds_as_labview_counts_them_are_reported(table, epoch, told):
    recording = table("time,pos\n" + "".join(f"{epoch + i / 10},{i}\n" for i in range(50)))
    assert ("clock.perhaps_since_1904" in codes(recording)) == told


@pytest.mark.parametrize("begin", ["0", "99999", "100001", "1700000000", "-99999"])
@pytest.mark.parametrize("decimals", [0, 3, 9, 11, 15])
@pytest.mark.parametrize("unit", ["s", "ms", "us"])
def test_seconds_in_decimals_are_read_exactly(table, begin, decimals, unit):
    """To the nanosecond, whatever a floating point number would make of them; rounded where there are more digits."""
    rng = np.random.default_rng(7)
    steps = np.cumsum(rng.integers(10 ** max(decimals - 1, 0), 10 ** (decimals + 1), 200))
    cells = [Decimal(begin) + Decimal(int(step)).scaleb(-decimals) for step in steps]
    log = table(f"time [{unit}],x", *(f"{cell},{i}" for i, cell in enumerate(cells)))
    digits = {"s": 9, "ms": 6, "us": 3}[unit]
    expected = [int(cell.scaleb(digits).to_integral_value(ROUND_HALF_EVEN)) for cell in cells]
    assert log.channels["x"].stamps.tolist() == expected


LEFT_OUT = {"date": "2024-03-13 23:59:{:02d}.{}", "day": "11:59:{:02d}.{} PM", "seconds": "17500000{:02d}.{}"}


@pytest.mark.parametrize("form", LEFT_OUT)
@pytest.mark.parametrize("step", [250, 1, 37])
def test_fractions_without_the_zeros_at_their_ends(table, form, step):
    ticks = [i * step for i in range(1500)]
    texts = [LEFT_OUT[form].format(t // 1000, f"{t % 1000:03d}".rstrip("0") or "0") for t in ticks if t < 60_000]
    recording = table("time,x", *(f"{text},{i}" for i, text in enumerate(texts)))
    assert since_first(recording) == [t * S // 1000 for t in ticks[: len(texts)]]
    assert recording.findings == ()


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("TimeUS", lambda i: f"{5_000_000 + i * 2500}"),
        ("millis", lambda i: f"{7000 + i * 2.5}"),
        ("micros", lambda i: f"{i * 2500}"),
        ("gps_time", lambda i: f"{604_800 + i * 0.0025:.4f}"),
        ("tv_sec,tv_usec", lambda i: f"{1_750_000_000 + i // 400},{i % 400 * 2500}"),
        ("tv_sec,tv_nsec", lambda i: f"{1_750_000_000 + i // 400},{i % 400 * 2_500_000}"),
        ("secs,nsecs", lambda i: f"{i // 400},{i % 400 * 2_500_000}"),
    ],
)
def test_what_programs_call_the_time(table, header, row):
    recording = table(f"{header},x", *(f"{row(i)},{i}" for i in range(1000)))
    assert list(recording.channels) == ["x"]
    assert since_first(recording) == [i * S // 400 for i in range(1000)]
    assert recording.findings == ()


@pytest.mark.parametrize("begin", [0, 1_750_000_000])
@pytest.mark.parametrize("order", [np.arange(900)[::-1], np.arange(900).reshape(-1, 2)[:, ::-1].ravel()])
@pytest.mark.parametrize("unit", ["s", ""])
def test_the_newest_row_first_and_rows_in_pairs(table, begin, order, unit):
    """They are sorted as dates are."""
    name, scale = (f"time [{unit}]", 1) if unit else ("time", 1000)
    recording = table(f"{name},x", *(f"{Decimal(begin * 1000 + int(i) * 10) * scale / 1000:f},{i}" for i in order))
    assert since_first(recording) == [i * S // 100 for i in range(900)]
    assert "clock.out_of_order" in codes(recording)


def test_a_falling_temperature_is_no_clock(table):
    recording = table("T,x", *(f"{300 - i / 10},{i}" for i in range(50)))
    assert recording.streams["log"].time_source == "none"
