"""One joint of one log, judged: what a frozen model predicts against everything the log offers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.estimators.device import Device, TransmissionView, deflection_of
from vsalog.model import JointModel
from vsalog.recording import Recording
from vsalog.resolution import step_of
from vsalog.rig.schema import AntagonisticJoint, Joint
from vsalog.signals import JointSignals
from vsalog.validation import references as ref
from vsalog.validation.dependence import LEAST_SHARE, dependences, gain_of
from vsalog.validation.document import Comparison, Dependence, Reference, Score, TransmissionReport
from vsalog.validation.evidence import JointEvidence, TransmissionEvidence, setpoint_unit
from vsalog.validation.independence import computed_from, stuck
from vsalog.validation.region import inside_region
from vsalog.validation.scores import LEAST_TORQUE, score
from vsalog.validation.signatures import POSITIONS, loops
from vsalog.validation.torques import felt, sensor_of
from vsalog.validation.torques import residual as residual_of

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TORQUE, STIFFNESS = ("flexibility_torque", "N*m"), ("stiffness", "N*m/rad")


@dataclass(frozen=True, slots=True)
class Judged:
    """What was found about a joint: the report's parts and what a figure draws."""

    transmissions: tuple[TransmissionReport, ...]
    evidence: JointEvidence
    not_independent: str | None


@dataclass(frozen=True, slots=True)
class _Part:
    """One transmission, or their sum: prediction and references."""

    name: str
    phi: Array
    torque: Array
    torque_std: Array
    stiffness: Array
    stiffness_std: Array
    inside: Flags
    sensor: Array | None
    sensor_role: str | None
    residual: Array | None
    lagged: Array | None
    nominal: tuple[Array, Array] | None
    truth: Array | None


def judge(model: JointModel, joint: Joint, device: Device, signals: JointSignals, recording: Recording) -> Judged:
    """Hold a joint's frozen model against a log.

    Parameters
    ----------
    model : frozen
    joint, device : of the rig
    signals : bound: deflections or positions, set-point, and whatever torques there are
    recording : for a simulator's truth

    Raises
    ------
    FilterError
        No run is long enough.
    """
    not_independent = _not_independent(device, signals)
    s = ref.smoothed(device, signals, tuple(signals.roles))
    setpoint = s.roles.get("setpoint")
    parts = [_part(model, joint, device, view, s, setpoint, signals, recording) for view in device.transmissions]
    if len(parts) > 1:
        parts.append(_total(parts, device, s, signals, recording))
    trusted = not_independent is None
    reports = tuple(_report(part, s, setpoint, signals, trusted) for part in parts)
    drawn = {p.name: _evidence(p, r) for p, r in zip(parts, reports, strict=True)}
    return Judged(
        reports, JointEvidence(signals.joint, s.time, setpoint, setpoint_unit(joint), drawn, model), not_independent
    )


def _part(
    model: JointModel, joint: Joint, device: Device, view: TransmissionView, s: ref.Smoothed, setpoint: Array | None,
    signals: JointSignals, recording: Recording,
) -> _Part:  # fmt: skip
    torque, torque_std, sigma, sigma_std = ref.prediction(model, view, s, setpoint)
    sensor, residual = sensor_of(device, view, s), residual_of(device, view, s, signals)
    phi = deflection_of(s.roles, view)
    fitted = next(t for t in model.transmission if t.name == view.name)
    suffix = f"_{view.name}" if isinstance(joint, AntagonisticJoint) else ""
    return _Part(
        view.name, phi, torque, torque_std, sigma, sigma_std, inside_region(fitted, phi, setpoint),
        felt(device, (view,), sensor, s, signals), sensor, residual,
        None if residual is None else ref.behind_the_lag(torque, signals.period),
        ref.nominal(view, s, setpoint), ref.true_stiffness(recording, device.joint, suffix, s),
    )  # fmt: skip


def _total(
    parts: Sequence[_Part], device: Device, s: ref.Smoothed, signals: JointSignals, recording: Recording
) -> _Part:
    """The joint as a whole: torques and stiffnesses of both transmissions add up (Flacco 2012 eq. 9–10)."""

    def total(values: Sequence[Array | None]) -> Array | None:
        known = [v for v in values if v is not None]
        return np.sum(known, axis=0) if len(known) == len(values) else None

    sensor = felt(device, device.transmissions, "torque_sensor", s, signals)
    nominal = [p.nominal for p in parts]
    known = [n for n in nominal if n is not None]
    return _Part(
        "total",
        parts[0].phi,
        np.sum([p.torque for p in parts], axis=0),
        np.sqrt(np.sum([p.torque_std**2 for p in parts], axis=0)),
        np.sum([p.stiffness for p in parts], axis=0),
        np.sqrt(np.sum([p.stiffness_std**2 for p in parts], axis=0)),
        np.logical_and.reduce([p.inside for p in parts]),
        sensor if sensor is not None else total([p.sensor for p in parts]),
        "torque_sensor" if sensor is not None else None,
        total([p.residual for p in parts]),
        total([p.lagged for p in parts]),
        (np.sum([n[0] for n in known], axis=0), np.sum([n[1] for n in known], axis=0))
        if len(known) == len(parts)
        else None,
        ref.true_stiffness(recording, signals.joint, "_total", s),
    )


def _report(
    part: _Part, s: ref.Smoothed, setpoint: Array | None, signals: JointSignals, trusted: bool
) -> TransmissionReport:
    comparisons: list[Comparison] = []
    judged_on: Reference | None = None
    dependence: tuple[Dependence, ...] = ()
    gain: float | None = None
    if part.sensor is not None:
        comparisons.append(_compare(TORQUE, "sensor", part.torque, part.sensor, part.inside))
    if part.residual is not None and part.lagged is not None:
        comparisons.append(_compare(TORQUE, "residual", part.lagged, part.residual, part.inside))
    if part.nominal is not None:
        comparisons.append(_compare(TORQUE, "nominal", part.torque, part.nominal[0], part.inside))
        comparisons.append(_compare(STIFFNESS, "nominal", part.stiffness, part.nominal[1], part.inside))
    if part.truth is not None:
        comparisons.append(_compare(STIFFNESS, "truth", part.stiffness, part.truth, part.inside))
    for reference, measured, predicted in (
        ("sensor", part.sensor if trusted else None, part.torque),
        ("residual", part.residual, part.lagged),
    ):
        if measured is not None and predicted is not None and judged_on is None and bool(part.inside.any()):
            judged_on = reference  # type: ignore[assignment]
            raw = signals.roles.get(part.sensor_role or "") if reference == "sensor" else None
            dependence = _dependence(part, predicted, measured, s, setpoint, signals.period, raw)
            gain = gain_of((predicted - measured)[part.inside], predicted[part.inside])
    comparisons.sort(key=lambda c: (c.reference != judged_on, c.quantity != "flexibility_torque"))
    known = np.isfinite(part.torque)
    share = float(part.inside[known].mean()) if known.any() else 0.0
    return TransmissionReport(
        transmission=part.name,
        judged_on=judged_on,
        comparisons=tuple(comparisons),
        inside_share=share,
        dependence=dependence,
        gain=gain,
    )


def _compare(
    quantity: tuple[str, str], reference: Reference, predicted: Array, measured: Array, inside: Flags
) -> Comparison:
    least = LEAST_TORQUE if quantity is TORQUE else 0.0

    def of(which: Flags) -> Score | None:
        return score(predicted[which], measured[which], least)

    return Comparison(
        quantity=quantity[0], unit=quantity[1], reference=reference, inside=of(inside), outside=of(~inside)
    )


def _dependence(
    part: _Part,
    predicted: Array,
    measured: Array,
    s: ref.Smoothed,
    setpoint: Array | None,
    period: float,
    raw: Array | None,
) -> tuple[Dependence, ...]:
    one_run = bool(np.all(np.diff(s.stamps) > 0))
    use = part.inside & np.isfinite(predicted) & np.isfinite(measured)
    rate = ref.rate_of(part.phi, s, period)
    variables: dict[str, Array] = {
        "deflection": part.phi,
        "velocity": rate,
        "loading": np.sign(rate * part.phi),
        "stiffness": part.stiffness,
        **loops(part.phi),
    }
    for name in s.roles:
        if name.startswith(POSITIONS):
            variables[name] = s.roles[name]
            variables[f"velocity of {name}"] = ref.rate_of(s.roles[name], s, period)
    if one_run:
        variables["time"] = s.time  # of several runs each has its own
    if setpoint is not None:
        variables["setpoint"] = setpoint
    error, told = predicted - measured, []
    step = None if raw is None else step_of(raw)
    if raw is not None:
        still = stuck(raw, predicted, step or 0.0) & use
        share = float(np.sum(error[still] ** 2) / max(np.sum(error[use] ** 2), 1e-300))
        if share >= LEAST_SHARE:
            told.append(_said_of_stuck(share, still, s.time))
            use &= ~still
    chosen: Mapping[str, Array] = {name: x[use] for name, x in variables.items()}
    rest = dependences(error[use], predicted[use], chosen, ref.noise_correlation(), step)
    left = 1.0 - sum(d.share for d in told)
    return (*told, *(replace(d, share=left * d.share) for d in rest))


def _said_of_stuck(share: float, still: Flags, time: Array) -> Dependence:
    first, part = float(time[np.argmax(still)]), 100.0 * float(still.mean())
    words = (
        f"the torque sensor stays at one value while the torque goes on, first at {first:.4g} s and for {part:.3g} % of the log:"
        " it is stuck, or its messages are"
    )
    return Dependence(on="stuck", share=share, p_value=0.0, slope=None, words=words)


def _not_independent(device: Device, signals: JointSignals) -> str | None:
    """Return why a torque sensor's channel is no measurement of its own; None where nothing speaks for that."""
    roles = signals.roles
    for view in device.transmissions:
        name = view.torque_sensor if view.torque_sensor in roles else "torque_sensor"
        if name not in roles:
            continue
        others: list[tuple[Array, str]] = []
        if view.deflection in roles:
            others.append((roles[view.deflection], "the deflection"))
        elif {"link_position", view.motor_position} <= set(roles):
            others.append((deflection_of(roles, view), "the deflection q − θ"))
        if view.motor_torque in roles:
            others.append((roles[view.motor_torque], "the motor's torque (its current)"))
        for x, what in others:
            why = computed_from(roles[name], name, x, what)
            if why is not None:
                return why
    return None


def _evidence(part: _Part, report: TransmissionReport) -> TransmissionEvidence:
    measured, predicted = {
        "sensor": (part.sensor, part.torque),
        "residual": (part.residual, part.lagged),
    }.get(report.judged_on or "", (part.sensor, part.torque))
    return TransmissionEvidence(
        part.phi,
        part.torque if predicted is None else predicted,
        part.torque_std,
        measured,
        report.judged_on or ("sensor" if part.sensor is not None else ""),
        part.stiffness,
        part.stiffness_std,
        part.truth,
        part.inside,
    )
