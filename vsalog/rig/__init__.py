"""Rig files: what a log does not say about the joints it was recorded on."""

from vsalog.rig.load import Rig, presets

__all__ = ["Rig", "presets"]
