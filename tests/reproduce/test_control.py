"""The papers' controllers in the loop: what is said of them holds on machines that they do not know exactly."""

from dataclasses import replace

import numpy as np
import pytest

from vsalog.reproduce import control
from vsalog.reproduce.measure import Study


def test_the_observers_state_damps_better_than_motor_states(monkeypatch):
    """De Luca 2007 §V-B: "significant improvements in damping and overshoot"."""
    monkeypatch.setattr(control, "TRIALS", replace(control.TRIALS, swing=1.6))
    overshoot, swinging = control.state_feedback(Study((3,))).rows
    assert overshoot.verdict == swinging.verdict == "holds"


def test_a_steady_error_is_that_before_each_step_and_before_the_end():
    time = np.arange(0.0, 10.0, 0.01)
    reference = np.where(time < 5.0, 1.0, 2.0)
    off = np.where(time < 3.9, 0.7, 0.1) + np.where((time > 5.0) & (time < 8.9), 0.5, 0.0)
    assert control._steady_error(time, reference, reference + off) == pytest.approx(0.1)
    off[time > 9.5] = -0.3
    assert control._steady_error(time, reference, reference + off) == pytest.approx(0.3)
