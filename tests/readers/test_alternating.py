"""Two publishers of one topic that nothing but their values tells apart."""

from __future__ import annotations

import numpy as np
import pytest
from finding_codes import found
from write_logs import MS, START, McapLog, joint_state

from vsalog.readers import read

T = np.arange(3000) * 1e-3
RNG = np.random.default_rng(1)
ONE, OTHER = np.sin(9 * T), 0.5 + np.cos(5 * T)
NOISE = 1e-3 * RNG.standard_normal(T.size)


def log_of(path, *joints):
    log = McapLog()
    for i, positions in enumerate(zip(*joints, strict=True)):
        log.add("/j", joint_state(START + i * MS, [f"j{k}" for k in range(len(joints))], positions), START + i * MS)
    return log.save(path)


def told(path):
    said = [len(found(log, "recording.values_alternate")) for log in (read(path), read(path, room=0))]
    assert said[0] == said[1] <= 1
    return bool(said[0])


def by_turns(one, other):
    return np.where(np.arange(T.size) % 2, one, other)


@pytest.mark.parametrize(
    "joints",
    [
        (by_turns(ONE, OTHER) + NOISE,),
        (by_turns(ONE, OTHER) + NOISE, by_turns(OTHER, 2 * ONE)),
        (by_turns(ONE, OTHER) + NOISE, np.ones(T.size)),  # a joint that stands still says nothing
    ],
)
def test_values_of_two_by_turns_are_told(tmp_path, joints):
    assert told(log_of(tmp_path / "log", *joints))


THIRD = 1.5 * np.sin(3 * T + 1)
PHASE = np.arange(T.size)


@pytest.mark.parametrize("turns", ["abc", "aab", "aaab", "abac", "abcabb"])
@pytest.mark.parametrize("digits", [2, 9])
def test_values_of_more_or_of_one_that_is_faster_are_told(tmp_path, turns, digits):
    which = np.array([ord(turn) - ord("a") for turn in turns])[PHASE % len(turns)]
    assert told(log_of(tmp_path / "log", np.round(np.choose(which, (ONE, OTHER, THIRD)) + NOISE, digits)))


@pytest.mark.every(3)
@pytest.mark.parametrize("turns", [3, 4, 5, 6])
@pytest.mark.parametrize("off", [0, 1e-3])
def test_vibrations_and_pulses_as_fast_are_those_of_one(tmp_path, turns, off):
    beat = PHASE * (1 / turns + off)
    for k, values in enumerate(
        (
            np.sin(2 * np.pi * beat + 0.3),
            np.sin(2 * np.pi * beat + 0.3) * np.exp(-T),
            1.0 * (beat % 1 < 0.5),
            1.0 * (beat % 1 < 0.5 + 0.4 * np.sin(2 * T)),
        )
    ):
        for noise in (0, 1, 100):
            assert not told(log_of(tmp_path / f"{k}{noise}", values + noise * NOISE))


@pytest.mark.filterwarnings("error")
def test_values_at_the_end_of_the_range_are_looked_at_too(tmp_path):
    huge = 1.7e308 * RNG.uniform(0.5, 1, T.size)
    assert told(log_of(tmp_path / "log", by_turns(huge, -huge)))
    assert not told(log_of(tmp_path / "other", huge, np.full(T.size, 1.7e308), 5e-324 * RNG.integers(0, 99, T.size)))


@pytest.mark.parametrize(
    "joints",
    [
        (ONE,),
        (ONE + NOISE, OTHER),
        (NOISE,),
        (np.cumsum(NOISE),),
        (np.round(ONE, 2),),
        (by_turns(1.0, 0.0),),  # a switch
        (np.arange(T.size) // 50 % 12 + by_turns(1.0, 0.0),),  # an encoder's counts per sample
        (by_turns(ONE, OTHER), ONE, OTHER),  # one of three
        (np.where(np.arange(T.size) < 900, by_turns(ONE, OTHER), ONE),),  # for a while
        (np.sin(2 * np.pi * 250 * T + 0.3) + NOISE,),  # four samples a turn
    ],
)
def test_values_of_one_are_not(tmp_path, joints):
    assert not told(log_of(tmp_path / "log", *joints))
