"""Text tables as programs of the laboratory export them."""

from __future__ import annotations

import numpy as np
import pytest
from finding_codes import codes, values_of

from vsalog.readers import read

N = 300
T = np.arange(N) / 100
Q, TAU = np.round(np.sin(T), 4), np.round(5 * np.cos(T), 4)


def rows(separator=",", clock="{:.2f}".format, behind=""):
    return "".join(
        f"{clock(t)}{separator}{q:.4f}{separator}{tau:.4f}{behind}\n" for t, q, tau in zip(T, Q, TAU, strict=True)
    )


def log_of(tmp_path, text):
    (tmp_path / "log").write_text(text)
    return read(tmp_path / "log")


def check(log, angle, torque, begin=0):
    for name, values in ((angle, Q), (torque, TAU)):
        np.testing.assert_array_equal(log.channel(name).values, values)
        np.testing.assert_array_equal(log.channel(name).stamps, begin + np.arange(N) * 10**7)


LABVIEW = """LabVIEW Measurement
Separator\tTab
X_Columns\tOne
***End_of_Header***

Channels\t2
Samples\t300\t300
Y_Unit_Label\tdeg\tN*m
X_Dimension\tTime\tTime
X0\t0.0\t0.0
Delta_X\t0.01\t0.01
***End_of_Header***
X_Value\tAngle\tTorque\tComment
"""


@pytest.mark.parametrize("behind", ["", "\t"])
def test_labview(tmp_path, behind):
    """Rows need not have a cell for the remark."""
    log = log_of(tmp_path, LABVIEW + rows("\t", behind=behind))
    check(log, "Angle", "Torque")
    assert (log.channel("Angle").unit, log.channel("Torque").unit) == ("deg", "N*m")


def test_simulink_states_units_with_a_word(tmp_path):
    log = log_of(tmp_path, "time,q,tau\n,Unit: rad,Unit: N*m\n,Interp: linear,Interp: linear\n" + rows())
    check(log, "q", "tau")
    assert (log.channel("q").unit, log.channel("tau").unit) == ("rad", "N*m")


def test_a_serial_port_that_was_listened_to_before_the_header_came(tmp_path):
    log = log_of(tmp_path, "7,0.25,9.5\n8,0.5,9.25\ntime,q,tau\n" + rows())
    check(log, "q", "tau")
    assert values_of(log, "table.rows_ahead_of_header") == [2]


@pytest.mark.parametrize("header", [",q,tau\n", "recorded at,q,tau\n", ""])
def test_dates_with_times_are_the_clock_whatever_they_are_called(tmp_path, header):
    """The index of a data frame has no name."""
    log = log_of(tmp_path, header + rows(clock=lambda t: f"2026-01-31 12:00:{t:09.6f}+00:00"))
    check(log, *(("q", "tau") if header else ("column_1", "column_2")), 1_769_860_800 * 10**9)
    assert "clock.guessed_by_dates" in codes(log)


def test_times_of_day_in_a_column_without_a_name(tmp_path):
    check(log_of(tmp_path, rows(clock=lambda t: f"12:00:{t:06.3f}")), "column_1", "column_2", 12 * 3600 * 10**9)


@pytest.mark.parametrize("cell", ["2026-01-31 12:00:00", "2026-01-31", "on"])
def test_dates_that_stand_still_are_no_clock(tmp_path, cell):
    log = log_of(tmp_path, "made,q,tau\n" + rows(clock=lambda t: cell))
    assert log.unread["made"] == "text"
    assert log.streams["log"].time_source == "none"


@pytest.mark.parametrize("days", [0, 3])
def test_elapsed_days(tmp_path, days):
    """As pandas writes durations, and Python with a comma."""
    begin = days * 86_400 * 10**9
    log = log_of(tmp_path, "time,q,tau\n" + rows(clock=lambda t: f"{days} days 00:00:{t:09.6f}"))
    check(log, "q", "tau", begin)
    log = log_of(tmp_path, "time;q;tau\n" + rows(";", clock=lambda t: f"{days} days, 0:00:{t:09.6f}"))
    check(log, "q", "tau", begin)


def test_a_zero_byte_near_the_beginning_costs_a_cell(tmp_path):
    raw = bytearray(b"time,q,tau\n" + rows().encode())
    raw[raw.index(b"0.6052")] = 0
    (tmp_path / "log").write_bytes(raw)
    log = read(tmp_path / "log")
    np.testing.assert_array_equal(log.channel("tau").values, TAU)
    assert np.flatnonzero(np.isnan(log.channel("q").values)).tolist() == [65]


@pytest.mark.parametrize("mark", [":", "=", ": "])
@pytest.mark.parametrize("separator", [",", "\t", ", ", ";"])
def test_cells_that_say_what_they_are(tmp_path, mark, separator):
    """As programs of microcontrollers write for a plotter, behind what they say of themselves."""
    cells = [(f"{t:.2f}", f"{q:.4f}", f"{tau:.4f}") for t, q, tau in zip(T, Q, TAU, strict=True)]
    lines = [
        separator.join(f"{n}{mark}{c}" for n, c in zip(("t", "q [rad]", "tau"), row, strict=True)) for row in cells
    ]
    log = log_of(tmp_path, "\n".join(["ready", *lines, ""]))
    check(log, "q", "tau")
    assert log.channel("q").unit == "rad"


def test_a_line_with_another_label_is_no_row(tmp_path):
    lines = [f"t:{t:.2f},q:{q:.4f},tau:{tau:.4f}" for t, q, tau in zip(T, Q, TAU, strict=True)]
    lines[250] = lines[250].replace("q:", "x:")
    log = log_of(tmp_path, "\n".join(lines) + "\n")
    np.testing.assert_array_equal(log.channel("q").values, np.delete(Q, 250))
    assert values_of(log, "clock.rows_without_time") == [1]


@pytest.mark.parametrize("ends", [("", ","), (",", ""), (",", ","), ("", "")])
@pytest.mark.parametrize("units", ["s,deg,Nm", "[s],[deg],[Nm]"])
def test_separators_at_the_ends_of_a_header_alone(tmp_path, ends, units):
    rows = "".join(f"{i / 100},{i},{i / 2}\n" for i in range(60))
    (tmp_path / "log").write_text(f"time,theta,torque{ends[0]}\n{units}{ends[1]}\n{rows}")
    log = read(tmp_path / "log")
    assert {name: channel.unit for name, channel in log.channels.items()} == {"theta": "deg", "torque": "Nm"}
    assert log.channel("theta").stamps[-1] == 590_000_000
    assert log.findings == ()
