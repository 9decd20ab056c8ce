"""How many numbers the modules of vsalog name, and how they are found and changed."""

from pathlib import Path

import vsalog
from tests.limits.constants import constants_below, constants_of
from tests.limits.run import changed

MOST = 225
"""Numbers that modules name, at most; it only falls."""

SOURCE = """
import numpy as np
from numpy import pi
LIMIT = 64
_BYTES, NAME = 2**20, "x"
WIDE: float = 3.0 * pi
PAIR = (1, LIMIT)
FIRST, SECOND = range(2)
ALL = range(5)
TWICE = 2 * LIMIT
lower = 5
TABLE = {1: 2}
RULER = "-" * 80
TRUE = True
def inside():
    HERE = 3
class Row:
    THERE = 3
"""


def test_there_are_no_more_numbers_than_there_were():
    count = len(constants_below(Path(vsalog.__file__).parent))
    assert count <= MOST, f"{count} numbers: derive a new one, or give it to a structure; lower MOST where numbers went"


def test_numbers_at_the_top_of_modules_are_found_and_nothing_else():
    names = ["LIMIT", "_BYTES", "WIDE", "PAIR", "FIRST", "SECOND", "TWICE"]
    assert [one.name for one in constants_of(SOURCE, "one.py")] == names


def value_of(name, change):
    constant = next(one for one in constants_of(SOURCE, "one.py") if one.name == name)
    module = {}
    exec(changed(SOURCE, constant, change), module)
    return module[name], module["TWICE"]


def test_a_change_doubles_or_halves_and_reaches_what_is_derived_from_it():
    assert value_of("LIMIT", "doubled") == (128, 256)
    assert value_of("LIMIT", "halved") == (32, 64)
    assert value_of("_BYTES", "doubled") == (2**21, 128)
    assert value_of("PAIR", "halved") == ((0, 32), 128)
    assert value_of("FIRST", "doubled") == (1, 128)
    assert value_of("FIRST", "halved") == (-1, 128)
    assert value_of("SECOND", "halved") == (0, 128)
