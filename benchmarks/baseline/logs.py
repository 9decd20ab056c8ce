"""The logs of a baseline. They are made once, by the first version that is recorded; all others get the same files."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from benchmarks.baseline.product import Product

Array = NDArray[np.float64]
Columns = dict[str, Array]
# Columns and role → name of a column, to columns with a fault.
Fault = Callable[[Columns, Mapping[str, str]], None]

EXPONENTIAL = Path(__file__).with_name("exponential.toml")
PRESETS = ("sea", "vsa2", "awas", "cubic-antagonist", "vsa2-2r", "kuka-kr15", "pam")
SCENARIOS = ("sines", "multisine", "chirp", "steps", "servo")
PNEUMATIC_SCENARIOS = ("pam-exp1", "pam-exp2", "pam-range")
DURATION = "20 s"


@dataclass(frozen=True, slots=True)
class Log:
    """A log to be simulated.

    Attributes
    ----------
    name : of the file
    rig : a preset, or a rig's file
    seed : of the noise, and of the encoders' zeros
    scenario : what drives it; the rig's own when absent
    rate : samples per second; the scenario's when absent
    coarser : by how much the encoders' steps are larger than the rig's
    actual : changes of the machine of which the rig knows nothing, for its only joint
    fault : what becomes of what is recorded
    """

    name: str
    rig: str
    seed: int = 0
    scenario: str | None = None
    rate: float | None = None
    coarser: float = 1.0
    actual: Mapping[str, str] = field(default_factory=dict)
    fault: Fault | None = None


def scenes() -> list[Log]:
    """Every preset under several scenarios, and the rig that is no preset."""
    out = [Log(f"{preset}-own", preset) for preset in PRESETS]
    for preset in PRESETS:
        kinds = PNEUMATIC_SCENARIOS[1:] if preset == "pam" else SCENARIOS[1:]
        out += [Log(f"{preset}-{kind}", preset, scenario=kind) for kind in kinds]
    return [*out, *(Log(f"exponential-{kind}", str(EXPONENTIAL), scenario=kind, rate=250.0) for kind in SCENARIOS)]


def calibrated(seeds: int) -> dict[str, list[Log]]:
    """One motion of four rigs under many noises, the encoders' zeros anywhere within a step, rig by rig."""
    rigs = {preset: (preset, None) for preset in ("sea", "vsa2", "awas")} | {"exponential": (str(EXPONENTIAL), 250.0)}
    return {
        name: [Log(f"{name}-{seed:03d}", rig, 5000 + seed, rate=rate) for seed in range(seeds)]
        for name, (rig, rate) in rigs.items()
    }


def sound(count: int) -> list[Log]:
    """Logs in which nothing is wrong: presets, scenarios, rates and encoders in turn, then again with other noises."""
    kinds = [
        (preset, scenario, rate, coarser)
        for rate, coarser, preset in product((1000.0, 500.0, 250.0), (1.0, 4.0), PRESETS)
        for scenario in (PNEUMATIC_SCENARIOS if preset == "pam" else (None, *SCENARIOS))
    ]
    turns = ((k, seed) for seed in range(count) for k in kinds)
    return [
        Log(f"{p}-{s or 'own'}-{r:g}-{c:g}-{seed}", p, 9000 + 97 * seed, s, r, c)
        for (p, s, r, c), seed in islice(turns, count)
    ]


def scaled(*roles: str, by: float) -> Fault:
    """Readings in another unit, of another sign, or before a gear."""

    def fault(columns: Columns, names: Mapping[str, str]) -> None:
        for role in _those(names, roles):
            columns[names[role]] *= by

    return fault


def swapped(columns: Columns, names: Mapping[str, str]) -> None:
    """Motor and link channels exchanged."""
    motor, link = (names[_those(names, (role,))[0]] for role in ("motor_position", "link_position"))
    columns[motor], columns[link] = columns[link], columns[motor]


def late(role: str, by: float) -> Fault:
    """A channel that lags behind its stamps by some seconds."""

    def fault(columns: Columns, names: Mapping[str, str]) -> None:
        name, time = names[_those(names, (role,))[0]], columns["stamp"] * 1e-9
        columns[name] = np.interp(time - by, time, columns[name])

    return fault


def changed(role: str, change: Callable[[Array], Array]) -> Fault:
    """A channel of which something else is recorded."""

    def fault(columns: Columns, names: Mapping[str, str]) -> None:
        name = names[_those(names, (role,))[0]]
        columns[name] = change(columns[name])

    return fault


def frozen(x: Array) -> Array:
    return np.where(np.arange(x.size) > 0.6 * x.size, x[int(0.6 * x.size)], x)


def saturated(x: Array) -> Array:
    return np.clip(x, 0.5 * x.min(), 0.5 * x.max())


def wrapped(x: Array) -> Array:
    """An angle that starts again every 0.6 of its span."""
    return x.min() + np.mod(x - x.min(), 0.6 * np.ptp(x))


def zeroed_again(x: Array) -> Array:
    return x + np.where(np.arange(x.size) > 0.5 * x.size, 0.1 * np.ptp(x), 0.0)


def with_outliers(x: Array) -> Array:
    rng = np.random.default_rng(1)
    out = x.copy()
    at = rng.choice(x.size, max(x.size // 500, 1), replace=False)
    out[at] += 10.0 * np.ptp(x) * rng.choice([-1.0, 1.0], at.size)
    return out


def drifting(x: Array) -> Array:
    return x + np.linspace(0.0, 0.3 * np.ptp(x), x.size)


def milliseconds(columns: Columns, names: Mapping[str, str]) -> None:
    """Stamps a thousand times too far apart: milliseconds taken for seconds."""
    first = columns["stamp"][0]
    columns["stamp"] = first + 1000.0 * (columns["stamp"] - first)


FAULTS: Mapping[str, Fault] = {
    "degrees": scaled("motor_position", "link_position", by=180.0 / np.pi),
    "degrees-of-one": scaled("motor_position", by=180.0 / np.pi),
    "sign-of-motor": scaled("motor_position", by=-1.0),
    "sign-of-link": scaled("link_position", by=-1.0),
    "sign-of-motor-torque": scaled("motor_torque", by=-1.0),
    "sign-of-torque-sensor": scaled("torque_sensor", by=-1.0),
    "swapped": swapped,
    "gear-x10": scaled("motor_position", by=10.0),
    "milliseconds": milliseconds,
    "frozen-link": changed("link_position", frozen),
    "frozen-motor": changed("motor_position", frozen),
    "saturated-motor-torque": changed("motor_torque", saturated),
    "saturated-torque-sensor": changed("torque_sensor", saturated),
    "wrapped-motor": changed("motor_position", wrapped),
    "zeroed-again": changed("motor_position", zeroed_again),
    "late-motor": late("motor_position", 0.02),
    "late-link": late("link_position", 0.02),
    "late-motor-torque": late("motor_torque", 0.02),
    "late-torque-sensor": late("torque_sensor", 0.02),
    "outliers": changed("motor_position", with_outliers),
    "drift-of-torque-sensor": changed("torque_sensor", drifting),
    "motor-torque-x10": scaled("motor_torque", by=10.0),
    "torques-x10": scaled("motor_torque", "torque_sensor", by=10.0),
    "torques-x1000": scaled("motor_torque", "torque_sensor", by=1000.0),
}
# Faults of the machine: key of the only joint → value that is a tenth of the rig's, or what the rig lacks.
MACHINES: Mapping[str, Mapping[str, Mapping[str, str]]] = {
    "sea": {
        "inertia-x10": {"motor.inertia": "0.008 kg*m^2"},
        "spring-drift-2": {"transmission.drift": "-0.001"},
        "spring-drift-6": {"transmission.drift": "-0.003"},
    },
    "awas": {"inertia-x10": {"motor.inertia": "2.3e-6 kg*m^2"}, "spring-drift-2": {"transmission.drift": "-0.001"}},
    "vsa2": {},
}


def faulty() -> list[Log]:
    """Logs in which something is wrong that a user should be reported."""
    out = [Log(f"{rig}-{name}", rig, 77, fault=fault) for rig in MACHINES for name, fault in FAULTS.items()]
    for rig, machines in MACHINES.items():
        out += [Log(f"{rig}-{name}", rig, 77, actual=actual) for name, actual in machines.items()]
    return out


def make(logs: Sequence[Log], folder: Path, product: Product, workers: int) -> list[str]:
    """Simulate those logs that are not there yet; return what a version could not simulate, and why."""
    folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(workers) as pool:
        problems = pool.map(lambda log: _made(log, folder, product), logs)
        return [problem for problem in problems if problem is not None]


def _made(log: Log, folder: Path, product: Product) -> str | None:
    path, plain = folder / f"{log.name}.parquet", folder / f".{log.name}.parquet"
    if path.exists():
        return None
    given: list[str | Path] = [log.rig, "--truth", "--seed", str(log.seed), "--duration", DURATION]
    given += ["--scenario", log.scenario] if log.scenario else []
    given += ["--rate", f"{log.rate:g}"] if log.rate else []
    try:
        rig = _rig_of(product, log.rig, folder)
        for key, value in _encoders(rig, log):
            given += ["--set", f"{key}={value}"]
        (joint, *_) = rig["joint"]
        for key, value in log.actual.items():
            given += ["--actual", f"joint.{joint}.{key}={value}"]
        product.vsalog("simulate", *given, "-o", plain)
    except RuntimeError as error:
        return f"{log.name}: {error}"
    if log.fault is not None:
        _spoil(plain, log.fault, rig)
    plain.rename(path)
    return None


def _rig_of(product: Product, rig: str, folder: Path) -> Any:
    """Return the content of a rig's file; of a preset, as a log of it carries it."""
    if Path(rig).exists():
        return tomllib.loads(Path(rig).read_text(encoding="utf-8"))
    log = folder.parent / f"{rig}.rig.parquet"
    if not log.exists():
        product.vsalog("simulate", rig, "--duration", "1 s", "-o", log)
    return tomllib.loads(pq.read_schema(log).metadata[b"vsalog.rig"].decode())


def _encoders(rig: Any, log: Log) -> list[tuple[str, str]]:
    """Return the settings that put an encoder's zero anywhere within a step, and make its steps larger."""
    rng, out = np.random.default_rng(log.seed), []
    for name, joint in rig["joint"].items():
        for role, signal in joint["signals"].items():
            if "position" in role and isinstance(signal, dict) and "resolution" in signal:
                number, _, unit = str(signal["resolution"]).partition(" ")
                step, key = log.coarser * float(number), f"joint.{name}.signals.{role}"
                out.append((f"{key}.offset", f"{float(step * rng.uniform())!r} {unit}".strip()))
                out += [(f"{key}.resolution", f"{step!r} {unit}".strip())] if log.coarser != 1.0 else []
    return out


def _spoil(path: Path, fault: Fault, rig: Any) -> None:
    table = pq.read_table(path)
    columns = {name: table[name].to_numpy().astype(np.float64) for name in table.column_names}
    (joint,) = rig["joint"].values()
    names = {role: s if isinstance(s, str) else s["channel"] for role, s in joint["signals"].items()}
    fault(columns, names)
    kinds = {f.name: f.type for f in table.schema}
    pq.write_table(
        pa.table({n: pa.array(c).cast(kinds[n], safe=False) for n, c in columns.items()}, schema=table.schema), path
    )


def _those(names: Mapping[str, str], roles: Sequence[str]) -> list[str]:
    """Return the roles of a joint that are meant: a joint of two motors has each of a motor's twice."""
    return [own for role in roles for own in names if own == role or own.startswith(f"{role}_")]
