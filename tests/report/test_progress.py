"""What a terminal is shown of work under way: a bar with the time that is left, and what is compiled."""

import io
import time
from functools import partial

import pytest
from numba import njit
from rich.console import Console

from vsalog.core.progress import Advanced, tell
from vsalog.report import progress as module
from vsalog.report.progress import BatchProgress, Progress
from vsalog.report.verbosity import Verbosity, ask


@pytest.fixture
def screen(monkeypatch):
    """What is written to a terminal of 80 columns."""
    screen = io.StringIO()
    # What numba keeps of stdout when it first compiles must outlive the bar.
    monkeypatch.setattr(module, "Bar", partial(module.Bar, redirect_stdout=False, redirect_stderr=False))
    monkeypatch.setattr(
        module, "Console", lambda **_: Console(file=screen, force_terminal=True, width=80, color_system=None)
    )
    yield screen
    ask(Verbosity.NORMAL)


def loop():
    """Return a numerical loop of vsalog's that nobody has compiled."""

    def added(x):
        return x + 1

    added.__module__ = "vsalog.made"
    return njit(added)


def work(share, at_most=False):
    with Progress() as progress:
        progress.say("estimating")
        tell(Advanced("estimate", 0.0, at_most))
        time.sleep(0.3)
        tell(Advanced("estimate", share, at_most))
        time.sleep(0.3)


def test_a_step_has_a_bar_with_the_time_left(screen):
    work(0.01)
    assert "estimating: filtering" in screen.getvalue()
    # A hundredth took 0.3 s or more.
    assert any(f"{seconds} s left" in screen.getvalue() for seconds in range(25, 60))
    assert "at most" not in screen.getvalue()


def test_a_bar_is_one_line_of_the_terminal(screen):
    def drawn():
        """Return what the last bar drew before it was erased."""
        return screen.getvalue().rpartition("\x1b[?25l")[2].partition("\n\x1b[?25h")[0]

    with Progress() as progress:
        progress.say("estimating a joint whose name is long, which leaves little room")
        tell(Advanced("checks", 0.0))
        time.sleep(0.3)
        tell(Advanced("checks", 0.01, at_most=True))
        time.sleep(0.3)
    assert "\n" not in drawn()
    with BatchProgress() as shown:
        shown.begin([1] * 20)
        shown.now("a log in a folder of a name that is long, of an experiment that took a whole night")
        time.sleep(0.3)
    assert "whole night" not in drawn()
    assert "\n" not in drawn()


def test_a_loop_that_may_end_earlier_says_at_most(screen):
    work(0.01, at_most=True)
    assert "at most" in screen.getvalue()


def test_quiet_shows_nothing(screen):
    ask(Verbosity.QUIET)
    work(0.5)
    with Progress() as progress, progress.saying_when_compiling():
        loop()(1)
    assert screen.getvalue() == ""


def test_compiling_is_announced_once_and_counted(screen):
    with Progress() as progress:
        with progress.saying_when_compiling():
            for _ in range(2):
                loop()(1)
        assert progress.loops is not None
        assert (progress.loops.count, progress.loops.done) == (2, True)
        assert progress.loops.seconds > 0.0
    assert screen.getvalue().count("once") == 1
    assert progress.loops.most >= 2
    with Progress() as progress, progress.saying_when_compiling():
        compiled = loop()
        compiled(1)
        before = progress.loops.count
        compiled(2)
        assert progress.loops.count == before
