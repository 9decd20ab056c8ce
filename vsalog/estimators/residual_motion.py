"""Whether the residual of a fit follows the motion, as it does where the rig or a clock is wrong.

A signal that is late by δ puts the deflection q − θ off by δ times the speed, an encoder whose gain is off by a
part one that is off by that part of the position; a wrong inertia leaves its error times the acceleration. A fit of the
stiffness absorbs what it can of either, which biases it unnoticed. The rest is in the residual: where one of these
predicts it in other blocks of the log, in addition to the regressors (`core/dependence.py`), and would change the
stiffness by more than its standard deviation, that is a finding.

Rows are averages over windows (`row_moments.py`). What noise is left there makes residuals follow the acceleration too, but
less the longer the average: what is found has to be there in averages four times as long as well. And what moves the deflection
by less than its encoders' rounding is not found, for rounding makes as much.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.dependence import (
    association,
    least_squares,
    mean_above_zero,
    squares_beyond,
)
from vsalog.core.finding import Finding
from vsalog.core.resolution import ROUNDED
from vsalog.core.significance import DETECTED, FALSE_ALARM
from vsalog.estimators.equation import REPORTED_CHANGE, REPORTED_MISFIT, Equation
from vsalog.estimators.row_moments import (
    AVERAGED_SAMPLES,
    ROWS_OF_LONG,
    RowMoments,
    lasts,
    row_moments_block,
    row_moments_start,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Share of a residual's power that is predicted at least where it follows a motion [1]: any shape follows one a little.
PREDICTED_SHARE = 0.15
# Each is right to first order: another that predicts this share of what the best does explains it as well [1].
ALTERNATIVE_SHARE = 0.8
SPEED, ACCELERATION, POSITION = "speed", "acceleration", "position"
SUSPECTS = (SPEED, ACCELERATION, POSITION)


class MotionRows(NamedTuple):
    """Rows of an equation with n regressors: F, the slopes of the stiffness, position, speed, y, a constant, and acceleration.

    Attributes
    ----------
    short, long : rows of a window, and of `ROWS_OF_LONG` windows
    """

    short: RowMoments
    long: RowMoments

    @property
    def size(self) -> int:
        """Number of regressors."""
        return (self.short.row.size - 5) // 2

    def column(self, suspect: str) -> int:
        """Return where a suspect is."""
        return 2 * self.size + {POSITION: 0, SPEED: 1, ACCELERATION: 4}[suspect]

    @property
    def torque(self) -> int:
        """Where y is."""
        return 2 * self.size + 2

    @property
    def known(self) -> list[int]:
        """Where the regressors are, and the constant: an offset follows no motion."""
        return [*range(self.size), self.torque + 1]


@dataclass(frozen=True, slots=True)
class Follower:
    """What the residual follows.

    Attributes
    ----------
    suspect : of `SUSPECTS`
    taken : part of the residual's power that it predicts in blocks that it was not fitted to
    coefficient : what multiplies it, in the units of the equation
    stiffness : root mean square of it with the suspect taken out [N·m/rad]
    moved : relative change of the stiffness by that
    """

    suspect: str
    taken: float
    coefficient: float
    stiffness: float
    moved: float


def motion_rows_start(n: int) -> MotionRows:
    """Return the state before the first sample, for n regressors."""
    return MotionRows(row_moments_start(2 * n + 5), row_moments_start(2 * n + 5))


def motion_rows_block(
    state: MotionRows, F: Array, slopes: Array, y: Array, motion: tuple[Array, Array], use: Flags, starts: Flags, window: int,
    period: float,
) -> MotionRows:  # fmt: skip
    """Go on with the rows.

    Parameters
    ----------
    F, slopes : shape (N, n), regressors and their derivatives by the deflection
    y : shape (N,), what they add up to
    motion : shape (N,) each, the motor's position [rad] and speed [rad/s]
    use, starts : shape (N,), samples that are used, and those before which one is missing
    window : samples of the filter before
    period : [s]
    """
    columns, window = np.column_stack((F, slopes, *motion, y, np.ones(y.size))), max(window, AVERAGED_SAMPLES)
    speed = 2 * F.shape[1] + 1
    return MotionRows(
        row_moments_block(state.short, columns, use, starts, window, period, speed),
        row_moments_block(state.long, columns, use, starts, ROWS_OF_LONG * window, period, speed),
    )


def residual_findings(joint: str, equation: Equation, state: MotionRows, claimed: float, step: float) -> list[Finding]:
    """Return what the residual of an equation follows, or that it is no noise; none where neither is the case.

    Parameters
    ----------
    claimed, step : as for `followers`
    """
    part = " and ".join(view.name for view in equation.transmissions)
    # An equation with the speed or the acceleration among its unknowns takes up what would follow these.
    suspects = (POSITION,) if equation.parameters else SUSPECTS
    if found := followers(state, claimed, step, suspects):
        return [following(joint, part, found, equation.motor, claimed)]
    share = misfit(state, step)
    if share is None:
        return []
    return [Finding(code="residual.not_noise", joint=joint, part=part, value=share, limit=REPORTED_MISFIT)]


def least_change(claimed: float) -> float:
    """Return how much of a stiffness has to change, for its claimed standard deviation, both relative."""
    return max(REPORTED_CHANGE, DETECTED * claimed)


def followers(state: MotionRows, claimed: float, step: float, suspects: tuple[str, ...] = SUSPECTS) -> list[Follower]:
    """Return what the residual follows, the worst first; none where it follows nothing that matters.

    Parameters
    ----------
    claimed : relative standard deviation claimed of the stiffness
    step : of the deflection's sensors [rad], 0 where they have none
    suspects : those that are no unknowns of the equation
    """
    known, y = state.known, state.torque
    whole, long = state.short.blocks.sum(axis=0), state.long.blocks.sum(axis=0)
    plain = least_squares(whole, known, y)
    moments, changing, unexplained = _changing(state)
    few = state.long.rows <= len(known) + 1
    found: list[Follower] = []
    for suspect in suspects:
        place = state.column(suspect)
        shape = association(moments, [place], changing, y)
        if shape is None or shape.p_value * len(suspects) > FALSE_ALARM or unexplained * shape.share < PREDICTED_SHARE:
            continue
        unknowns, lasting = (least_squares(m, [*known, place], y) for m in (whole, long))
        now = _stiffness(unknowns[: state.size], state)
        moved = _stiffness((unknowns[:-1] - plain)[: state.size], state) / now if now > 0.0 else np.inf
        torque = abs(unknowns[-1]) * float(np.sqrt(whole[place, place] / state.short.rows))
        # Fewer long averages than unknowns say nothing.
        if (
            (few or lasts(float(lasting[-1] * np.sign(unknowns[-1])), abs(float(unknowns[-1]))))
            and torque > ROUNDED * step * now
            and max(least_change(claimed), _rounded(whole, plain, state, place, step)) < moved < np.inf
        ):
            found.append(Follower(suspect, unexplained * shape.share, float(unknowns[-1]), now, moved))
    found.sort(key=lambda f: -f.taken)
    return [f for f in found if f.taken >= ALTERNATIVE_SHARE * found[0].taken]


def _rounded(whole: Array, plain: Array, state: MotionRows, place: int, step: float) -> float:
    """Return the relative change of a stiffness by a suspect that explains the torque as well as the deflection without rounding.

    Noise makes a coefficient smaller by its part of what tells the regressor from the others (Fuller 1987).
    """
    torque = np.zeros(len(whole))
    torque[: state.size] = plain[: state.size]
    others = [place, state.torque + 1]
    products = whole[others] @ torque
    apart = torque @ whole @ torque - products @ np.linalg.lstsq(whole[np.ix_(others, others)], products, rcond=None)[0]
    noise = state.short.rows * (ROUNDED * step * _stiffness(plain[: state.size], state)) ** 2
    return float(noise / (apart - noise)) if apart > noise else np.inf


def _changing(state: MotionRows) -> tuple[Array, list[int], float]:
    """Return moments of rows whose regressors have coefficients of their own in parts of the log, and where these are.

    Also returned is the part of the residual's power that these coefficients leave of the one with the same ones all the time.
    There are as many parts, of equal length, as the Bayesian information criterion has (Schwarz 1978): a spring that changes
    leaves a residual in a fit of one stiffness, which follows the motion as well.
    """
    blocks, known, y, rows = state.short.blocks, state.known, state.torque, state.short.rows
    best, least, first, parts = (blocks, known, 1.0), np.inf, 0.0, 1
    while parts <= max(1, len(blocks) // 2):
        moments, own = _by_part(blocks, known, parts)
        left = squares_beyond(moments, own, y)
        if left is None or not left.sum() > 0.0:
            break
        power = float(left.sum())
        first = first or power
        criterion = rows * np.log(power) + len(own) * np.log(rows)
        if criterion < least:
            best, least = (moments, own, power / first), criterion
        parts *= 2
    return best


def _by_part(blocks: Array, columns: list[int], parts: int) -> tuple[Array, list[int]]:
    """Return blocks' moments, shape (B, K, K), with columns repeated for each of equal parts of the log, and where these are."""
    count, size = blocks.shape[:2]
    own = size + np.arange(parts * len(columns)).reshape(parts, -1)
    places = np.zeros((count, size + own.size, size))
    places[:, np.arange(size), np.arange(size)] = 1.0
    places[:, columns, columns] = 0.0
    of_block = own[np.arange(count) * parts // count]
    places[np.arange(count)[:, None], of_block, columns] = 1.0
    return places @ blocks @ places.transpose(0, 2, 1), own.ravel().tolist()


def misfit(state: MotionRows, step: float) -> float | None:
    """Return the relative residual of a fit that does not average out; None where that is little.

    Parameters
    ----------
    step : of the deflection's sensors [rad], 0 where they have none
    """
    known, y, rows = range(state.size), state.torque, state.short.rows
    short, long = (squares_beyond(rows.blocks, known, y) for rows in state)
    if short is None or long is None:
        return None
    whole = state.short.blocks.sum(axis=0)
    left, torque = float(short.sum()) / rows, float(whole[y, y]) / rows
    # Of white noise, however loud it is now and then, a long average leaves a part of ROWS_OF_LONG. The difference over the sum
    # of both is bounded: no stretch counts for more than another, and of few long averages it is below zero rather than above.
    count = min(short.size, long.size)
    now, then = (_mean_squares(r.sizes, squares, count) for r, squares in zip(state, (short, long), strict=True))
    both = ROWS_OF_LONG * then + now
    slow = np.divide(ROWS_OF_LONG * then - now, both, out=np.zeros_like(both), where=both > 0.0)
    if mean_above_zero(slow) > FALSE_ALARM:
        return None
    lasting = (float(long.sum()) / state.long.rows - left / ROWS_OF_LONG) * ROWS_OF_LONG / (ROWS_OF_LONG - 1.0)
    rounding = ROUNDED * step * _stiffness(least_squares(whole, known, y), state)
    return float(np.sqrt(left / torque)) if lasting > max(REPORTED_MISFIT**2 * torque, rounding**2) else None


def following(
    joint: str, part: str, found: list[Follower], motor: tuple[float, float] | None, claimed: float
) -> Finding:
    """Return the finding that the residual follows the motor's motion, with what would explain it.

    Parameters
    ----------
    found : of `followers`, at least one; each alone would do, and so they are alternatives
    claimed : as for `followers`
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
        code="residual.follows_motion",
        joint=joint,
        part=part,
        value=found[0].moved,
        limit=least_change(claimed),
        evidence=evidence,
    )


def _causes(found: Follower, motor: tuple[float, float] | None) -> str:
    """Name possible explanations: no inertia is negative."""
    k, causes = found.coefficient, []
    if found.suspect == SPEED:
        causes.append(f"the {'link' if k > 0.0 else 'motor'}'s encoder {1e3 * abs(k) / found.stiffness:.2g} ms late")
        if motor is None and k > 0.0:
            causes.append(f"{k:.3g} N·m·s/rad of damping missing in the rig")
        elif motor is not None and motor[1] - k >= 0.0:
            causes.append(f"a motor's damping of {motor[1] - k:.3g} N·m·s/rad, not {motor[1]:.3g}")
    elif found.suspect == POSITION and k < found.stiffness:
        # What is added to the deflection is a part of the position as it was read.
        error = k / (found.stiffness - k)
        causes.append(f"the motor's encoder reading {abs(error):.1%} too {'much' if error > 0.0 else 'little'}")
    elif found.suspect == ACCELERATION and motor is None and k > 0.0:
        causes.append(f"an inertia of {k:.3g} kg·m² between spring and torque sensor")
    elif found.suspect == ACCELERATION and motor is not None and motor[0] - k > 0.0:
        causes.append(f"a motor's inertia of {motor[0] - k:.3g} kg·m², not {motor[0]:.3g}")
    else:
        causes.append(f"the {found.suspect} in the equation")
    return " or ".join(causes)


def _mean_squares(sizes: Array, squares: Array, count: int) -> Array:
    """Return the mean square of each of a number of stretches of a log, from at least as many blocks."""
    place = np.arange(sizes.size) * count // sizes.size
    return np.asarray(np.bincount(place, squares, count) / np.bincount(place, sizes, count))


def _stiffness(unknowns: Array, state: MotionRows) -> float:
    """Return the root mean square of a stiffness [N·m/rad]."""
    n = state.size
    slopes = state.short.blocks[:, n : 2 * n, n : 2 * n].sum(axis=0)
    return float(np.sqrt(max(float(unknowns @ slopes @ unknowns), 0.0) / state.short.rows))
