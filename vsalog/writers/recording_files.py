"""A recording and its rig as a log of the format that its file name selects."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from vsalog.core.errors import WriteError
from vsalog.core.recording import Recording
from vsalog.core.units import shown
from vsalog.writers.atomic import atomic_path, check_path
from vsalog.writers.recording_mcap import write_mcap
from vsalog.writers.recording_rosbags import check_folder, write_rosbag1, write_rosbag2
from vsalog.writers.recording_tables import write_csv, write_parquet

MCAP, ROSBAG1, CSV, PARQUET, ROSBAG2 = "mcap", "rosbag1", "csv", "parquet", "rosbag2"
FORMATS = {".mcap": MCAP, ".bag": ROSBAG1, ".csv": CSV, ".parquet": PARQUET, "": ROSBAG2}
# Formats whose channels are fields of ROS messages.
MESSAGE_FORMATS = (MCAP, ROSBAG1, ROSBAG2)

# The first line of rig files written next to logs, which marks them as replaceable.
MARK = "# Written by 'vsalog simulate' as the rig of "


@dataclass(frozen=True, slots=True)
class LogFiles:
    """The files of a log and its rig.

    Attributes
    ----------
    log : file, or folder of a ROS 2 bag
    format : ``mcap``, ``rosbag1``, ``csv``, ``parquet`` or ``rosbag2``
    rig : file next to the log; None where the log itself carries the rig
    """

    log: Path
    format: str
    rig: Path | None

    @classmethod
    def named(cls, output: str) -> LogFiles:
        """Return the format by the name's suffix: .mcap, .bag, .csv, .parquet; none, or a slash, is a ROS 2 bag's folder.

        Raises
        ------
        WriteError
            The suffix is another one, the folder does not exist, or something there would be overwritten.
        """
        log = Path(output)
        ending = "" if output.endswith("/") else log.suffix.lower()
        if not log.name or log.name == "..":
            raise WriteError(f"'{output}' names no file")
        if log.name in FORMATS:
            raise WriteError(f"'{output}' is a suffix without a name")
        if ending not in FORMATS:
            raise WriteError(
                f"{log}: no log format has the suffix '{ending}'; write .mcap, .bag, .csv or .parquet, or a folder's name"
                " with a slash behind it for a ROS 2 bag"
            )
        kind = FORMATS[ending]
        rig = log.with_name(f"{log.stem}.rig.toml") if kind in (ROSBAG1, CSV, ROSBAG2) else None
        files = cls(log, kind, rig)
        files._check()
        return files

    def _check(self) -> None:
        """Refuse what cannot be written, before anything is computed."""
        if self.format == ROSBAG2:
            check_folder(self.log)
        else:
            check_path(self.log)
        if self.rig is not None and self.rig.exists():
            with self.rig.open("rb") as file:
                ours = file.readline(len(MARK.encode())) == MARK.encode()
            if not ours:
                raise WriteError(
                    f"{self.rig}: exists already and is not of 'vsalog simulate'; the log's rig would replace it:"
                    " choose another name with -o"
                )


def write_log(recording: Recording, files: LogFiles, rig_text: str) -> None:
    """Write a recording and its rig; both appear when all went well, and not at all otherwise.

    Raises
    ------
    WriteError
        A file cannot be written, or the channels do not fit the format.
    """
    with ExitStack() as stack:
        if files.rig is not None:
            temporary = stack.enter_context(atomic_path(files.rig))
            temporary.write_text(f"{MARK}{shown(files.log.name)}.\n\n{rig_text}", encoding="utf-8")
        writers: dict[str, Callable[[Recording, Path], None]] = {
            MCAP: partial(write_mcap, rig_text=rig_text),
            PARQUET: partial(write_parquet, rig_text=rig_text),
            ROSBAG1: write_rosbag1,
            ROSBAG2: write_rosbag2,
            CSV: write_csv,
        }
        writers[files.format](recording, files.log)
