"""Cross-checks an estimate's torque and angle against references that the estimator does not read.

A wrong scale of a motor's torque makes the stiffness wrong by the same factor, and nothing in that motor's log shows it; a
torque sensor on the joint does. Conversely, the estimate of `residual-rls` from the motor's side is a reference for one from a
sensor. Both torques are averaged over windows, and the reference's is regressed on the estimate's: the slope is its change where
the estimate changes by one. Noise in either biases this slope, and that of the reverse regression in the other direction; the
torques agree where 1 is between the two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.grid import LONGEST_GAP
from vsalog.binding.joint import bind, offered_roles
from vsalog.checks.check import Context
from vsalog.checks.motor_reference import motor_roles, motor_trace
from vsalog.checks.samples import FEWEST_LEVELS, SAME_MOTION
from vsalog.core.errors import VsalogError
from vsalog.core.finding import Evidence, Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.look import of_signals
from vsalog.core.recording import Recording
from vsalog.core.signals import JointSignals
from vsalog.core.significance import DETECTED_OF_MANY, INTERVAL
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device
from vsalog.estimators.equation import REPORTED_MISFIT
from vsalog.estimators.row_moments import AVERAGED_SAMPLES, ROWS_OF_LONG, lasts
from vsalog.rig.schema import Joint
from vsalog.uncertainty.errors_in_variables import MOST_NOISE

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Shortest time over which torques are averaged before they are compared [s]: the transients that an estimator's filters add to
# quick changes are shorter.
AVERAGED_TIME = 0.05
ANGLE = "link_position"
# The reference that is no sensor, but estimated from the motor's torque and motion.
MOTOR = "the motor's side by residual-rls"
# What may be wrong instead of the stiffness where a sensor's torque differs, and where that of the motor's side does.
SENSOR_CAUSE, MOTOR_CAUSE = "the sensor's scale", "the motor's torque, its inertia or friction in the rig"


def reference_roles(device: Device, joint: Joint, read: Sequence[str]) -> tuple[str, ...]:
    """Return the roles that could be references for an estimate: offered by the rig, and not among those that are read."""
    unread = (r for r, s in offered_roles(joint).items() if r not in read and s.channel is not None)
    motor = motor_roles(device, joint, read)
    return tuple(role for role in unread if role.startswith("torque_sensor") or role == ANGLE or role in motor)


class Sensed:
    """A sensor's values over time.

    Parameters
    ----------
    stamps : shape (N,) [ns], which only ever increase
    values : shape (N,), NaN where there is none
    period : of its samples [s]
    """

    def __init__(self, stamps: NDArray[np.int64], values: Array, period: float) -> None:
        known = np.isfinite(values)
        self.first = int(stamps[0]) if stamps.size else 0
        self.time, self.values, self.apart = (stamps[known] - self.first) * 1e-9, values[known], LONGEST_GAP * period

    def at(self, stamps: NDArray[np.int64]) -> Array:
        """Return the values at other stamps, in order, shape (n,), NaN where no sample is near."""
        if self.time.size < 2:
            return np.full(stamps.shape, np.nan)
        ours = (stamps - self.first) * 1e-9
        after = np.clip(np.searchsorted(self.time, ours), 1, self.time.size - 1)
        near = self.time[after] - self.time[after - 1] <= self.apart
        found = np.interp(ours, self.time, self.values, left=np.nan, right=np.nan)
        return np.where(near, found, np.nan)


@dataclass(slots=True)
class _Compared:
    """Averages of the estimate and of the reference, and the estimate's standard deviations, each in squares."""

    estimated: list[Array] = field(default_factory=list)
    sensed: list[Array] = field(default_factory=list)
    claimed: list[Array] = field(default_factory=list)

    def add(self, estimated: Array, sensed: Array, claimed: Array, box: int) -> None:
        """Average matching samples in blocks of this length."""
        columns = np.column_stack((estimated, sensed, claimed**2))
        whole = columns[: len(columns) // box * box].reshape(-1, box, 3)
        known = whole[np.isfinite(whole).all(axis=(1, 2))].mean(axis=1)
        for kept, values in zip((self.estimated, self.sensed, self.claimed), known.T, strict=True):
            kept.append(values)

    def all(self) -> tuple[Array, Array, float]:
        """Return both, and the estimate's standard deviation."""
        claimed = np.concatenate(self.claimed)
        return (
            np.concatenate(self.estimated),
            np.concatenate(self.sensed),
            float(np.sqrt(np.median(claimed))) if claimed.size else np.inf,
        )


class ReferenceSensors:
    """Compares the estimate with sensors that its estimator does not read."""

    name = "cross_check"
    supersedes: Mapping[str, Sequence[str]] = {}

    def start(self, context: Context) -> CrossCheck:
        """Begin with a log."""
        return CrossCheck(
            context.recordings, context.device, context.joint, context.read, context.look.period, context.setpoints,
            context.estimator,
        )  # fmt: skip


class CrossCheck:
    """An estimate and the references that its estimator does not read.

    Parameters
    ----------
    recordings, joint : as they are bound for the estimator
    device : of the joint
    read : the roles that the estimator reads
    period : of the estimate's rows [s]
    setpoints : as they are bound for the estimator
    estimator : its name
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        device: Device,
        joint: Joint,
        read: Sequence[str],
        period: float,
        setpoints: Sequence[float | None] = (),
        estimator: str = "",
    ) -> None:
        self.device, self.estimator = device, estimator
        self.box = max(AVERAGED_SAMPLES, round(AVERAGED_TIME / period))
        self.compared: dict[tuple[str, str], _Compared] = {}
        self.sensors: dict[str, dict[int, Sensed]] = {}
        self.moves: dict[str, float] = {}
        self.claimed: dict[str, float] = {}
        self.inertia: tuple[float, float] | None = None
        for role in reference_roles(device, joint, read):
            found = _bound(recordings, device.joint, joint, [role], ()) if _is_sensor(role) else None
            if found is not None:
                self.moves[role] = FEWEST_LEVELS * found.resolution.get(role, 0.0)
                self.sensors[role] = sensed_by_run(found.stamps, found.run, found.roles[role], found.period)
        if motor := motor_roles(device, joint, read):
            signals = _bound(recordings, device.joint, joint, motor, setpoints)
            if signals is not None:
                self._take_motor(signals)

    def _take_motor(self, signals: JointSignals) -> None:
        """Use the estimate of residual-rls as a sensor."""
        trace = motor_trace(self.device, signals)
        if trace is None:
            return
        for name, columns in trace.transmissions.items():
            role, (_, std, sure) = f"{MOTOR} {name}", _torque(columns)
            # Not its fit, which would show the limits of its basis; noise is averaged out anyway.
            torque = np.asarray(columns["flexibility_torque"], float)
            self.sensors[role] = sensed_by_run(trace.stamps, trace.run, torque, signals.period)
            self.moves[role], self.claimed[role] = 0.0, float(np.median(std[sure])) if sure.any() else 0.0

    def add(self, trace: Trace) -> None:
        """Take a block of the estimates into account."""
        self._take_link(trace)
        parts = {view.name: view.torque_sensor for view in self.device.transmissions}
        if len(parts) != 1:
            parts["total"] = "torque_sensor"
        for name, role in parts.items():
            columns = trace.transmissions.get(name)
            if columns is None:
                continue
            torque, std, sure = _torque(columns)
            for reference in (role, f"{MOTOR} {name}"):
                if reference in self.sensors:
                    self._compare(name, reference, np.where(sure, torque, np.nan), std, trace)
            if ANGLE in self.sensors and f"{ANGLE}_std" in columns:
                angle, std = (np.asarray(columns[n], float) for n in (ANGLE, f"{ANGLE}_std"))
                self._compare(name, ANGLE, angle, std, trace)

    def _take_link(self, trace: Trace) -> None:
        """Take the last estimate of the link's inertia, and its standard deviation."""
        columns = trace.transmissions["total"]
        if "link_inertia" in columns:
            found = np.asarray(columns["link_inertia"], float)
            known = np.flatnonzero(np.isfinite(found))
            if known.size:
                self.inertia = float(found[known[-1]]), float(np.asarray(columns["link_inertia_std"])[known[-1]])

    def _compare(self, name: str, role: str, estimated: Array, claimed: Array, trace: Trace) -> None:
        compared = self.compared.setdefault((name, role), _Compared())
        for run in np.unique(trace.run):
            rows, sensor = trace.run == run, self.sensors[role].get(int(run))
            if sensor is not None:
                compared.add(estimated[rows], sensor.at(trace.stamps[rows]), claimed[rows], self.box)

    def findings(self) -> list[Finding]:
        """Return which references differ from the estimate, or, for muscles, that there is none."""
        joint, estimator, found = self.device.joint, self.estimator, list[Finding]()
        if self.device.pneumatic is not None and not self.sensors:
            found.append(Finding(code="cross_check.none", joint=joint, evidence={"estimator": estimator}))
        for (name, role), compared in self.compared.items():
            estimated, sensed, claimed = compared.all()
            if estimated.size < FEWEST_LEVELS or not np.ptp(sensed) > self.moves[role] or not np.isfinite(claimed):
                continue
            claimed = float(np.hypot(claimed, self.claimed.get(role, 0.0)))
            part = "" if name == "total" else name
            evidence = {"estimator": estimator, "of": f"transmission {part}" if part else "the joint"}
            if role == ANGLE:
                found += _of_angles(joint, part, estimated, sensed, claimed, evidence | {"reference": role})
            elif _is_sensor(role):
                evidence |= {"reference": role, "other_cause": SENSOR_CAUSE}
                found += _of_torques(joint, part, estimated, sensed, claimed, evidence)
            elif not _too_noisy(estimated, sensed):
                evidence |= {"reference": MOTOR, "other_cause": MOTOR_CAUSE}
                found += _of_torques(joint, part, estimated, sensed, claimed, evidence)
        return [*found, *self._of_link()]

    def _of_link(self) -> list[Finding]:
        """Return that the link's inertia differs: the scale of its torque goes into its inertia and into the stiffness."""
        rig = None if self.device.link is None else self.device.link.inertia
        if rig is None or self.inertia is None:
            return []
        inertia, std = self.inertia
        limit = max(REPORTED_MISFIT * rig, DETECTED_OF_MANY * std)
        if abs(inertia - rig) <= limit:
            return []
        return [
            Finding(
                code="link.inertia_differs",
                joint=self.device.joint,
                value=inertia - rig,
                limit=limit,
                unit="kg*m^2",
                evidence={"inertia": inertia, "rig": rig, "ratio": inertia / rig},
            )
        ]


def _is_sensor(role: str) -> bool:
    return role.startswith("torque_sensor") or role == ANGLE


def sensed_by_run(
    stamps: NDArray[np.int64], runs: NDArray[np.int32], values: Array, period: float
) -> dict[int, Sensed]:
    """Separate the runs: each log has a clock of its own."""
    return {int(run): Sensed(stamps[runs == run], values[runs == run], period) for run in np.unique(runs)}


def _of_torques(
    joint: str, part: str, estimated: Array, sensed: Array, claimed: float, evidence: Evidence
) -> list[Finding]:
    """Return by how much the changes of two torques differ; nothing where they agree."""
    (xx, xy), (_, yy) = _without_transients(estimated, sensed)
    shared = max(float(xy), 0.0) ** 2 / (xx * yy) if xx * yy > 0.0 else 0.0
    if shared < MOST_NOISE:
        if _is_noise(sensed):
            return []
        return [
            Finding(
                code="cross_check.torque_unrelated",
                joint=joint,
                part=part,
                value=float(shared),
                limit=MOST_NOISE,
                evidence=evidence,
            )
        ]
    least, most, margin = xy / xx, yy / xy, max(REPORTED_MISFIT, INTERVAL * claimed)
    if 1.0 - margin <= most and least <= 1.0 + margin:
        return []
    slope = float((least * most) ** 0.5)
    if not _lasts(estimated, sensed, slope):
        return []
    return [
        Finding(
            code="cross_check.torque_scale",
            joint=joint,
            part=part,
            value=slope,
            limit=1.0 + margin if slope > 1.0 else 1.0 - margin,
            evidence=evidence,
        )
    ]


def _lasts(estimated: Array, sensed: Array, slope: float) -> bool:
    """Return whether a slope persists in longer averages: a filter's effect on quick changes does not."""
    (xx, xy), (_, yy) = np.cov(_long(estimated), _long(sensed))
    if not min(xx, xy, yy) > 0.0:
        return True
    return lasts(float(np.log(yy / xx) / 2.0 * np.sign(np.log(slope))), abs(float(np.log(slope))))


def _too_noisy(estimated: Array, sensed: Array) -> bool:
    """Return whether an encoder's noise, differentiated twice, is most of a torque, and averages out."""
    (xx, xy), (_, yy) = np.cov(estimated, sensed)
    own = sensed - xy / xx * estimated if xx > 0.0 else sensed
    return bool(own.var() > MOST_NOISE * yy and not lasts(float(_long(own).var()), float(own.var())))


def _is_noise(averages: Array) -> bool:
    """Return whether averages differ from the next one as from any, and average out: nothing moves there."""
    variance, changes = float(averages.var()), float(np.diff(averages).var()) / 2.0
    return changes > MOST_NOISE * variance and not lasts(float(_long(averages).var()), variance)


def _long(averages: Array) -> Array:
    """Average some averages in a row."""
    return np.asarray(averages[: averages.size // ROWS_OF_LONG * ROWS_OF_LONG].reshape(-1, ROWS_OF_LONG).mean(axis=1))


def _without_transients(estimated: Array, sensed: Array) -> Array:
    """Return the covariance of two torques, without those averages in which one of them lags the other in a quick change."""
    kept, least = np.ones(estimated.size, dtype=np.bool_), np.inf
    while True:
        (xx, xy), (_, yy) = cov = np.cov(estimated[kept], sensed[kept])
        if not xx > 0.0:
            return cov
        off = sensed - np.sign(xy) * (yy / xx) ** 0.5 * estimated
        off = np.abs(off - np.median(off[kept]))
        kept = off <= np.quantile(off, SAME_MOTION)
        if not (size := float(off[kept].sum() / yy**0.5)) < least:
            return cov
        least = size


def _of_angles(
    joint: str, part: str, estimated: Array, sensed: Array, claimed: float, evidence: Evidence
) -> list[Finding]:
    """Return the error of an angle; nothing where it is small."""
    off, span = float(np.sqrt(np.mean((estimated - sensed) ** 2))), float(np.ptp(sensed))
    limit = max(REPORTED_MISFIT * span, INTERVAL * claimed)
    if off <= limit:
        return []
    return [
        Finding(
            code="cross_check.angle",
            joint=joint,
            part=part,
            value=off,
            limit=limit,
            unit="rad",
            evidence={**evidence, "share_of_range": off / span, "claimed": claimed},
        )
    ]


def _torque(columns: Mapping[str, Any]) -> tuple[Array, Array, Flags]:
    """Return an estimate's torque, the standard deviation of its changes relative to them, and where it is excited.

    It is that of the fit; without a fit the torque is known along with the stiffness, or observed as a whole.
    """
    excited = np.asarray(columns["excited"], dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        std = np.asarray(columns["stiffness_std"], float) / np.asarray(columns["stiffness"], float)
    fit = np.asarray(columns["flexibility_torque_fit"], float)
    if np.isfinite(fit).any():
        return fit, std, excited
    return np.asarray(columns["flexibility_torque"], float), np.where(excited, std, 0.0), np.ones_like(excited)


def _bound(
    recordings: Sequence[Recording],
    name: str,
    joint: Joint,
    roles: Sequence[str],
    setpoints: Sequence[float | None],
) -> JointSignals | None:
    """Bind roles, only parts of them where a log is too long for memory; None where that is not possible."""
    try:
        return of_signals(bind(recordings, name, joint, roles, setpoints))
    except VsalogError:
        return None


TEXTS = {
    "link.inertia_differs": Text(
        "the link's inertia is estimated as {inertia:.3g} kg·m², {ratio:.3g} times the rig's {rig:.3g}.",
        "The torque sensor's scale or unit, or the angles' unit, would explain it, and the stiffness would be wrong by the same"
        " factor; or the link's inertia in the rig is wrong.",
    ),
    "cross_check.torque_scale": Text(
        "{reference}, not read by {estimator}, differs: where the estimated torque of {of} changes by 1 N·m, the"
        " reference changes by {value:.3g} N·m. The stiffness may be wrong by the same factor, or {other_cause}.",
        "'vsalog compare' runs the other estimators on this log.",
    ),
    "cross_check.torque_unrelated": Text(
        "{reference}, not read by {estimator}, differs: only {value:.0%} of its torque's power is in the estimated"
        " torque of {of} too.",
        "Check the signs, the units and the channels of both in the rig: one of them may be wrong there.",
    ),
    "cross_check.angle": Text(
        "{reference}, not read by {estimator}, differs: the estimated angle of {of} is {value:.2g} {unit} off,"
        " {share_of_range:.0%} of its range, but its standard deviation is {claimed:.1g} {unit}.",
        "The stiffness may be wrong too.",
    ),
    "cross_check.none": Text(
        "neither the joint's angle nor its torque is in the log, so there is no reference for the estimate of {estimator} from"
        " the pressures: a pressure that is not absolute, a sensor's wrong gain, or other muscles than the rig's would give an"
        " equally plausible stiffness, wrong by 5 to 20 % and more, which its standard deviation does not include.",
        "Record link_position or torque_sensor once.",
    ),
}
add_texts(TEXTS)
