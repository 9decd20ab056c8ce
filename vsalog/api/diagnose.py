"""`vsalog.diagnose`: the errors of a rig's simulation, and their causes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from vsalog.api.results import Listed, Paths, columns, logs_of, names, paths, texts, warned
from vsalog.core.finding import Finding
from vsalog.diagnosis import document
from vsalog.diagnosis.run import Options, Outcome
from vsalog.diagnosis.run import diagnose as run
from vsalog.figures.decimation import FIGURE_COLUMNS
from vsalog.figures.dot_plots import equations_chart, gain_chart
from vsalog.figures.equation_residuals import cause_chart, remainder_chart
from vsalog.figures.simulated_signals import in_windows
from vsalog.report.diagnose import diagnosis_document, simulated_charts
from vsalog.report.diagnosis_sentences import further_findings, worded
from vsalog.report.document import Document
from vsalog.report.experiment import scenario_text
from vsalog.report.plot import Drawn
from vsalog.rig import Rig


class Diagnosis(Listed):
    """The errors of a rig's simulation, their causes, the extended rig, and the gain."""

    def __init__(self, found: document.Diagnosis, outcome: Outcome) -> None:
        self._found, self._outcome = found, outcome

    @property
    def data(self) -> document.Diagnosis:
        """What ``diagnosis.json`` holds."""
        return self._found

    @property
    def verdict(self) -> str:
        """``consistent``, ``consistent as far as checked``, ``explained``, ``partly explained`` or ``unexplained``."""
        return self._found.verdict

    @property
    def causes(self) -> tuple[document.FoundCause, ...]:
        """The causes that were found, the most important first."""
        return self._found.causes

    @property
    def rig(self) -> Rig:
        """The original rig."""
        return self._outcome.rig

    @property
    def extended(self) -> Rig | None:
        """The rig with the causes filled in; None where there is nothing to fill in."""
        return self._outcome.extended

    @property
    def proposed(self) -> str | None:
        """The next experiment, a scenario as TOML; None where none was requested, or can be proposed."""
        return None if self._outcome.proposed is None else scenario_text(self._outcome.proposed)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings."""
        return self._found.findings

    def _document(self) -> Document:
        extended = None if self.extended is None else self.extended.to_toml()
        return diagnosis_document(self._found, {}, (), extended)

    def _figures(self) -> Iterator[Drawn]:
        found, gain = self._found, self._found.gain
        for joint in self._outcome.evidence:
            own = joint.joint
            roles = list(in_windows(joint).signals)
            simulated = simulated_charts(found, joint, FIGURE_COLUMNS)
            charts = [
                (gain_chart([g for g in gain.signals if g.joint == own], gain.where), ""),
                *((chart, "") for chart in simulated[len(roles) :]),
                *zip(simulated, roles, strict=False),
                (equations_chart([e for e in found.equations if e.joint == own]), ""),
                *((cause_chart(joint, cause), f"{cause.cause} {cause.part}") for cause in joint.causes),
            ]
            yield from (Drawn(chart, own, part) for chart, part in charts if chart is not None)
        unit = next((e.unit for e in found.equations if e.equation == found.unexplained.equation), "")
        left = remainder_chart(found.unexplained, unit)
        if left is not None:
            yield Drawn(left)

    _columns = columns(
        joint=str, cause=str, part=str, log=str, confidence=float, error_removed=float, stiffness_change=float, parameter=str,
        value=float, std=float, unit=str, rig=float, determined=bool,
    )  # fmt: skip

    def _rows(self) -> Iterator[Mapping[str, object]]:
        for cause in self.causes:
            for name, number in cause.parameters.items():
                yield {
                    "joint": cause.joint,
                    "cause": cause.cause,
                    "part": cause.part,
                    "log": cause.log,
                    "confidence": cause.confidence,
                    "error_removed": cause.error_removed,
                    "stiffness_change": cause.stiffness_change,
                    "parameter": name,
                    "value": number.value,
                    "std": number.std,
                    "unit": number.unit,
                    "rig": number.rig,
                    "determined": number.determined,
                }

    def _warned(self) -> list[Finding]:
        return further_findings(self._found)


def diagnose(
    logs: Paths,
    rig: Rig | str | Path | None = None,
    *,
    holdouts: Paths = (),
    differs: str | Sequence[str] = (),
    joints: str | Sequence[str] = (),
    set: Mapping[str, object] | None = None,
    rate: float | None = None,
    time: str = "auto",
    start: str | None = None,
    end: str | None = None,
    suggest: bool = False,
) -> Diagnosis:
    """Name the causes of the errors of a rig's simulation, as ``vsalog diagnose`` does, without writing files.

    Parameters
    ----------
    logs : a log's path, or several of one machine, which are explained together
    rig : a rig, its file or a preset's name; that in the log, or next to it, when absent
    holdouts : other logs of the same machine, on which the gain is measured; windows of the log itself when empty
    differs : of several logs, causes that may have their own values in each
    joints : names of the joints wanted; all when empty
    set : changes to the rig, e.g. ``{"joint.elbow.motor.damping": "1 N*mm*s/rad"}``
    rate : samples per second of a table without a time column [Hz]
    time : which clock to trust: auto, header, log or publish
    start, end : the part of each log that is used: seconds from its beginning, ``"2 min"``, an ISO 8601 date or a time since the
        epoch
    suggest : propose the next experiment

    Raises
    ------
    VsalogError
        What the input is to blame for; the message says what, where and what to do.
    """
    options = Options(rig, names(joints), texts(set), rate, time, suggest, start, end, names(differs))
    outcome = run(logs_of(logs), paths(holdouts), options)
    return warned(Diagnosis(worded(outcome), outcome))
