"""What a version does, section by section, as one JSON document."""

from __future__ import annotations

import ast
import json
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from benchmarks.baseline.logs import Log, calibrated, faulty, make, scenes, sound
from benchmarks.baseline.product import Product

ESTIMATORS = (
    "auto",
    "direct",
    "residual-rls",
    "qr-rls",
    "batch-ls",
    "algebraic",
    "impedance",
    "grioli-bicchi",
    "pam-ukf",
)
CALIBRATED = ("direct", "residual-rls", "qr-rls", "batch-ls", "algebraic", "impedance", "grioli-bicchi")
SAMPLES = ("sea_exp1.csv", "vsa2_exp1.mcap", "awas_exp1.mcap")
# Two-sided 95 % of a normal distribution.
BAND = 1.96
NOTHING_EXCITED: dict[str, float | None] = {"inside": None, "width": None, "excited": 0.0}
# Rows of a trace that are kept.
KEPT = 101
FAMILIES = ("messy", "model-error", "bench", "rigid", "closed-loop", "low-rate", "coarse", "short", "current", "gaps")


@dataclass(frozen=True, slots=True)
class Asked:
    """How much is recorded.

    Attributes
    ----------
    logs : folder of the logs, which are made where they are missing
    workers : processes at once
    seeds : noises of each cell of the calibration
    sound : logs in which nothing is wrong
    cases : logs of each family of hidden effects
    """

    logs: Path
    workers: int
    seeds: int
    sound: int
    cases: int


def estimates(product: Product, asked: Asked) -> Any:
    """Traces, models and findings of every scene by every estimator, and of the sample logs."""
    logs, problems = _made(product, asked, "scenes", scenes())
    out = {estimator: _batch(product, asked, logs, estimator, _trace) for estimator in ESTIMATORS}
    samples = {}
    with tempfile.TemporaryDirectory() as name:
        for sample in SAMPLES:
            told = product.asked("estimate", product.folder / "sample_logs" / sample, "-o", name)
            trace, model = (Path(told["outputs"][k]) for k in ("trace", "model"))
            samples[sample] = {
                "findings": _findings(told),
                "trace": _trace(trace, None),
                "model": model.read_text(encoding="utf-8"),
            }
    return {"not_made": problems, "scenes": out, "samples": samples}


def calibration(product: Product, asked: Asked) -> Any:
    """How often the truth is in the 95 % band where a row is excited, in the second half of a log, and how wide that is."""
    out: dict[str, Any] = {}
    for rig, logs in calibrated(asked.seeds).items():
        made, _ = _made(product, asked, f"calibration-{rig}", logs)
        for estimator in CALIBRATED:
            rows = _batch(product, asked, made, estimator, _coverage)
            out[f"{rig}, {estimator}"] = {
                log: {**(row["trace"] or NOTHING_EXCITED), "findings": row["findings"]}
                for log, row in rows.items()
                if row["status"] == "done"
            }
    return out


def findings(product: Product, asked: Asked) -> Any:
    """What is reported of logs in which nothing is wrong, and of faults."""
    out = {}
    for name, logs in {"sound": sound(asked.sound), "faulty": faulty()}.items():
        made, _ = _made(product, asked, name, logs)
        rows = _batch(product, asked, made, "auto", lambda trace, log: None)
        out[name] = {log: row["findings"] + row["refused"] for log, row in rows.items()}
    return out


def battery(product: Product, asked: Asked) -> Any:
    """Hidden effects, and how many of them the diagnosis finds, family by family."""
    out = {}
    for family in FAMILIES:
        folder = asked.logs / "battery" / product.commit() / family
        given = ("--kind", family, "--seed", 404, "--cases", asked.cases, "--out", folder)
        product.run("tests.hidden_effects.battery", *map(str, given), codes=(0, 1))
        numbers = json.loads((folder / "battery.json").read_text(encoding="utf-8"))["numbers"]
        out[family] = {n["what"]: {"value": n["value"], "met": n["met"]} for n in numbers}
    return out


def papers(product: Product, asked: Asked) -> Any:
    """The rows of the papers' tables."""
    return product.asked("reproduce")


def times(product: Product, asked: Asked) -> Any:
    """CPU time of whole commands [s], and reading next to rosbags."""
    out: dict[str, Any] = {"help": min(product.cpu("--help") for _ in range(5))}
    with tempfile.TemporaryDirectory() as name:
        for sample in SAMPLES:
            job = ("estimate", product.folder / "sample_logs" / sample, "-o", name)
            out[f"estimate {sample}, cold"] = product.cpu(*job, cache=Path(name) / sample)
            product.cpu(*job)
            out[f"estimate {sample}"] = min(product.cpu(*job) for _ in range(5))
    out["readers"] = product.run("benchmarks.readers", codes=(0, 1))
    return out


def structure(product: Product, asked: Asked) -> Any:
    """The size of the code: lines, files, module-level numeric constants, imports inside functions, the largest cycle."""
    files = sorted((product.folder / "vsalog").rglob("*.py"))
    trees = {_module(product, file): ast.parse(file.read_text(encoding="utf-8")) for file in files}
    inner = sum(isinstance(n, ast.ImportFrom | ast.Import) for n in _in_functions(trees) if _of_vsalog(n))
    return {
        "files": len(files),
        "lines": sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files),
        "constants": sum(_constants(tree) for tree in trees.values()),
        "imports inside functions": inner,
        "largest import cycle": _largest_cycle(trees),
    }


SECTIONS: Mapping[str, Callable[[Product, Asked], Any]] = {
    s.__name__: s for s in (structure, estimates, calibration, findings, papers, times, battery)
}


def _made(product: Product, asked: Asked, name: str, logs: Sequence[Log]) -> tuple[list[Path], list[str]]:
    """Make a group of logs; return the files, and what could not be made."""
    problems = make(logs, asked.logs / name, product, asked.workers)
    files = (asked.logs / name / f"{log.name}.parquet" for log in logs)
    return [file for file in files if file.exists()], problems


def _batch(
    product: Product, asked: Asked, logs: Sequence[Path], estimator: str, digest: Callable[[Path, Path], Any]
) -> dict[str, Any]:
    """Estimate logs; return of each: status, findings, the reason where it is refused, numbers, model, digest of its trace."""
    with tempfile.TemporaryDirectory() as name:
        out, listed = Path(name) / "out", Path(name) / "logs.txt"
        listed.write_text("\n".join(map(str, logs)), encoding="utf-8")
        given = ("--do", "estimate", "-e", estimator, "-j", str(asked.workers), "-o", out)
        product.vsalog("batch", f"@{listed}", *given, codes=(0, 2))
        rows: dict[str, Any] = {}
        for row in pq.read_table(out / "summary.parquet").to_pylist():
            path = next(log for log in logs if log.name == Path(row["log"]).name)
            empty = {"status": row["status"], "findings": [], "refused": [], "joints": {}, "trace": None, "model": None}
            one = rows.setdefault(path.stem, empty)
            one["findings"] += row.get("findings") or row["warnings"] or []
            if row["status"] != "done":
                one["refused"].append(row["reason"])
                continue
            one["joints"][row["joint"]] = {k: v for k, v in row.items() if isinstance(v, float) and k != "run_seconds"}
            if one["model"] is None:
                one["trace"] = digest(out / row["trace"], path)
                one["model"] = (out / row["model"]).read_text(encoding="utf-8") if row["model"] else ""
        return rows


def _findings(told: Any) -> list[Any]:
    """Return what is found of a log and of its joints: codes and parts where a version has them, and texts where it does not."""
    own = [f for j in told["joints"] for f in j.get("findings", j["warnings"])]
    return [*told["warnings"], *(f if isinstance(f, str) else f"{f['code']} {f['part']}".strip() for f in own)]


def _transmissions(trace: Path) -> Iterator[tuple[str, str, Any]]:
    """Yield joint, transmission and columns of a trace."""
    table = pq.read_table(trace)
    joints, names = (np.asarray(table[k].to_pylist()) for k in ("joint", "transmission"))
    for joint in dict.fromkeys(joints.tolist()):
        for name in dict.fromkeys(names[joints == joint].tolist()):
            here = (joints == joint) & (names == name)
            columns = ("stamp", "stiffness", "stiffness_std", "excited")
            yield joint, name, {k: np.asarray(table[k], dtype=np.float64)[here] for k in columns}


def _trace(trace: Path, log: Path | None) -> Any:
    """Return some rows of a trace, and the root mean square of its relative error where the log contains the truth."""
    out = {}
    for joint, name, columns in _transmissions(trace):
        at = np.linspace(0, columns["stamp"].size - 1, min(KEPT, columns["stamp"].size)).astype(int)
        one: dict[str, Any] = {
            k: [None if not np.isfinite(v) else float(v) for v in columns[k][at]]
            for k in ("stiffness", "stiffness_std", "excited")
        }
        truth = None if log is None else _truth(log, joint, name, columns["stamp"])
        if truth is not None:
            good = (columns["excited"] > 0.5) & np.isfinite(columns["stiffness"])
            off = (columns["stiffness"][good] - truth[good]) / np.sqrt(np.mean(truth**2))
            one["error"] = float(np.sqrt(np.mean(off**2))) if off.size else None
        out[f"{joint}/{name}"] = one
    return out


def _coverage(trace: Path, log: Path) -> dict[str, float] | None:
    """Return the share of excited rows of the second half whose 95 % band contains the truth; of all transmissions but the total.

    Along with it the median of half the band, as a part of the truth, and how many rows are excited.
    """
    scores, widths, all_rows = [], [], 0
    for joint, name, columns in _transmissions(trace):
        truth = None if name == "total" else _truth(log, joint, name, columns["stamp"])
        if truth is not None:
            half = np.arange(truth.size) >= truth.size // 2
            counts = (columns["excited"] > 0.5) & half
            z = (columns["stiffness"] - truth) / columns["stiffness_std"]
            scores.append(np.abs(z[counts]))
            widths.append(BAND * columns["stiffness_std"][counts] / truth[counts])
            all_rows += np.count_nonzero(half)
    z = np.concatenate(scores) if scores else np.array([])
    if not z.size:
        return None
    width = float(np.median(np.concatenate(widths)))
    return {"inside": float(np.mean(z < BAND)), "width": width, "excited": z.size / all_rows}


def _truth(log: Path, joint: str, name: str, stamps: Any) -> Any:
    """Return the true stiffness at some stamps; None where the log does not hold it."""
    there = pq.read_schema(log).names
    known = [
        f"/truth/{where}stiffness{which}.data"
        for where in ("", f"{joint}/")
        for which in (f"_{name}", *(("",) if name in ("1", "total") else ()))
    ]
    column = next((k for k in known if k in there), None)
    if column is None:
        return None
    table = pq.read_table(log, columns=["stamp", column])
    own, values = (np.asarray(table[k], dtype=np.float64) for k in ("stamp", column))
    return np.interp(stamps, own, values)


def _module(product: Product, file: Path) -> str:
    parts = file.relative_to(product.folder).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _constants(tree: ast.Module) -> int:
    """Count the numbers with names in capitals at a module's level, of tuples and mappings each."""
    count = 0
    for node in tree.body:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
        if any(name.isupper() for name in names) and node.value is not None:  # type: ignore[union-attr]
            numbers = [n for n in ast.walk(node) if isinstance(n, ast.Constant)]
            count += sum(isinstance(n.value, int | float) and not isinstance(n.value, bool) for n in numbers) > 0
    return count


def _in_functions(trees: Mapping[str, ast.Module]) -> set[ast.AST]:
    functions = (
        n for t in trees.values() for n in ast.walk(t) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)
    )
    return {node for function in functions for node in ast.walk(function)}


def _of_vsalog(node: ast.AST) -> bool:
    if isinstance(node, ast.ImportFrom):
        return (node.module or "").partition(".")[0] == "vsalog"
    return isinstance(node, ast.Import) and any(a.name.partition(".")[0] == "vsalog" for a in node.names)


def _largest_cycle(trees: Mapping[str, ast.Module]) -> int:
    """Return how many packages and modules right under `vsalog` import one another in a circle, at their most."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    def unit(module: str) -> str:
        return ".".join(module.split(".")[:2])

    units = sorted({unit(m) for m in trees})
    edges = {
        (unit(module), unit(node.module))
        for module, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and _of_vsalog(node) and node.module is not None
    }
    known = [(units.index(a), units.index(b)) for a, b in edges if a != b and a in units and b in units]
    rows, columns = zip(*known, strict=True)
    graph = csr_matrix((np.ones(len(known)), (rows, columns)), shape=(len(units), len(units)))
    _, labels = connected_components(graph, directed=True, connection="strong")
    return int(np.bincount(labels).max())
