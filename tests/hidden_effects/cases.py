"""One case: a machine, what is hidden in it, the log and the nominal rig that tell of it, and the sealed truth."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from . import mujoco_engine
from .alike import same_physics, told_apart
from .bench import Bench, Hidden, wild
from .devices import ALL_DEVICES
from .effects import EFFECTS, OUTSIDE, SCORED_OUTSIDE, Effect
from .families import FAMILIES, NEAR
from .machines import Sensors
from .motion import Truth, Wanted
from .rig_file import CHANNELS, unit_of
from .sensors import random_qualities, recorded, stamp_errors
from .true_rig import true_rig

VARIANTS = {
    "full": (),
    "no-torque-sensor": ("torque_sensor", "torque_sensor_1", "torque_sensor_2"),
    "no-link-encoder": ("link_position",),
}
# An effect is at least so many times as strong as the noise, and at most.
SIZES = 3.0, 100.0
ATTEMPTS = 40


@dataclass(frozen=True)
class Plan:
    """What a case shall be.

    Attributes
    ----------
    name : of its folder
    device : elastic, antagonistic, serial, pneumatic
    seed : of everything random in it
    causes : what to hide, of the catalogue; at most two
    outside : what to hide that is not in the catalogue, or none
    roles : full, no-torque-sensor, no-link-encoder
    sizes : range of sizes, drawn from log-uniformly
    poor : whether the machine hardly moves
    engine : that simulates the hidden machine
    repeat : of a test of the same machine, with another motion and other noise
    family : that says what is hidden and how strongly, in place of `causes`, `outside` and `sizes`; none when empty
    """

    name: str
    device: str
    seed: int
    causes: tuple[str, ...] = ()
    outside: str | None = None
    roles: str = "full"
    sizes: tuple[float, float] = SIZES
    poor: bool = False
    family: str = ""
    engine: str = "own"
    repeat: int = 0


@dataclass
class Case:
    """Everything about a case, in memory.

    Attributes
    ----------
    bench : the nominal machine, as the rig describes it
    hidden : what is hidden in it
    log, holdout : role → shape (N,), SI
    truth : what goes into the sealed file
    period : [s]
    stamps : of the log and of the hold-out [s]
    """

    plan: Plan
    bench: Bench
    hidden: list[Hidden]
    log: dict[str, np.ndarray]
    holdout: dict[str, np.ndarray]
    truth: dict[str, Any]
    period: float
    stamps: list[np.ndarray]


class NotVisibleError(RuntimeError):
    """No machine was found in which the effect would be visible."""


def make_case(plan: Plan) -> Case:
    """Make a case.

    Raises
    ------
    NotVisibleError
        No machine was found in which the effects are as visible as asked for.
    """
    rng = np.random.default_rng([plan.seed, 1])
    for _ in range(ATTEMPTS):
        bench = _bench(plan, rng)
        hidden = None if bench is None else _hide_all(plan, bench, rng)
        case = None if bench is None or hidden is None else _finish(plan, bench, hidden, rng)
        if case is not None:
            return case
    what = plan.family or plan.causes or plan.outside
    raise NotVisibleError(f"{plan.name}: {what} is not visible in {plan.device}, {plan.roles}")


def _effects(plan: Plan) -> list[Effect]:
    return [EFFECTS[c] for c in plan.causes] + ([OUTSIDE[plan.outside]] if plan.outside else [])


def _bench(plan: Plan, rng: np.random.Generator) -> Bench | None:
    family = FAMILIES[plan.family] if plan.family else None
    period = family.period(rng) if family else 1e-3 if rng.random() < 0.7 else 2e-3
    device = ALL_DEVICES[plan.device]
    nominal = device.random_machine(plan.device, rng)
    if any(not effect.parts(nominal) for effect in _effects(plan)) or not _simulates(plan, nominal):
        return None
    if family:
        family.prepare(nominal, rng)
    follow = _wanted(plan, nominal, period, rng)
    truth = device.happened(nominal, follow)
    if truth is None:
        return None
    qualities = random_qualities(nominal, truth, rng)
    if family:
        family.record(nominal, truth, qualities, rng)
    return Bench(nominal, follow, truth, qualities, device.scales_of(nominal, truth), _missing(plan, nominal))


def _simulates(plan: Plan, nominal: Any) -> bool:
    """Tell whether the plan's engine can simulate a machine."""
    return plan.engine == "own" or mujoco_engine.simulates(nominal)


def _missing(plan: Plan, nominal: Any) -> tuple[str, ...]:
    if plan.device == "rigid":
        # Its one encoder goes by either name.
        return VARIANTS[plan.roles] + tuple({"motor_position", "link_position"} - {nominal.role})
    return VARIANTS[plan.roles]


def _wanted(plan: Plan, nominal: Any, period: float, rng: np.random.Generator) -> Wanted:
    family = FAMILIES[plan.family] if plan.family else None
    draw = family.drive if family and family.drive else ALL_DEVICES[plan.device].wanted
    return draw(nominal, rng.uniform(*(family.duration if family else (20.0, 30.0))), period, rng, plan.poor)


def _hide_all(plan: Plan, bench: Bench, rng: np.random.Generator) -> list[Hidden] | None:
    if plan.family:
        return _hide_family(plan, bench, rng)
    hidden: list[Hidden] = []
    taken: set[str] = set()
    for effect in _effects(plan):
        parts = [p for p in effect.parts(bench.nominal) if p not in bench.missing]
        if not parts:
            return None
        part = str(rng.choice([p for p in parts if p not in taken] or parts))
        taken.add(part)
        one = Hidden(effect, part, effect.shape(rng, bench.nominal, part, bench.scales), 0.0)
        low, high = np.log(plan.sizes[0]), np.log(plan.sizes[1])
        sign = -1.0 if effect.bounds(bench.nominal, part, bench.scales)[0] < 0.0 and rng.random() < 0.5 else 1.0
        bench.scaled(one, float(np.exp(rng.uniform(low, high))), sign)
        if not 0.9 * plan.sizes[0] <= one.size <= 1.1 * plan.sizes[1]:
            return None
        hidden.append(one)
    return hidden


def _hide_family(plan: Plan, bench: Bench, rng: np.random.Generator) -> list[Hidden] | None:
    hidden = FAMILIES[plan.family].hide(bench, rng)
    if plan.engine != "own" and not mujoco_engine.simulates(bench.nominal, hidden):
        return None
    for one in hidden or ():
        one.size = bench.size([one])
    sizes = np.array([one.size for one in hidden or ()])
    return hidden if sizes.size and np.isfinite(sizes).all() and np.max(sizes) >= SIZES[0] else None


def _finish(plan: Plan, bench: Bench, hidden: list[Hidden], rng: np.random.Generator) -> Case | None:
    machine, sensors = bench.changed(hidden)
    device, played = ALL_DEVICES[plan.device], bench.follow
    happened = device.happened if plan.engine == "own" else mujoco_engine.happened
    if plan.repeat:
        rng = np.random.default_rng([plan.seed, 2, plan.repeat])
        played = _wanted(plan, bench.nominal, bench.follow.period, rng)
    again = _wanted(plan, bench.nominal, bench.follow.period, rng)
    logs, stamps = [], []
    for follow in (played, again):
        truth = happened(machine, follow)
        nominal = device.happened(bench.nominal, follow)
        if truth is None or nominal is None or wild(truth, nominal, bench.most):
            return None
        said = recorded(truth, sensors, bench.nominal, bench.qualities, rng)
        time, keep = _stamps(plan, sensors, truth, rng)
        logs.append({role: values[keep] for role, values in said.items() if role not in bench.missing})
        stamps.append(time[keep])
    sealed = {
        "case": plan.name,
        "device": plan.device,
        "roles": plan.roles,
        "seed": plan.seed,
        "poor": plan.poor,
        "family": plan.family,
        "engine": plan.engine,
        "machine": f"{plan.seed}-{bench.nominal.torque if bench.nominal.suffixes else 0.0:.9g}",
        "effects": [_sealed(h, bench, rng) for h in hidden if h.effect.cause in EFFECTS],
        "outside": None,
        "noise": {CHANNELS[r]: q.deviation for r, q in bench.qualities.items() if r not in bench.missing},
    }
    for h in hidden:
        if h.effect.cause in OUTSIDE and not plan.family:
            own = {"what": h.effect.cause, "part": h.part, "parameters": h.parameters, "size": h.size}
            sealed["outside"] = SCORED_OUTSIDE[h.effect.cause] | own
    if plan.family:
        _compare_with_remainder(sealed, hidden, bench)
    return Case(plan, bench, hidden, logs[0], logs[1], sealed, bench.follow.period, stamps)


def _sealed(one: Hidden, bench: Bench, rng: np.random.Generator) -> dict[str, Any]:
    same = same_physics(one.effect.cause, bench.nominal)
    return {
        "cause": one.effect.cause,
        "part": one.part,
        "parameters": one.parameters,
        "nominal": nominal_values(one, bench),
        "size": one.size,
        "shared": one.shared,
        "alike": told_apart(one, bench, rng) | dict.fromkeys(same, 0.0),
    }


def _stamps(
    plan: Plan, sensors: Sensors, truth: Truth, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray | slice]:
    """Return the stamps of a log, and which of its samples are in it."""
    count = truth.inside.stop - truth.inside.start
    if plan.family and FAMILIES[plan.family].stamps:
        return FAMILIES[plan.family].stamps(count, truth.period, rng)
    time = np.arange(count) * truth.period
    return (time + stamp_errors(count, sensors, truth.period, rng) if sensors.jitter else time), slice(None)


def _compare_with_remainder(sealed: dict[str, Any], hidden: list[Hidden], bench: Bench) -> None:
    """Note what of the hidden is outside the catalogue, and how each effect compares with it, equation by equation."""
    lacking = [h for h in hidden if h.effect.cause not in EFFECTS]
    sealed["outside"] = [
        {
            "what": h.effect.cause, "part": h.part, "parameters": h.parameters, "size": h.size,
            "near": [f"{cause}@{h.part}" for cause in NEAR.get(h.effect.cause, ())],
        }
        for h in lacking
    ]  # fmt: skip
    rest = bench.left_over(lacking) if lacking else None
    sealed["remainder"] = max(p.ratio for p in rest.values()) if rest else 0.0
    known = [h for h in hidden if h.effect.cause in EFFECTS]
    for one, entry in zip(known, sealed["effects"], strict=True):
        if rest:
            own = bench.left_over([one]) or {}
            entry["over_remainder"] = max(float(p.ratio / np.hypot(rest[name].ratio, 1.0)) for name, p in own.items())


def nominal_values(one: Hidden, bench: Bench) -> dict[str, float]:
    """Return what an effect's parameters are where it is absent."""
    absent = Hidden(one.effect, one.part, one.shape, 0.0)
    bench.changed([absent])
    return absent.parameters


def write_case(case: Case, out: Path) -> Path:
    """Write log, hold-out and nominal rig into OUT/CASE, the truth into OUT/sealed; return the case's folder.

    Of a family's case the rig as it truly is lies along with the truth.
    """
    folder, sealed = out / case.plan.name, out / "sealed"
    folder.mkdir(parents=True, exist_ok=True)
    sealed.mkdir(exist_ok=True)
    write_log(case.log, case.stamps[0], folder / "log.parquet")
    write_log(case.holdout, case.stamps[1], folder / "holdout.parquet")
    rig = ALL_DEVICES[case.plan.device].rig_text(case.bench.nominal, list(case.log))
    (folder / "rig.toml").write_text(rig, encoding="utf-8")
    if case.plan.family:
        text = true_rig(rig, *case.bench.changed(case.hidden), case.plan.engine)
        (sealed / f"{case.plan.name}.rig.toml").write_text(text, encoding="utf-8")
    (sealed / f"{case.plan.name}.json").write_text(json.dumps(case.truth, indent=1), encoding="utf-8")
    return folder


def write_log(roles: dict[str, np.ndarray], stamps: np.ndarray, path: Path) -> None:
    columns = {"time": stamps} | {CHANNELS[role]: values for role, values in roles.items()}
    fields = [pa.field("time", pa.float64(), metadata={"unit": "s"})]
    fields += [pa.field(CHANNELS[r], pa.float64(), metadata={"unit": unit_of(r)}) for r in roles]
    pq.write_table(pa.table(list(columns.values()), schema=pa.schema(fields)), path)
