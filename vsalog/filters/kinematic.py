"""Kinematic Kalman filters: position and velocity from an encoder, without a model of the machine.

KKF: Flacco 2014 eq. 28–29, with constant measurement variance. MKKF: Flacco 2012 eq. 18–20, whose measurement variance
falls with speed, since quantisation disturbs a slow signal more than a fast one. The KKF is the MKKF with
`variance_max == variance_min`, so one compiled loop serves both.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.core.errors import FilterError

Array = NDArray[np.float64]


class State(IntEnum):
    """Position, velocity, their covariance, and 1.0 once a first sample has been seen."""

    POSITION, VELOCITY, P11, P12, P22, STARTED = range(6)


PAPER_TRACKING_INDEX = 1e-6 * (1e10 / 10.0) ** 0.5
"""The tracking index T² √(V_a / R) of the papers' tuning at T = 1 ms (V_a = 1e10, R = 10 at rest and 0.1 at speed)."""


@dataclass(frozen=True, slots=True)
class KinematicSettings:
    """Tuning of the (modified) kinematic Kalman filter.

    Attributes
    ----------
    acceleration_variance : V_a, variance of the acceleration missing in the motion model; the process noise is
        Q = V_a Γ Γᵀ with Γ = (T²/2, T)ᵀ [(unit/s²)²]
    variance_max, variance_min : measurement variance at rest and at high speed [unit²]
    shape : α of eq. 20, how sharply the variance falls
    threshold_speed : w_s of eq. 20, the speed of one encoder step per sample [unit/s]
    """

    acceleration_variance: float
    variance_max: float
    variance_min: float
    shape: float = 6.0
    threshold_speed: float = 1.0

    def __post_init__(self) -> None:
        positive = (self.acceleration_variance, self.variance_max, self.variance_min, self.threshold_speed)
        if not all(np.isfinite(v) and v > 0.0 for v in positive):
            raise FilterError(
                "kinematic filter: acceleration_variance, variance_max, variance_min and threshold_speed must be"
                f" positive numbers, not {positive}"
            )
        if self.variance_min > self.variance_max:
            raise FilterError("kinematic filter: variance_min must not exceed variance_max")

    @classmethod
    def for_resolution(cls, resolution: float, period: float, shape: float = 6.0) -> KinematicSettings:
        """Derive the tuning from an encoder's least step, 0 for one without steps, and the sample time.

        The papers' ratios are kept (V_max / V_min = 100 and the tracking index T² √(V_a / V_max)), so that at 1 ms the
        filter is the papers' own and at any other rate it smooths over as many samples.

        Raises
        ------
        FilterError
            No encoder has a step like that.
        """
        # A signal without steps is exact at every speed.
        resolution = resolution or 1e-12
        if not 1e-50 < resolution < 1e50:
            raise FilterError(
                f"kinematic filter: an encoder's least step of {resolution:.3g} cannot be: correct the signal's resolution in"
                " the rig, or leave it out to have it taken from the log"
            )
        variance = resolution**2 / 12.0
        return cls(
            acceleration_variance=variance * (PAPER_TRACKING_INDEX / period**2) ** 2,
            variance_max=variance,
            variance_min=variance / 100.0,
            shape=shape,
            threshold_speed=resolution / period,
        )


def kinematic_start() -> Array:
    """Return the state before the first sample, shape (6,)."""
    return np.zeros(6)


def kinematic_filter(
    z: Array, dt: float | Array, settings: KinematicSettings, state: Array | None = None
) -> tuple[Array, Array, Array]:
    """Filter a block of positions (Flacco 2012 eq. 18–20).

    Parameters
    ----------
    z : shape (n,), measured positions; NaN where a sample is missing (the filter then predicts)
    dt : time since the previous sample [s], one value or shape (n,)
    settings : tuning
    state : as a previous call returned it, shape (6,); None to start again

    Returns
    -------
    position, velocity : shape (n,), estimates given the samples so far; NaN before the first sample
    state : shape (6,), to go on with

    Raises
    ------
    FilterError
        A time step is not positive.
    """
    z = np.ascontiguousarray(z, dtype=np.float64)
    steps = np.broadcast_to(np.asarray(dt, dtype=np.float64), z.shape)
    if z.size and not bool(np.all(steps > 0.0)):
        raise FilterError("kinematic filter: every time step must be positive")
    new = kinematic_start() if state is None else state.copy()
    position, velocity = np.empty_like(z), np.empty_like(z)
    _run(
        z,
        np.ascontiguousarray(steps),
        settings.acceleration_variance,
        settings.variance_max,
        settings.variance_min,
        settings.shape,
        settings.threshold_speed,
        new,
        position,
        velocity,
    )
    return position, velocity, new


@compiled
def _run(
    z: Array,
    dt: Array,
    v_a: float,
    v_max: float,
    v_min: float,
    shape: float,
    w_s: float,
    state: Array,
    position: Array,
    velocity: Array,
) -> None:
    x, v = state[State.POSITION], state[State.VELOCITY]
    p11, p12, p22 = state[State.P11], state[State.P12], state[State.P22]
    started = state[State.STARTED] > 0.0
    for k in range(z.shape[0]):
        if not started:
            if np.isnan(z[k]):
                position[k] = np.nan
                velocity[k] = np.nan
                continue
            # The first sample sets the position; the velocity is unknown to within a few steps per sample.
            x, v = z[k], 0.0
            p11, p12, p22 = v_max, 0.0, 100.0 * (w_s * w_s + v_max / (dt[k] * dt[k]))
            started = True
        else:
            t = dt[k]
            q = v_a * t * t
            x = x + t * v
            p11 = p11 + t * (2.0 * p12 + t * p22) + 0.25 * q * t * t
            p12 = p12 + t * p22 + 0.5 * q * t
            p22 = p22 + q
            if not np.isnan(z[k]):
                exponent = (abs(v) / w_s - 1.0) * shape
                r = v_min if exponent > 700.0 else (v_max - v_min) / (1.0 + np.exp(exponent)) + v_min
                s = p11 + r
                k1, k2 = p11 / s, p12 / s
                e = z[k] - x
                x = x + k1 * e
                v = v + k2 * e
                p22 = p22 - k2 * p12
                p12 = p12 * r / s
                p11 = p11 * r / s
        position[k] = x
        velocity[k] = v
    state[State.POSITION], state[State.VELOCITY] = x, v
    state[State.P11], state[State.P12], state[State.P22] = p11, p12, p22
    state[State.STARTED] = 1.0 if started else 0.0
