"""One case: a machine, what is hidden in it, the log and the nominal rig that tell of it, and the sealed truth."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from .alike import told_apart
from .bench import Bench, Hidden, wild
from .devices import DEVICES
from .effects import EFFECTS, OUTSIDE, SCORED_OUTSIDE, Effect
from .families import FAMILIES
from .rig_file import CHANNELS, unit_of
from .sensors import random_qualities, recorded

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
    """

    plan: Plan
    bench: Bench
    hidden: list[Hidden]
    log: dict[str, np.ndarray]
    holdout: dict[str, np.ndarray]
    truth: dict[str, Any]
    period: float


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
    period = 1e-3 if rng.random() < 0.7 else 2e-3
    device = DEVICES[plan.device]
    nominal = device.random_machine(plan.device, rng)
    if any(not effect.parts(nominal) for effect in _effects(plan)):
        return None
    follow = device.wanted(nominal, rng.uniform(20.0, 30.0), period, rng, plan.poor)
    truth = device.happened(nominal, follow)
    if truth is None:
        return None
    qualities = random_qualities(nominal, truth, rng)
    return Bench(nominal, follow, truth, qualities, device.scales_of(nominal, truth), VARIANTS[plan.roles])


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
    for one in hidden or ():
        one.size = bench.size([one])
        if not np.isfinite(one.size):
            return None
    return hidden


def _finish(plan: Plan, bench: Bench, hidden: list[Hidden], rng: np.random.Generator) -> Case | None:
    machine, sensors = bench.changed(hidden)
    duration = rng.uniform(20.0, 30.0)
    device = DEVICES[plan.device]
    again = device.wanted(bench.nominal, duration, bench.follow.period, rng, plan.poor)
    logs = []
    for follow in (bench.follow, again):
        truth = device.happened(machine, follow)
        nominal = device.happened(bench.nominal, follow)
        if truth is None or nominal is None or wild(truth, nominal):
            return None
        said = recorded(truth, sensors, bench.nominal, bench.qualities, rng)
        logs.append({role: values for role, values in said.items() if role not in bench.missing})
    sealed = {
        "case": plan.name,
        "device": plan.device,
        "roles": plan.roles,
        "seed": plan.seed,
        "poor": plan.poor,
        "family": plan.family,
        "engine": plan.engine,
        "effects": [
            {
                "cause": h.effect.cause,
                "part": h.part,
                "parameters": h.parameters,
                "nominal": nominal_values(h, bench),
                "size": h.size,
                "shared": h.shared,
                "alike": told_apart(h, bench, rng),
            }
            for h in hidden
            if h.effect.cause in EFFECTS
        ],
        "outside": None,
        "noise": {CHANNELS[r]: q.deviation for r, q in bench.qualities.items() if r not in bench.missing},
    }
    for h in hidden:
        if h.effect.cause in OUTSIDE:
            own = {"what": h.effect.cause, "part": h.part, "parameters": h.parameters, "size": h.size}
            sealed["outside"] = SCORED_OUTSIDE[h.effect.cause] | own
    return Case(plan, bench, hidden, logs[0], logs[1], sealed, bench.follow.period)


def nominal_values(one: Hidden, bench: Bench) -> dict[str, float]:
    """Return what an effect's parameters are where it is absent."""
    absent = Hidden(one.effect, one.part, one.shape, 0.0)
    bench.changed([absent])
    return absent.parameters


def write_case(case: Case, out: Path) -> Path:
    """Write log, hold-out and nominal rig into OUT/CASE, the truth into OUT/sealed; return the case's folder."""
    folder, sealed = out / case.plan.name, out / "sealed"
    folder.mkdir(parents=True, exist_ok=True)
    sealed.mkdir(exist_ok=True)
    _write_log(case.log, case.period, folder / "log.parquet")
    _write_log(case.holdout, case.period, folder / "holdout.parquet")
    (folder / "rig.toml").write_text(
        DEVICES[case.plan.device].rig_text(case.bench.nominal, list(case.log)), encoding="utf-8"
    )
    (sealed / f"{case.plan.name}.json").write_text(json.dumps(case.truth, indent=1), encoding="utf-8")
    return folder


def _write_log(roles: dict[str, np.ndarray], period: float, path: Path) -> None:
    count = len(next(iter(roles.values())))
    columns = {"time": np.arange(count) * period} | {CHANNELS[role]: values for role, values in roles.items()}
    fields = [pa.field("time", pa.float64(), metadata={"unit": "s"})]
    fields += [pa.field(CHANNELS[r], pa.float64(), metadata={"unit": unit_of(r)}) for r in roles]
    pq.write_table(pa.table(list(columns.values()), schema=pa.schema(fields)), path)
