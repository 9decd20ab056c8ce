"""Rig files: the properties of joints that a log does not contain."""

from vsalog.rig.load import Rig, presets

__all__ = ["Rig", "presets"]
