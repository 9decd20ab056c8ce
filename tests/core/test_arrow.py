"""Columns made without pandas are those that pyarrow makes, and pandas is not imported for them."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from vsalog.core.arrow import arrow_column, arrow_texts

KINDS = (np.float64, np.int64, np.int32, np.bool_)


@given(st.sampled_from(KINDS).flatmap(lambda kind: arrays.arrays(kind, st.integers(0, 40))))
def test_a_column_is_what_pyarrow_makes_of_it(values):
    for part in (values, values[::2]):
        made = arrow_column(part)
        made.validate(full=True)
        assert made.type == pa.array(part).type
        np.testing.assert_array_equal(made.to_numpy(zero_copy_only=False), part)


@given(st.lists(st.text(st.characters(exclude_categories=["Cs"]))))
def test_texts_are_what_pyarrow_makes_of_them(texts):
    made = arrow_texts(texts)
    made.validate(full=True)
    assert made.equals(pa.array(texts, pa.string()))


def test_another_type_is_refused():
    with pytest.raises(KeyError):
        arrow_column(np.zeros(3, dtype=np.float32))


def test_a_trace_is_written_without_pandas(samples, tmp_path):
    code = "import sys; from vsalog.cli import cli; cli(sys.argv[1:], standalone_mode=False); print('pandas' in sys.modules)"
    command = [sys.executable, "-c", code, "estimate", str(samples / "vsa2_exp1.mcap")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.stdout.endswith("False\n"), done.stderr
