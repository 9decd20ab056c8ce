"""A nominal machine on the bench: hide effects in it, and say how visible they are."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .devices import ALL_DEVICES
from .effects import Effect, Scales, Shape
from .equations import LeftOver
from .machines import Machine, Sensors
from .motion import Truth, Wanted
from .sensors import Quality, ideal


@dataclass
class Hidden:
    """An effect with everything decided: where, how strong, and what that makes of its parameters.

    One that is `shared` is the same, by the same strength, in another part of the joint.
    """

    effect: Effect
    part: str
    shape: Shape
    strength: float
    parameters: dict[str, float] = field(default_factory=dict)
    size: float = 0.0
    shared: bool = False


@dataclass
class Bench:
    """A nominal machine that has been played once, and what it takes to say how visible a change is.

    Attributes
    ----------
    nominal : the machine without effects
    follow : what its servos follow
    truth : what then happens
    qualities : role → of its sensor
    scales : of the motion
    missing : roles that are not recorded
    most : times the nominal machine's torque that the servo may need
    """

    nominal: Machine
    follow: Wanted
    truth: Truth
    qualities: dict[str, Quality]
    scales: Scales
    missing: tuple[str, ...]
    most: float = 2.5

    def changed(self, hidden: list[Hidden]) -> tuple[Machine, Sensors]:
        """Return the machine and its sensors with effects; notes their parameters."""
        machine, sensors = self.nominal.copy(), Sensors()
        for h in hidden:
            h.parameters = h.effect.hide(h.strength, h.shape, machine, sensors, h.part, self.scales)
        return machine, sensors

    def left_over(self, hidden: list[Hidden]) -> dict[str, LeftOver] | None:
        """Return what effects leave over in the nominal equations; none where the machine breaks or its servo swings."""
        machine, sensors = self.changed(hidden)
        device = ALL_DEVICES[self.nominal.device]
        # What is wrong with sensors alone leaves the motion as it is.
        unmoved = all(h.effect.cause.startswith("sensor.") for h in hidden)
        truth = self.truth if unmoved else device.happened(machine, self.follow)
        if truth is None or wild(truth, self.truth, self.most):
            return None
        said = {r: v for r, v in ideal(truth, sensors, self.nominal).items() if r not in self.missing}
        return device.left_over(self.nominal, said, self.qualities, truth.inside, truth.period)

    def size(self, hidden: list[Hidden]) -> float:
        """Return how visible effects are: the largest ratio of all equations, NaN where there is none."""
        parts = self.left_over(hidden)
        return float("nan") if parts is None else max(part.ratio for part in parts.values())

    def scaled(self, one: Hidden, wanted: float, sign: float, rounds: int = 8) -> bool:
        """Find the strength at which an effect is as visible as wanted, or as near as its bounds allow."""
        low, high = one.effect.bounds(self.nominal, one.part, self.scales)
        most = -low if sign < 0.0 else high
        weak, strong = 0.0, most
        one.strength = sign * 0.3 * most
        for _ in range(rounds):
            one.size = self.size([one])
            if np.isfinite(one.size) and (one.size == 0.0 or abs(np.log(one.size / wanted)) < 0.15):
                break
            here = abs(one.strength)
            if np.isfinite(one.size) and one.size < wanted:
                weak = here
            else:
                strong = here
            # Sizes grow about as strengths do; what has been tried sets the limits.
            guess = here * wanted / one.size if np.isfinite(one.size) else 0.4 * here
            if not weak < guess < strong:
                guess = most if strong == most and weak > 0.7 * most else 0.5 * (weak + strong)
            if guess == here:
                break
            one.strength = sign * guess
        return bool(np.isfinite(one.size))


def wild(truth: Truth, nominal: Truth, most: float = 2.5) -> bool:
    """Tell whether an effect made the servo swing: much more torque than the nominal machine's."""
    inside = truth.inside
    torques = [role for role in truth.roles if role.startswith(("motor_torque", "secondary_torque"))]
    return any(np.std(truth.roles[r][inside]) > most * np.std(nominal.roles[r][inside]) for r in torques)
