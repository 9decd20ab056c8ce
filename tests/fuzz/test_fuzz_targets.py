"""Every fuzz target takes its seeds, and some changes of each: that the targets work, not that all is found."""

from __future__ import annotations

import importlib
import random

import pytest
from fuzz_frames import framed, frames
from run_fuzz import TARGETS

EACH = 1
"""Changes of each seed; `make fuzz` makes thousands."""


@pytest.mark.every(2)
@pytest.mark.parametrize("name", TARGETS)
def test_seeds_and_changes_of_them(name):
    target, rng = importlib.import_module(f"fuzz_{name}"), random.Random(name)
    seeds = list(target.seeds())
    assert len(seeds) >= 3
    for seed in seeds:
        target.one(seed)
        for _ in range(EACH):
            target.one(changed(seed, rng))


def changed(seed, rng):
    """Return an input with some bytes changed, put in or left out."""
    data = bytearray(seed)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(data))
        data[at : at + rng.randint(0, 2)] = rng.choice([b"", b"\0", b"\xff", b"9", rng.randbytes(2), b"-1e999"])
    return bytes(data)


def test_frames_are_read_as_they_were_written():
    parts = [(0, b""), (255, b"abc"), (7, bytes(0xFFFF))]
    assert frames(framed(parts)) == parts
    assert frames(framed([(1, b"abcdef")])[:-2]) == [(1, b"abcd")]
    assert frames(b"\1\2") == []


def test_most_seeds_are_read(monkeypatch):
    """A corpus of what is refused at once would reach nothing."""
    import fuzz_contract

    read = []
    monkeypatch.setattr(fuzz_contract, "well_formed", lambda recording: read.append(recording.channels))
    monkeypatch.setattr(fuzz_contract, "inspected", lambda recording: None)
    for name in TARGETS[:7]:
        target = importlib.import_module(f"fuzz_{name}")
        for seed in target.seeds():
            read.clear()
            target.one(seed)
            assert read, (name, seed[:40])
            assert read[0], (name, seed[:40])
