"""One joint of one log: the predictions of a frozen model compared with all references in the log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from vsalog.checks.torque_independence import stuck
from vsalog.core.dependence import REPORTED_SHARE
from vsalog.core.finding import Finding
from vsalog.core.model import JointModel
from vsalog.core.recording import Channel
from vsalog.core.region import inside_region
from vsalog.core.resolution import step_of
from vsalog.core.signals import JointSignals
from vsalog.estimation.evidence import JointEvidence, TransmissionEvidence, setpoint_unit
from vsalog.estimators.device import Device, TransmissionView, deflection_of
from vsalog.rig.schema import AntagonisticJoint, AwasTransmission, Joint
from vsalog.validation import references as ref
from vsalog.validation.computed_torque import computed_torques
from vsalog.validation.dependence import dependences, gain_of, thinned
from vsalog.validation.document import Comparison, Dependence, ErrorOver, Reference, Score, TransmissionReport
from vsalog.validation.scores import LEAST_TORQUE, bins_of, score
from vsalog.validation.signatures import POSITIONS, loops
from vsalog.validation.torques import felt, sensor_of
from vsalog.validation.torques import residual as residual_of

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Truth = Mapping[str, Channel]

TORQUE, STIFFNESS = ("flexibility_torque", "N*m"), ("stiffness", "N*m/rad")


@dataclass(frozen=True, slots=True)
class Judged:
    """The results for a joint: the report's parts."""

    transmissions: tuple[TransmissionReport, ...]
    not_independent: Finding | None


@dataclass(frozen=True, slots=True)
class _Part:
    """One transmission, or their sum: prediction and references."""

    name: str
    phi: Array
    torque: Array
    torque_std: ref.Deviations
    stiffness: Array
    stiffness_std: ref.Deviations
    inside: Flags
    sensor: Array | None
    sensor_role: str | None
    residual: Array | None
    lagged: Array | None
    nominal: tuple[Array, Array] | None
    truth: Array | None


@dataclass(frozen=True, slots=True)
class Prepared:
    """A joint's signals, ready to be judged.

    Attributes
    ----------
    signals : as bound, but with smoothed values where available: an hour's are not kept twice
    smoothed : the same, with rates
    sensors : torque sensors as they were recorded, role → shape (N,)
    not_independent : why a torque sensor is no measurement; None without evidence for that
    """

    signals: JointSignals
    smoothed: ref.Smoothed
    sensors: Mapping[str, Array]
    not_independent: Finding | None


def prepare(device: Device, signals: JointSignals) -> Prepared:
    """Filter a joint's signals.

    Parameters
    ----------
    device : of the joint
    signals : bound: deflections or positions, set-point, and whatever torques there are

    Raises
    ------
    FilterError
        No run is long enough.
    """
    lever = any(isinstance(view.nominal, AwasTransmission) for view in device.transmissions)
    with ThreadPoolExecutor(1) as pool:  # both are slow with an hour's samples, and run in parallel
        computed = pool.submit(computed_torques, signals.joint, signals.roles, lever=lever)
        s = ref.smoothed(device, signals, tuple(signals.roles))
    sensors = {role: values for role, values in signals.roles.items() if role.startswith("torque_sensor")}
    kept = {role: s.roles.get(role, values) for role, values in signals.roles.items()}
    return Prepared(replace(signals, roles=kept), s, sensors, next(iter(computed.result().values()), None))


def judge(
    model: JointModel,
    joint: Joint,
    device: Device,
    prepared: Prepared,
    truth: Truth,
    draw: Callable[[JointEvidence], None] = lambda _: None,
) -> Judged:
    """Compare a joint's frozen model with a log.

    Parameters
    ----------
    model : frozen
    joint, device : of the rig
    prepared : the log's signals
    truth : a simulator's truth in the log, by channel
    draw : given each transmission, as soon as it is judged
    """
    signals, s = prepared.signals, prepared.smoothed
    setpoint = s.roles.get("setpoint")
    reports = list[TransmissionReport]()

    def report(part: _Part) -> JointEvidence:
        reports.append(_report(part, prepared, setpoint))
        evidence = {part.name: _evidence(part, reports[-1])}
        return JointEvidence(signals.joint, s.time, setpoint, setpoint_unit(joint), evidence, model)

    total: _Part | None = None
    for view in device.transmissions:
        # A part is long: along with the sum only one is kept, and of that only the figures' data once it is judged.
        part = _part(model, joint, device, view, s, setpoint, signals, truth)
        evidence = report(part)
        if len(device.transmissions) > 1:
            total = part if total is None else _added(total, part)
        del part
        draw(evidence)
    if total is not None:
        draw(report(_whole(total, device, s, signals, truth)))
    return Judged(tuple(reports), prepared.not_independent)


def _part(
    model: JointModel, joint: Joint, device: Device, view: TransmissionView, s: ref.Smoothed, setpoint: Array | None,
    signals: JointSignals, truth: Truth,
) -> _Part:  # fmt: skip
    torque, torque_std, sigma, sigma_std = ref.prediction(model, view, s, setpoint)
    sensor, residual = sensor_of(device, view, s), residual_of(device, view, s, signals)
    phi = deflection_of(s.roles, view)
    fitted = next(t for t in model.transmission if t.name == view.name)
    suffix = f"_{view.name}" if isinstance(joint, AntagonisticJoint) else ""
    return _Part(
        view.name, phi, torque, torque_std, sigma, sigma_std, inside_region(fitted.region, phi, setpoint),
        felt(device, (view,), sensor, s, signals), sensor, residual,
        None if residual is None else ref.behind_the_lag(torque, signals.period),
        ref.nominal(view, s, setpoint), ref.true_stiffness(truth, device.joint, suffix, s),
    )  # fmt: skip


def _added(one: _Part, other: _Part) -> _Part:
    """Both transmissions' torques and stiffnesses add up (Flacco 2012 eq. 9–10); the standard deviations in squares.

    The sums replace the arrays of `one`, which is judged and drawn already: an hour's are long.
    """
    nominal = None
    if one.nominal is not None and other.nominal is not None:
        nominal = (_sum(one.nominal[0], other.nominal[0]), _sum(one.nominal[1], other.nominal[1]))
    return replace(
        one,
        torque=_sum(one.torque, other.torque),
        torque_std=np.hypot(one.torque_std, other.torque_std, out=one.torque_std),
        stiffness=_sum(one.stiffness, other.stiffness),
        stiffness_std=np.hypot(one.stiffness_std, other.stiffness_std, out=one.stiffness_std),
        inside=one.inside & other.inside,
        sensor=None if one.sensor is None or other.sensor is None else one.sensor + other.sensor,  # the log's own
        residual=None if one.residual is None or other.residual is None else _sum(one.residual, other.residual),
        lagged=None if one.lagged is None or other.lagged is None else _sum(one.lagged, other.lagged),
        nominal=nominal,
    )


def _sum(a: Array, b: Array) -> Array:
    """Add to `a` in place."""
    return np.add(a, b, out=a)


def _whole(total: _Part, device: Device, s: ref.Smoothed, signals: JointSignals, truth: Truth) -> _Part:
    """The joint as a whole, with a sensor of its own where it has one."""
    sensor = felt(device, device.transmissions, "torque_sensor", s, signals)
    return replace(
        total,
        name="total",
        sensor=total.sensor if sensor is None else sensor,
        sensor_role=None if sensor is None else "torque_sensor",
        truth=ref.true_stiffness(truth, signals.joint, "_total", s),
    )


def _report(part: _Part, prepared: Prepared, setpoint: Array | None) -> TransmissionReport:
    trusted = prepared.not_independent is None
    comparisons: list[Comparison] = []
    judged_on: Reference | None = None
    dependence: tuple[Dependence, ...] = ()
    gain: float | None = None
    errors: tuple[ErrorOver, ...] = ()
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
            raw = prepared.sensors.get(part.sensor_role or "") if reference == "sensor" else None
            period = prepared.signals.period
            dependence = _dependence(part, predicted, measured, prepared.smoothed, setpoint, period, raw)
            few = thinned(part.inside & np.isfinite(predicted - measured))[0]
            gain = gain_of(predicted[few] - measured[few], predicted[few])
            errors = _errors_over(part, predicted - measured, prepared.smoothed, setpoint, period, few)
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
        errors=errors,
    )


def _errors_over(
    part: _Part, error: Array, s: ref.Smoothed, setpoint: Array | None, period: float, rows: NDArray[np.int64]
) -> tuple[ErrorOver, ...]:
    """Return the error over what the joint did, at some of the samples."""
    variables = {"deflection": part.phi[rows], "speed": ref.rate_at(part.phi, rows, s, period)}
    if setpoint is not None:
        variables["setpoint"] = setpoint[rows]
    out = []
    for name, x in variables.items():
        known = np.isfinite(x)
        if known.any() and np.ptp(x[known]) > 0.0:
            out.append(ErrorOver(on=name, bins=bins_of(error[rows][known], x[known])))
    return tuple(out)


def _compare(
    quantity: tuple[str, str], reference: Reference, predicted: Array, measured: Array, inside: Flags
) -> Comparison:
    least = LEAST_TORQUE if quantity is TORQUE else 0.0

    def of(which: Flags) -> Score | None:
        return score(predicted, measured, least, which) if which.any() else None

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
    error, found = predicted - measured, []
    use = part.inside & np.isfinite(error)
    step = None if raw is None else step_of(raw)
    if raw is not None:
        still = stuck(raw, predicted, step or 0.0) & use
        share = float(np.sum(error[still] ** 2) / max(np.sum(error[use] ** 2), 1e-300))
        if share >= REPORTED_SHARE:
            found.append(_stuck(share, still, s.time))
            use &= ~still
    rows, thin = thinned(use)
    variables = _variables(part, s, setpoint, period, rows)
    rest = dependences(error[rows], predicted[rows], variables, ref.noise_correlation(), step, thin)
    left = 1.0 - sum(d.share for d in found)
    return (*found, *(structs.replace(d, share=left * d.share) for d in rest))


def _variables(
    part: _Part, s: ref.Smoothed, setpoint: Array | None, period: float, rows: NDArray[np.int64]
) -> dict[str, Array]:
    """Return what an error may depend on, at some of the samples."""
    rate = ref.rate_at(part.phi, rows, s, period)
    variables = {
        "deflection": part.phi[rows],
        "velocity": rate,
        "loading": np.sign(rate * part.phi[rows]),
        "stiffness": part.stiffness[rows],
        **loops(part.phi, rows),
    }
    for name, values in s.roles.items():
        if name.startswith(POSITIONS):
            variables[name] = values[rows]
            variables[f"velocity of {name}"] = ref.rate_at(values, rows, s, period)
    if bool(np.all(np.diff(s.stamps) > 0)):
        variables["time"] = s.time[rows]  # of several runs each has its own
    if setpoint is not None:
        variables["setpoint"] = setpoint[rows]
    return variables


def _stuck(share: float, still: Flags, time: Array) -> Dependence:
    first, part = float(time[np.argmax(still)]), float(still.mean())
    evidence = {"first": first, "stuck_share": part}
    return Dependence(on="stuck", share=share, p_value=0.0, slope=None, code="error.sensor_stuck", evidence=evidence)


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
