"""What sensors may do that is more than one number of the rig: an encoder off its axis, a torque that was computed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from vsalog.diagnosis.causes.base import (
    Cause,
    Parameter,
    Setting,
    Site,
    recorded,
    with_signal,
)
from vsalog.diagnosis.causes.one_number import ANGLES
from vsalog.effects.base import Exactness
from vsalog.effects.eccentricity import Eccentricity


class EncoderEccentricity(Cause):
    """An encoder's disc off its axis."""

    name = "sensor.encoder_eccentricity"
    exact = Exactness.WAVY
    title = "The disc of the {part} encoder is off its axis"
    says = "the deflection is off by a sine of the position, once per turn"
    confirm = "Turn the joint slowly through a whole turn, unloaded: motor and link encoder differ by a sine."
    reference = "Hagiwara, Suzuki, Murase (1992), A method of improving the resolution and accuracy of rotary encoders"
    signature = "all equations with φ: sin(x + α) σ(φ)"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per encoder of an angle that turns."""
        for role, signal in recorded(setting, ANGLES):
            disc = signal.eccentricity
            cosine, sine = (
                (disc.amplitude * np.cos(disc.phase), disc.amplitude * np.sin(disc.phase)) if disc else (0.0, 0.0)
            )
            step = 1e-3 * setting.deflection_size("")
            # amplitude · sin(x + phase) = (amplitude cos phase) sin x + (amplitude sin phase) cos x
            parameters = (
                Parameter("sine", "rad", float(cosine), step, -0.3, 0.3, hard=True, key="eccentricity.amplitude"),
                Parameter("cosine", "rad", float(sine), step, -0.3, 0.3, hard=True, key="eccentricity.amplitude"),
            )
            yield Site(self.name, role, parameters, _eccentric(role), report=_disc)


def _eccentric(role: str) -> Any:
    def apply(joint: Any, values: Sequence[float]) -> Any:
        reported = _disc(values)
        return with_signal(joint, role, eccentricity=Eccentricity(reported["amplitude"][0], reported["phase"][0]))

    return apply


def _disc(values: Sequence[float]) -> dict[str, tuple[float, str]]:
    sine, cosine = float(values[0]), float(values[1])
    return {"amplitude": (float(np.hypot(sine, cosine)), "rad"), "phase": (float(np.arctan2(cosine, sine)), "rad")}


class TorqueNotIndependent(Cause):
    """A torque channel that was computed, not measured; found before anything is fitted, see `validation.computed_torque`."""

    name = "sensor.torque_not_independent"
    title = "The {part} is no measurement: it was computed from another channel"
    says = "it follows from another channel without any noise of its own"
    confirm = "Push the link with the motor switched off: a sensor responds, a formula of the motor's current does not."
    reference = "see `vsalog validate`, which refuses such a channel as a reference"
    signature = "a function of the deflection or of the motor's torque"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield nothing: it has no parameters to fit."""
        return iter(())
