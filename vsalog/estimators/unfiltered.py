"""What methods have in the place of a conditioner that filter for themselves."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Unfiltered:
    """Nothing is filtered before: every sample counts."""

    window = 1

    def check_length(self, longest: int) -> None:
        """Any stretch is long enough."""
