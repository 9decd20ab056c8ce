"""Checks of a joint's signals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vsalog.checks import encoder, sensor, torque
from vsalog.checks.check import Context, OfSignals
from vsalog.checks.torque_independence import COMPUTED_RESIDUAL, multiple_of
from vsalog.core.errors import EstimatorError
from vsalog.core.finding import Evidence, Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.resolution import ENOUGH
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, deflection_of, has_deflection

Array = NDArray[np.float64]


class DeadSensorError(EstimatorError):
    """A torque sensor never changes.

    Attributes
    ----------
    role, value : of it, and its constant reading [N·m]
    """

    def __init__(self, message: str, role: str, value: float) -> None:
        super().__init__(message)
        self.role, self.value = role, value


def refuse_dead_sensors(estimator: str, signals: JointSignals) -> None:
    """Refuse a torque or a pressure that never changes: from a dead sensor every method would estimate a meaningless stiffness.

    Parameters
    ----------
    estimator : name of the method that reads every sensor among the signals
    signals : of a joint, those that the method reads

    Raises
    ------
    DeadSensorError
        A torque sensor never changes.
    EstimatorError
        A muscle's pressure never changes while its valve moves.
    """
    for role, values in signals.roles.items():
        if role.startswith("torque_sensor") and _still(values):
            raise DeadSensorError(
                f"joint '{signals.joint}': {role} is {_first(values):.6g} N·m from beginning to end, as of a sensor that is off"
                f" or not connected, and {estimator} takes the torque from it. Use an estimator that needs no torque sensor"
                " (residual-rls, qr-rls), or put the right channel into the rig ('vsalog inspect' shows their values)",
                role,
                _first(values),
            )
        valve = signals.roles.get(role.replace("pressure", "valve"))
        if role.startswith("pressure") and _still(values) and valve is not None and not _still(valve):
            raise EstimatorError(
                f"joint '{signals.joint}': {role} is {_first(values):.6g} Pa from beginning to end while its valve moves, as of a"
                f" sensor that is off or not connected, and {estimator} takes the joint's state from it. Put the right"
                " channel into the rig ('vsalog inspect' shows their values)"
            )


def _still(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    return bool(finite.size and np.ptp(finite) == 0.0)


def _first(values: Array) -> float:
    return float(values[np.isfinite(values)][0])


class Signals:
    """Checks the bound signals."""

    name = "signals"
    supersedes: Mapping[str, Sequence[str]] = {}

    def start(self, context: Context) -> OfSignals:
        """Check stretches of a long log, and all of it for temporary faults of a sensor."""
        found, signals = signal_findings(context.device, context.look), context.signals
        if signals.in_file:
            found = first_of_each((*found, *passing_findings(context.device, signals)))
        return OfSignals(found)


def signal_findings(device: Device, signals: JointSignals) -> tuple[Finding, ...]:
    """Return the findings about a joint's bound signals, the most severe first."""
    found: list[Finding] = []
    for view in device.transmissions:
        sensor = view.torque_sensor if view.torque_sensor in signals.roles else "torque_sensor"
        if sensor not in signals.roles:
            continue
        others = {role: signals.roles[role] for role in (view.deflection, view.motor_torque) if role in signals.roles}
        if view.deflection not in signals.roles and has_deflection(signals.roles, view):
            others["deflection q − θ"] = deflection_of(signals.roles, view)
        for name, x in others.items():
            if (multiple := multiple_of(signals.roles[sensor], x)) is not None:
                computed = partial(Finding, code="torque.computed", joint=signals.joint, part=sensor)
                evidence: Evidence = {"factor": multiple.factor, "source": name}
                found.append(computed(value=multiple.left, limit=COMPUTED_RESIDUAL, evidence=evidence))
    for view in device.transmissions:
        if has_deflection(signals.roles, view) and _still(deflection_of(signals.roles, view)):
            still = partial(Finding, joint=signals.joint, severity="invalidates")
            found.append(still(code="deflection.still", part=view.name))
    return first_of_each((*found, *implausible(device, signals)))


def implausible(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Yield implausible readings."""
    yield from encoder.findings(device, signals)
    yield from passing(device, signals)


def passing(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Yield temporary faults of a sensor, each found where it occurs."""
    stuck = list(encoder.passing(device, signals))
    yield from stuck
    yield from torque.passing(device, signals)
    reported = {finding.part for finding in stuck}
    yield from (
        found for found in sensor.passing(signals) if found.code != "sensor.frozen" or found.part not in reported
    )


def passing_findings(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Yield temporary faults at any time of a log of which only stretches were checked."""
    return (finding for block in signals.blocks(ENOUGH) for finding in passing(device, block))


def first_of_each(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return the first of the findings that differ in their numbers only."""
    first: dict[tuple[str, ...], Finding] = {}
    for finding in findings:
        texts = (text for text in finding.evidence.values() if isinstance(text, str))
        first.setdefault((finding.code, finding.part, *texts), finding)
    return tuple(first.values())


def whole_windows(signals: JointSignals, window: int) -> float:
    """Return the share of windows, of a given number of samples, in which none is missing."""
    missing = np.logical_or.reduce([~np.isfinite(values) for values in signals.roles.values()])
    if not missing.any() or window > missing.size:
        return 1.0
    before = np.append(0, np.cumsum(missing))
    return float(np.mean(before[window:] == before[:-window]))


TEXTS = {
    "deflection.still": Text(
        "the deflection of transmission {part} never changes; its stiffness cannot be estimated.",
        "Move the joint under load.",
    ),
}
add_texts(TEXTS)
