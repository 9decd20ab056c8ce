"""Document of `identify`: parameters with intervals, how well the log determines each, and held-out errors."""

from __future__ import annotations

from collections.abc import Mapping

from vsalog.core.notation import digits_apart, number, signal_name, unit_of
from vsalog.figures.chart import Chart
from vsalog.figures.dot_plots import identified_chart
from vsalog.identification.document import Combination, Determined, Identification, IdentifiedNumber, SimulationError
from vsalog.report.document import Block, Cell, Document, Facts, Notes, Section, Table, Verdict, Words, provenance

TOLD: Mapping[Determined, tuple[str, str]] = {
    "alone": ("yes", "good"),
    "in combination": ("in combination", "open"),
    "not": ("no", "bad"),
}
PARTS = {"whole": "", "last third": ", last third, not fitted", "itself": ", which was fitted"}
MEANING = (
    "determined: whether the log determines a number as well as a rig usually knows it; in combination: it would if others were"
    " known; correlated: the number whose estimate depends most on it."
)
INVALID = "Its numbers are not given, since a finding invalidates them; in the written rig they are unchanged."


def identification_document(found: Identification, files: Mapping[str, str] = {}) -> Document:
    """Return an identification.

    Parameters
    ----------
    found : what was found
    files : what was written: what each is, and its path
    """
    joints = list(dict.fromkeys(n.joint for n in found.numbers))
    items: list[Block] = [Notes(found.findings)]
    for joint in joints:
        own = [n for n in found.numbers if n.joint == joint]
        blocks: list[Block] = [_numbers(joint, own)]
        blocks += [Words(_combined(c)) for c in found.combinations if c.joint == joint]
        blocks += [_errors(joint, [e for e in found.errors if e.joint == joint])]
        blocks += [_correlations(own, found.correlations[joint])] if len(own) > 1 else []
        items.append(Section(f"Joint {joint}" if len(joints) > 1 else "", tuple(blocks)))
    invalid = dict.fromkeys(f.joint for f in found.findings if f.severity == "invalidates" and f.joint not in joints)
    items += [Verdict(joint, "invalid", "bad", (INVALID,)) for joint in invalid]
    items += [*([Words(MEANING)] if joints else []), Section("", (Facts(tuple(files.items())),), where="terminal")]
    pairs = [("log", f"{found.log}, SHA-256 {found.log_sha256}"), ("vsalog", found.vsalog), *found.settings.items()]
    items.append(provenance(pairs, found.rig))
    return Document(f"Identification of {found.log}", "The rig's parameters, fitted to a log", tuple(items), found)


def identification_charts(found: Identification) -> dict[str, Chart]:
    """Return per joint the figure of its numbers with their intervals, where it has one."""
    charts = {}
    for joint in dict.fromkeys(n.joint for n in found.numbers):
        chart = identified_chart([n for n in found.numbers if n.joint == joint])
        if chart is not None:
            charts[joint] = chart
    return charts


def _numbers(joint: str, numbers: list[IdentifiedNumber]) -> Table:
    rows = []
    for n in numbers:
        word, tone = TOLD[n.determined]
        digits = digits_apart(n.low, n.high)
        interval = f"{number(n.low, digits)} to {number(n.high, digits)}"
        nearest = "" if n.correlated_with is None else f"{n.correlated_with} ({number(n.correlation, 2)})"
        sure = Cell(word, tone=tone)  # type: ignore[arg-type]
        own = number(n.value, digits)
        rows.append((n.key, unit_of(n.unit), sure, nearest, number(n.rig, 4), own, interval))
    heads = ("number", "unit", "determined", "correlated", "rig", "identified", "95 % interval")
    return Table(f"Numbers of joint {joint}", heads, tuple(rows), keys=1, texts=4)


def _combined(found: Combination) -> str:
    together = ", ".join(f"{key} by {number(change)} %" for key, change in zip(found.keys, found.changes, strict=True))
    return f"Determined in combination only: the simulation hardly changes where these change together: {together}."


def _errors(joint: str, errors: list[SimulationError]) -> Table:
    rows = tuple(
        (
            signal_name(e.signal),
            f"{e.where}{PARTS[e.part]}",
            unit_of(e.unit),
            number(e.rig),
            number(e.identified),
            number(e.noise_floor),
            number(e.spread),
        )
        for e in errors
    )
    heads = ("signal", "log", "unit", "rig", "identified", "noise floor", "spread")
    return Table(f"RMS simulation error of joint {joint}", heads, rows, keys=2, texts=3)


def _correlations(numbers: list[IdentifiedNumber], matrix: tuple[tuple[float, ...], ...]) -> Section:
    heads = ("number", *(n.key for n in numbers))
    rows = tuple((n.key, *(number(c, 2) for c in row)) for n, row in zip(numbers, matrix, strict=True))
    return Section("", (Table("Correlations of the estimates", heads, rows, keys=1, texts=1),), where="page")
