"""How much memory may be used: four fifths of what is free, of the machine or of the process's group, whichever is less."""

import pytest

from vsalog.core import memory


@pytest.mark.parametrize(("machine", "group", "usable"), [(1000, None, 800), (1000, 500, 400), (500, 1000, 400)])
def test_a_fifth_is_left_to_others(monkeypatch, machine, group, usable):
    monkeypatch.setattr(memory, "_available", lambda: machine)
    monkeypatch.setattr(memory, "_group", lambda: group)
    assert memory.usable_memory() == usable


def test_a_machine_that_says_nothing_is_a_small_one(monkeypatch):
    monkeypatch.setattr(memory, "_available", lambda: None)
    monkeypatch.setattr(memory, "_group", lambda: None)
    assert 2**30 < memory.usable_memory() < 8 * 2**30
