"""Going through signals with an estimator, as often as it asks for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from vsalog.core.progress import counted
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace

if TYPE_CHECKING:  # the package imports the estimators, which import this
    from vsalog.estimators.fold import Fold

BLOCK = 2**13
"""Rows that an estimator works on at a time: what it computes of them stays in a processor's cache."""


def fold_over(fold: Fold, signals: JointSignals, block: int, give: Callable[[Trace], None]) -> Any:
    """Go through signals; give out the blocks of the trace the last time, and return the state at the end.

    Parameters
    ----------
    fold : the estimator
    signals : of a joint
    block : rows at a time
    give : takes the blocks in order
    """
    state = fold.start()
    for left in counted("estimate", range(fold.passes - 1, -1, -1)):
        for part in counted("estimate", signals.blocks(block), -(-len(signals) // block)):
            state, traces = fold.step(state, part)
            if not left:
                for trace in traces:
                    give(trace)
        state, traces = fold.finish(state)
        if left:
            state = fold.freeze(state)
        else:
            for trace in traces:
                give(trace)
    return state


class Estimated(NamedTuple):
    """A fold's trace of signals that fit into memory, in blocks, and its state at the end."""

    blocks: list[Trace]
    state: Any

    @property
    def trace(self) -> Trace:
        """The trace as a whole."""
        return Trace.concatenate(self.blocks)


def run(fold: Fold, signals: JointSignals, block: int = BLOCK) -> Estimated:
    """Run an estimator over signals that fit into memory."""
    kept: list[Trace] = []
    # Where numbers run out of range the estimate is infinite or NaN in the trace; numpy need not warn.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        state = fold_over(fold, signals, block, kept.append)
    return Estimated(kept, state)


def estimated(fold: Fold, signals: JointSignals) -> Trace:
    """Return an estimator's trace of signals that fit into memory."""
    return run(fold, signals).trace
