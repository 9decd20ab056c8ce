"""The offline optimum: coefficients as a random walk, estimated from all samples of a log.

Rows of each equation, averaged over boxes, have coloured noise: they are made white by an autoregression fitted to their
residuals (`row_noise.py`), and those of an interval are rotated into one triangle (Flacco 2014 eq. 21–22). From interval to
interval the coefficients are a random walk, and a square-root filter and Rauch–Tung–Striebel smoother estimate them
(`filters/square_root_smoother.py`). How fast a spring changes is not assumed: hypotheses — it does not change, its torque changes
as a whole, its shape changes, either by so much — are averaged with the probabilities that the log gives them (Hoeting, Madigan,
Raftery, Volinsky, "Bayesian model averaging", Statistical Science 14(4), 1999). A sudden change is one that the smoothed
disturbances show (de Jong and Penzer, "Diagnosing shocks in time series", J. Am. Stat. Assoc. 93(442), 1998). How far a spring is
from a polynomial is averaged in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from vsalog.core.compiled import compiled
from vsalog.core.precision import ROUNDING
from vsalog.core.significance import FALSE_ALARM, two_sided
from vsalog.estimators.box_rows import BOXES, BoxRows, BoxState, box_block, box_start
from vsalog.estimators.equation import GAIN, REPORTED_MISFIT, EquationRows
from vsalog.estimators.qr import qr_update
from vsalog.estimators.residual_motion import PREDICTED_SHARE
from vsalog.estimators.row_moments import ROWS_OF_LONG, lasts
from vsalog.estimators.row_noise import RowNoise
from vsalog.filters.random_walk import RandomWalk, log_likelihood, triangle_of
from vsalog.filters.square_root_smoother import Smoothed, smooth
from vsalog.uncertainty.heavy_tails import Weights, tail_weights

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


class Change(NamedTuple):
    """How a spring may change over a log.

    Attributes
    ----------
    whole : standard deviation of what its torque gains as a whole, as a part of it, over the log [1]
    shape : the same of each coefficient by itself, as a part of what it is in a spring that does not change [1]
    jumps : intervals after which it changes at once
    spread : intervals after which each jump goes on, for filters smear it [1]
    trend : standard deviation of what its torque gains steadily, as a part of it, over the log [1]
    """

    whole: float = 0.0
    shape: float = 0.0
    jumps: tuple[int, ...] = ()
    spread: int = 1
    trend: float = 0.0

    @property
    def constant(self) -> bool:
        """Whether it does not change."""
        return not (self.whole or self.shape or self.jumps or self.trend)


class Limits(NamedTuple):
    """Numbers of the smoother that are no result of the data.

    Attributes
    ----------
    intervals : at most, within which coefficients change linearly [1]: a log of an hour has one in 7 s
    boxes_per_interval : at least [1]: half of what a jump of the stiffness takes to be seen behind a filter's window
    prior : standard deviation of a coefficient before the log, times what it were if its term alone made the torque [1]: wide,
        for terms cancel one another
    slowest, fastest : the least and the largest change over a log that is a hypothesis, in half decades [1]: less is nothing, and
        more than all of a spring cannot go
    roughest, smoothest : of a power of the deflection what a spring's torque has at its largest deflection, in that of the power
        before [1], eight ratios in between: the one for a spring with a corner, the other for a straight line
    rounds : of hypotheses of the change and of the smoothness, each from the other, and of the noise where bases compete [1]
    most_rounds : of the noise and the torque's scale, each from the estimate before it [1]: one that changes halves its error
    settled : change of an unknown's average that ends them, in standard deviations [1]: one in ten adds 0.5 % to an error
    evidence_loss : of log evidence a row, that ends them [1]: its noise is a twentieth larger; less comes of rows near a jump
    jumps : at most [1]: a log that shows more has a spring that the basis cannot follow
    spreads : of a jump [1]: a window of the filters is an interval at most, which touches two, so that three steps contain it
    least_probability : of a hypothesis that is averaged, as a part of the most probable one's [1]
    """

    intervals: int = 512
    boxes_per_interval: int = 4
    prior: float = 10.0
    slowest: float = 1e-3
    fastest: float = 1.0
    roughest: float = 1.0
    smoothest: float = 0.01
    rounds: int = 3
    most_rounds: int = 10
    settled: float = 0.1
    evidence_loss: float = 0.05
    jumps: int = 4
    spreads: tuple[int, ...] = (1, 2, 3)
    least_probability: float = 1e-3

    @property
    def ratios(self) -> Array:
        """The ratios between the powers of the deflection that are hypotheses."""
        return np.asarray(np.geomspace(self.smoothest, self.roughest, 9))

    @property
    def curvatures(self) -> Array:
        """How much the curvature may change at a knot: hypotheses, in the scale of the prior, the first next to nothing."""
        return np.asarray(np.geomspace(self.smoothest**3, self.roughest, 13))

    @property
    def parts(self) -> Array:
        """Parts of the torque that a friction element or a piece may make: hypotheses, in the scale of the prior."""
        return np.asarray(np.geomspace(self.smoothest, self.roughest, 3)) / self.prior

    @property
    def changes(self) -> Array:
        """The changes that are hypotheses, in addition to none."""
        count = 2 * round(np.log10(self.fastest / self.slowest)) + 1
        return np.asarray(np.geomspace(self.slowest, self.fastest, count))

    @property
    def trends(self) -> Array:
        """The trends that are hypotheses, in decades: the estimate of one hardly depends on its prior deviation."""
        return np.asarray(self.changes[::2])


LIMITS = Limits()
# Name of an unknown that equations share, in place of an equation's own.
SHARED = "shared"


class Smoothness(NamedTuple):
    """A hypothesis of how smooth a spring is.

    Attributes
    ----------
    evidence : logarithm of its probability, but for a constant
    prior : shape (active,), standard deviation of each scaled unknown before the log
    """

    evidence: float
    prior: Array


class Round(NamedTuple):
    """Noise, and what is estimated with it.

    Attributes
    ----------
    evidence : logarithm of its probability, but for a constant
    no_change : probability that the spring does not change
    noise, weights : of each equation
    active, nominal, steady : as of `Choice`, before the estimate
    smoothness : as of `Choice`
    course : shape (K, transmissions), torque of each as a whole, over what it is usually
    smoothed : by the most probable hypothesis
    """

    evidence: float
    no_change: float
    noise: tuple[RowNoise, ...]
    weights: tuple[Weights | None, ...]
    active: NDArray[np.intp]
    nominal: Array
    steady: Array
    smoothness: tuple[Smoothness, ...]
    course: Array
    smoothed: Smoothed


class Choice(NamedTuple):
    """What a smoother chose from a log, in scaled unknowns.

    Attributes
    ----------
    intervals : K, of the log
    noise : of each equation; none where it is to be fitted to other rows
    active : numbers of the unknowns that are estimated
    smoothness : hypotheses of how smooth a spring is; of the first it is a polynomial
    nominal : shape (size,), all unknowns, on average
    direction : shape (transmissions, active), the torque of each transmission as a whole
    usual : shape (active,), size of each unknown
    steady : shape (transmissions,), what the torque of each as a whole gains from interval to interval, as a part of it
    evidence : logarithm of each hypothesis' probability, but for a constant
    """

    intervals: int
    noise: tuple[RowNoise, ...]
    active: NDArray[np.intp]
    smoothness: tuple[Smoothness, ...]
    nominal: Array
    direction: Array
    usual: Array
    steady: Array
    evidence: Mapping[Change, float]

    @property
    def change(self) -> Change:
        """The most probable hypothesis."""
        return _likeliest(self.evidence)

    @property
    def probabilities(self) -> dict[Change, float]:
        """The probability of each hypothesis."""
        return _probabilities(self.evidence)

    @property
    def probability_of_no_change(self) -> float:
        """Probability that the spring does not change."""
        return _probability_of_no_change(self.evidence)

    @property
    def probability_of_polynomial(self) -> float:
        """Probability that the pieces of the deflection's range are not needed."""
        return _probability_of_first(self.smoothness)


class BasisEvidence(NamedTuple):
    """How probable a basis is in the rows of a log.

    Attributes
    ----------
    logarithm : of its probability, but for a constant; −∞ for fewer rows than unknowns
    polynomial : probability that the pieces of the deflection's range are not needed
    shown : whether the log shows unknowns that are not always estimated
    surroundings : of the coefficients, for fits of other functions; None where there are fewer rows than unknowns
    """

    logarithm: float
    polynomial: float
    shown: bool
    surroundings: Surroundings | None


class Surroundings(NamedTuple):
    """What a fit of coefficients alone takes as known, from one of everything.

    Attributes
    ----------
    others : numbers of the other unknowns, after the coefficients and the friction elements
    noise, weights, steepness : of the rows
    course : shape (K, transmissions), of the torques in the middles of intervals, which the functions are multiplied by
    deviations : shape (n,), of the coefficients before the log
    """

    others: NDArray[np.intp]
    noise: tuple[RowNoise, ...]
    weights: tuple[Weights | None, ...]
    steepness: tuple[Array, ...]
    course: Array
    deviations: Array


class Trajectory(NamedTuple):
    """Unknowns over a log.

    Attributes
    ----------
    samples : of the log
    mean, root : shapes (K, n) and (K, n, n), in the middle of each interval; root is upper triangular U with P = Uᵀ U
    linear : shape (K,), whether they change linearly to the next interval
    noise : standard deviation of a row of the first equation, averaged over a box
    choice : what was chosen from the log
    torque, torque_std : shape (K, transmissions), of each as a whole, over what it is usually, and its standard deviation
    misfit : root mean square of a residual that does not average out, over that of its torque, the largest of all equations
    others : equation and name → value and standard deviation of an unknown that is no coefficient, where the log shows it
    stiffnesses, covariance : of the friction elements, shapes (shared,) and (shared, shared); 0 where none is needed [N·m/rad]
    """

    samples: int
    mean: Array
    root: Array
    linear: Flags
    noise: float
    choice: Choice
    torque: Array
    torque_std: Array
    misfit: float
    others: Mapping[tuple[int, str], tuple[float, float]]
    stiffnesses: Array
    covariance: Array


class SmootherState(NamedTuple):
    """What is collected of a log, or estimated from it.

    Attributes
    ----------
    boxes : of each equation, None once all are collected
    samples : so far
    choice : what was chosen before
    trajectory : once all are collected, None where the log is too short for one
    """

    boxes: tuple[BoxState, ...] | None
    samples: int = 0
    choice: Choice | None = None
    trajectory: Trajectory | None = None


@dataclass(frozen=True, slots=True)
class SmootherSolver:
    """Estimates coefficients, and unknowns that each equation has of its own, over a whole log.

    Attributes
    ----------
    powers : of the deflection that each coefficient multiplies, of all transmissions; −1 for a piece that reaches one at most
    pieces : which coefficients are of a part of the deflection's or the set-point's range
    transmissions : how many they are of
    unknowns : of each equation, names of its own
    required : of each equation, names of those that are always unknown; the others only where the log shows it
    hidden : of each equation, names of those that noise or others hide, which are not looked for
    gains : how well the gain of each equation's torque is known, standard deviation as a part of it
    box : samples of a box
    slips : of each friction element, whose stiffness is an unknown of all equations, the deflection after which it slips [rad]
    leading : unknowns that functionals have before the coefficients, the equation and the name of each
    causal : whether an interval is estimated from those before alone
    constant : whether no change is looked for
    """

    powers: tuple[int, ...]
    pieces: tuple[bool, ...]
    transmissions: int
    unknowns: tuple[tuple[str, ...], ...]
    required: tuple[frozenset[str], ...]
    hidden: tuple[frozenset[str], ...]
    gains: tuple[float, ...]
    box: int
    slips: tuple[float, ...] = ()
    leading: tuple[tuple[int, str], ...] = ()
    causal: bool = False
    constant: bool = False

    @property
    def coefficients(self) -> int:
        """Number of coefficients."""
        return len(self.powers)

    @property
    def shared(self) -> int:
        """Number of unknowns of all equations that are no coefficients."""
        return len(self.slips)

    @property
    def p0(self) -> float:
        """There is no prior covariance to tune."""
        return float("inf")

    def start(self, size: int) -> SmootherState:
        """Return the state before the first sample."""
        return SmootherState(
            tuple(box_start(2 * self.coefficients + self.shared + len(own) + 1) for own in self.unknowns)
        )

    def block(
        self, state: SmootherState, rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[SmootherState, Array, Array, Array, Mapping[str, Array]]:
        """Collect a block, or evaluate functionals of what is estimated."""
        count, q, n = E.shape
        values, variances, unknowns = (
            np.full((count, q), np.nan),
            np.full((count, q), np.nan),
            np.full((count, n), np.nan),
        )
        if state.boxes is not None:
            return self.collected(state, rows), values, variances, unknowns, {}
        found = state.trajectory
        if found is None:
            return state, values, variances, unknowns, {}
        _evaluate(
            found.mean, found.root, found.linear, found.samples, state.samples, E, spread, values, variances, unknowns
        )
        return state._replace(samples=state.samples + count), values, variances, unknowns, {}

    def collected(self, state: SmootherState, rows: EquationRows) -> SmootherState:
        """Collect a block."""
        assert state.boxes is not None
        boxes = tuple(
            box_block(own, np.hstack((part.columns, part.slopes)), part.use, rows.fresh, self.box)
            for own, part in zip(state.boxes, rows.parts, strict=True)
        )
        return state._replace(boxes=boxes, samples=state.samples + len(rows.y))

    def smoothed(self, state: SmootherState) -> SmootherState:
        """Estimate from what was collected, and go back to the first sample."""
        assert state.boxes is not None
        boxes = [own.whole for own in state.boxes]
        trajectory = Smoother(self, boxes, state.samples, state.choice).trajectory()
        return SmootherState(None, 0, None, trajectory)

    def evidence(self, state: SmootherState) -> BasisEvidence:
        """Return how probable the basis is in the collected rows, of a spring that may change."""
        found = self._shape(state).evidence()
        if not found.shown:
            return found
        return max(found, self._shape(state, shown=False).evidence(), key=lambda own: own.logarithm)

    def information(self, state: SmootherState, among: Surroundings) -> Array:
        """Return what the collected rows say of coefficients and friction elements that a spring would have without its change.

        Rows [R z] with noise of variance one, shape (n + 1, n + 1): the coefficients are the last unknowns, then the elements.
        """
        return self._shape(state).information(among)

    def _shape(self, state: SmootherState, shown: bool = True) -> Smoother:
        """Return a smoother of the first equation, a torque sensor's if there is one: what equations disagree on is no shape."""
        assert state.boxes is not None
        alone = replace(
            self,
            unknowns=self.unknowns[:1],
            required=self.required[:1],
            hidden=(self.hidden[0] | {GAIN},),
            gains=self.gains[:1],
        )
        return Smoother(alone, [state.boxes[0].whole], state.samples, shown=shown)

    def solution(self, state: SmootherState) -> tuple[Array, Array, float]:
        """Return ξ̂ (n,), its covariance (n, n), both averages over the log, and the noise seen in y (standard deviation)."""
        size = len(self.leading) + self.coefficients
        found = state.trajectory
        if found is None:
            return np.full(size, np.nan), np.full((size, size), np.nan), float("nan")
        mean = found.mean.mean(axis=0)
        off = found.mean - mean
        covariance = np.einsum("kij,kil->jl", found.root, found.root) / len(off) + off.T @ off / len(off)
        return mean, covariance, found.noise


class Smoother:
    """The boxes of a log, and estimates from them."""

    def __init__(
        self,
        solver: SmootherSolver,
        boxes: Sequence[BoxRows],
        samples: int,
        choice: Choice | None = None,
        loops: bool = True,
        shown: bool = True,
        changing: bool = False,
    ) -> None:
        self.solver, self.collected, self.samples, self.choice = solver, boxes, samples, choice
        self.loops, self.shown, self.changing = loops and bool(solver.slips), shown, changing
        n = solver.coefficients
        self.boxes = [own._replace(rows=own.rows[:, :-n].copy()) for own in boxes]
        self.slopes = [own.rows[:, -n:] for own in boxes]
        shared = [(i, SHARED) for i in range(solver.shared)]
        self.names = shared + [(i, name) for i, own in enumerate(solver.unknowns) for name in own]
        self.size = n + len(self.names)
        fullest = max(len(part.rows) for part in boxes)
        self.columns, first = [], n + solver.shared
        for own in solver.unknowns:
            self.columns.append(np.r_[: n + solver.shared, first : first + len(own)])
            first += len(own)
        self.active = np.r_[
            :n,
            [
                n + i
                for i, (part, name) in enumerate(self.names)
                if (loops if name == SHARED else name in solver.required[part])
            ],
        ].astype(int)
        # A triangle has as many rows as unknowns: of fewer boxes it would be no shorter.
        count = int(np.clip(fullest // max(LIMITS.boxes_per_interval, self.active.size), 1, LIMITS.intervals))
        self.count = count if choice is None else choice.intervals
        self.where = [np.minimum(part.place * self.count // samples, self.count - 1) for part in self.boxes]
        self.powers = np.zeros(self.size)
        self.powers[:n] = np.maximum(np.array(solver.powers) - 1.0, 0.0)
        self.knots = np.zeros(self.size, dtype=np.bool_)
        at_knot = np.array(solver.powers) < 0
        self.knots[:n] = at_knot
        # Friction elements, and pieces of the set-point's range.
        self.elements = np.zeros(self.size, dtype=np.bool_)
        self.elements[:n], self.elements[n : n + solver.shared] = np.array(solver.pieces) & ~at_knot, True
        self.scale = self._scale()
        self.smoothness: tuple[Smoothness, ...] = ()
        self.prior = self.usual = np.zeros(0)
        self.direction = np.zeros((solver.transmissions, 0))
        self.nominal, self.steady = np.zeros(self.size), np.zeros(solver.transmissions)
        if choice is None:
            self._form()
            self.nominal[: n + solver.shared] = _least_squares(self.boxes[0])[: n + solver.shared]
            self._take(self.nominal)
        else:
            self.steady = choice.steady
            self._take(choice.nominal)

    def _scale(self) -> Array:
        """Return the prior's standard deviation of each unknown, shape (size,)."""
        scale = np.zeros(self.size)
        for part, columns in zip(self.boxes, self.columns, strict=True):
            rms = np.sqrt(np.mean(np.square(part.rows), axis=0)) if len(part.rows) else np.ones(columns.size + 1)
            with np.errstate(divide="ignore", invalid="ignore"):
                own = np.where(rms[:-1] > 0.0, rms[-1] / rms[:-1], 0.0)
            # The function of a knot reaches one at most: its coefficient is in the torque's unit, wherever the knot is.
            own[: self.solver.coefficients][np.array(self.solver.powers) < 0] = rms[-1]
            scale[columns] = np.maximum(scale[columns], own)
        scale = LIMITS.prior * np.where(scale > 0.0, scale, 1.0)
        for i, known in enumerate(self.solver.gains):
            scale[self.solver.coefficients + self.names.index((i, GAIN))] = known
        return scale

    def _take(self, nominal: Array) -> None:
        """Form the rows around values of all unknowns, shape (size,)."""
        self.nominal = nominal
        self._form()
        self.steepness = [self._steepness(own) for own in self.slopes]

    def _follow(self, steady: Array) -> None:
        """Let the torques of an interval's rows change steadily, by parts (transmissions,) from interval to interval."""
        self.steady = steady
        self._form()

    def _form(self) -> None:
        """Form the rows, to first order: (1 + gain) (torques + what the rig has of the motor) + offset = measured torque."""
        n, views = self.solver.coefficients, self.solver.transmissions
        equations = zip(self.boxes, self.collected, self.where, self.columns, self.solver.unknowns, strict=True)
        for part, own, where, columns, names in equations:
            after = (own.place + 0.5) * self.count / self.samples - 0.5 - where
            rows, first = own.rows[:, :-n].copy(), columns.size - len(names)
            rows[:, :n] *= np.repeat(1.0 + after[:, None] * self.steady, n // views, axis=1)
            gain, nominal = first + names.index(GAIN), self.nominal[columns]
            torques = np.delete(np.arange(columns.size), [gain, first + names.index("offset")])
            torque = rows[:, torques] @ nominal[torques]
            rows[:, torques] *= 1.0 + nominal[gain]
            rows[:, gain] += torque
            rows[:, -1] += nominal[gain] * torque
            part.rows[:] = rows

    def _steady(self, course: Array, change: Change) -> Array:
        """Return by which part torques change from interval to interval where they do not jump, shape (transmissions,)."""
        held = self._linear(change)[:-1]
        if self.solver.causal or not held.any():
            return np.zeros(self.solver.transmissions)
        return np.asarray(np.diff(course, axis=0)[held].mean(axis=0) / course.mean(axis=0))

    def _steepness(self, slopes: Array) -> Array:
        """Return the squares of the transmissions' stiffness, over their average, shape (M,)."""
        views, n = self.solver.transmissions, self.solver.coefficients
        each = (slopes * self.nominal[:n]).reshape(len(slopes), views, n // views).sum(axis=2)
        squares = np.square(each).sum(axis=1)
        return np.asarray(squares / squares.mean()) if squares.any() else np.ones_like(squares)

    def trajectory(self) -> Trajectory | None:
        """Estimate the unknowns; None where there are fewer rows than unknowns."""
        if sum(len(part.rows) for part in self.boxes) <= self.active.size:
            return None
        if self.choice is not None:
            self.active, self.direction, self.usual = self.choice.active, self.choice.direction, self.choice.usual
            choice, weights = self.choice, list[Weights | None]([None] * len(self.boxes))
            if not choice.noise:
                noise, weights = self._refitted(choice)
                choice = choice._replace(noise=noise)
            return self._external(*self._averaged(self._triangles(choice.noise, weights), choice), choice)
        found, triangles, choice, smoothed = self._settled()
        if not found._resists(smoothed):
            return Smoother(self.solver, self.collected, self.samples, loops=False).trajectory()
        # Unknowns that leave the equations in disagreement are not what is wrong with the machine.
        if self.shown and found._misfit(found._whole(smoothed.mean)) > REPORTED_MISFIT:
            return Smoother(self.solver, self.collected, self.samples, loops=self.loops, shown=False).trajectory()
        return found._external(*found._averaged(triangles, choice), choice)

    def _settled(self) -> tuple[Smoother, Array, Choice, Smoothed]:
        """Return a smoother and what it has chosen; of a spring that changes only if it is a thousand times as probable as none.

        Noise at first is white: coloured noise looks like a change, and a spring that follows it leaves white noise. Either is
        therefore fitted with its own noise, and their evidence is compared.
        """
        best = self._settled_round(self.changing, LIMITS.most_rounds)
        if self.changing or best.no_change > FALSE_ALARM:
            chosen = self._chosen(best)
            if self.changing or chosen[1].change.constant:
                return self, *chosen
        same = self.collected, self.samples, None, self.loops, self.shown
        changing, constant = Smoother(self.solver, *same, True), Smoother(replace(self.solver, constant=True), *same)
        changed = changing._settled_round(True, LIMITS.most_rounds)
        unchanged = constant._settled_round(False, LIMITS.most_rounds)
        # The first noise of the one has no steady change in it, which the other's noise may take up.
        if max(best.evidence, changed.evidence) - unchanged.evidence > -math.log(FALSE_ALARM):
            return changing, *changing._chosen(changed)
        return constant, *constant._chosen(unchanged)

    def _refitted(self, choice: Choice) -> tuple[tuple[RowNoise, ...], list[Weights | None]]:
        """Return the noise of these rows and the weights of each, for hypotheses that are chosen."""
        noise = self._white(not choice.change.constant)
        weights: tuple[Weights | None, ...] = (None,) * len(noise)
        self.smoothness = choice.smoothness
        for _ in range(LIMITS.rounds):
            self._roughen(self._measurements(self._triangles(noise, weights)), choice.change)
            noise, weights = self._noise(self._whole(self.roughest.mean), choice.change)
        return noise, list(weights)

    def _chosen(self, best: Round) -> tuple[Array, Choice, Smoothed]:
        """Choose noise, unknowns and hypotheses; return the triangles, too, and what the best hypothesis estimates."""
        self.active = best.active
        self._follow(best.steady)
        self._take(best.nominal)
        triangles = self._triangles(best.noise, best.weights)
        evidence, smoothed = self._explained(triangles, best.course, True)
        choice = Choice(
            self.count,
            best.noise,
            self.active,
            self.smoothness,
            self.nominal,
            self.direction,
            self.usual,
            self.steady,
            evidence,
        )
        return triangles, choice, smoothed

    def _settled_round(self, changing: bool, most: int) -> Round:
        """Fit noise and unknowns to each other until they settle, or up to the round before the evidence falls.

        It falls where noise takes up motion, which moves ever farther away.

        Parameters
        ----------
        changing : whether the noise at first is that of a spring which is another in each interval
        most : rounds
        """
        noise, course, at = self._white(changing), None, np.full(self.size, np.inf)
        weights: tuple[Weights | None, ...] = (None,) * len(noise)
        rounds, count = list[Round](), sum(len(part.rows) for part in self.boxes)
        for _ in range(most):
            nominal, active = self.nominal, self.active
            found, smoothed = self._explained(self._triangles(noise, weights), course, False)
            evidence = self._evidence(found, noise, weights)
            if rounds and evidence < rounds[-1].evidence - LIMITS.evidence_loss * count:
                break
            no_change = _probability_of_no_change(found)
            course = smoothed.mean @ self._projection
            given = noise, weights, active, nominal, self.steady
            rounds.append(Round(evidence, no_change, *given, self.smoothness, course, smoothed))
            # Its noise is another at first: `_settled` begins again.
            if not changing and len(rounds) == LIMITS.rounds and no_change < FALSE_ALARM:
                break
            mean, before = self._whole(smoothed.mean), at
            # Rows that follow a change are not those of a spring without one, and noise at first is a guess.
            shown = len(rounds) > 1 and no_change < FALSE_ALARM
            self._follow(self._steady(course, _likeliest(found)) if shown else np.zeros_like(self.steady))
            noise, weights = self._noise(self._whole(self.roughest.mean), _likeliest(found))
            at = mean.mean(axis=0)
            self._take(at)
            deviation = self._whole(np.sqrt(np.square(smoothed.root).sum(axis=1))).mean(axis=0)
            if np.all(np.abs(at - before) <= LIMITS.settled * deviation):
                break
        return rounds[-1]

    def _evidence(
        self, found: Mapping[Change, float], noise: Sequence[RowNoise], weights: Sequence[Weights | None]
    ) -> float:
        """Return the log evidence of the noise and the functions, by that of each change for the most probable prior."""
        # Rows were divided by these deviations.
        sizes = sum(own.left.logarithm(steep) for own, steep in zip(noise, self.steepness, strict=True))
        smoothness = np.array([own.evidence for own in self.smoothness])
        evidence = float(np.logaddexp.reduce(list(found.values()))) - float(sizes) - 0.5 * self.left
        evidence += float(np.logaddexp.reduce(smoothness) - smoothness.max())
        return evidence + sum(own.logarithm for own in weights if own is not None)

    def evidence(self) -> BasisEvidence:
        """Return how probable the functions are, for noise as residuals show it; without friction elements that do not resist."""
        always = self.active.size
        if sum(len(part.rows) for part in self.boxes) <= always:
            return BasisEvidence(-np.inf, 1.0, False, None)
        best = self._settled_round(True, LIMITS.rounds)
        if not self._resists(best.smoothed):
            return Smoother(self.solver, self.collected, self.samples, loops=False, shown=self.shown).evidence()
        n, first = self.solver.coefficients, self.solver.coefficients + self.solver.shared
        likeliest = max(best.smoothness, key=lambda own: own.evidence).prior
        self._take(best.nominal)
        among = Surroundings(
            best.active[best.active >= first] - first,
            best.noise,
            best.weights,
            tuple(self.steepness),
            best.course,
            likeliest[:n] * self.scale[:n],
        )
        return BasisEvidence(
            best.evidence,
            _probability_of_first(best.smoothness),
            self.active.size > always,
            among,
        )

    def information(self, among: Surroundings) -> Array:
        """Return rows as of `SmootherSolver.information`."""
        n, views = self.solver.coefficients, self.solver.transmissions
        first = n + self.solver.shared
        self.active, self.steepness = np.r_[first + among.others, :first], list(among.steepness)
        middles = (np.arange(len(among.course)) + 0.5) * self.samples / len(among.course)
        for part, own in zip(self.boxes, self.collected, strict=True):
            course = np.column_stack([np.interp(own.place, middles, each) for each in among.course.T])
            part.rows[:, :n] = own.rows[:, :n] * np.repeat(course, n // views, axis=1)
        rows = self._measurements(self._triangles(among.noise, among.weights)).reshape(-1, self.active.size + 1)
        rows = np.vstack((rows, np.r_[np.zeros(self.active.size), np.sqrt(self.left)]))
        triangle = np.zeros((self.active.size + 1,) * 2)
        found = triangle_of(rows) / np.r_[self.scale[self.active], 1.0]
        triangle[: len(found)] = found
        return triangle

    def _resists(self, smoothed: Smoothed) -> bool:
        """Tell whether all friction elements together have a significant positive torque; true where there are none."""
        if not self.loops:
            return True
        n, level = self.solver.coefficients, np.zeros(self.active.size)
        level[n : n + self.solver.shared] = self.solver.slips
        level *= self.scale[self.active]
        deviation = np.sqrt(np.square(smoothed.root @ level).sum(axis=1).mean())
        return bool(level @ smoothed.mean.mean(axis=0) > two_sided(FALSE_ALARM) * deviation)

    def _misfit(self, mean: Array) -> float:
        """Return the largest residual that is no noise: it does not average out beyond a filter's window."""
        worst = 0.0
        for part, residual in zip(self.boxes, self._residuals(mean), strict=True):
            long = len(residual) // (BOXES.per_window * ROWS_OF_LONG)
            if long:
                short = residual[: long * BOXES.per_window * ROWS_OF_LONG].reshape(-1, BOXES.per_window).mean(axis=1)
                left = [float(np.sqrt(np.mean(r**2))) for r in (short.reshape(long, -1).mean(axis=1), short)]
                if lasts(*left):
                    worst = max(worst, left[0] / float(np.sqrt(np.mean(part.rows[:, -1] ** 2))))
        return worst

    def _residuals(self, mean: Array) -> list[Array]:
        """Return the residuals of each equation's rows for unknowns (K, size)."""
        return [
            part.rows[:, -1] - np.einsum("ij,ij->i", part.rows[:, :-1], mean[where][:, columns])
            for part, columns, where in zip(self.boxes, self.columns, self.where, strict=True)
        ]

    def _white(self, changing: bool) -> tuple[RowNoise, ...]:
        """Return white noise of each equation, as a spring leaves it that does not change, or is another in each interval."""
        return tuple(
            RowNoise.white(part, self._torques(part) if changing else None, where)
            for part, where in zip(self.boxes, self.where, strict=True)
        )

    def _torques(self, part: BoxRows) -> Array:
        """Return each transmission's torque in an equation's rows, shape (M, transmissions)."""
        n, views = self.solver.coefficients, self.solver.transmissions
        return np.asarray((part.rows[:, :n] * self.nominal[:n]).reshape(-1, views, n // views).sum(axis=2))

    def _noise(self, mean: Array, change: Change) -> tuple[tuple[RowNoise, ...], tuple[Weights | None, ...]]:
        """Return the noise of each equation, fitted to the residuals of an estimate, and the weights of its rows."""
        count = sum(len(part.rows) for part in self.boxes)
        # What is fitted leaves less than the noise: by its effective number of unknowns (Hastie and Tibshirani).
        freedom = np.sqrt(count / max(count - self.fitted, ROUNDING * count))
        residuals = [freedom * own for own in self._residuals(mean)]
        # What a jump is smeared over is no noise.
        smeared = {at + after for at in self._broken(change) for after in (0, 1)}
        clear = [~np.isin(where, list(smeared)) for where in self.where]
        sound = [(own[keep], part.only(keep)) for own, part, keep in zip(residuals, self.boxes, clear, strict=True)]
        noise, weights = list[RowNoise](), list[Weights | None]()
        for i, (residual, part) in enumerate(zip(residuals, self.boxes, strict=True)):
            before = list(zip(residuals[:i], self.boxes[:i], strict=True))
            steep, columns = self.steepness[i], [(own[:, None], boxes) for own, boxes in before]
            noise.append(RowNoise.fitted(*sound[i], steep[clear[i]], sound[:i]))
            weights.append(tail_weights(noise[-1].whitened(residual[:, None], part, steep, columns)[:, 0]))
        return tuple(noise), tuple(weights)

    def _triangles(self, noise: Sequence[RowNoise], weights: Sequence[Weights | None]) -> Array:
        """Return the whitened and weighted rows of each interval as a triangle over all unknowns, shape (K, size, size + 1)."""
        out = np.zeros((self.count, self.size, self.size + 1))
        self.left = 0.0
        whole: list[Array] = []
        for i, (part, own, columns) in enumerate(zip(self.boxes, noise, self.columns, strict=True)):
            rows = np.zeros((len(part.rows), self.size + 1))
            rows[:, np.r_[columns, self.size]] = part.rows
            whole.append(rows)
            white = own.whitened(rows, part, self.steepness[i], list(zip(whole[:i], self.boxes[:i], strict=True)))
            weight = weights[i]
            self.left += _rotate(white if weight is None else np.sqrt(weight.each)[:, None] * white, self.where[i], out)
        return out

    def _measurements(self, triangles: Array) -> Array:
        """Return triangles of the active unknowns, scaled, with a last row for the residual that they cannot reduce."""
        picked = np.concatenate((triangles[:, :, self.active] * self.scale[self.active], triangles[:, :, -1:]), axis=2)
        return np.ascontiguousarray(triangle_of(picked))

    def _steps(self, change: Change, direction: Array) -> Array:
        """Return the random walk's rows for a hypothesis, shape (K − 1, r, active).

        Parameters
        ----------
        direction : shape (transmissions, active), the torque of each transmission as a whole, in scaled unknowns
        """
        n, count = self.solver.coefficients, max(self.count - 1, 0)
        rows = []
        if change.whole or change.jumps:
            rows += [self._shares(change)[:, None] * own for own in direction]
        if change.shape:
            step = change.shape / np.sqrt(max(count, 1))
            rows += [np.tile(step * row, (count, 1)) for row in np.diag(self.usual)[:n]]
        return np.ascontiguousarray(np.stack(rows, axis=1) if rows else np.zeros((count, 1, self.active.size)))

    def _smooth(self, measurements: Array, change: Change, direction: Array, backward: bool) -> Smoothed:
        if change.trend:
            return self._smooth_with_trend(measurements, change, direction, backward)
        start = np.zeros(self.active.size), np.diag(self.prior)
        if not change.constant or self.solver.causal:
            return smooth(measurements, self._steps(change, direction), *start, backward)
        whole = triangle_of(measurements.reshape(1, -1, measurements.shape[2]))
        found = smooth(whole, np.zeros((0, 1, self.active.size)), *start, backward)
        arrays = (found.mean, found.root, found.filtered_mean, found.filtered_root, found.before)
        mean, root, filtered_mean, filtered_root, before = (np.repeat(own, self.count, axis=0) for own in arrays)
        return Smoothed(mean, root, filtered_mean, filtered_root, before, found.log_likelihood)

    def _smooth_with_trend(self, measurements: Array, change: Change, direction: Array, backward: bool) -> Smoothed:
        """Smooth with the trend as a state of each transmission that does not change; a filtered mean is the next one's."""
        steps, views = self._steps(change, direction), len(direction)
        found = smooth(
            self._with_trend(measurements, direction),
            np.ascontiguousarray(np.concatenate((steps, np.zeros((*steps.shape[:2], views))), axis=2)),
            np.zeros(self.active.size + views),
            np.diag(np.r_[self.prior, np.full(views, change.trend)]),
            backward,
        )
        moved = np.zeros((self.count, self.active.size + views, self.active.size))
        moved[:, : self.active.size] = np.eye(self.active.size)
        moved[:, self.active.size :] = self.ramp[:, None, None] * direction
        after = np.concatenate((moved[1:], moved[-1:]))
        mean, filtered_mean = (
            np.einsum("ki,kij->kj", x, by) for x, by in ((found.mean, moved), (found.filtered_mean, after))
        )
        pairs = (found.root, moved), (found.filtered_root, after), (found.before, moved)
        root, filtered_root, before = (triangle_of(own @ by) for own, by in pairs)
        return Smoothed(mean, root, filtered_mean, filtered_root, before, found.log_likelihood)

    @property
    def ramp(self) -> Array:
        """What a trend has added of all that it adds over the log, from its middle on, shape (K,)."""
        return np.asarray((np.arange(self.count) - 0.5 * (self.count - 1)) / self.count)

    def _with_trend(self, measurements: Array, direction: Array) -> Array:
        """Return measurements with a trend's column of each transmission after the unknowns'."""
        trends = self.ramp[:, None, None] * (measurements[:, :, :-1] @ direction.T)
        return np.ascontiguousarray(np.concatenate((measurements[:, :, :-1], trends, measurements[:, :, -1:]), axis=2))

    def _walk(self, measurements: Array) -> RandomWalk:
        """Return the walk of the torque as a whole, with a trend's unknown of each transmission after the others."""
        still = np.zeros((len(self.direction), len(self.direction)))
        return RandomWalk(self._with_trend(measurements, self.direction), np.hstack((self.direction, still)))

    def _shares(self, change: Change) -> Array:
        """Return the standard deviation of each step of the torque as a whole, shape (K − 1,)."""
        count = max(self.count - 1, 0)
        share = np.full(count, change.whole / np.sqrt(max(count, 1)))
        share[self._broken(change)] = LIMITS.fastest
        return share

    @property
    def _projection(self) -> Array:
        """What the torque of each transmission as a whole is of scaled unknowns, shape (active, transmissions).

        By least squares of the torque that they make in the rows: single coefficients of a spline may be unknown.
        """
        n, views = self.solver.coefficients, self.solver.transmissions
        out = np.zeros((self.active.size, views))
        for i, direction in enumerate(self.direction):
            own = slice(i * n // views, (i + 1) * n // views)
            for part in self.boxes:
                rows = part.rows[:, own] * self.scale[own]
                out[own, i] += rows.T @ (rows @ direction[own])
            out[own, i] /= (direction[own] @ out[own, i]) or 1.0
        return out

    def _linear(self, change: Change) -> Flags:
        """Return whether unknowns change linearly from each interval to the next, shape (K,)."""
        linear = np.ones(self.count, dtype=np.bool_)
        linear[[*self._broken(change), self.count - 1]] = False
        return linear

    def _broken(self, change: Change) -> list[int]:
        """Return the steps of a change's jumps: a window of the filters that contains one is of neither side."""
        each = (range(jump, min(jump + change.spread, self.count - 1)) for jump in change.jumps)
        return sorted({at for own in each for at in own})

    def _log_likelihood(self, measurements: Array, walk: RandomWalk, change: Change) -> float:
        """Return the log likelihood of a hypothesis; `walk` is that of the measurements."""
        if change.shape:
            return self._smooth(measurements, change, self.direction, False).log_likelihood
        triangle, logarithm = walk.triangle(self._shares(change))
        return log_likelihood(triangle, self._deviations(self.prior, triangle, change)) + logarithm

    def _deviations(self, prior: Array, triangle: Array, change: Change) -> Array:
        """Return the prior deviations of a triangle's unknowns: those of a trend are the last."""
        return np.asarray(np.r_[prior, np.full(triangle.shape[1] - 1 - prior.size, change.trend)])

    def _direction(self, usual: Array) -> Array:
        views, n = self.solver.transmissions, self.solver.coefficients
        out = np.zeros((views, self.active.size))
        for i in range(views):
            part = slice(i * n // views, (i + 1) * n // views)
            out[i, part] = usual[part]
        return out

    def _explained(self, triangles: Array, course: Array | None, shapes: bool) -> tuple[dict[Change, float], Smoothed]:
        """Return each hypothesis' log evidence, and what the best one estimates; unknowns that the log shows become active.

        Parameters
        ----------
        triangles : of `_triangles`
        course : shape (K, transmissions), of the torques, as far as it is known; None for that of a constant spring
        shapes : whether the shape may change, too
        """
        measurements = self._measurements(triangles)
        best, most = Change(), -np.inf
        course = np.ones((self.count, self.solver.transmissions)) if course is None else course
        kept = self.smoothness, self.prior, self.direction, self.usual
        for _ in range(LIMITS.rounds):
            # A spring that changes may look like one that is no polynomial, and the other way round.
            unchanged = self._unchanged(measurements, course)
            self.smoothness = self._smoothnesses(unchanged)
            likeliest = max(range(len(self.smoothness)), key=lambda i: self.smoothness[i].evidence)
            self.prior = self.smoothness[likeliest].prior
            tried, estimate = self._changing(measurements, unchanged, shapes)
            joint = max(tried.values()) + float(_log_prior(len(self.smoothness))[likeliest])
            if joint < most:
                self.smoothness, self.prior, self.direction, self.usual = kept
                break
            kept = self.smoothness, self.prior, self.direction, self.usual
            most, evidence, smoothed = joint, tried, estimate
            course = smoothed.mean @ self._projection
            explained, best = best, _likeliest(evidence)
            if best == explained:
                break
        else:
            self.smoothness = self._smoothnesses(self._unchanged(measurements, course))
        prior = self.prior
        self._roughen(measurements, best)
        self.prior = prior
        # A causal filter's acceleration lags and is noisy, which another inertia would explain.
        if self.shown and not self.solver.causal and self._shown(triangles, best):
            return self._explained(triangles, None, shapes)
        return evidence, smoothed

    def _roughen(self, measurements: Array, change: Change) -> None:
        """Estimate the least smooth spring: its residual is noise; that of a smoother one has the misfit in it that shows it."""
        self.prior = self.smoothness[-1].prior
        self.roughest = self._smooth(measurements, change, self.direction, True)
        known = 1.0 - np.square(self.roughest.root).sum(axis=1).mean(axis=0) / np.square(self.prior)
        self.fitted = float(np.clip(known, 0.0, 1.0).sum())

    def _unchanged(self, measurements: Array, course: Array) -> Array:
        """Return the triangle of the coefficients that a spring would have without its change, which is taken as known.

        A change along a spline's torque would bring knots to a polynomial.
        """
        n, views = self.solver.coefficients, self.solver.transmissions
        changed = measurements[:, :, :n] * np.repeat(course, n // views, axis=1)[:, None]
        return triangle_of(np.concatenate((changed, measurements[:, :, n:]), axis=2).reshape(-1, measurements.shape[2]))

    def _smoothnesses(self, triangle: Array) -> tuple[Smoothness, ...]:
        """Return the hypotheses of how smooth a spring is, of a triangle of the scaled unknowns.

        Of a power of the deflection the torque has r times as much as of the power before; the curvature changes from knot to
        knot by so much. Deviations of the others are geometric means over what the log makes probable.
        """
        powers, knots, elements = self.powers[self.active], self.knots[self.active], self.elements[self.active]
        curvatures = LIMITS.curvatures if knots.any() else np.ones(1)
        before = _log_prior(curvatures.size)
        rest = np.where(elements, LIMITS.parts[-1], 1.0)

        def each(rest: Array) -> tuple[Smoothness, ...]:
            priors = [np.where(knots, curvature, rest) for curvature in curvatures]
            return tuple(
                Smoothness(float(own) + log_likelihood(triangle, prior), prior)
                for own, prior in zip(before, priors, strict=True)
            )

        curvature = curvatures[np.argmax([own.evidence for own in each(rest)])]
        parts = LIMITS.parts if elements.any() else np.ones(1)
        rests = np.array([np.where(elements, part, ratio**powers) for ratio in LIMITS.ratios for part in parts])
        evidence = [log_likelihood(triangle, np.where(knots, curvature, rest)) for rest in rests]
        return each(np.exp(_normalised(evidence) @ np.log(rests)))

    def _changing(self, measurements: Array, unchanged: Array, shapes: bool) -> tuple[dict[Change, float], Smoothed]:
        """Return each change's log evidence, and what the best one estimates; `unchanged` as of `_unchanged`."""
        n = self.active.size
        fitted = smooth(unchanged[None], np.zeros((0, 1, n)), np.zeros(n), np.diag(self.prior), False)
        self.direction = self._direction(fitted.filtered_mean[0])
        self.usual = np.sqrt(fitted.filtered_mean[0] ** 2 + np.square(fitted.filtered_root[0]).sum(axis=0))
        walk = self._walk(measurements)
        # Until the noise is known, steps of a decade suffice.
        sizes = LIMITS.changes[:: 1 if shapes else 2] if self.count > 1 and not self.solver.constant else ()
        trends = [Change(), *(Change(trend=size) for size in (LIMITS.trends if len(sizes) else ()))]
        evidence = self._weighed(measurements, walk, [own._replace(whole=w) for own in trends for w in (0.0, *sizes)])
        best = _likeliest(evidence)
        if not best.constant:
            # A fast walk would hide a jump. The search is shortest with as many steps between places as there are places.
            most = max(LIMITS.spreads)
            places = range(0, self.count - 1, math.isqrt(self.count))
            broken = self._weighed(measurements, walk, [Change(jumps=(place,), spread=most) for place in places])
            self._place(measurements, walk, broken)
            evidence |= broken
            best = _likeliest(evidence)
        while True:
            smoothed = self._smooth(measurements, best, self.direction, True)
            jump = None if self.solver.constant else self._jump(smoothed, best)
            if jump is None or len(best.jumps) == LIMITS.jumps:
                break
            # A jump explains part of the random walk, which is then as fast, half a decade slower, or none.
            jumps, slower = tuple(sorted((*best.jumps, jump))), [size for size in sizes if size <= best.whole][-2:]
            tried = [own._replace(whole=w, jumps=jumps) for own in trends for w in (0.0, *slower)]
            more = self._weighed(measurements, walk, tried)
            self._place(measurements, walk, more)
            evidence |= more
            better = _likeliest(evidence)
            if better == best:
                break
            best = better
        if shapes:
            evidence |= self._weighed(measurements, walk, [best._replace(shape=size) for size in sizes])
        return evidence, smoothed

    def _place(self, measurements: Array, walk: RandomWalk, evidence: dict[Change, float]) -> None:
        """Add hypotheses with each jump of the most probable one at other times, as far as they are probable."""
        best, placed = _likeliest(evidence), None
        while best != placed:
            placed = best
            for jump in best.jumps:
                others = tuple(own for own in best.jumps if own != jump)
                for step in (-1, 1):
                    at = jump
                    while 0 <= at < self.count - 1 and at not in others:
                        jumps = tuple(sorted((*others, at)))
                        moved = [best._replace(jumps=jumps, spread=spread) for spread in LIMITS.spreads]
                        evidence |= self._weighed(measurements, walk, [own for own in moved if own not in evidence])
                        least = max(evidence.values()) + np.log(LIMITS.least_probability)
                        if max(evidence[own] for own in moved) < least:
                            break
                        at += step
            best = _likeliest(evidence)

    def _shown(self, triangles: Array, change: Change) -> bool:
        """Make the unknown with the largest likelihood ratio active; return whether one is significant."""
        likelihoods = {}
        active, prior, direction, usual = self.active, self.prior, self.direction, self.usual
        first = self.solver.coefficients
        hidden = {(part, name) for part, own in enumerate(self.solver.hidden) for name in own}
        sought = [first + i for i, name in enumerate(self.names) if name not in hidden and name[1] != SHARED]
        for i in (-1, *np.setdiff1d(sought, active)):
            added = int(i >= 0)
            self.active = np.r_[active, [i] * added].astype(int)
            self.prior, self.usual = (np.r_[own, [1.0] * added] for own in (prior, usual))
            self.direction = np.hstack((direction, np.zeros((len(direction), added))))
            measurements = self._measurements(triangles)
            walk = self._walk(measurements)
            likelihoods[i] = self._log_likelihood(measurements, walk, change)
        best = max(likelihoods, key=lambda i: likelihoods[i])
        # The noise is estimated from the same rows: twice a logarithm of likelihoods is Student's t squared.
        # Noise is never quite as it is modelled, so any regressor predicts a little of a residual. An offset does no harm.
        count = sum(len(part.rows) for part in self.boxes)
        freedom = count - active.size - 1
        rows = 0 if best >= 0 and self.names[best - first][1] == "offset" else count
        least = (
            max(float(stdtrit(freedom, 1.0 - 0.5 * FALSE_ALARM)) ** 2, PREDICTED_SHARE * rows)
            if freedom > 0
            else np.inf
        )
        shown = best >= 0 and 2.0 * (likelihoods[best] - likelihoods[-1]) > least
        self.active = np.r_[active, [best] if shown else []].astype(int)
        self.prior, self.direction, self.usual = prior, direction, usual
        return shown

    def _weighed(self, measurements: Array, walk: RandomWalk, changes: Sequence[Change]) -> dict[Change, float]:
        """Return the log evidence of hypotheses: either the whole walks or not, and so for its shape and trend, each alike."""
        absent, walks, steady = (math.log(0.5 / count) for count in (1, LIMITS.changes.size, LIMITS.trends.size))
        return {
            change: self._log_likelihood(measurements, walk, change)
            + sum(walks if size else absent for size in (change.whole, change.shape))
            + (steady if change.trend else absent)
            # Any interval could have been the one of a jump.
            - np.log(max(self.count - 1, 1)) * len(change.jumps)
            - (np.log(len(LIMITS.spreads)) if change.jumps else 0.0)
            for change in changes
        }

    def _jump(self, smoothed: Smoothed, change: Change) -> int | None:
        """Return the interval after which the disturbance is too large for the random walk, None where none is."""
        if self.count < 2:
            return None
        V = smoothed.before[1:]
        P, Ps = np.swapaxes(V, 1, 2) @ V, np.swapaxes(smoothed.root[1:], 1, 2) @ smoothed.root[1:]
        off, inverse = smoothed.mean[1:] - smoothed.filtered_mean[:-1], np.linalg.pinv(P, hermitian=True)
        most, found = two_sided(FALSE_ALARM / (self.count - 1) / len(self.direction)), None
        for direction in self.direction:
            # By the pseudo-inverse: what is known exactly does not change.
            g = np.einsum("kij,j->ki", inverse, direction)
            score = np.einsum("ki,ki->k", g, off)
            information = np.einsum("ki,kij,kj->k", g, P - Ps, g)
            with np.errstate(divide="ignore", invalid="ignore"):
                size = np.abs(score) / np.sqrt(information)
            size[~np.isfinite(size)] = 0.0
            size[self._broken(change)] = 0.0
            k = int(np.argmax(size))
            if size[k] > most:
                most, found = float(size[k]), k
        return found

    def _averaged(self, triangles: Array, choice: Choice) -> tuple[Array, Array]:
        """Return mean (K, n) and root (K, n, n) of all unknowns, averaged over hypotheses."""
        measurements, n = self._measurements(triangles), self.active.size
        total, mean, root = 0.0, np.zeros((self.count, n)), np.zeros((self.count, 0, n))
        parts, changes = _normalised([h.evidence for h in choice.smoothness]), choice.probabilities
        least = LIMITS.least_probability * float(parts.max()) * max(changes.values())
        for part, smoothness in zip(parts, choice.smoothness, strict=True):
            self.prior = smoothness.prior
            for change, p in changes.items():
                weight = float(part * p)
                if weight < least:
                    continue
                own = self._smooth(measurements, change, self.direction, True)
                if self.solver.causal:
                    # An interval is estimated from those before it.
                    own = own._replace(mean=np.vstack((0.0 * mean[:1], own.filtered_mean[:-1])), root=own.before)
                off = (own.mean - mean)[:, None, :]
                rows = (root, np.sqrt(weight) * own.root, np.sqrt(total * weight / (total + weight)) * off)
                mean += weight / (total + weight) * off[:, 0]
                root, total = triangle_of(np.concatenate(rows, axis=1)), total + weight
        return self._whole(mean), root / np.sqrt(total) * self.scale[self.active]

    def _whole(self, mean: Array) -> Array:
        """Return all unknowns, in their units, of scaled ones that are active."""
        out = np.zeros((len(mean), self.size))
        out[:, self.active] = mean * self.scale[self.active]
        return out

    def _external(self, mean: Array, root: Array, choice: Choice) -> Trajectory:
        """Return what functionals are of: the motor's unknowns where it has any, and the coefficients."""
        n = self.solver.coefficients
        order = np.r_[[n + self.names.index(name) for name in self.solver.leading], :n].astype(int)
        full = np.zeros((self.count, root.shape[1], self.size))
        full[:, :, self.active] = root
        picked = triangle_of(full[:, :, order])
        linear = self._linear(choice.change) & (not self.solver.causal)
        deviation = np.sqrt(np.square(full).sum(axis=1)).mean(axis=0)
        others = {self.names[i - n]: (float(mean[:, i].mean()), float(deviation[i])) for i in self.active if i >= n}
        projection = self._projection / self.scale[self.active][:, None]
        torque, deviations = mean[:, self.active] @ projection, np.sqrt(np.square(root @ projection).sum(axis=1))
        external = np.ascontiguousarray(mean[:, order])
        elements = slice(n, n + self.solver.shared)
        return Trajectory(
            self.samples,
            external,
            picked,
            linear,
            choice.noise[0].deviation,
            choice,
            torque,
            deviations,
            self._misfit(mean),
            others,
            mean[:, elements].mean(axis=0),
            np.einsum("kij,kil->jl", full[:, :, elements], full[:, :, elements]) / self.count,
        )


def _log_prior(count: int) -> Array:
    """Return the logarithm of each smoothness' probability before the log: a polynomial has that of all others together."""
    return np.asarray(np.log(np.r_[0.5, np.full(count - 1, 0.5 / max(count - 1, 1))]))


def _least_squares(part: BoxRows) -> Array:
    """Return the unknowns of an equation, shape (c - 1,), by its rows alone."""
    return np.asarray(np.linalg.lstsq(part.rows[:, :-1], part.rows[:, -1], rcond=None)[0])


def _likeliest(evidence: Mapping[Change, float]) -> Change:
    return max(evidence, key=lambda change: evidence[change])


def _probabilities(evidence: Mapping[Change, float]) -> dict[Change, float]:
    return dict(zip(evidence, _normalised(list(evidence.values())).tolist(), strict=True))


def _probability_of_no_change(evidence: Mapping[Change, float]) -> float:
    return sum(p for change, p in _probabilities(evidence).items() if change.constant)


def _probability_of_first(smoothness: Sequence[Smoothness]) -> float:
    return float(_normalised([own.evidence for own in smoothness])[0])


def _normalised(evidence: Sequence[float] | Array) -> Array:
    """Return probabilities in proportion to the exponentials of `evidence`, shape (K,)."""
    weights = np.exp(np.asarray(evidence) - np.max(evidence))
    return np.asarray(weights / weights.sum())


@compiled
def _rotate(rows: Array, where: Integers, triangles: Array) -> float:
    """Rotate each row into its interval's triangle; return the sum of squares that no value of the unknowns can reduce."""
    scratch = np.empty(rows.shape[1])
    n, left = rows.shape[1] - 1, 0.0
    for k in range(rows.shape[0]):
        qr_update(rows[k, :n], rows[k, n], 1.0, triangles[where[k]], scratch)
        left += scratch[n] * scratch[n]
    return left


@compiled
def _evaluate(
    mean: Array, root: Array, linear: Flags, samples: int, first: int, E: Array, spread: Flags, values: Array, variances: Array,
    unknowns: Array,
) -> None:  # fmt: skip
    """Evaluate functionals: linearly between the middles of intervals, and as in the interval where there was a jump."""
    count, n = mean.shape
    for k in range(E.shape[0]):
        place = (first + k + 0.5) * count / samples - 0.5
        left = min(max(int(np.floor(place)), 0), count - 1)
        right, part = min(left + 1, count - 1), min(max(place - left, 0.0), 1.0)
        if not linear[left]:
            part = 1.0 if part > 0.5 else 0.0
        for i in range(n):
            unknowns[k, i] = (1.0 - part) * mean[left, i] + part * mean[right, i]
        nearest = right if part > 0.5 else left
        for s in range(E.shape[1]):
            value = 0.0
            for i in range(n):
                value += E[k, s, i] * unknowns[k, i]
            values[k, s] = value
            if not spread[s]:
                continue
            variance = 0.0
            # Unknowns that are not estimated leave a root with fewer rows than columns.
            for h in range(root.shape[1]):
                total = 0.0
                for i in range(h, n):
                    total += root[nearest, h, i] * E[k, s, i]
                variance += total * total
            variances[k, s] = variance
