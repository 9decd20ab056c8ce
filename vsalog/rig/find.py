"""The location of a log's rig: given, in the log itself, next to it, or nowhere; and other rigs there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from vsalog.core.errors import RigError
from vsalog.core.progress import is_watched, tell
from vsalog.rig.load import Rig

Place = Literal["given", "log", "next to log", "model", "guessed"]


@dataclass(frozen=True, slots=True)
class RigFound:
    """The rig that is used; `vsalog.core.progress.tell` reports it.

    Attributes
    ----------
    place : its source: requested, in the log, next to it, in the model file, or guessed since there is none
    where : its name in messages
    path : of its file; None where it is in no file of its own
    others : rig files next to the log or in the working directory that differ and are not used
    """

    place: Place
    where: str
    path: Path | None = None
    others: tuple[Path, ...] = ()


def find_rig(log: Path, rig_text: str | None, given: Rig | str | Path | None = None) -> Rig | None:
    """Find a log's rig.

    Parameters
    ----------
    log : the log's path
    rig_text : the rig in the log itself, None for none
    given : a loaded rig, a rig file or a preset's name, which has priority

    Returns
    -------
    the rig given; else the one in the log; else `LOG.rig.toml` next to `LOG.ext`; else `rig.toml` in a log that is a folder, else
    in the folder that a log is in; else None

    Raises
    ------
    RigError
        The rig that was found cannot be used.
    """
    if given is not None:
        return given_rig(given, log)
    if rig_text is not None:
        rig = Rig.from_toml(rig_text, f"rig in {log.name}")
        tell_rig(rig, "log", log)
        return rig
    found = rig_beside(log)
    if found is None:
        return None
    rig = Rig.load(found)
    tell_rig(rig, "next to log", log)
    return rig


def given_rig(source: Rig | str | Path, log: Path | None = None) -> Rig:
    """Return the requested rig: one that is loaded, a file, else a preset or TOML text.

    Raises
    ------
    RigError
        There is no such file or preset, or its content is not possible.
    """
    rig = source if isinstance(source, Rig) else Rig.load(source)
    tell_rig(rig, "given", log)
    return rig


def tell_rig(rig: Rig, place: Place, log: Path | None = None) -> None:
    """Report which rig is used, and which others exist where one is searched."""
    if not is_watched():
        return
    others = () if log is None else tuple(other for other in _there(log) if not _same(other, rig))
    tell(RigFound(place, rig.where, rig.path, others))


def rig_beside(log: Path) -> Path | None:
    """Return the rig file next to a log; None where there is none."""
    return next((path for path in _beside(log) if path.is_file()), None)


def _beside(log: Path) -> tuple[Path, ...]:
    inside = (log / "rig.toml",) if log.is_dir() else ()
    return (log.parent / f"{log.stem}.rig.toml", *inside, log.parent / "rig.toml")


def _there(log: Path) -> Iterator[Path]:
    """Yield the rig files next to a log and in the working directory, each once."""
    seen: list[Path] = []
    for path in (*_beside(log), *_beside(Path(log.name))):
        if path.is_file() and not any(path.samefile(other) for other in seen):
            seen.append(path)
            yield path


def _same(other: Path, rig: Rig) -> bool:
    """Return whether a file is the rig's own, or has the same content."""
    if rig.path is not None and rig.path.exists() and other.samefile(rig.path):
        return True
    try:
        return Rig.load(other).to_toml() == rig.to_toml()
    except RigError:
        return False
