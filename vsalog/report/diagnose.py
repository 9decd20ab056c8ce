"""What `diagnose` says: verdict, causes and gain on stdout, warnings on stderr."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vsalog.core.documents import document_text
from vsalog.diagnosis.document import Diagnosis, FoundCause, Gain, SignalError
from vsalog.report.console import WORDS, console_for_stdout, print_findings
from vsalog.report.diagnose_files import Outputs
from vsalog.report.diagnosis_words import (
    confidence_words,
    further_findings,
    kind_text,
    open_experiment,
    parameter_text,
    reduction_text,
    signal_name,
    unexplained_words,
    unit_of,
)
from vsalog.report.page_text import number, plain

_STYLE = {
    "consistent": "green",
    "consistent as far as checked": "green",
    "explained": "cyan",
    "partly explained": "yellow",
    "unexplained": "bold red",
}


def print_report(diagnosis: Diagnosis, outputs: Outputs) -> None:
    """Print what was found for people."""
    console = console_for_stdout(markup=True)
    several = len({e.joint for e in diagnosis.simulation_error} | {c.joint for c in diagnosis.causes}) > 1
    print_findings(further_findings(diagnosis))
    verdict = f"[{_STYLE[diagnosis.verdict]}]{diagnosis.verdict}[/]"
    console.print(f"[bold]{escape(plain(diagnosis.log))}[/]: {verdict}", soft_wrap=True)
    for sentence in diagnosis.sentences:
        _say(console, sentence)
    _causes(console, diagnosis.causes, several)
    _errors(console, diagnosis, several)
    console.print("\n[bold]Unexplained[/]")
    _say(console, unexplained_words(diagnosis.unexplained))
    _advice(console, diagnosis)
    _files(console, diagnosis, outputs)


def print_json(diagnosis: Diagnosis, outputs: Outputs) -> None:
    """Print the diagnosis as one JSON document."""
    sys.stdout.buffer.write(document_text(diagnosis).encode())
    sys.stdout.buffer.flush()


def _say(console: Console, text: str, first: str = "  ", after: str = "  ", style: str = "") -> None:
    """Print a text of any length, broken between words."""
    width = max(console.width, 20)
    broken = textwrap.wrap(
        plain(text),
        width,
        initial_indent=first,
        subsequent_indent=after,
        break_long_words=False,
        break_on_hyphens=False,
    )
    for line in broken:
        console.print(escape(line), style=style, soft_wrap=True)


def _causes(console: Console, causes: Sequence[FoundCause], several: bool) -> None:
    if not causes:
        return
    console.print("\n[bold]Causes[/]")
    for i, cause in enumerate(causes, 1):
        where = f", joint {cause.joint}" if several else ""
        _say(console, f"{cause.title} ({kind_text(cause)}{where})", f"{i:>2}. ", "    ", "bold")
        for line in _parameters(cause):
            _say(console, line, "    ", "      ")
        _say(console, f"{confidence_words(cause)}.", "    ", "    ")
        if cause.indistinguishable_from:
            _say(console, f"This log cannot tell it from {', '.join(cause.indistinguishable_from)}.", "    ", "    ")


def _parameters(cause: FoundCause) -> Iterator[str]:
    for name, found in cause.parameters.items():
        yield plain(f"{signal_name(name)} {parameter_text(found)}")


def _errors(console: Console, diagnosis: Diagnosis, several: bool) -> None:
    """Simulation errors: before and after where there is an after."""
    gains, errors = diagnosis.gain.signals, diagnosis.simulation_error
    if not gains and not errors:
        return
    table = Table(box=None, pad_edge=False)
    heads = ["joint"] if several else []
    heads += ["signal"]
    for head in heads:
        table.add_column(head, overflow="fold")
    numbers = (
        ("error (rmse)", "noise floor", "less by (95 %)") if gains else ("error (rmse)", "noise floor", "of its span")
    )
    for head in numbers:
        table.add_column(head, justify="right", no_wrap=True)
    for row in map(_gain_row, gains) if gains else map(_error_row, errors):
        table.add_row(*map(escape, row if several else row[1:]))
    where = diagnosis.gain.where if gains else "windows of the log"
    console.print(f"\n[bold]Simulation error[/] on {escape(plain(where))}", soft_wrap=True)
    console.print(table)


def _gain_row(gain: Gain) -> tuple[str, ...]:
    change = f"{number(gain.rmse_before)} → {number(gain.rmse_after)}"
    return plain(gain.joint), _signal(gain), change, number(gain.noise_floor), reduction_text(gain)


def _error_row(error: SignalError) -> tuple[str, ...]:
    return plain(error.joint), _signal(error), number(error.rmse), number(error.noise_floor), f"{number(error.nrmse)} %"


def _signal(found: Gain | SignalError) -> str:
    return plain(f"{signal_name(found.signal)} [{unit_of(found.unit).strip() or '1'}]")


def _advice(console: Console, diagnosis: Diagnosis) -> None:
    """How to confirm what was found, and what would tell more."""
    if diagnosis.causes:
        console.print("\n[bold]How to confirm[/]")
    for cause in diagnosis.causes:
        if cause.how_to_confirm:
            _say(console, f"{cause.cause}: {cause.how_to_confirm}")
        if cause.tell_apart:
            _say(console, cause.tell_apart, "    ", "    ")
    more = open_experiment(diagnosis)
    if more:
        console.print("\n[bold]Next experiment[/]")
        _say(console, more)


def _files(console: Console, diagnosis: Diagnosis, outputs: Outputs) -> None:
    files = [("report", outputs.page), ("data", outputs.document)]
    if outputs.rig_is == "written" or (outputs.rig_is == "planned" and diagnosis.causes):
        files.append(("extended rig", outputs.rig))
    if outputs.scenario is not None:
        files.append(("next experiment", outputs.scenario))
    console.print()
    for what, path in files:
        console.print(f"{what}: {escape(plain(str(path)))}", soft_wrap=True)
    if outputs.rig_is == "old":
        note = f"{outputs.rig} is from before and was left as it is: this diagnosis found nothing to extend the rig by."
        console.print(f"[yellow]{WORDS['info']}:[/] {escape(plain(note))}", soft_wrap=True)
