"""Stretches of a long log, and what the steps of a sensor add to what it reads."""

import numpy as np
import pytest

from vsalog.core.errors import FilterError
from vsalog.core.look import stretches
from vsalog.core.resolution import sensor_noise
from vsalog.filters.derivatives import Derivatives


def test_eight_stretches_show_what_changes_over_a_log():
    assert stretches(1600, 800) == [(first, first + 100) for first in np.linspace(0, 1500, 8).astype(int).tolist()]
    assert stretches(800, 800) == [(0, 800)]


def test_a_run_holds_the_longest_window():
    Derivatives({"q": 1}, 1e-3, 100.0, 2)
    with pytest.raises(FilterError):
        Derivatives({"q": 1}, 1e-3, 140.0, 2)


def test_steps_add_what_rounding_does():
    read = np.random.default_rng(0).uniform(0.0, 100.0, 10_000)
    assert sensor_noise(np.zeros(100), 1.0, 1e-9) == pytest.approx(np.std(read - np.round(read)), rel=0.05)
