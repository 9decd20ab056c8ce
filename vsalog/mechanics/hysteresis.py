"""Hysteresis of a transmission, from the deflection that was measured.

A loop has a memory, and its state before the log is not known. So it is followed from both extremes it could have
begun with: their middle is taken as its torque, and half of their distance is the doubt, which decays as the
deflection moves.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.mechanics._atoms import STAMP, beyond_gap, loop_after, slipped
from vsalog.rig.parts import Transmission, UnknownTransmission

Array = NDArray[np.float64]


def loop_level(transmission: Transmission) -> float:
    """Return the largest torque of all loops together [N·m]; 0 where there is none."""
    if isinstance(transmission, UnknownTransmission):
        return 0.0
    smooth = transmission.bouc_wen.torque if transmission.bouc_wen is not None else 0.0
    return smooth + sum(e.limit for e in transmission.slip)


def loop_start(transmission: Transmission) -> Array:
    """Return the state before the first sample, shape (2, 2 + n): a deflection, there the loop and n slip elements; and again.

    The second row has the direction in which the deflection was reached in the place of the deflection.
    """
    state = np.full((2, 2), np.nan)
    if isinstance(transmission, UnknownTransmission):
        return state
    state[:, 1] = (1.0, -1.0)
    limits = np.array([e.limit for e in transmission.slip])
    return np.hstack((state, np.stack((limits, -limits))))


def loop_block(state: Array, transmission: Transmission, phi: Array, slack: float = 0.0) -> tuple[Array, Array, Array]:
    """Return the torque of a transmission's loops over its deflection.

    Noise alone, going to and fro, would erase a loop's memory. It is therefore kept, at the farthest deflection, until the
    deflection has come back by more than `slack`, and the motion until then starts from there.

    Parameters
    ----------
    state : of `loop_start` or a previous call
    transmission : of the rig
    phi : shape (N,), deflection [rad]; the loops rest while it is NaN
    slack : how far noise may move the deflection [rad]

    Returns
    -------
    state
    torque : shape (N,) [N·m], NaN where `phi` is
    doubt : shape (N,), by how much it may be off [N·m]
    """
    new, out = state.copy(), np.zeros((2, phi.shape[0]))
    if isinstance(transmission, UnknownTransmission):
        return new, out[0], out[1]
    loop = transmission.bouc_wen
    torque, width, exponent, shape = (
        (0.0, 1.0, 1.0, 1.0) if loop is None else (loop.torque, loop.width, loop.exponent, loop.shape)
    )
    elements = np.array([(e.stiffness, e.limit) for e in transmission.slip]).reshape(-1, 2)
    _follow(phi, 0.5 * transmission.backlash, torque, width, exponent, shape, slack, elements, new, out)
    return new, out[0], out[1]


def _compiled_follow(stamp: str) -> Callable[..., Any]:
    """Compile it again where a formula that it calls has changed, which numba's cache does not see."""

    @njit(cache=True, error_model="numpy")
    def follow(
        phi: Array, half_gap: float, torque: float, width: float, exponent: float, shape: float, slack: float, elements: Array,
        state: Array, out: Array,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        for k in range(phi.shape[0]):
            x = phi[k]
            if np.isnan(x):
                out[0, k], out[1, k] = np.nan, np.nan
                continue
            u = beyond_gap(x, half_gap)[0]
            begin = np.isnan(state[0, 0])
            du = 0.0 if begin else u - state[0, 0]
            kept = begin or abs(du) > slack or du * state[1, 0] > 0.0
            middle, doubt = 0.0, 0.0
            for extreme in range(2):
                total = 0.0
                if torque > 0.0:
                    z = loop_after(state[extreme, 1], du, width, exponent, shape)
                    if kept:
                        state[extreme, 1] = z
                    total += torque * z
                for e in range(elements.shape[0]):
                    limit = elements[e, 1]
                    pulled = slipped(state[extreme, 2 + e], du, elements[e, 0], limit)
                    if kept:
                        state[extreme, 2 + e] = pulled
                    total += pulled
                middle += 0.5 * total
                doubt += 0.5 * total if extreme == 0 else -0.5 * total
            out[0, k], out[1, k] = middle, doubt
            if kept:
                state[0, 0], state[1, 0] = u, np.sign(du)

    return follow


_follow = _compiled_follow(STAMP)
