"""Work in a copy of the process."""

import os
import time

import numpy as np
import pytest

from vsalog.readers.sandbox import SandboxError, sandboxed

MIB = 2**20


def test_what_it_returns_comes_back():
    value = {"x": np.arange(6.0).reshape(2, 3, order="F"), "s": [{"y": np.arange(3, dtype=">i2")}, "text", None, 7]}
    back = sandboxed(lambda: value, 64 * MIB)
    np.testing.assert_array_equal(back["x"], value["x"])
    np.testing.assert_array_equal(back["s"][0]["y"], [0, 1, 2])
    assert back["s"][1:] == ["text", None, 7]


def fails():
    raise OSError("what is wrong")


@pytest.mark.parametrize(
    ("work", "words"),
    [
        (os.abort, "ends the process"),
        (lambda: os._exit(0), "ends the process"),
        (lambda: np.ones(2**28), "more memory"),
        (lambda: time.sleep(60), "more than 4 s"),
        (fails, "what is wrong"),
        (lambda: object(), "ends the process"),
    ],
)
def test_what_goes_wrong_is_an_error_of_its_own(work, words):
    begin = time.perf_counter()
    with pytest.raises(SandboxError, match=words):
        sandboxed(work, 64 * MIB)
    assert time.perf_counter() - begin < 10


def test_nothing_reaches_the_terminal(capfd):
    with pytest.raises(SandboxError):
        sandboxed(lambda: os.write(2, b"words") and os.abort(), 64 * MIB)
    assert capfd.readouterr() == ("", "")
