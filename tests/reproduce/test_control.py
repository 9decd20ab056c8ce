"""The papers' controllers in the loop: what is reported of them holds on machines that they do not know exactly."""

from dataclasses import replace

import numpy as np
import pytest

from vsalog.estimation.live import LiveEstimate
from vsalog.reproduce import deluca2007_motion, shin_control
from vsalog.reproduce.measure import Study


def test_the_observers_state_damps_better_than_motor_states():
    """De Luca 2007 §V-B: "significant improvements in damping and overshoot"."""
    motion = deluca2007_motion.MOTIONS[0]
    runs = {feedback: deluca2007_motion.swung(motion, feedback, 3) for feedback in deluca2007_motion.FEEDBACK}
    step = np.radians(5.0)
    over = {f: np.max(r.joints["axis1"].truth["link_position"]) / step - 1.0 for f, r in runs.items()}
    assert 0.0 < over["acceleration-observer"] < 0.75 * over["motor"]


def test_both_motions_are_as_long_as_printed():
    assert [m.degrees for m in deluca2007_motion.MOTIONS] == [5.0, 30.0]
    for motion in deluca2007_motion.MOTIONS:
        path = deluca2007_motion.reference(motion)(np.array([0.0, deluca2007_motion.arrival(motion)]))
        np.testing.assert_allclose(np.degrees(path), [0.0, motion.degrees])


def test_a_steady_error_is_that_before_each_step_and_before_the_end():
    time = np.arange(0.0, 10.0, 0.01)
    reference = np.where(time < 5.0, 1.0, 2.0)
    off = np.where(time < 3.9, 0.7, 0.1) + np.where((time > 5.0) & (time < 8.9), 0.5, 0.0)
    assert shin_control.steady_error(time, reference, reference + off) == pytest.approx(0.1)
    off[time > 9.5] = -0.3
    assert shin_control.steady_error(time, reference, reference + off) == pytest.approx(0.3)


def test_the_filter_alone_tells_what_the_estimator_in_the_loop_tells(monkeypatch):
    task = replace(shin_control.TASKS[1], times=(0.1,), values=(2.0,))
    monkeypatch.setitem(shin_control.END, task.scenario, 0.4)
    alone = shin_control._run(Study((7,)), task, 7, 1e-3, "printed")

    class Whole(LiveEstimate):
        estimates = ()

        def take(self, k, readings):
            self.estimates = [*self.estimates, super().take(k, readings)]
            return self.estimates[-1]

    monkeypatch.setattr(shin_control, "FilterAlone", Whole)
    whole = shin_control._run(Study((7,)), task, 7, 1e-3, "printed")
    np.testing.assert_allclose(alone.estimated, whole.estimated, rtol=1e-9, atol=1e-12)
    assert alone.actual[-1] > 0.1
