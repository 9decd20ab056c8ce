"""Two records side by side, as Markdown: what changed by how much, and what is worse."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from statistics import median
from typing import Any

import numpy as np

# One-sided level of the paired tests by which a cell of the calibration is called worse, before it is divided by the cells.
LEVEL = 0.05
# By how much a CPU time may grow: what repeated runs of one version differ by on a shared machine.
SLOWER = 1.15


def compared(before: Any, after: Any) -> tuple[str, bool]:
    """Compare two records.

    Parameters
    ----------
    before, after : as `record` writes them; sections that only one has are left out

    Returns
    -------
    Markdown, and whether something is worse
    """
    parts, worse = [f"# {before['commit']} → {after['commit']}"], False
    for section, compare in SECTIONS.items():
        if section in before and section in after:
            lines, bad = compare(before[section], after[section])
            parts.append(f"## {section}\n\n" + "\n".join(lines) + ("\n\n**worse**: " + "; ".join(bad) if bad else ""))
            worse |= bool(bad)
    return "\n\n".join(parts), worse


Part = tuple[list[str], list[str]]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(r)} |" for r in (head, ["---"] * len(head), *rows)]


def structure(before: Any, after: Any) -> Part:
    rows = [(k, f"{before[k]}", f"{after.get(k)}") for k in before]
    return _table(("what", "before", "after"), rows), []


def estimates(before: Any, after: Any) -> Part:
    """Traces in units of their standard deviation, and against the truth."""
    rows, bad, told = [], list[str](), list[str]()
    for estimator, olds in before["scenes"].items():
        news = after["scenes"].get(estimator, {})
        both = [log for log in olds if log in news and olds[log]["status"] == news[log]["status"] == "done"]
        lost = [log for log in olds if olds[log]["status"] == "done" and log not in both]
        bad += [f"{log} is not estimated by {estimator} any more" for log in lost]
        gained = sum(row["status"] == "done" for row in news.values()) - len(both)
        pairs = [(olds[log], news[log]) for log in both]
        shifts = [s for o, n in pairs for s in _shifts(o["trace"], n["trace"])]
        ratios = [n / o for a, b in pairs for o, n in _errors(a["trace"], b["trace"]) if o]
        stated = lambda v, f: f(v) if v else "–"  # noqa: E731
        rows.append(
            (
                estimator,
                f"{len(both)} (+{gained} −{len(lost)})",
                stated(shifts, lambda v: f"{median(v):.2g} / {max(v):.2g}"),
                stated(ratios, lambda v: f"{median(v):.3g} / {max(v):.3g}"),
            )
        )
        told += _told(
            {log: olds[log]["findings"] for log in both}, {log: news[log]["findings"] for log in both}, estimator
        )
    for sample, old in before["samples"].items():
        new = after["samples"][sample]
        shifts = _shifts(old["trace"], new["trace"])
        same = "equal" if old["model"] == new["model"] else "differs"
        told.append(f"{sample}: largest shift {max(shifts, default=0.0):.2g} standard deviations, model {same}")
        told += _told({sample: old["findings"]}, {sample: new["findings"]}, "auto")
    head = ("estimator", "logs", "shift, median / most [std]", "error after / before, median / most")
    return [*_table(head, rows), "", *(f"- {t}" for t in told)], bad


def calibration(before: Any, after: Any) -> Part:
    rows, bad = [], []
    cells = [cell for cell in before if cell in after]
    for cell in cells:
        both = [log for log in before[cell] if log in after[cell]]
        pairs = [(before[cell][log]["inside"], after[cell][log]["inside"]) for log in both]
        known = np.array([p for p in pairs if None not in p], dtype=np.float64).reshape(-1, 2)
        old, new = known.mean(axis=0) if known.size else (np.nan, np.nan)
        if _lower(known[:, 1] - known[:, 0], LEVEL / len(cells)):
            bad.append(f"{cell}: {old:.1%} → {new:.1%}")
        low = sum(_silent(row) for row in after[cell].values())
        widths = [_median(record[cell], both, "width") for record in (before, after)]
        shares = [_median(record[cell], both, "excited") for record in (before, after)]
        rows.append(
            (cell, f"{len(known)}", f"{old:.1%}", f"{new:.1%}", f"{low}", *(f"{x:.2%}" for x in (*widths, *shares)))
        )
    averages = [np.nanmean([float(r[i].rstrip("%")) for r in rows]) for i in (2, 3)] if rows else []
    rows += [("all cells", "", *(f"{a:.1f}%" for a in averages), *[""] * 5)] if averages else []
    head = ("rig, estimator", "logs", "in the 95 % band before", "after", "below 80 %, silent")
    return _table((*head, "half band before", "after", "excited before", "after"), rows), bad


def _median(cell: Any, logs: Sequence[str], what: str) -> float:
    """Return the median of a number over logs; NaN where none has it."""
    known = [value for log in logs if (value := cell[log].get(what)) is not None]
    return float(np.median(known)) if known else np.nan


def _lower(differences: Any, level: float) -> bool:
    """Tell by a paired t-test whether values became lower."""
    from scipy.stats import ttest_1samp

    if differences.size < 2 or not np.any(differences):
        return False
    return bool(ttest_1samp(differences, 0.0, alternative="less").pvalue < level)


def _silent(row: Any) -> bool:
    return row["inside"] is not None and row["inside"] < 0.8 and not row["findings"]


def findings(before: Any, after: Any) -> Part:
    lines, bad = [], []
    for group in ("sound", "faulty"):
        both = [log for log in before[group] if log in after[group]]
        old, new = ([log for log in both if record[group][log]] for record in (before, after))
        lines.append(f"- {group}: {len(old)} of {len(both)} logs with a finding before, {len(new)} after")
        silent, loud = sorted(set(old) - set(new)), sorted(set(new) - set(old))
        lines += [f"  - not any more: {', '.join(silent)}"] if silent else []
        lines += [f"  - now: {', '.join(f'{log} ({after[group][log][0]})' for log in loud)}"] if loud else []
        if group == "sound" and len(new) > len(old):
            bad.append(f"{len(new) - len(old)} more sound logs carry a finding")
        if group == "faulty" and silent:
            bad.append(f"not told any more: {', '.join(silent)}")
    return lines, bad


def papers(before: Any, after: Any) -> Part:
    old, new = (dict(_leaves(record)) for record in (before, after))
    changed = [k for k in old if k in new and old[k] != new[k]]
    rows = [(k, f"{old[k]:.5g}", f"{new[k]:.5g}") for k in changed]
    lost = [k for k in old if k not in new]
    return [f"{len(old)} numbers, {len(changed)} changed", "", *_table(("number", "before", "after"), rows)], (
        [f"{len(lost)} numbers are missing"] if lost else []
    )


def times(before: Any, after: Any) -> Part:
    names = [k for k in before if k != "readers" and k in after]
    rows = [(k, f"{before[k]:.2f}", f"{after[k]:.2f}", f"{after[k] / before[k]:.2f}") for k in names]
    bad = [f"{k}: {before[k]:.2f} → {after[k]:.2f} s" for k in names if after[k] > SLOWER * before[k]]
    readers = [f"```\n{record['readers'].strip()}\n```" for record in (before, after)]
    return [*_table(("CPU time [s]", "before", "after", "ratio"), rows), "", *readers], bad


def battery(before: Any, after: Any) -> Part:
    rows, bad = [], []
    for family, numbers in before.items():
        for what, old in numbers.items():
            new = after.get(family, {}).get(what)
            if new is None:
                continue
            if old["value"] != new["value"]:
                rows.append((family, what, *(f"{v['value']:.3g}" for v in (old, new))))
            if old["met"] and not new["met"]:
                bad.append(f"{family}: {what}")
    return _table(("family", "number", "before", "after"), rows), bad


SECTIONS: Mapping[str, Callable[[Any, Any], Part]] = {
    s.__name__: s for s in (structure, estimates, calibration, findings, papers, times, battery)
}


def _shifts(old: Any, new: Any) -> list[float]:
    """Return by how much each transmission's stiffness moved at most, over the standard deviation that was stated before."""
    out = []
    for name in old.keys() & new.keys():
        a, b = (np.array(t[name]["stiffness"], dtype=np.float64) for t in (old, new))
        std, excited = (np.array(old[name][k], dtype=np.float64) for k in ("stiffness_std", "excited"))
        if a.size == b.size:
            off = np.abs(b - a)[excited > 0.5] / std[excited > 0.5]
            out += [float(np.nanmax(off))] if np.isfinite(off).any() else []
    return out


def _errors(old: Any, new: Any) -> list[tuple[float, float]]:
    names = [n for n in old.keys() & new.keys() if old[n].get("error") is not None and new[n].get("error") is not None]
    return [(old[n]["error"], new[n]["error"]) for n in names]


def _told(old: Mapping[str, list[Any]], new: Mapping[str, list[Any]], by: str) -> list[str]:
    return list(
        chain.from_iterable(
            [
                *(
                    f"{log} by {by}: no finding any more, before: {old[log][0]}"
                    for _ in [0]
                    if old[log] and not new[log]
                ),
                *(f"{log} by {by}: a finding: {new[log][0]}" for _ in [0] if new[log] and not old[log]),
            ]
            for log in old
        )
    )


def _leaves(tree: Any, path: str = "") -> list[tuple[str, float]]:
    if isinstance(tree, Mapping):
        return [leaf for k, v in tree.items() for leaf in _leaves(v, f"{path}/{k}")]
    if isinstance(tree, list):
        return [leaf for i, v in enumerate(tree) for leaf in _leaves(v, f"{path}/{i}")]
    return [(path, float(tree))] if isinstance(tree, int | float) and not isinstance(tree, bool) else []
