"""Estimators: one published method per file, and the table of them.

Third parties add a method by an entry point in the group ``vsalog.estimators`` that names a module with `NAME`, `SUMMARY`,
`TUNING`, `roles` and `build`, as the modules here have them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, Protocol

from vsalog.core.errors import EstimatorError, did_you_mean
from vsalog.core.finding import Finding
from vsalog.core.model import JointModel
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device
from vsalog.estimators.tuning import Tuning

BUILT_IN = {
    "residual-rls": "vsalog.estimators.residual_rls",
    "qr-rls": "vsalog.estimators.qr_rls",
    "batch-ls": "vsalog.estimators.batch_ls",
    "direct": "vsalog.estimators.direct",
    "algebraic": "vsalog.estimators.algebraic",
    "impedance": "vsalog.estimators.impedance",
    "impedance-coupled": "vsalog.estimators.impedance_coupled",
    "grioli-bicchi": "vsalog.estimators.grioli_bicchi",
    "grioli-parametric": "vsalog.estimators.grioli_parametric",
    "acceleration-observer": "vsalog.estimators.acceleration_observer",
    "pam-ukf": "vsalog.estimators.pam_ukf",
    "pam-model": "vsalog.estimators.pam_model",
}


class Filters(Protocol):
    """What an estimator does to signals before it learns from them.

    Attributes
    ----------
    window : samples that it looks at together
    """

    window: int

    def check_length(self, longest: int) -> None:
        """Refuse signals whose longest stretch without a gap has too few samples."""


class Fold(Protocol):
    """An assembled estimator: a fold over blocks of signals. States are its own affair."""

    passes: int

    @property
    def conditioner(self) -> Filters:
        """The filters before it."""

    @property
    def derived(self) -> dict[str, float]:
        """What was derived from the log where the tuning left it open."""

    def start(self) -> Any:
        """Return the state before the first sample."""

    def freeze(self, state: Any) -> Any:
        """Go back to the first sample with what was learnt."""

    def step(self, state: Any, block: JointSignals) -> tuple[Any, list[Trace]]:
        """Take a block of samples; give the new state and the trace of the rows that are ready."""

    def finish(self, state: Any) -> tuple[Any, list[Trace]]:
        """Give out the rows that are still held back."""

    def findings(self, state: Any) -> tuple[Finding, ...]:
        """Return what a person should know of what was learnt."""

    def model(self, state: Any) -> JointModel:
        """Freeze what has been learnt into a model."""


class Method(Protocol):
    """What the module of a method offers."""

    NAME: str
    SUMMARY: str
    TUNING: type[Tuning]

    def roles(self, device: Device, offered: Collection[str], tuning: Tuning) -> tuple[str, ...]:
        """Return the roles the method reads, or raise EstimatorError for a missing one."""

    def build(self, device: Device, signals: JointSignals, tuning: Tuning) -> Fold:
        """Assemble the estimator for a joint's signals."""


def methods() -> Mapping[str, str]:
    """Return every method's name and module, those of third parties included."""
    found = dict(BUILT_IN)
    for point in entry_points(group="vsalog.estimators"):
        found.setdefault(point.name, point.value)
    return found


def method(name: str) -> Method:
    """Return a method by name.

    Raises
    ------
    EstimatorError
        There is no such method; the nearest names are suggested.
    """
    known = methods()
    if name not in known:
        raise EstimatorError(
            f"there is no estimator '{name}'{did_you_mean(name, known) or '.'} There are: auto, {', '.join(known)}"
        )
    module: Method = import_module(known[name])
    return module
