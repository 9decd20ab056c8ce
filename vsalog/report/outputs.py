"""Where results go: the files of a run, named before anything is done, and never what is read."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from vsalog.core.errors import WriteError
from vsalog.rig.find import rig_beside


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where the results go; a page, figures and a log of the trace only where they are asked for."""

    trace: Path
    model: Path
    mcap: Path | None = None
    page: Path | None = None
    figures: Path | None = None

    @classmethod
    def named(
        cls,
        logs: Sequence[Path],
        output: str | None,
        mcap: Path | None,
        page: Path | None = None,
        figures: Path | None = None,
    ) -> Outputs:
        """Name the results after the first log, in the current folder, or as `output` says.

        Raises
        ------
        WriteError
            A result would overwrite one of the logs or another result, or the folder asked for is not there.
        """
        stem = _stem(logs[0])
        if output is None or Path(output).is_dir():
            folder = Path(output or "")
            trace = folder / f"{stem}.stiffness.parquet"
        elif output.endswith(("/", os.sep)):
            raise WriteError(f"{output}: there is no such folder")
        else:
            trace = Path(output)
            folder = trace.parent
            stem = re.sub(r"(\.stiffness)?\.parquet$", "", trace.name)
        outputs = cls(trace, folder / f"{stem}.model.toml", mcap, page, figures)
        taken = {outputs.trace.resolve(): "-o", outputs.model.resolve(): "-o"}
        for path, option in ((mcap, "--mcap"), (page, "--report")):
            if path is not None:
                if path.resolve() in taken:
                    raise WriteError(f"{path}: is asked for twice, by {option} and by {taken[path.resolve()]}")
                taken[path.resolve()] = option
        if figures is not None and figures.exists() and not figures.is_dir():
            raise WriteError(f"{figures}: is no folder; name one for the figures")
        for path in (outputs.trace, outputs.model, outputs.mcap, outputs.page):
            if path is not None and any(path.exists() and log.exists() and path.samefile(log) for log in logs):
                raise WriteError(f"{path}: is the log itself; choose another name with -o")
        return outputs

    def pairs(self) -> Iterator[tuple[str, str]]:
        """Yield what each file is, and its path."""
        yield "trace", str(self.trace)
        yield "model", str(self.model)
        if self.mcap is not None:
            yield "log of the trace", str(self.mcap)


def _stem(log: Path) -> str:
    name = log.resolve().name
    return name if log.is_dir() else Path(name).stem


def inputs_of(logs: Iterable[Path], rig: str | Path | None = None) -> list[Path]:
    """Return the files that a command reads: the logs, what a bag's folder holds, the rig that is given or lies next to them."""
    logs = list(logs)
    parts = [part for log in logs if log.is_dir() for part in log.iterdir()]
    rigs = [rig_beside(log) for log in logs] if rig is None else [Path(rig)]
    return [*logs, *parts, *(path for path in rigs if path is not None)]


def keep_inputs(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Refuse to write over what is read, before anything is done.

    Raises
    ------
    WriteError
        An output is one of the inputs, or no file can be written there.
    """
    for output in outputs:
        for given in inputs:
            if output.exists() and given.exists() and output.samefile(given):
                raise WriteError(f"{output}: is what is read; choose another place for what is written")
        if output.is_dir():
            raise WriteError(f"{output}: is a folder; name a file")
