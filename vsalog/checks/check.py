"""The interface of a check, which reads a joint's signals and the trace of an estimate, and returns findings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from vsalog.core.finding import Finding
from vsalog.core.recording import Recording
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device
from vsalog.estimators.fold import Fold
from vsalog.rig.schema import Joint


@dataclass(frozen=True, slots=True)
class Context:
    """The input of checks.

    Attributes
    ----------
    recordings, setpoints : as they were bound; a fixed set-point per recording [SI], None for none
    device, joint : of the rig
    estimator, read : name of the estimator, and the roles that it reads
    signals, look : bound, the whole log; and the part that is read where it is too long for memory, all of it otherwise
    fold : the estimator
    """

    recordings: Sequence[Recording]
    setpoints: Sequence[float | None]
    device: Device
    joint: Joint
    estimator: str
    read: Sequence[str]
    signals: JointSignals
    look: JointSignals
    fold: Fold


class Watch(Protocol):
    """A check at work on one log."""

    def add(self, trace: Trace) -> None:
        """Take a block of the trace into account; blocks come in order."""

    def findings(self) -> Iterable[Finding]:
        """Return what was found when the log has ended; nothing that invalidates the trace, which is written by then."""


class Check(Protocol):
    """A kind of check.

    Attributes
    ----------
    name : one noun, unique
    supersedes : code of a finding → codes with the same meaning, or that follow from it
    """

    name: str
    supersedes: Mapping[str, Sequence[str]]

    def start(self, context: Context) -> Watch | None:
        """Begin with a log; None where there is nothing to check."""


@dataclass(frozen=True, slots=True)
class OfSignals:
    """A check that reads signals alone, and is complete."""

    found: Sequence[Finding]

    def add(self, trace: Trace) -> None:
        """Ignore the block."""

    def findings(self) -> Sequence[Finding]:
        """Return what was found."""
        return self.found


def without_superseded(findings: Iterable[Finding], rules: Mapping[str, Sequence[str]]) -> list[Finding]:
    """Return findings without those that another one supersedes."""
    found = list(findings)
    superseded = {code for finding in found for code in rules.get(finding.code, ())}
    return [finding for finding in found if finding.code not in superseded]
