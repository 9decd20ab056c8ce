"""Stiffness, with honest uncertainty, from the recordings of compliant robot joints.

The main job in three lines::

    import vsalog

    (joint,) = vsalog.estimate("exp1.mcap")
    joint.trace["total"]["stiffness"]  # numpy array [N·m/rad]
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from vsalog._version import __version__
from vsalog.core.errors import VsalogError

if TYPE_CHECKING:
    from vsalog.core.model import ModelFile
    from vsalog.core.recording import Recording
    from vsalog.estimation.estimate import estimate
    from vsalog.readers import read
    from vsalog.rig import Rig

__all__ = ["ModelFile", "Recording", "Rig", "VsalogError", "__version__", "estimate", "read"]

_LAZY = {
    "ModelFile": "vsalog.core.model",
    "Recording": "vsalog.core.recording",
    "Rig": "vsalog.rig",
    "estimate": "vsalog.estimation.estimate",
    "read": "vsalog.readers",
}


def __getattr__(name: str) -> Any:
    """Import what is heavy when it is asked for."""
    if name not in _LAZY:
        raise AttributeError(f"module 'vsalog' has no attribute '{name}'")
    return getattr(import_module(_LAZY[name]), name)
