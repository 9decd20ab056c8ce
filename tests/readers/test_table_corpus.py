"""One small table of every exporter that is read, with what its file says: channels, units, values and times."""

from pathlib import Path

import numpy as np
import pytest
from finding_codes import codes

from vsalog.readers import read

CORPUS = Path(__file__).parent / "corpus"
MS = 10**6
NAN = float("nan")
NOON = 1_769_860_800_000 * MS
"""2026-01-31 12:00:00 UTC [ns]."""
TODAY = 1_700_000_000_000 * MS
RISING = [0.5, 0.625, 0.75]
FALLING = [-0.5, -0.625, -0.75]

# By file: stamps [ns] or None without a time, then name -> (unit, values), then codes of findings.
FILES = {
    "appended.csv": (
        [0, 100 * MS, 200 * MS, 300 * MS, 400 * MS],
        {"angle": (None, [*RISING, 1.5, 1.625])},
        ["table.header_again"],
    ),
    "arduino_plotter.txt": (
        [0, 10 * MS, 20 * MS, 30 * MS],
        {"angle": (None, [*RISING, 0.875]), "torque": (None, [*FALLING, -0.875])},
        [],
    ),
    "excel_american.csv": (
        [NOON - 1000 * MS, NOON, NOON + 1000 * MS],
        {"Angle, left": ("deg", [1.5, 1.625, 1.75]), "Torque": ("N*m", [-1250.5, -1250, -1249])},
        [],
    ),
    "excel_french.csv": (
        [NOON, NOON + 1000 * MS, NOON + 2000 * MS],
        {"Angle": ("deg", [1.5, 1.625, 1.75]), "Couple": ("N*m", [-1250.5, -1250, -1249])},
        [],
    ),
    "excel_german.csv": (
        [NOON + 250 * MS, NOON + 500 * MS, NOON + 750 * MS],
        {"Winkel": ("°", [1.5, 1.625, 1.75]), "Moment": ("N·mm", [-1250.5, -1250, -1249])},
        [],
    ),
    "excel_minutes.csv": (
        [3_599_000 * MS, 3_599_500 * MS, 3_600_000 * MS, 3_600_500 * MS],
        {"angle": (None, [1.5, 1.625, 1.75, 1.875])},
        ["clock.minutes_and_seconds", "clock.restarts"],
    ),
    "hebi.csv": (
        [10_803_938, 19_073_963, 29_106_855, 39_258_003],
        {
            "position": (None, [-0.397193223, -0.344939262, -0.27370438, -0.202395663]),
            "deflection": (None, [-0.00130563974, -0.000882714987, -0.00082936883, -5.77121973e-05]),
            "effort": (None, [0.0522255898, 0.0353085995, 0.0331747532, 0.00230848789]),
        },
        [],
    ),
    "labview.lvm": (
        [0, MS, 2 * MS, 3 * MS],
        {"Angle": ("deg", [1.5, 1.625, 1.75, 1.875]), "Torque": ("N*m", [-0.25, -0.5, -0.75, -1])},
        [],
    ),
    "lerobot.csv": (
        [0, 100 * MS, 200 * MS, 300 * MS],
        {
            "observation.state[0]": (None, [*RISING, NAN]),
            "observation.state[1]": (None, [-1.5, -1.625, -1.75, NAN]),
            "action[0]": (None, [0.25, 0.5, 0.75, 1]),
            "action[1]": (None, [-0.25, -0.5, NAN, -1]),
            "frame_index": (None, [0, 1, 2, 3]),
        },
        ["table.cells_without_number"] * 2,
    ),
    "lists.csv": (
        [4957, 20_080_370, 40_136_594, 60_196_393],
        {
            f"{name}[{k}]": (None, values)
            for name, rows in {
                "positions": [
                    [0.03451456772742693] * 4,
                    [0.05062136600022616] * 3 + [0.05368932757599744],
                    [0.6097573631845423] * 3 + [0.6082233823966567],
                    [0.035281558121369745] * 3 + [0.04141748127291231],
                    [0.023009711818284616, 0.023009711818284616, 0.026077673394055898, 0.035281558121369745],
                    [0.5377544320420223, 0.5377544320420223, 0.5403808273145109, 0.5489166119500984],
                ],
                "velocities": [
                    [0, 0, 0, 0],
                    [0, 0, 0, 0.07669903939428206],
                    [0, 0, 0, 0],
                    [0, 0, 0, 0.23009711818284617],
                    [0, 0, 0.15339807878856412, 0.38349519697141027],
                    [0, 0, 0.15339807878856412, 0.8436894333371027],
                ],
                "torques": [
                    [0, 0, 0.022814, 0.045628],
                    [0, 0, 0, 0],
                    [0.501908, 0.273768, 0.159698, 0.11407],
                    [0, 0.045628, 0.091256, 0.022814],
                    [0.022814, 0.136884, 0.091256, 0.022814],
                    [0, 0.11407, 0.433466, 0.11407],
                ],
            }.items()
            for k, values in enumerate(rows)
        },
        ["clock.unit_by_steps"],
    ),
    "matlab_timetable.csv": (
        [0, 10 * MS, 20 * MS],
        {"Angle": (None, RISING), "Torque": (None, [1.25, 1.5, 1.75])},
        [],
    ),
    "matlab_writetable.csv": (
        [NOON, NOON + 1000 * MS, NOON + 2000 * MS],
        {"Angle": (None, RISING), "Torque": (None, [NAN, 1.25e-05, float("inf")])},
        [],
    ),
    "no_time.csv": (
        None,
        {
            "column_0": (None, [0, 1, 2]),
            "header": (None, [-0.004345893859863281, -0.0013458728790283203, 0.001653909683227539]),
            "joint_position": (None, [0.018100000000000005, 0.018100000000000005, 0.012199999999999989]),
            "rege_current": (None, [1.2000000476837158, 1.2000000476837158, 1.0]),
            "servo1_position": (None, [0, 0, 0]),
            "servo2_position": (None, [0, 0, 0]),
            "servo_current": (None, [0, 0, 0]),
        },
        ["clock.missing", "clock.perhaps"],
    ),
    "numpy_savetxt.txt": ([0, 10 * MS, 20 * MS], {"angle": (None, RISING), "torque": (None, FALLING)}, []),
    "pandas_index.csv": (
        [NOON, NOON + 10 * MS, NOON + 20 * MS],
        {"angle": (None, RISING), "torque": (None, [1.25, 1.5, 1.75])},
        ["clock.guessed_by_dates"],
    ),
    "rostopic_echo.csv": (
        [1494360168925000928, 1494360168930000928, 1494360168935000928, 1494360168945000928],
        {
            "header.seq": (None, [544072, 544073, 544074, 544076]),
            "joint_angle": (None, [592, 595, 581, 593]),
            **{name: (None, [0, 0, 0, 0]) for name in ("servo1_position", "servo2_position", "u1", "u2", "u3")},
        },
        [],
    ),
    "seconds_and_nanoseconds.csv": (
        [TODAY + 999_999_999, TODAY + 1_004_999_999],
        {"angle": (None, [0.5, 0.625])},
        [],
    ),
    "shifted.csv": (
        [0, 10 * MS, 20 * MS],
        {"column_0": (None, [1, 2, 3]), "angle": (None, RISING)},
        ["table.unnamed_column"],
    ),
    "simulink.csv": (
        [0, 10 * MS, 20 * MS],
        {"q": ("rad", RISING), "tau": ("N*m", [1.25, 1.5, 1.75])},
        [],
    ),
    "time_of_day.csv": (
        [86_399_500 * MS, 86_399_750 * MS, 86_400_000 * MS, 86_400_250 * MS],
        {"angle": (None, [*RISING, 0.875])},
        ["clock.restarts"],
    ),
    "units_row.csv": ([10 * MS, 20 * MS], {"angle": ("deg", [0.5, 0.625]), "torque": ("N*m", [1.25, 1.5])}, []),
}
APART = {
    "labview_columns.lvm": {
        "Angle": ([0, MS, 2 * MS, 3 * MS], [1.5, 1.625, 1.75, 1.875]),
        "Torque": ([0, 2.5 * MS, 5 * MS, 7.5 * MS], [10.25, 10.5, 10.75, 11]),
    },
    "long.csv": {
        f"position[{joint}]": ([10 * MS * k for k in range(6)], [begin + k for k in range(6)])
        for joint, begin in (("hip", 0.5), ("knee", 100.5))
    },
    "plotjuggler.csv": {
        "/arm/position": ([TODAY, TODAY + 10 * MS, TODAY + 20 * MS], RISING),
        "/tool/force/x": ([TODAY + 5 * MS, TODAY + 15 * MS, TODAY + 25 * MS], [10.25, 10.5, 10.75]),
        "/tool/force/y": ([TODAY + 5 * MS, TODAY + 15 * MS, TODAY + 25 * MS], [-1, -2, -3]),
    },
}
NOTES = {"table.words_below_header"}
"""What may be told of any file."""


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_an_exporter_is_read(name):
    stamps, channels, told = FILES[name]
    log = read(CORPUS / name)
    assert {found: channel.unit for found, channel in log.channels.items()} == {
        wanted: unit for wanted, (unit, _) in channels.items()
    }
    for wanted, (_, values) in channels.items():
        np.testing.assert_array_equal(log.channel(wanted).values[: len(values)], values)
        if stamps is not None:
            assert log.channel(wanted).stamps.tolist() == stamps
    assert {stream.time_source for stream in log.streams.values()} <= {"header", "column", "none"}
    assert [code for code in codes(log) if code not in NOTES] == told


@pytest.mark.parametrize("name", APART)
def test_a_file_whose_columns_have_times_of_their_own_is_read(name):
    log = read(CORPUS / name)
    assert list(log.channels) == list(APART[name])
    for wanted, (stamps, values) in APART[name].items():
        np.testing.assert_array_equal(log.channel(wanted).values, values)
        assert log.channel(wanted).stamps.tolist() == stamps


def test_every_table_of_the_corpus_is_compared():
    tables = {path.name for path in CORPUS.iterdir() if path.suffix in (".csv", ".txt", ".lvm")}
    assert tables == FILES.keys() | APART.keys()
