"""What an estimator is, and what the module of a method offers."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Protocol, TypeGuard

from vsalog.core.finding import Finding
from vsalog.core.model import JointModel
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device
from vsalog.estimators.tuning import Tuning


class Filters(Protocol):
    """The preprocessing of signals before an estimator uses them.

    Attributes
    ----------
    window : samples that it looks at together
    """

    window: int

    def check_length(self, longest: int) -> None:
        """Refuse signals whose longest stretch without a gap has too few samples."""


class Fold(Protocol):
    """An assembled estimator: a fold over blocks of signals. Its states are private.

    Attributes
    ----------
    passes : how often it goes through the signals; the traces of the last time count. One that smooths puts aside what it needs
        (`vsalog.estimators.spool`) the first time, works through that from the end in `freeze`, and gives it out the second time
    """

    passes: int

    @property
    def conditioner(self) -> Filters:
        """The filters before it."""

    @property
    def derived(self) -> dict[str, float]:
        """Parameters derived from the log where the tuning left them open."""

    def start(self) -> Any:
        """Return the state before the first sample."""

    def freeze(self, state: Any) -> Any:
        """Go back to the first sample with the result."""

    def step(self, state: Any, block: JointSignals) -> tuple[Any, list[Trace]]:
        """Take a block of samples; give the new state and the trace of the rows that are ready."""

    def finish(self, state: Any) -> tuple[Any, list[Trace]]:
        """Give out the rows that are still held back."""

    def findings(self, state: Any) -> tuple[Finding, ...]:
        """Return the findings about the estimate."""

    def model(self, state: Any) -> JointModel:
        """Freeze the result into a model."""


class FollowingFold(Fold, Protocol):
    """A fold that follows a spring that changes, and chooses from a log how: what most folds need not offer.

    Attributes
    ----------
    follows_changes : true
    """

    follows_changes: bool

    def rebuilt(self, signals: JointSignals) -> Fold:
        """Return the fold for other signals of the same joint, with the functions of this one."""

    def settled(self, state: Any) -> Fold:
        """Return the same fold, which no longer chooses anything but takes what it chose."""


def follows_changes(fold: Fold) -> TypeGuard[FollowingFold]:
    """Return whether a fold follows a spring that changes."""
    return bool(getattr(fold, "follows_changes", False))


class Method(Protocol):
    """What the module of a method offers."""

    NAME: str
    SUMMARY: str
    TUNING: type[Tuning]

    def roles(self, device: Device, offered: Collection[str], tuning: Tuning) -> tuple[str, ...]:
        """Return the roles the method reads, or raise EstimatorError for a missing one."""

    def build(self, device: Device, signals: JointSignals, tuning: Tuning) -> Fold:
        """Assemble the estimator for a joint's signals."""
