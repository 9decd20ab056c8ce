"""What `estimate` says: progress on stderr, the summary on stdout."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.status import Status
from rich.table import Table

from vsalog.core.documents import document_text
from vsalog.core.printable import printable
from vsalog.estimation.job import Job
from vsalog.estimation.joint import JointEstimate
from vsalog.estimation.summary import TransmissionSummary
from vsalog.estimators.equation import SUPPORTED_SHARE
from vsalog.report.console import console_for_stdout, print_findings
from vsalog.report.estimate_files import Outputs


class Progress:
    """One line on stderr that says what is being done, on a terminal; a log file gets the slow steps only."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._status: Status | None = None

    def __enter__(self) -> Progress:
        if self._console.is_terminal:
            self._status = self._console.status("starting")
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._status is not None:
            self._status.stop()

    def say(self, text: str) -> None:
        """Show what is being done."""
        if self._status is not None:
            self._status.update(escape(printable(text)))

    @contextmanager
    def saying_when_compiling(self) -> Iterator[None]:
        """Say so, once, when numba begins to compile a numerical loop that is not in its cache yet."""
        from numba.core import event

        console = self._console

        class Once(event.Listener):
            said = False

            def on_start(self, event: object) -> None:
                if not self.said:
                    console.print("first run: compiling the numerical loops takes a few seconds …", soft_wrap=True)
                self.said = True

            def on_end(self, event: object) -> None:
                pass

        with event.install_listener("numba:compile", Once()):
            yield


def print_summary(job: Job, estimates: Sequence[JointEstimate], outputs: Outputs) -> None:
    """Print the summary for people, findings on stderr."""
    console = console_for_stdout(markup=True)
    print_findings([*job.findings, *(finding for e in estimates for finding in e.findings)])
    for e in estimates:
        s = e.summary
        console.print(
            f"[bold]{escape(printable(e.joint))}[/]: {escape(e.estimator)} ({escape(e.reason)});"
            f" {s.duration:.4g} s at {1.0 / s.period:.4g} Hz"
        )
        console.print(_observed(s.transmissions) or _table(s.transmissions))
        for line in _motor(e.model.motor):
            console.print(f"  {escape(line)}")
    console.print(
        f"trace: {escape(printable(str(outputs.trace)))}   model: {escape(printable(str(outputs.model)))}",
        soft_wrap=True,
    )
    if outputs.mcap is not None:
        console.print(f"log of the trace: {escape(printable(str(outputs.mcap)))}", soft_wrap=True)


def _observed(parts: Sequence[TransmissionSummary]) -> str:
    """Say of a method that observes the joint's state how far that moves; "" for those that estimate a stiffness."""
    fitted = any(p.transmission != "total" or p.fit_rms is not None or p.stiffness_low is not None for p in parts)
    spans = [p.deflection_span for p in parts if p.deflection_span is not None]
    return (
        ""
        if fitted or not spans
        else f"state observed, no stiffness estimated; the deflection spans {spans[0]:.4g} rad"
    )


def _table(parts: Sequence[TransmissionSummary]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2))
    table.add_column("transmission")
    for heading in ("stiffness [N·m/rad]", "± (1 std)", "RMS residual [N·m]", "of the torque", "excited"):
        table.add_column(heading, justify="right")
    for p in parts:
        span = "–" if p.stiffness_low is None else f"{p.stiffness_low:.4g} … {p.stiffness_high:.4g}"
        table.add_row(
            p.transmission,
            span,
            _percent(p.relative_std),
            "–" if p.fit_rms is None else f"{p.fit_rms:.3g}",
            _percent(p.fit_share),
            f"{p.excited_share:.0%} of the time",
        )
    return table


def _motor(found: Mapping[str, float]) -> Iterator[str]:
    """Say what was estimated of the motors; a value that its own uncertainty swallows is not one."""
    for name in (n for n in found if not n.endswith("_std")):
        value, std = found[name], found[f"{name}_std"]
        unit = "kg·m²" if name.startswith("inertia") else "N·m·s/rad"
        text = f"{value:.5g} ± {std:.2g} {unit}"
        known = value > 0.0 and std < SUPPORTED_SHARE * value
        yield f"motor {name}: {text}" if known else f"motor {name}: this log does not tell it ({text})"


def _percent(x: float | None) -> str:
    return "–" if x is None else f"{100.0 * x:.2g} %"


def print_json(job: Job, estimates: Sequence[JointEstimate], outputs: Outputs) -> None:
    """Print one JSON document on stdout."""
    document = {
        "logs": [printable(str(log)) for log in job.logs],
        "rig": {"name": job.rig.name, "guessed": job.guessed},
        "outputs": {
            "trace": printable(str(outputs.trace)),
            "model": printable(str(outputs.model)),
            "mcap": None if outputs.mcap is None else printable(str(outputs.mcap)),
        },
        "joints": [
            {
                "joint": e.joint,
                "estimator": e.estimator,
                "reason": e.reason,
                "modality": e.model.modality,
                "settings": e.settings,
                "motor": e.model.motor,
                "summary": e.summary,
                "findings": e.findings,
                "warnings": list(e.warnings),
            }
            for e in estimates
        ],
        "findings": job.findings,
        "warnings": list(job.warnings),
    }
    sys.stdout.write(document_text(document))
