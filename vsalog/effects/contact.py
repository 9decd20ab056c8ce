"""Contact: a push on the link from outside, once. What looks for it is `diagnosis.causes.link`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.core.quantities import Base, Duration, TimeSpan, Torque
from vsalog.effects.base import Effect

Array = NDArray[np.float64]


class Contact(Base, frozen=True):
    """A push from outside: a torque on the link that swells and fades, torque · sin²(π (t − start) / duration).

    Attributes
    ----------
    start : [s]
    duration : [s]
    torque : at its height [N·m]
    """

    start: TimeSpan
    duration: Duration
    torque: Torque

    def at(self, time: Array) -> Array:
        """Return the torque on the link [N·m], shape of `time` [s]."""
        u = (time - self.start) / self.duration
        return np.where((u > 0.0) & (u < 1.0), self.torque * np.sin(np.pi * u) ** 2, 0.0)


EFFECT = Effect()
