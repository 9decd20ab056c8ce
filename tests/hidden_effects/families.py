"""Families of cases: what is hidden in each, how strong, and how it is driven and recorded.

A family hides effects whose strengths are those of real machines, however visible that makes them; the truth says how visible
each is alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from .bench import Bench, Hidden
from .clamped import BENCH_EFFECTS
from .effects import EFFECTS, OUTSIDE, Effect, main_motors, motor_of, springs
from .machines import Machine
from .model_errors import MODEL_ERRORS
from .motion import LEAD, Truth, Wanted, happened
from .motion import _grid as grid
from .motion import _ramps as ramps
from .motion import _steps as steps
from .sensors import POSITIONS, Quality

MECHANICAL = ("elastic", "serial", "antagonistic")
Random = np.random.Generator
# One effect alone is at least so many times as strong as the noise; so often is it drawn until it is.
PLAIN, TRIES = 3.0, 12
# What simulates, and which devices it can.
ENGINES = {"own": (*MECHANICAL, "rigid", "bench"), "mujoco": ("elastic", "rigid")}


@dataclass(frozen=True)
class Common:
    """Something that is wrong with a machine, as often and as strongly as in real ones.

    Attributes
    ----------
    cause : name of the effect
    draw : random generator → number that says how wrong
    weight : how often it is chosen, relative to the others
    excludes : causes that are not hidden along with it
    shared : probability that both like parts of an antagonistic joint are as wrong
    strength : that number, bench, part → strength of the effect
    main : whether only the motors that move the joint may have it
    shape : what of the effect's shape is not drawn
    """

    cause: str
    draw: Callable[[Random], float]
    weight: float = 1.0
    excludes: tuple[str, ...] = ()
    shared: float = 0.0
    strength: Callable[[float, Bench, str], float] = lambda number, *_: number
    main: bool = False
    shape: Mapping[str, float] = field(default_factory=dict)


def signed(low: float, high: float) -> Callable[[Random], float]:
    """Return what draws a number of either sign."""
    return lambda rng: float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


def positive(low: float, high: float) -> Callable[[Random], float]:
    """Return what draws a positive number."""
    return lambda rng: float(rng.uniform(low, high))


def damping_times(factor: float, bench: Bench, part: str) -> float:
    """Return the strength that multiplies a damping by a factor."""
    row = bench.nominal.link[0] if part == "link" else motor_of(bench.nominal, part)
    return (factor - 1.0) * float(row["damping"]) * bench.scales.speed[part] / bench.scales.torque[part]


def of_first(share: float, bench: Bench, part: str) -> float:
    """Return the strength that gives every motor a torque of that share of the first one's scale."""
    own = main_motors(bench.nominal)
    return share * (bench.scales.torque[own[0]] / bench.scales.torque[part] if part in own else 1.0)


# A loop of the law that the catalogue has, and not one of slipping springs, which it can only approach.
SMOOTH = {"slips": 0.0}
# What is commonly wrong, in the order in which the effects are laid upon one another.
COMMON = (
    Common("motor.inertia", signed(0.05, 0.15), shared=0.3),
    Common("motor.viscous_friction", positive(1.4, 2.2), shared=0.3, strength=damping_times),
    Common("motor.torque_constant", signed(0.03, 0.08), shared=0.3),
    Common("motor.coulomb_friction", positive(0.02, 0.06), shared=0.3, strength=of_first),
    Common("motor.torque_offset", signed(0.01, 0.04), 0.7),
    Common("motor.cogging", positive(0.01, 0.04), 0.3),
    Common("transmission.stiffness", signed(0.04, 0.10), 1.3, shared=0.5),
    Common("transmission.backlash", positive(0.01, 0.05), 0.2, ("transmission.hysteresis",)),
    Common("transmission.hysteresis", positive(0.01, 0.05), 0.25, ("transmission.backlash",), shape=SMOOTH),
    Common("link.inertia", signed(0.05, 0.15)),
    Common("link.viscous_friction", positive(1.4, 2.2), strength=damping_times),
    Common("link.coulomb_friction", positive(0.01, 0.04), 0.3),
    Common("link.gravity", signed(0.04, 0.12), 0.4, ("link.payload",)),
    Common("link.payload", positive(0.05, 0.2), 0.3, ("link.gravity",)),
    Common("sensor.torque_gain", signed(0.02, 0.06), 0.8),
    Common("sensor.torque_offset", signed(0.01, 0.05), 0.8),
    Common("sensor.encoder_offset", signed(0.01, 0.06), 0.8),
    Common("sensor.clock_skew", signed(0.001, 0.003), 0.8),
)


def hide_common(bench: Bench, rng: Random, count: int, choice: tuple[Common, ...] = COMMON) -> list[Hidden]:
    """Choose things that are wrong and where; what both parts of a joint share counts once."""
    chosen: list[Common] = []
    possible = [c for c in choice if _parts(c, bench)]
    while possible and len(chosen) < count:
        weights = np.array([c.weight for c in possible])
        one = possible[int(rng.choice(len(possible), p=weights / weights.sum()))]
        chosen.append(one)
        possible = [c for c in possible if c is not one and c.cause not in one.excludes]
    chosen.sort(key=choice.index)
    return [hidden for one in chosen for hidden in _hide(one, bench, rng)]


def _parts(one: Common, bench: Bench) -> list[str]:
    parts = effect_of(one.cause, bench).parts(bench.nominal)
    return [p for p in parts if p not in bench.missing and not (one.main and p == "secondary_motor")]


def effect_of(cause: str, bench: Bench) -> Effect:
    """Return the effect of a cause; a spring bench has one of its own."""
    return BENCH_EFFECTS.get(cause, EFFECTS[cause]) if bench.nominal.device == "bench" else EFFECTS[cause]


def _hide(one: Common, bench: Bench, rng: Random) -> list[Hidden]:
    effect, parts = effect_of(one.cause, bench), _parts(one, bench)
    first = parts[int(rng.integers(len(parts)))]
    if "secondary_motor" in parts and rng.random() < 0.5:
        first = "motor"
    number, both = one.draw(rng), [first]
    alike = [group for group in (main_motors(bench.nominal), springs(bench.nominal)) if first in group]
    if alike and rng.random() < one.shared:
        both = alike[0]
    shared = len(both) > 1
    shape = effect.shape(rng, bench.nominal, first, bench.scales) | dict(one.shape)
    return [Hidden(effect, part, shape, one.strength(number, bench, part), shared=shared) for part in both]


@dataclass(frozen=True)
class Family:
    """A family of cases.

    Attributes
    ----------
    name : of the family, and of its cases
    about : what it stands for
    hide : bench, random generator → what is hidden; none where that bench will not do
    devices : that are taken in turn
    period : random generator → sample time [s]
    duration : least and most of a log [s]
    roles : variants of what is recorded, taken in turn
    prepare : nominal machine, random generator; changes how it is built or controlled
    drive : as a device's `wanted`, in its place
    record : nominal machine, truth, qualities, random generator; changes the qualities
    stamps : count, period, random generator → stamps [s], and which samples are kept
    repeats : how many tests are made of each machine, with other motions and noise
    """

    name: str
    about: str
    hide: Callable[[Bench, Random], list[Hidden] | None]
    devices: tuple[str, ...] = MECHANICAL
    period: Callable[[Random], float] = lambda rng: 1e-3 if rng.random() < 0.7 else 2e-3
    duration: tuple[float, float] = (20.0, 30.0)
    roles: tuple[str, ...] = ("full",)
    prepare: Callable[[Machine, Random], None] = lambda *_: None
    drive: Callable[..., Wanted] | None = None
    record: Callable[[Machine, Truth, dict[str, Quality], Random], None] = lambda *_: None
    stamps: Callable[[int, float, Random], tuple[np.ndarray, np.ndarray]] | None = None
    repeats: int = 1


def _some(least: int, most: int, choice: tuple[Common, ...] = COMMON):
    """Return what hides so many of the common things."""
    return lambda bench, rng: hide_common(bench, rng, int(rng.integers(least, most + 1)), choice)


def _one(choice: tuple[Common, ...]):
    """Return what hides one thing that is visible alone."""

    def hide(bench: Bench, rng: Random) -> list[Hidden] | None:
        for _ in range(TRIES):
            hidden = hide_common(bench, rng, 1, choice)
            sizes = [bench.size([one]) for one in hidden]
            if hidden and min(sizes) >= PLAIN:
                return hidden
        return None

    return hide


def _along_with(first: tuple[Common, ...], most: int, excluded: tuple[str, ...]):
    """Return what hides one of some causes, visible alone, and up to so many of the other common things."""
    rest = tuple(c for c in COMMON if c.cause not in excluded)

    def hide(bench: Bench, rng: Random) -> list[Hidden] | None:
        found = _one(first)(bench, rng)
        if found is None:
            return None
        return found + hide_common(bench, rng, int(rng.integers(0, most + 1)), rest)

    return hide


# What is less common, or stronger.
SINGLE = (
    *COMMON,
    Common("motor.stribeck_friction", positive(0.03, 0.1), 0.5),
    Common("motor.load_dependent_friction", positive(0.03, 0.12), 0.4),
    Common("motor.torque_delay", positive(0.001, 0.005), 0.6),
    Common("transmission.nonlinearity", signed(0.05, 0.14), 0.5),
    Common("transmission.asymmetry", signed(0.03, 0.1), 0.5),
    Common("transmission.stiffness_drift", signed(0.0005, 0.003), 0.3),
    Common("sensor.torque_delay", positive(0.001, 0.005), 0.5),
    Common("sensor.torque_drift", signed(0.0005, 0.003), 0.3),
)


# ── Servos ─────────────────────────────────────────────────────────────────────────────────────────────────────────────


def _stiff_servo(machine: Machine, rng: Random) -> None:
    faster = rng.uniform(1.4, 2.2)
    machine.servos["stiffness"] *= faster**2
    machine.servos["damping"] *= faster
    machine.servos["quantum"] = machine.torque * rng.uniform(0.002, 0.01)
    if machine.device == "serial":
        # The lever's motor is far weaker.
        machine.servos[1]["quantum"] = 0.0


def _slow_servo(machine: Machine, rng: Random) -> None:
    # What is held for so long bears less gain.
    machine.servos["stiffness"] *= 0.4
    machine.servos["damping"] *= 0.6


def _soft_servo(machine: Machine, rng: Random) -> None:
    softer = rng.uniform(0.3, 0.5)
    machine.servos["stiffness"] *= softer**2
    machine.servos["damping"] *= 0.5 * softer


def _command_is_exact(machine: Machine, truth: Truth, qualities: dict[str, Quality], rng: Random) -> None:
    for role in qualities:
        if role.startswith("motor_torque"):
            qualities[role] = Quality(1e-5 * machine.torque, 0.0)


# ── Coarse and fine encoders ───────────────────────────────────────────────────────────────────────────────────────────


def _counts(count: float):
    def record(machine: Machine, truth: Truth, qualities: dict[str, Quality], rng: Random) -> None:
        for role in qualities:
            if role in POSITIONS:
                qualities[role] = Quality(0.0, 2.0 * np.pi / count)

    return record


def _rotor_encoder(machine: Machine, truth: Truth, qualities: dict[str, Quality], rng: Random) -> None:
    """An encoder on the rotor's side of the gear: many counts per turn of the joint."""
    _counts(2.0 ** float(rng.integers(17, 21)))(machine, truth, qualities, rng)


def _fine(machine: Machine, truth: Truth, qualities: dict[str, Quality], rng: Random) -> None:
    _counts(2.0**20)(machine, truth, qualities, rng)
    for role, quality in qualities.items():
        if role not in POSITIONS:
            qualities[role] = Quality(0.05 * quality.noise, 0.05 * quality.step)


# ── Slow drives and dry motors ─────────────────────────────────────────────────────────────────────────────────────────


def _creep(machine: Machine, duration: float, period: float, rng: Random, poor: bool = False) -> Wanted:
    """Slow ramps with rests, and a few quicker moves that deflect the spring."""
    time = grid(duration, period)
    ease = np.clip((time - time[0]) / (0.8 * LEAD), 0.0, 1.0)
    # A place is kept for a while before the way goes on.
    slow = 0.3 * ramps(time, (3.0, 6.0), rng) + 0.7 * steps(time, (2.5, 6.0), 0.3, rng)
    quick = steps(time, (2.5, 6.0), 0.08, rng)
    angle = float(machine.link[0]["hangs_at"]) + rng.uniform(0.1, 0.3) * slow + 0.4 * machine.deflection * quick
    values = np.zeros((time.size, 2, 2))
    values[:, 0, 0] = ease * angle
    if machine.device == "antagonistic":
        squeeze = machine.deflection * (0.45 + 0.15 * ramps(time, (3.0, 6.0), rng))
        values[:, 0, 0], values[:, 1, 0] = ease * (angle + squeeze), ease * (angle - squeeze)
    if machine.device == "serial":
        values[:, 1, 0] = (0.25 + 0.15 * ramps(time, (3.0, 6.0), rng)) * machine.lever[0] / machine.lever[1]
    values[:, :, 1] = np.gradient(values[:, :, 0], period, axis=0)
    return Wanted(values, period, poor)


def of_machine(share: float, bench: Bench, part: str) -> float:
    """Return the strength of a torque that is a share of what the joint is made for."""
    return share * bench.nominal.torque / bench.scales.torque[part]


DRY = (
    Common("motor.coulomb_friction", positive(0.08, 0.25), strength=of_machine, shared=0.5, main=True),
    Common("motor.stribeck_friction", positive(0.06, 0.2), strength=of_machine, shared=0.5, main=True),
)
# A motor that lets go jumps faster than its drive goes [rad/s], and takes many times the torque that it would need else.
JUMP, PULL = 8.0, 25.0
# It rests for no less and no more than these shares of a log.
STILL = 0.1, 0.85


def _stick_slip(bench: Bench, rng: Random) -> list[Hidden] | None:
    bench.scales.fastest = {part: max(fastest, JUMP) for part, fastest in bench.scales.fastest.items()}
    bench.most = PULL
    hidden = _along_with(DRY, 1, (*DRY_CAUSES, "motor.viscous_friction"))(bench, rng)
    return hidden if hidden and STILL[0] < _still(bench, hidden) < STILL[1] else None


def _still(bench: Bench, hidden: list[Hidden]) -> float:
    """Return for which share of a log the motor that has the friction rests."""
    truth = happened(bench.changed(hidden)[0], bench.follow)
    if truth is None:
        return 1.0
    position = truth.roles[hidden[0].part.replace("motor", "motor_position")][truth.inside]
    lag = round(0.1 / truth.period)
    return float(np.mean(np.abs(position[lag:] - position[:-lag]) < 1e-4))


CURRENT = (Common("motor.torque_constant", signed(0.1, 0.4), shared=0.5, main=True),)


# ── Missing samples ────────────────────────────────────────────────────────────────────────────────────────────────────


def _holes(count: int, period: float, rng: Random) -> tuple[np.ndarray, np.ndarray]:
    """Leave out stretches and single samples, and most samples for a while; stamps are a little off."""
    keep, length = rng.random(count) > 0.005, count * period
    for _ in range(int(rng.integers(2, 7))):
        begin, lasts = rng.uniform(0.5, length - 2.0), rng.uniform(0.05, 1.2)
        keep[round(begin / period) : round((begin + lasts) / period)] = False
    for _ in range(int(rng.integers(1, 4))):
        begin, lasts, every = rng.uniform(0.5, 0.8 * length), rng.uniform(1.0, 5.0), int(rng.integers(2, 4))
        thin = np.arange(round(begin / period), min(round((begin + lasts) / period), count))
        keep[thin[thin % every > 0]] = False
    keep[0] = True
    off = np.clip(0.003 * rng.standard_normal(count), -0.1, 0.1)
    off[0] = 0.0
    return (np.arange(count) + off) * period, keep


# ── What the catalogue lacks ───────────────────────────────────────────────────────────────────────────────────────────

WARM = "motor friction that grows"
# How often each is chosen.
LACKING = {
    "flexible base": 1.0,
    "ripple of the drive's torque": 1.0,
    "friction that depends on the position": 0.8,
    WARM: 0.8,
    "filter in the drive": 0.6,
    "stamps that jitter": 0.6,
}
# What of the catalogue comes near to one of them: neither right nor false next to it.
DRY_CAUSES = ("motor.coulomb_friction", "motor.stribeck_friction", "motor.load_dependent_friction")
NEAR = {
    "friction that depends on the position": DRY_CAUSES,
    WARM: DRY_CAUSES,
    "filter in the drive": ("motor.torque_delay",),
    # Both are waves over the rotor's angle.
    "ripple of the drive's torque": ("motor.cogging",),
}
REMAINDER = 10.0, 1000.0


def _with_model_error(bench: Bench, rng: Random) -> list[Hidden] | None:
    """Hide three to five causes, and one or two effects that the catalogue lacks, 10 to 1000 times the noise together."""
    names, odds = list(LACKING), np.array(list(LACKING.values()))
    chosen = [str(n) for n in rng.choice(names, int(rng.integers(1, 3)), replace=False, p=odds / odds.sum())]
    if len(set(chosen) & {"friction that depends on the position", WARM}) == 2:
        chosen.pop()
    excluded = {c for n in chosen for c in NEAR.get(n, ())}
    hidden = hide_common(bench, rng, int(rng.integers(3, 6)), tuple(c for c in COMMON if c.cause not in excluded))
    tables = MODEL_ERRORS | OUTSIDE
    target = float(np.exp(rng.uniform(*np.log(REMAINDER)))) / np.sqrt(len(chosen))
    lacking = []
    for name in chosen:
        effect = tables[name]
        parts = effect.parts(bench.nominal)
        part = parts[int(rng.integers(len(parts)))]
        one = Hidden(effect, part, effect.shape(rng, bench.nominal, part, bench.scales), 0.0)
        bench.scaled(one, target, 1.0)
        lacking.append(one)
    whole = bench.size(lacking)
    return hidden + lacking if REMAINDER[0] <= whole <= 1.2 * REMAINDER[1] else None


# ── Spring benches and servos ──────────────────────────────────────────────────────────────────────────────────────────

BENCH = (
    Common("transmission.hysteresis", positive(0.02, 0.12), 1.3),
    Common("transmission.nonlinearity", signed(0.04, 0.14)),
    Common("link.coulomb_friction", positive(0.01, 0.05), 0.7, ("transmission.hysteresis",)),
    Common("link.gravity", positive(0.03, 0.15), 0.6, ("sensor.torque_offset",)),
    Common("sensor.torque_gain", signed(0.03, 0.1), 0.7, ("transmission.stiffness",)),
    Common("transmission.stiffness", signed(0.05, 0.2), 0.7, ("sensor.torque_gain",)),
    Common("sensor.torque_offset", signed(0.02, 0.1), 1.0, ("link.gravity",)),
)
RIGID = (
    Common("motor.inertia", signed(0.05, 0.2), 1.0, ("link.inertia",)),
    Common("motor.viscous_friction", positive(1.4, 2.5), strength=damping_times),
    Common("motor.torque_constant", signed(0.03, 0.15), 0.7),
    Common("motor.coulomb_friction", positive(0.02, 0.1), 1.5, ("motor.stribeck_friction",)),
    Common("motor.stribeck_friction", positive(0.02, 0.08), 0.5, ("motor.coulomb_friction",)),
    Common("motor.torque_offset", signed(0.01, 0.06)),
    Common("motor.torque_delay", positive(0.001, 0.005), 0.6),
    Common("motor.cogging", positive(0.01, 0.06), 0.6),
    Common("link.inertia", signed(0.05, 0.2), 0.6, ("motor.inertia",)),
    Common("link.gravity", signed(0.05, 0.2), 1.0, ("link.payload",)),
    Common("link.payload", positive(0.05, 0.3), 0.7, ("link.gravity",)),
    Common("sensor.encoder_offset", signed(0.1, 0.5), 0.4),
)


FAMILIES = {
    family.name: family
    for family in (
        Family("messy", "three to eight things wrong at once, with the strengths of real machines", _some(3, 8)),
        Family(
            "closed-loop", "a stiff position servo whose commanded torque is quantised; one thing wrong", _one(SINGLE),
            prepare=_stiff_servo, record=_command_is_exact,
        ),
        Family(
            "low-rate", "a drive that is commanded and recorded at 100 to 250 Hz; one thing wrong", _one(SINGLE),
            period=lambda rng: float(rng.choice([0.004, 0.005, 0.008, 0.01])), prepare=_slow_servo,
        ),
        Family("coarse", "encoders of 2000 counts; one thing wrong", _one(SINGLE), record=_counts(2000.0)),
        Family("short", "logs of 5 s; one thing wrong", _one(SINGLE), duration=(5.0, 5.0)),
        Family(
            "stick-slip", "a motor that sticks and slips behind a slow, soft drive; perhaps one thing more",
            _stick_slip, prepare=_soft_servo, drive=_creep,
        ),
        Family(
            "current", "a torque that was computed from a current with a wrong constant; up to two things more",
            _along_with(CURRENT, 2, ("motor.torque_constant", "sensor.torque_gain")),
        ),
        Family(
            "model-error", "three to five causes along with one or two effects that the catalogue lacks", _with_model_error,
            period=lambda rng: 1e-3, roles=("full", "no-torque-sensor", "no-link-encoder"), record=_fine,
        ),
        Family(
            "bench", "a clamped spring that a dynamometer turns: several loops, several amplitudes", _some(1, 4, BENCH),
            devices=("bench",), period=lambda rng: float(rng.choice([0.001, 0.002, 0.005])), repeats=2,
        ),
        Family(
            "rigid", "a servo with a load, one encoder and the motor's torque", _some(1, 5, RIGID), devices=("rigid",),
            record=_rotor_encoder, repeats=2,
        ),
        Family("gaps", "missing stretches and irregular rates; two to five things wrong", _some(2, 5), stamps=_holes),
    )
}  # fmt: skip
