"""The lock of a batch in an object store: a sign of life every 20 s, and dead where four of them are missing."""

import json
import time

import pytest

from vsalog.batch.lock import _alive


@pytest.mark.parametrize(("age", "alive"), [(0.0, True), (60.0, True), (100.0, False)])
def test_an_owner_without_signs_of_life_is_dead(age, alive):
    owner = {"host": "elsewhere", "process": 1, "at": time.time() - age}
    assert bool(_alive(json.dumps(owner).encode())) == alive


@pytest.mark.parametrize("held", [b"", b"{}", b'{"host": "x", "process": "y", "at": 0}'])
def test_what_is_no_lock_is_nobodys(held):
    assert _alive(held) == {}
