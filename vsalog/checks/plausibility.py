"""Signals that are possible and not plausible: an encoder's zero that is off, a wrong sign or unit, a sensor that is stuck.

Each of these gives a stiffness with a small standard deviation that is wrong. Bounds are wide: what a joint may really do is not
warned of.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, TransmissionView, deflection_of, has_deflection

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# A deflection whose middle is so many times half its range from zero rests on an encoder's zero, unless a torque is one-sided
# too; once is enough under a torque whose middle is less than this part of half its range.
OFF_CENTRE, CENTRED = 3.0, 0.2
# Positions of which one counts the other way round: how they are correlated, how much alike they move, and how little is left
# when one of them is turned.
OPPOSED, ALIKE, TURNED = -0.8, 3.0, 0.5
# More than a joint turns, and more than a spring gives way [rad].
FARTHEST, WIDEST = 100.0, 2.0 * np.pi
# A sensor at its end: part of the samples, samples and seconds in a row, and steps in its range.
CLIPPED, IN_A_ROW, LASTING, COUNTS = 0.01, 10, 0.02, 50
# A torque sensor of fewer levels tells no stiffness.
LEVELS = 20
# A slower sensor's values that were repeated: samples and seconds of each, how many are alike in length, and smallest steps in
# a usual change, for a coarse encoder goes on by single ones at an even speed.
REPEATED, REPEATED_FOR, EVENLY, STEPS = 3, 0.06, 0.9, 3.0
# A noisy signal stays where it is this seldom, and turns back at least this often.
STILL, TURNS_BACK = 0.3, 0.2
# An encoder that is stuck: how long [s], steps of the other one and part of the other's range meanwhile, how much more than the
# deflection that is, and how the two are correlated elsewhere.
STUCK, MOVED, MOVED_SHARE, MORE, TOGETHER = 0.5, 50.0, 0.2, 1.5, 0.8
# A lost value that reads zero: samples in a row, by what part the torque changes across it, how far from zero that
# is, as a part of its range and in the usual steps from sample to sample, and how many are no chance.
ZEROS, CALM, AWAY, LOUD, FEW = 3, 0.2, 0.05, 5.0, 5
# Fewer samples tell nothing, and more tell no more about where a signal usually is.
FEWEST, ENOUGH = 50, 100_000


@dataclass(frozen=True, slots=True)
class Standstill:
    """A stretch in which one encoder of a spring does not change by a single step, while the other one moves.

    Attributes
    ----------
    role, other : positions
    within, stamps : first and last time [s] and stamp [ns]
    moved, enough : how far the other one moves, and how far it has to at least [rad]
    spring : how far it has to where nothing else is known: more than the spring gives way elsewhere [rad]
    """

    role: str
    other: str
    within: tuple[float, float]
    stamps: tuple[int, int]
    moved: float
    enough: float
    spring: float

    def holds(self, stamps: NDArray[np.int64], farther: int = 0) -> Flags:
        """Return which stamps [ns] lie in it, or in one that reaches farther [ns] at both ends."""
        return (stamps >= self.stamps[0] - farther) & (stamps <= self.stamps[1] + farther)

    def finding(self, joint: str, limit: float) -> Finding:
        """Return the finding that the encoder was stuck, as the other one moves farther than so many rad."""
        begin, end = self.within
        return Finding(
            code="encoder.stuck",
            joint=joint,
            part=self.role,
            value=self.moved,
            limit=limit,
            unit="rad",
            evidence={"begin": begin, "end": end, "other": self.other},
        )


def implausible(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Yield what is possible and not plausible."""
    yield from _off_centre(device, signals)
    for view in with_both_positions(device, signals):
        yield from _opposed(signals, view)
    yield from _too_far(device, signals)
    yield from passing(device, signals)


def passing(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Yield what may befall a sensor for a while, and is found in that while."""
    for view in with_both_positions(device, signals):
        yield from _stuck(signals, view)
    yield from _torque_stuck(device, signals)
    for role in signals.roles:
        if role.startswith("torque_sensor"):
            yield from _few_levels(signals, role)
        if role.startswith(("torque_sensor", "link_position", "motor_position", "deflection", "pressure")):
            yield from _clipped(signals, role)
        if role.startswith(("torque_sensor", "motor_torque", "link_position", "motor_position", "deflection")):
            yield from _repeated(signals, role)
        if "torque" in role and _fine(signals, role):
            yield from _frozen(signals, role)
            yield from _dropped_to_zero(signals, role)


def with_both_positions(device: Device, signals: JointSignals) -> list[TransmissionView]:
    """Return the transmissions both of whose ends have an encoder."""
    return [view for view in device.transmissions if {"link_position", view.motor_position} <= set(signals.roles)]


def _span(x: Array, share: float = 0.01) -> tuple[float, float]:
    """Return between what values a signal is, but for single ones; (0, 0) for one that is too short."""
    some = x[:: max(1, x.size // ENOUGH)]
    finite = some[np.isfinite(some)]
    if finite.size < FEWEST:
        return 0.0, 0.0
    low, high = np.quantile(finite, (share, 1.0 - share))
    return float(low), float(high)


def _off_centre(device: Device, signals: JointSignals) -> Iterator[Finding]:
    views = [view for view in device.transmissions if has_deflection(signals.roles, view)]
    if not views or len(views) < len(device.transmissions):
        return
    middle, half = _middle([deflection_of(signals.roles, view) for view in views])
    load, either = _middle(_torques(device, signals))
    one_sided, centred = abs(load) > either, len(views) == 1 and either > 0.0 and abs(load) < CENTRED * either
    if not half > 0.0 or one_sided or abs(middle) <= (1.0 if centred else OFF_CENTRE) * half:
        return
    yield Finding(
        code="encoder.zero",
        joint=signals.joint,
        part=" − ".join(views[0].deflection_roles(signals.roles)),
        value=middle,
        limit=(1.0 if centred else OFF_CENTRE) * half,
        unit="rad",
        evidence={"half_range": half},
    )


def _middle(parts: Sequence[Array]) -> tuple[float, float]:
    """Return around what value signals lie on average, and half the widest range of them.

    Two springs that pull against each other are stretched both; the middle between them is not.
    """
    spans = [_span(x) for x in parts]
    if not spans:
        return 0.0, 0.0
    return float(np.mean([0.5 * (low + high) for low, high in spans])), max(0.5 * (high - low) for low, high in spans)


def _torques(device: Device, signals: JointSignals) -> list[Array]:
    """Return the torques that tell whether the joint is loaded: its sensor's, its transmissions', or its motors'."""
    views = device.transmissions
    for roles in (["torque_sensor"], [v.torque_sensor for v in views], [v.motor_torque for v in views]):
        if set(roles) <= set(signals.roles):
            return [signals.roles[role] for role in roles]
    return []


def _opposed(signals: JointSignals, view: TransmissionView) -> Iterator[Finding]:
    q, theta = signals.roles["link_position"], signals.roles[view.motor_position]
    both = np.isfinite(q) & np.isfinite(theta)
    if np.count_nonzero(both) < FEWEST:
        return
    a, b = q[both] - q[both].mean(), theta[both] - theta[both].mean()
    spread_a, spread_b = float(a.std()), float(b.std())
    if not (min(spread_a, spread_b) > 0.0 and max(spread_a, spread_b) < ALIKE * min(spread_a, spread_b)):
        return
    together = float(np.mean(a * b)) / (spread_a * spread_b)
    if together < OPPOSED and float((a + b).std()) < TURNED * min(spread_a, spread_b):
        yield Finding(
            code="encoder.sign",
            joint=signals.joint,
            part=f"link_position and {view.motor_position}",
            value=together,
            limit=OPPOSED,
            evidence={"first_span": float(np.ptp(a)), "second_span": float(np.ptp(b))},
        )


def _too_far(device: Device, signals: JointSignals) -> Iterator[Finding]:
    for view in device.transmissions:
        if has_deflection(signals.roles, view):
            low, high = _span(deflection_of(signals.roles, view))
            if high - low > WIDEST:
                yield Finding(
                    code="encoder.deflection_unit",
                    joint=signals.joint,
                    part=" − ".join(view.deflection_roles(signals.roles)),
                    value=high - low,
                    limit=WIDEST,
                    unit="rad",
                )
    for role in _positions(signals.roles):
        low, high = _span(signals.roles[role])
        if high - low > FARTHEST:
            yield Finding(
                code="encoder.unit",
                joint=signals.joint,
                part=role,
                value=high - low,
                limit=FARTHEST,
                unit="rad",
                evidence={"turns": (high - low) / (2.0 * np.pi)},
            )


def _positions(roles: Collection[str]) -> list[str]:
    return [role for role in roles if role.startswith(("link_position", "motor_position"))]


def _runs(flags: Flags) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where stretches of True begin, and where they are over."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return edges[::2], edges[1::2]


def _noisy(x: Array, among: Flags) -> bool:
    """Tell whether a signal moves to and fro from sample to sample, where `among` says so of each sample."""
    steps = np.diff(x)[among[1:] & among[:-1]]
    steps = steps[np.isfinite(steps)]
    if steps.size < FEWEST or float(np.mean(steps == 0.0)) > STILL:
        return False
    return float(np.mean(steps[1:] * steps[:-1] < 0.0)) > TURNS_BACK


def _levels(x: Array) -> Array:
    """Return the values that a signal takes, ascending."""
    some = x[:: max(1, x.size // ENOUGH)]
    return np.unique(some[np.isfinite(some)])


def _fine(signals: JointSignals, role: str) -> bool:
    """Tell whether a signal has steps that are small beside its range: what is coarse rests, and is zero, by rounding."""
    levels = _levels(signals.roles[role])
    if levels.size < 2:
        return False
    return float(levels[-1] - levels[0]) > COUNTS * max(signals.resolution.get(role, 0.0), float(np.diff(levels).min()))


def _few_levels(signals: JointSignals, role: str) -> Iterator[Finding]:
    levels = _levels(signals.roles[role])
    if 2 < levels.size < LEVELS and len(signals) > FEWEST * levels.size:
        yield Finding(
            code="torque.coarse",
            joint=signals.joint,
            part=role,
            value=float(levels.size),
            limit=float(LEVELS),
            evidence={"step": float(np.diff(levels).min())},
        )


def _clipped(signals: JointSignals, role: str) -> Iterator[Finding]:
    x = signals.roles[role]
    finite = x[np.isfinite(x)]
    if finite.size < FEWEST or not _fine(signals, role):
        return
    least = max(IN_A_ROW, round(LASTING / signals.period))
    for end, extreme in (("highest", float(finite.max())), ("lowest", float(finite.min()))):
        there = x == extreme
        if np.count_nonzero(there) <= CLIPPED * finite.size:
            continue
        first, after = _runs(there)
        resting = int((after - first)[after - first >= least].sum())
        if resting > CLIPPED * finite.size and _noisy(x, ~there):
            yield Finding(
                code="sensor.saturated",
                joint=signals.joint,
                part=role,
                value=resting / finite.size,
                limit=CLIPPED,
                evidence={
                    "end": end,
                    "at": extreme,
                    "begin": float(signals.time[first[np.argmax(after - first >= least)]]),
                },
            )


def _repeated(signals: JointSignals, role: str) -> Iterator[Finding]:
    x, levels = signals.roles[role], _levels(signals.roles[role])
    changes = np.abs(np.diff(x))
    at = np.flatnonzero(changes > 0.0)
    if at.size < FEWEST or levels.size < FEWEST:
        return
    lengths = np.diff(at)
    each = int(np.median(lengths))
    if not REPEATED <= each <= REPEATED_FOR / signals.period or float(np.mean(lengths == each)) < EVENLY:
        return
    if float(np.median(changes[at])) > STEPS * float(np.diff(levels).min()):
        yield Finding(
            code="sensor.repeated",
            joint=signals.joint,
            part=role,
            value=float(each),
            limit=float(REPEATED),
            evidence={"rate": 1.0 / (each * signals.period)},
        )


def _frozen(signals: JointSignals, role: str) -> Iterator[Finding]:
    x = signals.roles[role]
    same = np.concatenate(([False], np.diff(x) == 0.0)) & ~signals.starts
    first, after = _runs(same)
    long = (after - first) * signals.period >= STUCK
    resting = np.zeros(x.shape, dtype=np.bool_)
    for begin, end in zip(first[long], after[long], strict=True):
        resting[begin - 1 : end] = True
    if not resting.any() or not _noisy(x, ~resting):
        return
    k = int(np.argmax(after - first))
    yield Finding(
        code="torque.stuck",
        joint=signals.joint,
        part=role,
        value=float((after[k] - first[k]) * signals.period),
        limit=STUCK,
        unit="s",
        evidence={"begin": float(signals.time[first[k] - 1]), "end": float(signals.time[after[k] - 1])},
    )


def _torque_stuck(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Tell of a torque sensor that stands still while its spring gives way, as it does not elsewhere."""
    for view in device.transmissions:
        role = view.torque_sensor if view.torque_sensor in signals.roles else "torque_sensor"
        alone = role != "torque_sensor" or len(device.transmissions) == 1
        if not (alone and role in signals.roles and has_deflection(signals.roles, view) and _fine(signals, role)):
            continue
        x, y = signals.roles[role], deflection_of(signals.roles, view)
        first, after = _runs(np.concatenate(([False], np.diff(x) == 0.0)) & ~signals.starts)
        long = (after - first) * signals.period >= STUCK
        resting = np.zeros(x.shape, dtype=np.bool_)
        for begin, end in zip(first[long], after[long], strict=True):
            resting[begin - 1 : end] = True
        elsewhere = ~resting & np.isfinite(x) & np.isfinite(y)
        if not resting.any() or _noisy(x, ~resting) or np.count_nonzero(elsewhere) < FEWEST:
            continue  # what is noisy elsewhere is told by itself
        if not (_go_together(x[elsewhere], y[elsewhere]) or _go_together(-x[elsewhere], y[elsewhere])):
            continue
        low, high = _span(y)
        for begin, end in zip(first[long] - 1, after[long], strict=True):
            moved = y[begin:end][np.isfinite(y[begin:end])]
            if moved.size and float(np.ptp(moved)) > MOVED_SHARE * (high - low):
                yield Finding(
                    code="torque.stuck_while_moving",
                    joint=signals.joint,
                    part=role,
                    value=float(np.ptp(moved)),
                    limit=MOVED_SHARE * (high - low),
                    unit="rad",
                    evidence={"begin": float(signals.time[begin]), "end": float(signals.time[end - 1])},
                )
                break


def _dropped_to_zero(signals: JointSignals, role: str) -> Iterator[Finding]:
    x = signals.roles[role]
    first, after = _runs(x == 0.0)
    inside = (first > 0) & (after < x.size) & (after - first <= ZEROS)
    first, after = first[inside], after[inside]
    before, behind = x[first - 1], x[after]
    with np.errstate(invalid="ignore"):
        # On either side the torque goes on where it was, far from zero.
        away = np.minimum(np.abs(before), np.abs(behind))
        low, high = _span(x)
        steps = np.abs(np.diff(x))
        steps = steps[np.isfinite(steps)]
        usual = float(np.median(steps)) if steps.size else 0.0
        torn = (np.abs(before - behind) < CALM * away) & (away > max(AWAY * (high - low), LOUD * usual))
    count = int((after - first)[torn].sum())
    if np.count_nonzero(torn) >= FEW:
        yield Finding(
            code="torque.dropouts",
            joint=signals.joint,
            part=role,
            value=float(count),
            limit=float(FEW),
            evidence={"begin": float(signals.time[first[torn][0]])},
        )


def _stuck(signals: JointSignals, view: TransmissionView) -> Iterator[Finding]:
    """Tell of encoders that stand still while the spring would have to give way more than elsewhere."""
    told = set[str]()
    for s in standstills(signals, view):
        if s.moved > s.spring and s.role not in told:
            told.add(s.role)
            yield s.finding(signals.joint, max(s.enough, s.spring))


def standstills(signals: JointSignals, view: TransmissionView) -> Iterator[Standstill]:
    """Yield the stretches in which one encoder of a spring does not change by a single step while the other one moves."""
    yield from _standstills(signals, "link_position", view.motor_position)
    yield from _standstills(signals, view.motor_position, "link_position")


def _standstills(signals: JointSignals, role: str, other: str) -> Iterator[Standstill]:
    x, y = signals.roles[role], signals.roles[other]
    # A run of the log ends where a sample is the first after a gap.
    same = np.concatenate(([False], np.diff(x) == 0.0)) & ~signals.starts
    first, after = _runs(same)
    long = (after - first) * signals.period >= STUCK
    if not long.any():
        return
    resting = np.zeros(x.shape, dtype=np.bool_)
    for begin, end in zip(first[long], after[long], strict=True):
        resting[begin - 1 : end] = True
    elsewhere = ~resting & np.isfinite(x) & np.isfinite(y)
    if np.count_nonzero(elsewhere) < FEWEST:
        return
    low, high = _span((x - y)[elsewhere])
    spring = 0.0 if _noisy(x, ~resting) else MORE * (high - low)
    if not _go_together(x[elsewhere], y[elsewhere]):
        spring = np.inf
    y_low, y_high = _span(y)
    enough = max(MOVED * signals.resolution.get(other, 0.0), MOVED_SHARE * (y_high - y_low))
    for begin, end in zip(first[long] - 1, after[long], strict=True):
        moved = y[begin:end][np.isfinite(y[begin:end])]
        if moved.size and float(np.ptp(moved)) > enough:
            within = float(signals.time[begin]), float(signals.time[end - 1])
            stamps = int(signals.stamps[begin]), int(signals.stamps[end - 1])
            yield Standstill(role, other, within, stamps, float(np.ptp(moved)), float(enough), float(spring))


def _go_together(x: Array, y: Array) -> bool:
    if not (float(np.ptp(x)) > 0.0 and float(np.ptp(y)) > 0.0):
        return False
    return float(np.corrcoef(x, y)[0, 1]) > TOGETHER
