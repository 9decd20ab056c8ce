"""What is remembered: the same question is worked out once, another one is never given its answer."""

import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vsalog.residuals.memory import Memory


@dataclass(frozen=True)
class Part:
    value: float


def counted():
    calls = []

    def make(x, part, more=0.0):
        calls.append(part)
        return x * part.value + more

    return make, calls


def test_the_same_arrays_and_equal_parts_are_worked_out_once():
    memory, (make, calls) = Memory(), counted()
    x = np.arange(5.0)
    first, second = memory(make, x, Part(2.0)), memory(make, x, Part(2.0))
    assert first is second
    assert len(calls) == 1
    np.testing.assert_array_equal(first, 2.0 * x)


def test_another_array_another_part_and_another_function_are_other_questions():
    memory, (make, calls), (other, more) = Memory(), counted(), counted()
    x = np.arange(5.0)
    memory(make, x, Part(2.0))
    memory(make, x.copy(), Part(2.0))
    memory(make, x, Part(3.0))
    memory(make, x, Part(2.0), 1.0)
    memory(other, x, Part(2.0))
    assert (len(calls), len(more)) == (4, 1)


def test_an_array_that_is_gone_is_not_taken_for_a_new_one_at_its_place():
    """Memory keeps what it was asked about, so that no new array can have the identity of an old one."""
    memory, (make, _) = Memory(), counted()
    for k in range(200):
        x = np.full(3, float(k))
        np.testing.assert_array_equal(memory(make, x, Part(1.0)), x)
        del x


@given(st.lists(st.integers(0, 20), max_size=60), st.integers(0, 10))
def test_what_is_forgotten_is_worked_out_again(asked, room):
    memory, (make, _) = Memory(limit=room * 160), counted()
    arrays = [np.full(10, float(k)) for k in range(21)]
    for k in asked:
        np.testing.assert_array_equal(memory(make, arrays[k], Part(3.0)), 3.0 * arrays[k])
    assert memory._bytes <= max(room * 160, 160)


def test_what_is_held_is_bounded_with_what_it_was_made_of():
    """Small results of large arrays that never come again: the arrays must not pile up behind them."""
    memory, held = Memory(limit=1_000_000), []
    for k in range(100):
        x = np.full(10_000, float(k))
        held.append(weakref.ref(x))
        assert memory(np.sum, x) == 10_000.0 * k
        del x
    assert sum(ref() is not None for ref in held) <= 1_000_000 // 80_000 + 1


def test_threads_share_it():
    memory, (make, _) = Memory(limit=4000), counted()
    arrays = [np.full(10, float(k)) for k in range(100)]

    def ask(k):
        return np.array_equal(memory(make, arrays[k % 100], Part(2.0)), 2.0 * arrays[k % 100])

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(ask, range(2000)))
