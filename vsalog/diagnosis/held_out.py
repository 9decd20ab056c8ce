"""What held-out data says of causes: those that do not make its simulation better are dropped."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes.base import Site
from vsalog.diagnosis.channels import channels_of
from vsalog.diagnosis.fit import Fit, applied, fitted
from vsalog.diagnosis.gain import Compared, compared, floors
from vsalog.diagnosis.selection import Selection
from vsalog.diagnosis.system import System
from vsalog.diagnosis.windows import Windows, windows_of
from vsalog.signals import JointSignals

Array = NDArray[np.float64]


def held_out_windows(joint: Any, own: Windows, holdout: JointSignals | None) -> tuple[Windows, str]:
    """Return the windows to measure the gain on, and what they are called."""
    if holdout is None:
        return own, "windows of the log itself"
    return windows_of(joint, channels_of(holdout), own.hold), "the held-out log"


def kept_by(
    name: str, system: System, joint: Any, selection: Selection, windows: Windows
) -> tuple[Fit, Compared, list[str]]:
    """Drop causes that do not make the simulation of the held-out windows better."""
    fit, dropped = selection.fit, list[str]()
    gain = compared(joint, fit.joint(joint) if fit.sites else joint, windows, noise=False)
    worth = {c.site.key: float((c.before - c.after).sum()) for c in selection.choices}
    weakest_first = sorted((c.site for c in selection.choices), key=lambda s: worth[s.key])

    def drop(site: Site) -> None:
        nonlocal fit, gain
        rest, start = others_of(fit, site)
        fit = fitted(system, joint, rest, start, selection.blocks)
        extended = fit.joint(joint) if rest else joint
        gain = compared(joint, extended, gain.windows, first=gain.before, near=gain.after, noise=False)
        dropped.append(
            f"joint '{name}': {site.cause} would explain part of the equations, but does not make the simulation of held-out data"
            " better: it is not kept"
        )

    for site in weakest_first:
        less = gain
        if len(fit.sites) > 1:
            without_it = applied(joint, *others_of(fit, site))
            less = compared(without_it, fit.joint(joint), gain.windows, second=gain.after, near=gain.after, noise=False)
        if not less.helps:
            drop(site)
    # Wrong ones may need each other: each helps beside the others, and all together do not.
    for site in weakest_first:
        if fit.sites and not gain.helps and site.key in {s.key for s in fit.sites}:
            drop(site)
    return fit, replace(gain, floor=floors(fit.joint(joint), gain.windows, gain.after)), dropped


def others_of(fit: Fit, site: Site) -> tuple[tuple[Site, ...], Array]:
    """Return the causes of a fit but one, and their values."""
    rest = tuple(s for s in fit.sites if s.key != site.key)
    return rest, np.concatenate([fit.own(s) for s in rest]) if rest else np.zeros(0)
