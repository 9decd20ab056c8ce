"""What is asked for on the command line → settings that mean the same on every machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vsalog.batch.records import Settings
from vsalog.core.documents import read_text
from vsalog.core.errors import ReadError
from vsalog.rig import Rig


def settings_of(do: str, rig: str | None, model: Path | None, **others: Any) -> Settings:
    """Return the settings, with rig and model read: whoever does the work need not have the files.

    Parameters
    ----------
    do : the command that is run
    rig : file or preset; None where each log's own is looked for
    model : of `validate`
    others : as they stand in `Settings`

    Raises
    ------
    VsalogError
        A file cannot be read, or is not what it should be.
    """
    loaded = None if rig is None else Rig.load(rig)
    text = None if model is None else read_text(model, "model file", ReadError, most=None)
    return Settings(
        do=do,  # type: ignore[arg-type]
        rig=None if loaded is None else loaded.to_toml(),
        rig_name="" if loaded is None else loaded.where,
        model=text,
        model_name="" if model is None else model.name.encode("utf-8", "replace").decode(),
        **others,
    )
