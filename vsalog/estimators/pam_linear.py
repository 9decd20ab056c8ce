"""States of a pneumatic joint by a linear model: "the whole of the proposed model is replaced" (Shin 2021 §IV-B, model 1).

The paper prints no linear model. This one is eq. 11 without dry friction, linearised about the rest at which the log's median
pressures hold the joint; what is measured is linear anyway (P₁ and P₂), and so is the torque here:

    x[k+1] = x̄ + A (x[k] − x̄) + B (u[k] − ū),    τ = τ̄ + C (x − x̄).

The valves' map α = κ(u) is kept, as a table that was measured. The sigma points of a linear model give the Kalman filter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec.structs import replace
from numba import njit
from numpy.typing import NDArray

from vsalog.core.source_stamp import source_stamp
from vsalog.estimators import pam_states
from vsalog.estimators.pam_noise import PamNoise
from vsalog.estimators.pam_states import Column, PamFold, pam_observation, pam_transition
from vsalog.filters import square_root_ukf as ukf
from vsalog.filters import unscented_smoother as smoothing
from vsalog.mechanics import pneumatics as pneu
from vsalog.rig.schema import PneumaticJoint, PressureFriction

Array = NDArray[np.float64]

# Steps to either side for the model's slopes: P₁, P₂ [Pa], ψ [rad], ψ̇ [rad/s], α₁, α₂, τ_ext [N·m].
MOVED = np.array([10.0, 10.0, 1e-5, 1e-4, 1e-4, 1e-4, 1e-5])


class LinearPamFold(PamFold):
    """The fold with a linear model.

    Attributes
    ----------
    A, B : shape (4, 4) and (4, 3), of a step of (P₁, P₂, ψ, ψ̇) under (α₁, α₂, τ_ext)
    at, held_by : shape (4,) and (3,), x̄ and ū
    torque, slope : τ̄ [N·m] and C, shape (4,)
    """

    def __init__(
        self,
        joint: PneumaticJoint,
        period: float,
        noise: PamNoise,
        pressures: tuple[float, float],
        *,
        correct: bool = True,
    ) -> None:
        """Prepare as `PamFold`; `pressures` are P₁ and P₂ about which it is linearised, absolute [Pa].

        Raises
        ------
        EstimatorError
            As `PamFold`, and where the muscles do not hold the joint at these pressures.
        """
        friction = joint.friction
        viscous = (
            replace(friction, shaft_coefficient=0.0, muscle=0.0) if isinstance(friction, PressureFriction) else None
        )
        joint = replace(joint, friction=viscous)
        super().__init__(joint, period, noise, correct=correct)
        psi = self._nonlinear_rest(np.array(pressures), 0.0)
        self.at = np.array([*pressures, psi, 0.0])
        self.held_by = np.array([*(_holding(joint, i, p) for i, p in enumerate(pressures)), 0.0])
        slopes = np.empty((4, 7))
        for j in range(7):
            ends = [self._stepped(j, side * MOVED[j]) for side in (1.0, -1.0)]
            slopes[:, j] = (ends[0] - ends[1]) / (2.0 * MOVED[j])
        self.A, self.B = slopes[:, :4].copy(), slopes[:, 4:].copy()
        self.torque = float(pneu.joint_torque(joint, psi, *pressures))
        self.slope = np.array([self._torque_slope(j) for j in range(4)])
        self._model = (self.at, self.held_by, self.A, self.B)
        self._run, self._back = _run, _back

    def estimates(self, trace: ukf.UnscentedTrace) -> dict[str, Array]:
        """Return torque and stiffness as `PamFold` does: the torque is linear, the stiffness what it is at rest."""
        there = {
            "torque": self.torque + (trace.x - self.at) @ self.slope,
            "torque_std": np.linalg.norm(np.einsum("nij,i->nj", trace.S, self.slope), axis=1),
        }
        for name, function in (("stiffness", pneu.trapped_stiffness), ("stiffness_isobaric", pneu.isobaric_stiffness)):
            value = float(function(self.joint, self.at[Column.ANGLE], self.at[0], self.at[1]))
            there[name] = np.where(np.isfinite(trace.x[:, 0]), value, np.nan)
            there[f"{name}_std"] = np.where(np.isfinite(trace.x[:, 0]), 0.0, np.nan)
        return there

    def _rest(self, pressures: Array, external: float) -> float:
        """Return ψ at which the linear torque, k_s and the push cancel."""
        seesaw = self.joint.seesaw
        if seesaw.held_at is not None:
            return seesaw.held_at
        drive = float(self.slope[:2] @ (pressures - self.at[:2])) + external
        return float(self.at[Column.ANGLE] + drive / (seesaw.return_stiffness - self.slope[Column.ANGLE]))

    def _nonlinear_rest(self, pressures: Array, external: float) -> float:
        return super()._rest(pressures, external)

    def _stepped(self, which: int, by: float) -> Array:
        x, u = self.at.copy(), self.held_by.copy()
        (x if which < 4 else u)[which % 4] += by
        X, Y = x.reshape(4, 1), np.empty((4, 1))
        pam_transition(X, 0, u, self._model, Y)
        return Y[:, 0]

    def _torque_slope(self, which: int) -> float:
        if which == 3:
            return 0.0
        ends = []
        for side in (1.0, -1.0):
            x = self.at.copy()
            x[which] += side * MOVED[which]
            ends.append(float(pneu.joint_torque(self.joint, x[Column.ANGLE], x[0], x[1])))
        return (ends[0] - ends[1]) / (2.0 * float(MOVED[which]))


def _holding(joint: PneumaticJoint, muscle: int, pressure: float) -> float:
    """Return the opening α at which as much air comes as goes (Proposition 1): α m_in = (1 − α) m_out, leaks with m_out."""
    valve, leak = ((joint.valve_1, joint.muscle_1.leak_area), (joint.valve_2, joint.muscle_2.leak_area))[muscle]
    air = joint.air
    coming = float(pneu.orifice_flow(air, 1.0, air.supply_pressure, pressure))
    going = float(pneu.orifice_flow(air, 1.0, pressure, air.outside_pressure))
    area = valve.area_scale * valve.inflow_area
    lost = going * leak / area if area > 0.0 else 0.0
    return float(np.clip((going + lost) / (coming + going), 0.0, 1.0)) if coming + going > 0.0 else 0.5


@njit(error_model="numpy")
def linear_transition(X: Array, first: int, u: Array, p: Any, Y: Array) -> None:
    """One step of the linear model for the columns X[:, first:]; a valve that is not known holds its pressure."""
    at, held_by, A, B = p
    for j in range(first, X.shape[1]):
        for i in range(4):
            s = at[i]
            for m in range(4):
                s += A[i, m] * (X[m, j] - at[m])
            for m in range(3):
                if not np.isnan(u[m]):
                    s += B[i, m] * (u[m] - held_by[m])
            Y[i, j] = s


_predict, _correct = ukf.unscented_filter(linear_transition, pam_observation)
_step_back = smoothing.unscented_smoother(linear_transition)


def _compiled(stamp: str) -> Callable[..., None]:
    # The loops of `pam_states` once more: a cached function finds what it calls among its own module's globals only.
    @njit(cache=True, error_model="numpy")
    def run(
        z: Array, u: Array, choice: Any, x: Array, S: Array, surprise: Array, p: Any, steps: int, correct: bool,
        numbers: Any, room: Any, xs: Array, Ss: Array, nis: Array, diverged: Any,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        weights, SQ, SR, limits = numbers
        for k in range(z.shape[0]):
            for _ in range(steps):
                _predict(x, S, u[k], p, weights, SQ[choice[k]], room)
            square, used = 0.0, 0
            if correct:
                square, used, _ = _correct(x, S, z[k], u[k], p, weights, SR, room)
            ukf.keep(k, x, S, square, used, limits, surprise, xs, Ss, nis, diverged)

    return run


def _compiled_back(stamp: str) -> Callable[..., None]:
    @njit(cache=True, error_model="numpy")
    def back(
        x: Array, S: Array, u: Array, choice: Any, goes_on: Any, x_next: Array, S_next: Array, p: Any, steps: int, weights: Array,
        SQ: Array, room: Any,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  as in `run`
        for k in range(x.shape[0] - 1, -1, -1):
            if goes_on[k]:
                _step_back(x[k], S[k], x_next, S_next, u[k], p, steps, weights, SQ[choice[k]], room)
            x_next, S_next = x[k], S[k]

    return back


_run = _compiled(source_stamp(ukf, pam_states))
_back = _compiled_back(source_stamp(ukf, smoothing, pam_states))
