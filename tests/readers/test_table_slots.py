"""Tables whose rows name the joints of numbered columns."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from finding_codes import found

from vsalog.readers import read

N = 900
HIP, KNEE = np.arange(N) / 8, 1000 + np.arange(N) / 8


def rows(order):
    """Yield time, names, positions and velocities of two joints, in the order that each row has."""
    for i in range(N):
        joints = [("hip", HIP[i], -HIP[i]), ("knee", KNEE[i], -KNEE[i])]
        yield 1_494_360_168 * 10**9 + i * 10**7, *zip(*(joints[k] for k in order(i)), strict=True)


@pytest.fixture(params=["csv", "parquet"])
def joints(request, tmp_path):
    """Read joint states."""

    def joints(order, wanted=None):
        if request.param == "parquet":
            columns = zip(("time", "name", "position", "velocity"), zip(*rows(order), strict=True), strict=True)
            pq.write_table(pa.table({name: [*map(list_of, cells)] for name, cells in columns}), tmp_path / "log")
            return read(tmp_path / "log", wanted and [f"{name[:-1]}[{name[-1]}]" for name in wanted])
        lines = ["%time,field.name0,field.name1,field.position0,field.position1,field.velocity0,field.velocity1"]
        lines += [",".join(map(str, (t, *n, *p, *v))) for t, n, p, v in rows(order)]
        (tmp_path / "log").write_text("\n".join(lines) + "\n")
        return read(tmp_path / "log", wanted)

    return joints


def list_of(cell):
    return list(cell) if isinstance(cell, tuple) else cell


def values(recording):
    return {name.replace("[", "").replace("]", ""): c.values.tolist() for name, c in recording.channels.items()}


@pytest.mark.parametrize("begin", [0, 1, 30, 700])
def test_values_go_with_their_names(joints, begin):
    recording = joints(lambda i: (1, 0) if i >= begin and i % 3 else (0, 1))
    first, second = HIP.tolist(), KNEE.tolist()
    minus = [(-HIP).tolist(), (-KNEE).tolist()]
    assert values(recording) == {"position0": first, "position1": second, "velocity0": minus[0], "velocity1": minus[1]}
    moved = sum(i >= begin and i % 3 > 0 for i in range(N))
    assert [(one.code, one.value) for one in recording.findings] == [("table.names_move", moved)]


def test_one_of_them_alone(joints):
    assert values(joints(lambda i: (1, 0) if i % 2 else (0, 1), ["position1"])) == {"position1": KNEE.tolist()}


def test_an_order_that_stays_is_not_told(joints):
    recording = joints(lambda _: (0, 1))
    assert values(recording)["position1"] == KNEE.tolist()
    assert recording.findings == ()


def test_names_that_come_later_are_reported(tmp_path):
    lines = [
        "time,name0,name1,pos0,pos1",
        *(f"{i / 100},hip,{'knee' if i < 50 else 'toe'},{i},{-i}" for i in range(99)),
    ]
    (tmp_path / "log").write_text("\n".join(lines) + "\n")
    recording = read(tmp_path / "log")
    assert recording.channel("pos0").values.tolist() == list(range(99))
    expected = [-i if i < 50 else np.nan for i in range(99)]
    np.testing.assert_array_equal(recording.channel("pos1").values, expected)
    (unknown,) = found(recording, "table.names_unknown")
    assert (unknown.value, unknown.evidence["first"]) == (49, "toe")
