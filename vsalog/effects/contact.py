"""Contact: a push on the link from outside, once. What looks for it is `diagnosis.causes.link`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.quantities import Duration, TimeSpan, Torque
from vsalog.effects.base import Effect, Key
from vsalog.effects.body_torque import BodyTorque

Array = NDArray[np.float64]


class Contact(BodyTorque, frozen=True):
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

    @staticmethod
    def formula(x: Any, v: Any, t: Any, p: Array, at: int) -> Any:
        """Return the push, which is zero before and after."""
        passed = np.minimum(np.maximum((t - p[at]) / p[at + 1], 0.0), 1.0)
        return p[at + 2] * np.sin(np.pi * passed) ** 2

    def numbers(self, ratio: float) -> tuple[float, ...]:
        """Return start and duration [s], and torque [N·m]."""
        return self.start, self.duration, self.torque

    def slopes(self, ratio: float) -> tuple[float, float]:
        """Return zero: it follows from the time alone."""
        return 0.0, 0.0


EFFECT = Effect(keys=(Key("link", "contact", Contact, "pushes from outside, [[…link.contact]]", many=True),))
