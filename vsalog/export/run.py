"""One export: a rig in, a model of another simulator as a text out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from vsalog._version import __version__
from vsalog.core.errors import ExportError
from vsalog.effects.counterpart import Dialect
from vsalog.export.assembly import take_apart
from vsalog.export.elements import comment, text_of
from vsalog.export.mjcf import mjcf
from vsalog.export.urdf import urdf
from vsalog.rig.decode import key_path
from vsalog.rig.load import Rig


@dataclass(frozen=True, slots=True)
class Exported:
    """A model.

    Attributes
    ----------
    text : of its file
    joints : of the rig that it has
    notes : on the model
    left_out : key of the rig → why the format does not support it
    """

    text: str
    joints: tuple[str, ...]
    notes: tuple[str, ...]
    left_out: Mapping[str, str]


def export(rig: Rig, dialect: Dialect, *, leave_out: bool = False) -> Exported:
    """Return a rig as a model of another simulator.

    Parameters
    ----------
    rig : it
    dialect : the model's format
    leave_out : whether unsupported keys are left out, and listed as a comment in the text

    Raises
    ------
    ExportError
        The rig lacks what any model needs, or has keys that the format does not support, and `leave_out` is False.
    """
    found = take_apart(rig, dialect)
    root, notes = (mjcf if dialect == "mjcf" else urdf)(found)
    left_out = {key_path(path): reason for path, reason in found.lacking.items()}
    if left_out and not leave_out:
        reasons = "; ".join(f"{key}: {reason}" for key, reason in left_out.items())
        raise ExportError(f"{rig.where}: {reasons} ('--unsupported comment' leaves it out)")
    head = root.makeelement("head", {})
    comment(head, f"{rig.name or rig.where}: written by vsalog {__version__} of {rig.where}. All units are SI.")
    for note in notes:
        comment(head, note)
    for key, reason in left_out.items():
        comment(head, f"left out: {key}: {reason}")
    for i, line in enumerate(head):
        root.insert(i, line)
    return Exported(text_of(root), tuple(found.joints), tuple(notes), left_out)
