"""Where the rig of a log is: given, in the log itself, next to it, or nowhere."""

from __future__ import annotations

from pathlib import Path

from vsalog.rig.load import Rig


def find_rig(log: Path, rig_text: str | None, given: Rig | str | Path | None = None) -> Rig | None:
    """Find a log's rig.

    Parameters
    ----------
    log : the log's path
    rig_text : what the log carries itself, None for nothing
    given : a loaded rig, a rig file or a preset's name, which goes before all else

    Returns
    -------
    the rig given; else the one in the log; else `LOG.rig.toml` next to `LOG.ext`; else `rig.toml` in the same folder; else None

    Raises
    ------
    RigError
        The rig that was found cannot be used.
    """
    if given is not None:
        return given if isinstance(given, Rig) else Rig.load(given)
    if rig_text is not None:
        return Rig.from_toml(rig_text, f"rig in {log.name}")
    found = rig_beside(log)
    return None if found is None else Rig.load(found)


def rig_beside(log: Path) -> Path | None:
    """Return the rig file that lies next to a log; None where there is none."""
    paths = (log.parent / f"{log.stem}.rig.toml", log.parent / "rig.toml")
    return next((path for path in paths if path.is_file()), None)
