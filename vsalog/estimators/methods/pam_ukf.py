"""pam-ukf: a joint of two pneumatic muscles from its pressures alone, by an unscented Kalman filter.

Shin, Ibayashi, Kogiso (2021): the hybrid model eq. 2–11, the filter eq. 13–24. Angle, velocity, torque and stiffness come from
the two pressures and the valves' commands; no encoder and no torque sensor is read.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from vsalog.binding.grid import LONGEST_GAP
from vsalog.core.errors import EstimatorError, OtherKindError
from vsalog.core.finding import Finding
from vsalog.core.resolution import sensor_noise
from vsalog.core.signals import JointSignals
from vsalog.core.significance import DETECTED_OF_MANY, INTERVAL
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device
from vsalog.estimators.needs import require
from vsalog.estimators.pam_linear import LinearPamFold
from vsalog.estimators.pam_models import PRINTED, ModelName, as_if
from vsalog.estimators.pam_noise import PamNoise, pam_noise
from vsalog.estimators.pam_states import Column, PamFold, PamState
from vsalog.estimators.region import lengths
from vsalog.estimators.state_observer import StateObserver, Unfiltered, UnfilteredTuning, state_columns
from vsalog.filters.square_root_ukf import UnscentedTrace
from vsalog.rig.tolerance import default_deviation
from vsalog.uncertainty.sensor_error import LEAST_NOISE

Array = NDArray[np.float64]

NAME = "pam-ukf"
SUMMARY = "angle, torque and stiffness of pneumatic muscles from their pressures alone (Shin 2021)"
PRESSURES = ("pressure_1", "pressure_2")
OTHERS = ("valve_1", "valve_2", "external_torque")
Share = Annotated[float, Meta(ge=0.0, le=1.0)]


# A pressure so far below that outside, which no valve can cause, is no sensor's offset [1].
LARGEST_OFFSET = 0.1

# A linear flow has one slope where the orifice into the muscle and that out of it have one each; and it never chokes. It is off
# by this share, at least [1].
LINEAR_FLOW_ERROR = 0.25


class PamTuning(UnfilteredTuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of pam-ukf, pam-smoother and pam-model.

    Attributes
    ----------
    air : the case that the stiffness is for: ``trapped`` (the valves are closed) or ``constant`` (the pressures are held)
    model : ``hybrid``, that of the rig, or a simpler one to compare with, as if the rig's were that (Shin §IV-B): see `as_if`
    flow, force, friction : uncertainty of the rig, one standard deviation as a share: of the valves' largest flow, of a
        muscle's pull, of the friction's level
    covariances : ``derived`` from the log's sensors and the rig's uncertainty, or ``printed``: those of Shin §IV, whatever
        the log
    """

    air: Literal["trapped", "constant"] = "trapped"
    model: ModelName = "hybrid"
    flow: Share = 0.2
    force: Share = 0.04
    friction: Share = 0.2
    covariances: Literal["derived", "printed"] = "derived"


TUNING = PamTuning


def printed(device: Device) -> dict[str, str]:
    """Return the tuning that Shin prints, §IV."""
    return {"covariances": "printed"}


def roles(device: Device, offered: Collection[str], tuning: PamTuning, name: str = NAME) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    if device.pneumatic is None:
        raise OtherKindError(
            f"joint '{device.joint}': {name} is for joints of kind 'pneumatic', two muscles and their pressures; 'vsalog estimate"
            " --help' lists the estimators for others"
        )
    require(name, device, PRESSURES, offered)
    return (*PRESSURES, *(role for role in OTHERS if role in offered))


def build(device: Device, signals: JointSignals, tuning: PamTuning) -> PamEstimate:
    """Assemble the estimator for a joint's signals.

    Raises
    ------
    EstimatorError
        A pressure has no value, the muscles do not hold the joint at these pressures, or a muscle's pull cannot take the form
        that the model asked for has.
    """
    return estimate_of(NAME, device, signals, tuning, correct=True)


def estimate_of(name: str, device: Device, signals: JointSignals, tuning: PamTuning, *, correct: bool) -> PamEstimate:
    """Assemble the filter, or with `correct` false the model alone."""
    assert device.pneumatic is not None
    middle, sensors, below = [], [], []
    for role in PRESSURES:
        finite = signals.roles[role][np.isfinite(signals.roles[role])]
        if finite.size == 0:
            raise EstimatorError(f"joint '{device.joint}': {role} has no value in this log")
        middle.append(float(np.median(finite)))
        sensors.append(sensor_noise(finite, signals.resolution.get(role, 0.0), LEAST_NOISE))
        below += _below_outside(role, finite, sensors[-1], device)
    pressures = middle[0], middle[1]
    joint = as_if(device.pneumatic, tuning.model, pressures)
    flow = max(tuning.flow, LINEAR_FLOW_ERROR) if tuning.model == "linear" else tuning.flow
    noise = pam_noise(
        joint, signals.period, pressures, (sensors[0], sensors[1]), flow=flow, force=tuning.force,
        friction=tuning.friction,
    )  # fmt: skip
    if tuning.covariances == "printed":
        # A joint that is held stays there, whatever noise a free one is given.
        free = 1.0 if joint.seesaw.held_at is None else 0.0
        of_pressures, angle, velocity = PRINTED.state[:2], free * PRINTED.state[2], free * PRINTED.state[3]
        noise = replace(
            noise, pressure=PRINTED.sensor, process=(*of_pressures, angle, velocity), start=(angle, velocity)
        )
    fold: PamFold
    if tuning.model == "linear":
        fold = LinearPamFold(joint, signals.period, noise, pressures, correct=correct)
    else:
        fold = PamFold(joint, signals.period, noise, correct=correct)
    return PamEstimate(name, device, fold, noise, tuning.air, signals.period, tuple(below))


def _below_outside(role: str, pressure: Array, noise: float, device: Device) -> list[Finding]:
    """Find a pressure that falls below that outside, as one that is not absolute does.

    Raises
    ------
    EstimatorError
        It falls so far that it cannot be absolute.
    """
    assert device.pneumatic is not None
    outside, least = device.pneumatic.air.outside_pressure, float(np.min(pressure))
    weather = INTERVAL * default_deviation("air.outside_pressure", outside, outside)
    limit = outside - max(DETECTED_OF_MANY * noise, weather)
    if least > limit:
        return []
    if least < (1.0 - LARGEST_OFFSET) * outside:
        raise EstimatorError(
            f"joint '{device.joint}': {role} falls to {least / 1e3:.4g} kPa, below the {outside / 1e3:.4g} kPa outside,"
            " which no valve causes: it is not absolute. A signal of the rig may have an offset, the sensor's reading at"
            f' zero: offset = "-{outside / 1e3:.4g} kPa" where it measures the pressure above that outside'
        )
    return [
        Finding(
            code="pressure.below_outside",
            joint=device.joint,
            part=role,
            value=least / 1e3,
            limit=limit / 1e3,
            unit="kPa",
            evidence={"outside": outside / 1e3},
        )
    ]


@dataclass(frozen=True, slots=True)
class PamFoldState:
    """State of the fold: the filter's state, samples seen, those at which it had lost the joint or did not know its angle,
    and of the last its run, its stamp [ns], and how many in a row had no pressure by then.
    """

    filter: PamState
    seen: int = 0
    diverged: int = 0
    anywhere: int = 0
    run: int = -1
    stamp: int = 0
    silent: int = 0

    def goes_on(self, piece: JointSignals) -> bool:
        """Return whether the filter continues into a piece: it does where commands alone were missing."""
        due = self.stamp + 1.5e9 * piece.period
        return bool(piece.run[0] == self.run and piece.stamps[0] < due and self.silent < LONGEST_GAP)


class PamEstimate(StateObserver):
    """The filter as an estimator: a fold over blocks of signals that gives a trace."""

    modality = "STATES"
    conditioner = Unfiltered()

    def __init__(
        self,
        name: str,
        device: Device,
        fold: PamFold,
        noise: PamNoise,
        air: str,
        period: float,
        noticed: tuple[Finding, ...] = (),
    ) -> None:
        self.name, self.device, self.fold, self.noise, self.air, self.period = name, device, fold, noise, air, period
        self.noticed = noticed

    @property
    def derived(self) -> dict[str, float]:
        """The noise that was derived from the log and the rig."""
        names = ("noise_pressure_1", "noise_pressure_2")
        process = ("process_pressure_1", "process_pressure_2", "process_angle", "process_velocity")
        return dict(zip((*names, *process), (*self.noise.pressure, *self.noise.process), strict=True))

    def start(self) -> PamFoldState:
        """Return the state before the first sample."""
        return PamFoldState(self.fold.start())

    def step(self, state: PamFoldState, block: JointSignals) -> tuple[PamFoldState, list[Trace]]:
        """Take a block of samples; give the new state and their trace."""
        traces = []
        for piece in block.between_gaps():
            state, found = self.follow(state, piece)
            state, trace = self.traced(state, piece, found)
            traces.append(trace)
        return state, traces

    def follow(self, state: PamFoldState, piece: JointSignals) -> tuple[PamFoldState, UnscentedTrace]:
        """Filter a piece without a gap in it."""
        given, pressures = [piece.roles.get(role) for role in OTHERS], [piece.roles[role] for role in PRESSURES]
        filtered, found = self.fold.block(self.before(state, piece), *pressures, *given)
        silent = lengths(np.logical_and(*(np.isnan(p) for p in pressures)), state.silent)
        diverged = state.diverged + int(np.count_nonzero(found.diverged))
        followed = PamFoldState(
            filtered, state.seen + len(piece), diverged, state.anywhere, int(piece.run[-1]), int(piece.stamps[-1]),
            int(silent[-1]),
        )  # fmt: skip
        return followed, found

    def before(self, state: PamFoldState, piece: JointSignals) -> PamState:
        """Return the filter's state before a piece, that before the first sample where it does not continue into it."""
        return self.fold.start() if piece.starts[0] and not state.goes_on(piece) else state.filter

    def traced(self, state: PamFoldState, piece: JointSignals, found: UnscentedTrace) -> tuple[PamFoldState, Trace]:
        """Return the trace of a piece, and the state with its count of samples whose angle is unknown."""
        anywhere = _anywhere(found)
        columns = self._columns(found, _blind(piece, self.fold.correct) | anywhere)
        counted = replace(state, anywhere=state.anywhere + int(np.count_nonzero(anywhere)))
        return counted, Trace.of_rows(piece, {"total": columns})

    def _columns(self, found: UnscentedTrace, blind: NDArray[np.bool_]) -> Mapping[str, Any]:
        estimates = self.fold.estimates(found)
        deviation = np.sqrt(np.einsum("nij,nij->ni", found.S, found.S))
        if not self.fold.correct:  # nothing determines the error of a model alone
            deviation[:] = np.nan
        nothing = np.full(found.x.shape[0], np.nan)
        kind = "stiffness" if self.air == "trapped" else "stiffness_isobaric"
        sigma, std = estimates[kind], _known(estimates[f"{kind}_std"])
        lost = found.diverged | blind
        states = (
            ("link_position", Column.ANGLE),
            ("link_velocity", Column.VELOCITY),
            *zip(PRESSURES, (Column.PRESSURE_1, Column.PRESSURE_2), strict=True),
        )
        extra = {name: found.x[:, i] for name, i in states} | {f"{name}_std": deviation[:, i] for name, i in states}
        # Where the filter has lost the joint, or a muscle's input is not known, the trace is NaN: a number would look valid.
        columns = state_columns(nothing, estimates["torque"], sigma, std, np.isfinite(sigma) & ~lost)
        excited = columns.pop("excited")
        columns |= {"flexibility_torque_std": _known(estimates["torque_std"]), **extra}
        return {name: np.where(lost, np.nan, values) for name, values in columns.items()} | {"excited": excited}

    def findings(self, state: PamFoldState) -> tuple[Finding, ...]:
        """Return where the pressures do not determine the angle, or differ from the model's response to the valves."""
        found, joint = list(self.noticed), self.device.joint
        if state.anywhere:
            share = state.anywhere / state.seen
            unknown = partial(Finding, joint=joint, severity="info")
            found.append(unknown(code="pressure.angle_unknown", value=share, limit=0.0))
        if state.diverged:
            share = state.diverged / state.seen
            found.append(Finding(code="pressure.not_explained", joint=joint, value=share, limit=0.0))
        return tuple(found)


def _blind(rows: JointSignals, correct: bool) -> NDArray[np.bool_]:
    """Return where a muscle's input is not known: its pressure is missing, or not corrected with, and its valve's command is."""
    blind = np.zeros(len(rows), dtype=np.bool_)
    for pressure, valve in zip(PRESSURES, ("valve_1", "valve_2"), strict=True):
        command = rows.roles.get(valve)
        unknown = np.ones(len(rows), dtype=np.bool_) if command is None else np.isnan(command)
        blind |= unknown & (np.isnan(rows.roles[pressure]) if correct else True)
    return blind


def _anywhere(found: UnscentedTrace) -> NDArray[np.bool_]:
    """Return where the joint may be further than a quarter turn from its middle, beyond which no seesaw turns, by the filter."""
    deviation = np.sqrt(np.einsum("nj,nj->n", found.S[:, Column.ANGLE], found.S[:, Column.ANGLE]))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(found.x[:, Column.ANGLE]) + deviation > 0.5 * np.pi)


def _known(deviation: Array) -> Array:
    """Return deviations, NaN for 0: the error of a state that nothing corrects, or that is a model's constant, is not known."""
    return np.where(deviation > 0.0, deviation, np.nan)
