"""Stiffness, with honest uncertainty, from the recordings of compliant robot joints.

A function per command, and results that print, plot and become tables::

    import vsalog

    (joint,) = found = vsalog.estimate("exp1.mcap")
    joint.trace["total"]["stiffness"]  # numpy array [N·m/rad]
    found.plot()  # a figure of matplotlib
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from vsalog._version import __version__
from vsalog.core.errors import VsalogError, VsalogWarning

if TYPE_CHECKING:
    from vsalog.api.compare import Comparison, compare
    from vsalog.api.diagnose import Diagnosis, diagnose
    from vsalog.api.estimate import Estimate, estimate
    from vsalog.api.identify import Identification, identify
    from vsalog.api.inspect import Inspection, inspect
    from vsalog.api.plan import Plan, plan
    from vsalog.api.results import Results
    from vsalog.api.simulate import Simulation, simulate
    from vsalog.api.validate import Validation, validate
    from vsalog.core.finding import Finding
    from vsalog.core.model import ModelFile
    from vsalog.core.recording import Recording
    from vsalog.readers import read
    from vsalog.rig import Rig

__all__ = [
    "Comparison",
    "Diagnosis",
    "Estimate",
    "Finding",
    "Identification",
    "Inspection",
    "ModelFile",
    "Plan",
    "Recording",
    "Results",
    "Rig",
    "Simulation",
    "Validation",
    "VsalogError",
    "VsalogWarning",
    "__version__",
    "compare",
    "diagnose",
    "estimate",
    "identify",
    "inspect",
    "plan",
    "read",
    "simulate",
    "validate",
]

_LAZY = {
    "Comparison": "vsalog.api.compare",
    "Diagnosis": "vsalog.api.diagnose",
    "Estimate": "vsalog.api.estimate",
    "Finding": "vsalog.core.finding",
    "Identification": "vsalog.api.identify",
    "Inspection": "vsalog.api.inspect",
    "ModelFile": "vsalog.core.model",
    "Plan": "vsalog.api.plan",
    "Recording": "vsalog.core.recording",
    "Results": "vsalog.api.results",
    "Rig": "vsalog.rig",
    "Simulation": "vsalog.api.simulate",
    "Validation": "vsalog.api.validate",
    "compare": "vsalog.api.compare",
    "diagnose": "vsalog.api.diagnose",
    "estimate": "vsalog.api.estimate",
    "identify": "vsalog.api.identify",
    "inspect": "vsalog.api.inspect",
    "plan": "vsalog.api.plan",
    "read": "vsalog.readers",
    "simulate": "vsalog.api.simulate",
    "validate": "vsalog.api.validate",
}


def __getattr__(name: str) -> Any:
    """Import heavy modules on first use."""
    if name not in _LAZY:
        raise AttributeError(f"module 'vsalog' has no attribute '{name}'")
    found = globals()[name] = getattr(import_module(_LAZY[name]), name)
    return found


def __dir__() -> list[str]:
    """Return all names, also those not imported yet."""
    return sorted(__all__)
