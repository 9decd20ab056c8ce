"""Quantisation: the least step of an encoder, a converter or a command."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsalog.effects.base import Effect


def rounded(values: Any, step: float) -> Any:
    """Return a number or an array as multiples of `step`, in its unit; as it is where there is no step."""
    # The sum turns −0 into 0.
    return np.round(values / step) * step + 0.0 if step > 0.0 else values


EFFECT = Effect()
