"""Two publishers of one topic that nothing but their values separates."""

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
def test_values_of_two_by_turns_are_reported(tmp_path, joints):
    assert told(log_of(tmp_path / "log", *joints))


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
