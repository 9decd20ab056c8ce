"""What floating-point numbers resolve."""

from __future__ import annotations

import numpy as np

ROUNDING: float = float(np.finfo(np.float64).eps) ** 0.5
"""Part of a number below which it is rounding [1]: half of a double's digits, which differences and normal equations keep."""
