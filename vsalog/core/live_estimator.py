"""An estimator that runs in a control loop, as a controller sees it: given samples one by one."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Protocol

from vsalog.core.recording import Recording

# Joint → role → its sensor's reading.
Said = Mapping[str, Mapping[str, float]]


class LiveEstimator(Protocol):
    """An estimator that is given samples one by one."""

    @property
    def reads(self) -> Mapping[str, Collection[str]]:
        """Joint → roles of the sensors that it needs."""
        ...

    def prepare(self, dry: Recording) -> None:
        """Estimate the sensors' noise from a run without feedback."""
        ...

    def take(self, k: int, said: Said) -> dict[str, float]:
        """Return the estimate after sample `k`, column → value; empty while there is none."""
        ...
