"""Tables in which logs stand side by side, each with a clock of its own."""

from __future__ import annotations

import gzip

import numpy as np
import pytest
from finding_codes import codes, values_of

from vsalog.readers import open_reader, read

N, M = 400, 150
Q, TAU, P = np.arange(N) * 0.5, 1000.0 + np.arange(M), 5000.0 + np.arange(N)


def table(header):
    """Return a table: times and q at 100 Hz, times and tau at 40 Hz."""
    lines = [header]
    for i in range(N):
        cells = {"q": f"{i / 100:.2f},{Q[i]},{P[i]}", "t": f"{i / 40:.3f},{TAU[i]}" if i < M else ","}
        lines.append(f"{cells['q']},{cells['t']}")
    return "\n".join(lines) + "\n"


def check(log):
    for name, values, step in (("q", Q, 10), ("p", P, 10), ("tau", TAU, 25)):
        np.testing.assert_array_equal(log.channel(name).values, values)
        np.testing.assert_array_equal(log.channel(name).stamps, np.arange(len(values)) * step * 10**6)
    assert values_of(log, "table.several_clocks") == [2]
    assert "clock.rows_without_time" not in codes(log)
    assert not any(name.startswith("time") for name in log.channels)


@pytest.mark.parametrize(
    "header", ["time,q,p,time,tau", "time [s],q,p,time [s],tau", "time,q,p,time.1,tau", "time [s],q,p,time [s].1,tau"]
)
@pytest.mark.parametrize("packed", [False, True])
def test_each_has_its_own_clock(tmp_path, header, packed):
    """On the clock of the first, those of the second would be at wrong times."""
    text = table(header).encode()
    (tmp_path / "log").write_bytes(gzip.compress(text) if packed else text)
    check(read(tmp_path / "log"))
    assert list(open_reader(tmp_path / "log").catalogue().channels) == ["q", "p", "tau"]
    (tau,) = read(tmp_path / "log", ["tau"]).channels.values()
    np.testing.assert_array_equal(tau.stamps, np.arange(M) * 25 * 10**6)


def test_values_ahead_of_their_clock(tmp_path):
    lines = (line.split(",") for line in table("time,q,p,time,tau").splitlines())
    (tmp_path / "log").write_text("".join(",".join([q, p, t, tau, s]) + "\n" for t, q, p, s, tau in lines))
    check(read(tmp_path / "log"))


def test_a_column_of_the_same_name_that_is_no_clock_is_a_signal(tmp_path):
    rows = "".join(f"{i / 100},{np.sin(i)},{i % 7},{i}\n" for i in range(N))
    (tmp_path / "log").write_text("time,q,time,tau\n" + rows)
    log = read(tmp_path / "log")
    assert list(log.channels) == ["q", "time#2", "tau"]
    assert len(log.channel("tau").values) == N


def test_a_time_that_cannot_be_read_is_reported(tmp_path):
    text = table("time,q,p,time,tau").replace("\n3.00,", "\nx,").replace(",2.500,", ",?x,")
    (tmp_path / "log").write_text(text)
    log = read(tmp_path / "log")
    np.testing.assert_array_equal(log.channel("q").values, np.delete(Q, 300))
    np.testing.assert_array_equal(log.channel("tau").values, np.delete(TAU, 100))
    assert values_of(log, "clock.rows_without_time") == [2]


@pytest.mark.parametrize(("again", "q"), [("time.1", "q.1"), ("time_1", "q_1"), ("time (2)", "q (2)"), ("time2", "q2")])
def test_two_tables_of_the_same_columns_side_by_side(tmp_path, again, q):
    """As programs rename what would be there twice."""
    text = table(f"time,q,p,{again},{q}")
    (tmp_path / "log").write_text(text)
    log = read(tmp_path / "log")
    assert list(log.channels) == ["q", "p", q]
    np.testing.assert_array_equal(log.channel(q).values, TAU)
    np.testing.assert_array_equal(log.channel(q).stamps, np.arange(M) * 25 * 10**6)


def test_units_of_columns_that_pandas_numbered(tmp_path):
    (tmp_path / "log").write_text(table("time [s],q [rad],p [N],time [s].1,q [rad].1"))
    assert {name: channel.unit for name, channel in read(tmp_path / "log").channels.items()} == {
        "q": "rad",
        "p": "N",
        "q.1": "rad",
    }


@pytest.mark.parametrize(
    "header", ["time,time.1,q", "time,q,time.1", "time,q,time_1", "time,q,time_2,tau", "time.1,q,tau"]
)
def test_a_second_clock_of_no_columns_is_a_signal(tmp_path, header):
    """So is one with a number that no other column has."""
    width = header.count(",")
    rows = "".join(",".join([f"{i / 100:.2f}"] * 2 + [str(i)] * (width - 1)) + "\n" for i in range(N))
    (tmp_path / "log").write_text(f"{header}\n{rows}")
    log = read(tmp_path / "log", rate=100.0)
    assert len(log.channels) == (width if header.startswith("time,") else 3)
    assert len(log.streams) == 1
