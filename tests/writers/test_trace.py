"""The trace's Parquet file: joints with columns of their own share it."""

import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest

from vsalog.core.errors import WriteError
from vsalog.core.finding import Finding
from vsalog.core.trace import UNITS, Trace
from vsalog.writers.trace import TraceWriter


def block(joint, first, count, *extra):
    stamps = np.arange(first, first + count, dtype=np.int64)
    columns = {name: np.zeros(count, dtype=bool) if name == "excited" else stamps * 1.0 for name in UNITS}
    columns |= {name: stamps + 0.25 + i for i, name in enumerate(extra)}
    return Trace(joint, stamps, stamps * 1e-3, np.zeros(count, np.int32), ("",), {"1": columns, "total": columns})


@pytest.mark.parametrize("count", [3, 40_000])
def test_columns_that_only_a_later_joint_has_are_written_too(tmp_path, count):
    path = tmp_path / "a.parquet"
    with TraceWriter(path, {"key": "text"}) as writer:
        for first in (0, count):
            writer.write(block("a", first, count, "coefficient_0"))
        writer.write(block("b", 0, count, "coefficient_0", "residual"))
        writer.write(block("c", 0, count, "motor_inertia"))
    assert [p.name for p in tmp_path.iterdir()] == ["a.parquet"]
    schema = pq.read_schema(path)
    assert schema.metadata[b"key"] == b"text"
    assert schema.field("residual").metadata[b"unit"] == b"N*m"
    rows = pq.read_table(path).to_pandas()
    assert rows.joint.value_counts().to_dict() == {"a": 4 * count, "b": 2 * count, "c": 2 * count}
    for joint, length, extra in (("a", 2 * count, ["coefficient_0"]), ("b", count, ["coefficient_0", "residual"])):
        for transmission in ("1", "total"):
            own = rows[(rows.joint == joint) & (rows.transmission == transmission)]
            np.testing.assert_array_equal(own.stamp, np.arange(length))
            np.testing.assert_array_equal(own.stiffness, np.arange(length))
            for i, name in enumerate(extra):
                np.testing.assert_array_equal(own[name], np.arange(length) + 0.25 + i)
    assert rows[rows.joint != "b"].residual.isna().all()
    assert rows[rows.joint != "c"].motor_inertia.isna().all()


def test_findings_stand_in_the_metadata_of_the_file(tmp_path):
    path = tmp_path / "a.parquet"
    found = Finding(code="encoder.zero", joint="a", part="motor_position", value=0.2, evidence={"half_range": 0.01})
    with TraceWriter(path, {"key": "text"}) as writer:
        writer.write(block("a", 0, 5))
        writer.add_findings([(found,), ()])
        writer.write(block("b", 0, 5, "residual"))
    told = pq.read_metadata(path).metadata[b"vsalog.findings"]
    assert msgspec.json.decode(told, type=list[Finding]) == [found]
    assert pq.read_schema(path).metadata[b"key"] == b"text"


def test_nothing_is_left_behind_when_a_later_joint_fails(tmp_path):
    def write():
        with TraceWriter(tmp_path / "a.parquet", {}) as writer:
            writer.write(block("a", 0, 5))
            writer.write(block("b", 0, 5, "residual"))
            raise OSError(28, "No space left on device")

    with pytest.raises(WriteError):
        write()
    assert not list(tmp_path.iterdir())
