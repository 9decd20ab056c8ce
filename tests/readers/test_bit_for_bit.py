"""Every number is what the library decodes, bit for bit, with layouts and without."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exhaustive import compare
from hypothesis import given, settings
from hypothesis import strategies as st
from random_definitions import Definition, FieldOf, definitions
from random_messages import make, numbers, same_number, stamp_of, vary

from vsalog.readers.fields import MAX_FIELDS
from vsalog.readers.message_definitions import parse_definition
from vsalog.readers.messages import RosDecoder
from vsalog.readers.packets import Messages

SAMPLES = Path(__file__).parents[2] / "sample_logs"
NAME = "a/msg/T0"
PARTS = FieldOf("p", "a/T1", "*")


def check(definition, seed, language, shapes=3, alike=3):
    """Compare messages of some shapes, some of each, in an order of their own, in two batches."""
    ros1 = language == "ros1"
    store, rng = definition.store(ros1), np.random.default_rng(seed)
    first = [make(rng, store, NAME) for _ in range(shapes)]
    messages = [*first, *(vary(rng, store, one, NAME) for one in first for _ in range(alike))]
    messages = [messages[k] for k in rng.permutation(len(messages))]
    little = [bool(k) for k in rng.integers(0, 4, len(messages))]
    raws = [
        bytes(store.serialize_ros1(one, NAME) if ros1 else store.serialize_cdr(one, NAME, little_endian=low))
        for one, low in zip(messages, little, strict=True)
    ]
    if len({path for one in messages for path in numbers(store, one, NAME)}) > MAX_FIELDS:
        return  # some are left out and said, which is tested elsewhere
    text = definition.idl() if language == "idl" else definition.ros(ros1)
    root = parse_definition("a/T0", text, "idl" if language == "idl" else "msg", ros1)
    unread = []
    for remember in (True, False):
        decoder = RosDecoder(root, not ros1, "t", None, remember)
        half = len(raws) // 2
        for part, some in ((messages[:half], raws[:half]), (messages[half:], raws[half:])):
            decoded = decoder.decode(Messages.of(some))
            assert decoded.good.all()
            rows = [numbers(store, one, NAME) for one in part]
            assert set(decoded.columns) == {f"t.{path}" for row in rows for path in row}
            for i, (message, row) in enumerate(zip(part, rows, strict=True)):
                for name, values in decoded.columns.items():
                    assert same_number(values[i], row.get(name[2:], np.nan)), name
                if decoded.stamps is not None and hasattr(message, "header"):
                    stamp = message.header.stamp
                    assert decoded.stamps[i] == stamp_of(store, stamp)
        unread.append(decoder.unread)
    assert unread[0] == unread[1]


@pytest.mark.parametrize("language", ["ros1", "ros2", "idl"])
@settings(max_examples=10, deadline=None)
@given(definition=definitions(), seed=st.integers(0, 2**32))
def test_random_definitions(language, definition, seed):
    check(definition, seed, language)


def test_names_that_change_places_among_arrays_of_parts():
    definition = Definition(
        (
            (FieldOf("header", "header"), FieldOf("name", "string", "*"), FieldOf("x", "float64", "*"), PARTS),
            (FieldOf("s", "string"), FieldOf("b", "bool"), FieldOf("y", "int16", "<=3"), FieldOf("z", "float32", "2")),
        )
    )
    for seed in range(4):
        for language in ("ros1", "ros2", "idl"):
            check(definition, seed, language, shapes=4)


@pytest.mark.parametrize("path", [*SAMPLES.glob("*.mcap"), *SAMPLES.glob("*.bag")], ids=lambda path: path.name)
def test_the_sample_logs(path):
    count, wrong = compare(path, every=50)
    assert not wrong, wrong[:5]
    assert count > 1000
