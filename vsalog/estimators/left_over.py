"""Whether what a fit leaves over follows the motion, as it does where the rig or a clock is wrong.

A signal that is late by δ makes of the deflection q − θ one that is off by δ times the speed, an encoder whose gain is off by a
part one that is off by that part of the position; a wrong inertia leaves its error times the acceleration. A fit of the stiffness
takes for its own what it can of either, and is off without a word. The rest is in the residual: the equation is solved again with
each of these among the regressors, and where that takes away much of the residual, and moves the stiffness by more than its
standard deviation says, that is a finding.

Equations are averaged over windows first. That leaves them as true as they are, takes most of the noise of differentiated
encoders out of both sides alike, and makes accelerations differences of speeds. Noise that is left makes left-overs follow the
acceleration too, but less the longer the average: what is told has to be there in averages four times as long as well. And what
moves the deflection by less than a part of its encoders' steps is not told, for rounding makes as much.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.finding import Finding

if TYPE_CHECKING:
    from vsalog.estimators.equation import Equation

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Samples that are averaged, at least; averages without which nothing is said.
BOX, AVERAGES = 25, 40
# What has to be taken away of the power of what was left over; how much the stiffness has to move, and in how many of its
# standard deviations; how sure the coefficient has to be, in its own.
TAKEN, MOVED, BEYOND, SURE = 0.15, 0.03, 3.0, 5.0
# Another suspect that takes away nearly as much is told too.
AS_WELL = 0.8
# Averages in a long one, and the part of the coefficient that has to be left there; the part of an encoder's step.
LONG, LEFT, REACH = 4, 0.6, 0.3
# What is left over of a torque and does not average out: this part of it, of which so much is left in long averages (of white
# noise a half), beyond so much of an encoder's step. More than all is left where the torque itself averages out.
POOR, SLOW, COARSE = 0.05, (0.7, 1.1), 0.5
SPEED, ACCELERATION, POSITION = "speed", "acceleration", "position"
SUSPECTS = (SPEED, ACCELERATION, POSITION)


class LeftOverState(NamedTuple):
    """Sums, for n regressors.

    Attributes
    ----------
    box : shape (2 n + 5,), of the average that fills: F, slopes of the stiffness, y, speed, position; its first speed, samples
    N : shape (n + 4, n + 4), Σ z zᵀ of the averages z = (F, speed, acceleration, position, y)
    long : shape (n + 5,), of the long average that fills: Σ z, and how many
    M : shape (n + 4, n + 4), Σ z zᵀ of the long averages
    H : shape (n, n), Σ s sᵀ of the slopes
    averages : shape (1,), how many
    """

    box: Array
    N: Array
    long: Array
    M: Array
    H: Array
    averages: Array


@dataclass(frozen=True, slots=True)
class Follower:
    """What the left-overs follow.

    Attributes
    ----------
    suspect : of `SUSPECTS`
    taken : part of the power of what was left over that it takes away
    coefficient : what multiplies it, in the units of the equation
    stiffness : root mean square of it with the suspect taken out [N·m/rad]
    moved : what that changes of the stiffness, as a part
    """

    suspect: str
    taken: float
    coefficient: float
    stiffness: float
    moved: float


def left_over_start(n: int) -> LeftOverState:
    """Return the state before the first sample."""
    squares = np.zeros((n + 4, n + 4))
    return LeftOverState(np.zeros(2 * n + 5), squares, np.zeros(n + 5), squares.copy(), np.zeros((n, n)), np.zeros(1))


def left_over_block(
    state: LeftOverState, F: Array, slopes: Array, y: Array, motion: tuple[Array, Array], use: Flags, starts: Flags, window: int,
    period: float,
) -> LeftOverState:  # fmt: skip
    """Go on with the sums.

    Parameters
    ----------
    F, slopes : shape (N, n), regressors and their derivatives by the deflection
    y : shape (N,), what they add up to
    motion : shape (N,) each, the motor's position [rad] and speed [rad/s]
    use, starts : shape (N,), samples that are learnt from, and those before which one is missing
    window : samples of the filter before
    period : [s]
    """
    new = LeftOverState(*(part.copy() for part in state))
    position, speed = motion
    use = use & np.isfinite(position) & np.isfinite(speed) & np.isfinite(y) & np.isfinite(F).all(axis=1)
    _run(F, slopes, y, position, speed, use, starts, max(window, BOX), period, *new)
    return new


@njit(cache=True, error_model="numpy", nogil=True)
def _run(
    F: Array, slopes: Array, y: Array, position: Array, speed: Array, use: Flags, starts: Flags, window: int, period: float,
    box: Array, N: Array, long: Array, M: Array, H: Array, averages: Array,
) -> None:  # fmt: skip
    n = F.shape[1]
    z = np.empty(n + 4)
    for k in range(F.shape[0]):
        if starts[k] or not use[k]:
            box[:], long[:] = 0.0, 0.0
        if not use[k]:
            continue
        if box[2 * n + 4] == 0.0:
            box[2 * n + 3] = speed[k]
        for i in range(n):
            box[i] += F[k, i]
            box[n + i] += slopes[k, i]
        box[2 * n] += y[k]
        box[2 * n + 1] += speed[k]
        box[2 * n + 2] += position[k]
        box[2 * n + 4] += 1.0
        count = box[2 * n + 4]
        if count < window:
            continue
        for i in range(n):
            z[i] = box[i] / count
        z[n] = box[2 * n + 1] / count
        # From the first sample to the last: a period less than what is averaged.
        z[n + 1] = (speed[k] - box[2 * n + 3]) / ((count - 1.0) * period)
        z[n + 2] = box[2 * n + 2] / count
        z[n + 3] = box[2 * n] / count
        for i in range(n + 4):
            long[i] += z[i] / LONG
            for j in range(n + 4):
                N[i, j] += z[i] * z[j]
        long[n + 4] += 1.0
        if long[n + 4] == LONG:
            for i in range(n + 4):
                for j in range(n + 4):
                    M[i, j] += long[i] * long[j]
            long[:] = 0.0
        for i in range(n):
            for j in range(n):
                H[i, j] += box[n + i] * box[n + j] / (count * count)
        averages[0] += 1.0
        box[:] = 0.0


def residual_findings(
    joint: str, equation: Equation, state: LeftOverState, claimed: float, step: float
) -> list[Finding]:
    """Return what the residual of an equation follows, or that it is no noise; nothing where neither is the case.

    Parameters
    ----------
    claimed, step : as for `followers`
    """
    part = " and ".join(view.name for view in equation.transmissions)
    # What would follow the speed or the acceleration, an equation that has them among its unknowns takes for those.
    suspects = (POSITION,) if equation.parameters else SUSPECTS
    if found := followers(state, claimed, step, suspects):
        return [following(joint, part, found, equation.motor)]
    share = misfit(state, step)
    if share is None:
        return []
    return [Finding(code="residual.not_noise", joint=joint, part=part, value=share, limit=POOR)]


def followers(
    state: LeftOverState, claimed: float, step: float, suspects: tuple[str, ...] = SUSPECTS
) -> list[Follower]:
    """Return what the left-overs follow, the worst first; nothing where they follow nothing that matters.

    Parameters
    ----------
    claimed : standard deviation that is said of the stiffness, as a part of it
    step : of the deflection's sensors [rad], 0 where they have none
    suspects : those that are no unknowns of the equation
    """
    n, count = state.H.shape[0], float(state.averages[0])
    if count < max(AVERAGES, 2 * n):
        return []
    found = []
    for suspect in suspects:
        place = SUSPECTS.index(suspect)
        short, long = _with(state.N, n, place, count), _with(state.M, n, place, count // LONG)
        told = max(short, long, key=lambda fit: fit.taken)
        k, now = told.unknowns[-1], _size(told.unknowns[:n], state.H, count)
        if not (np.isfinite(told.unknowns).all() and now > 0.0):
            continue
        moved = _size(told.unknowns[:n] - short.plain, state.H, count) / now
        torque = abs(k) * (float(state.N[n + place, n + place]) / count) ** 0.5
        if (
            told.taken > TAKEN
            and told.sure > SURE
            and long.unknowns[-1] * np.sign(short.unknowns[-1]) > LEFT * abs(short.unknowns[-1])
            and torque > REACH * step * now
            and moved > max(MOVED, BEYOND * claimed)
        ):
            found.append(Follower(suspect, told.taken, float(k), now, moved))
    found.sort(key=lambda f: -f.taken)
    return [f for f in found if f.taken >= AS_WELL * found[0].taken]


def misfit(state: LeftOverState, step: float) -> float | None:
    """Return the part of the torque that a fit leaves over and that is no noise; None where that is little.

    Parameters
    ----------
    step : of the deflection's sensors [rad], 0 where they have none
    """
    n, count = state.H.shape[0], float(state.averages[0])
    if count < max(AVERAGES, 2 * n):
        return None
    (unknowns, short), (_, long) = (_solved(squares, list(range(n))) for squares in (state.N, state.M))
    torques, slow = state.N[-1, -1], state.M[-1, -1]
    if not (torques > 0.0 and slow > 0.0 and short > 0.0 and long > 0.0):
        return None
    whole, part = (short / torques) ** 0.5, (long / slow) ** 0.5
    beyond = (long * LONG / count) ** 0.5 > COARSE * step * _size(unknowns, state.H, count)
    return float(part) if part > POOR and SLOW[0] < part / whole < SLOW[1] and beyond else None


def following(joint: str, part: str, found: list[Follower], motor: tuple[float, float] | None) -> Finding:
    """Return the finding that the residual follows the motor's motion, with what would explain it.

    Parameters
    ----------
    found : of `followers`, at least one; each alone would do, and so they are alternatives
    motor : inertia [kg·m²] and damping [N·m·s/rad] of the motor where the torque is computed from its motion, else None
    """
    evidence: dict[str, float | int | str] = {
        "signal": " or ".join(f.suspect for f in found),
        "explained_by": "; or ".join(f"{_causes(f, motor)} (stiffness {f.moved:.0%} different)" for f in found),
    }
    for f in found:
        evidence |= {
            f"{f.suspect}_share": f.taken,
            f"{f.suspect}_coefficient": f.coefficient,
            f"{f.suspect}_stiffness": f.stiffness,
            f"{f.suspect}_stiffness_change": f.moved,
        }
    return Finding(
        code="residual.follows_motion", joint=joint, part=part, value=found[0].taken, limit=TAKEN, evidence=evidence
    )


def _causes(found: Follower, motor: tuple[float, float] | None) -> str:
    """Name what would explain it, as far as it is possible: no inertia is negative."""
    k, causes = found.coefficient, []
    if found.suspect == SPEED:
        causes.append(f"the {'link' if k > 0.0 else 'motor'}'s encoder {1e3 * abs(k) / found.stiffness:.2g} ms late")
        if motor is None and k > 0.0:
            causes.append(f"{k:.3g} N·m·s/rad of damping that the rig does not have")
        elif motor is not None and motor[1] - k >= 0.0:
            causes.append(f"a motor's damping of {motor[1] - k:.3g} N·m·s/rad, not {motor[1]:.3g}")
    elif found.suspect == POSITION:
        causes.append(
            f"the motor's encoder reading {abs(k) / found.stiffness:.1%} too {'far' if k > 0.0 else 'little'}"
        )
    elif motor is None and k > 0.0:
        causes.append(f"an inertia of {k:.3g} kg·m² between spring and torque sensor")
    elif motor is not None and motor[0] - k > 0.0:
        causes.append(f"a motor's inertia of {motor[0] - k:.3g} kg·m², not {motor[0]:.3g}")
    else:
        causes.append(f"the {found.suspect} in the equation")
    return " or ".join(causes)


class _Fit(NamedTuple):
    """With a suspect and without it; what of the left-overs' power it takes away, and the coefficient in its deviations."""

    unknowns: Array
    plain: Array
    taken: float
    sure: float


def _with(squares: Array, n: int, place: int, count: float) -> _Fit:
    plain, left = _solved(squares, list(range(n)))
    unknowns, rest = _solved(squares, [*range(n), n + place])
    taken = 1.0 - rest / left if 0.0 < rest < left else 0.0
    sure = (taken / (1.0 - taken) * max(count - n - 1.0, 0.0)) ** 0.5
    return _Fit(unknowns, plain, taken, sure)


def _size(unknowns: Array, H: Array, count: float) -> float:
    """Return the root mean square of a stiffness [N·m/rad]."""
    return float(np.sqrt(max(float(unknowns @ H @ unknowns), 0.0) / count))


def _solved(N: Array, columns: list[int]) -> tuple[Array, float]:
    """Return the least-squares solution for some of the columns, and the sum of squares it leaves of y."""
    y = N.shape[0] - 1
    size = np.sqrt(np.maximum(np.diagonal(N)[columns], np.finfo(float).tiny))
    scaled = N[np.ix_(columns, columns)] / np.outer(size, size)
    target = N[columns, y] / size
    x = np.linalg.lstsq(scaled, target, rcond=1e-10)[0]
    return x / size, float(N[y, y] - 2.0 * x @ target + x @ scaled @ x)
