"""The exceptions of vsalog: one root, one kind per layer.

A message states what is wrong, where (file, channel, line, time) and what to do about it. The command line prints the
message alone and exits with 2; a traceback is for bugs.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


class VsalogError(Exception):
    """Root of every error that the input or the command line is to blame for."""


class VsalogWarning(UserWarning):
    """A finding of severity warning or invalidates, of a result in Python."""


class ReadError(VsalogError):
    """A log cannot be read, or not as what it claims to be.

    Parameters
    ----------
    what : what is wrong
    path : of the file or folder that it is about, which is printed first; None where it is about none
    """

    def __init__(self, what: str, path: Path | None = None) -> None:
        super().__init__(what, path)
        self.what, self.path = what, path

    def __str__(self) -> str:
        return self.what if self.path is None else f"{self.path}: {self.what}"

    def moved(self, old: Path, new: Path) -> ReadError:
        """Return the same error of a log that was requested as `new` and read as `old`."""
        if self.path is None or not self.path.is_relative_to(old):
            return self
        return ReadError(self.what, new / self.path.relative_to(old))


class RigError(VsalogError):
    """A rig file is malformed, or its values are impossible."""


class UnitError(VsalogError):
    """A unit is unknown or does not fit the quantity it is given for."""


class BindingError(VsalogError):
    """A rig and a recording do not fit together."""


class FilterError(VsalogError):
    """A filter cannot work on the data or the settings it is given."""


class ExtensionError(VsalogError):
    """An extension by another package cannot be loaded."""


class EstimatorError(VsalogError):
    """An estimator cannot work on the signals or the settings it is given."""


class OtherKindError(EstimatorError):
    """An estimator is for joints of another kind."""


class SimulationError(VsalogError):
    """A rig cannot be simulated, or its motion leaves what the model describes."""


class DiagnosisError(VsalogError):
    """The log or the rig lacks what a diagnosis needs."""


class ExportError(VsalogError):
    """A rig cannot be written as a model of another simulator."""


class WriteError(VsalogError):
    """A result cannot be written."""


class BatchError(VsalogError):
    """A batch cannot begin or continue."""


def words_of(error: VsalogError | OSError) -> str:
    """Return the message of an error with its notes; for one of the system, with its file."""
    words = str(error) if isinstance(error, VsalogError) else f"{error.filename or 'output'}: {error.strerror}"
    notes = getattr(error, "__notes__", ())
    return "; ".join([words.rstrip("."), *notes]) if notes else words


def near_names(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """Return the known names nearest to `name`.

    Also matches when one name is the tail of another, since channel names are long and people remember their ends.
    """
    names = list(dict.fromkeys(known))
    lowered = {n.lower(): n for n in names}
    near = [lowered[m] for m in get_close_matches(name.lower(), lowered, n=count, cutoff=0.6)]
    tail = name.lower().rsplit(".", 1)[-1].rsplit("/", 1)[-1]
    if len(tail) > 2:
        near += [n for n in names if tail in n.lower() and n not in near]
    return near[:count]


def did_you_mean(name: str, known: Iterable[str], count: int = 3) -> str:
    """Return ", did you mean 'a' or 'b'?" for the known names nearest to `name`, or "" when none is near."""
    near = " or ".join(f"'{n}'" for n in near_names(name, known, count))
    return f", did you mean {near}?" if near else ""
