"""Signs, units and channels that are wrong: no causes of the catalogue, but the most frequent errors of a new rig."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from msgspec.structs import replace as replace_struct

from vsalog.binding.joint import offered_roles
from vsalog.core.finding import Finding
from vsalog.diagnosis.causes.base import with_part, with_signal
from vsalog.residuals.channels import Channels
from vsalog.residuals.sensing import motors_of, torque_role
from vsalog.residuals.system import System

# What a wrong sign or unit makes of a signal, and whether also of an angle: degrees, and a prefix of SI.
FACTORS = {-1.0: True, float(np.degrees(1.0)): True, float(np.radians(1.0)): True, 1e3: False, 1e-3: False}
# A factor is reported where the equations would close with this part of the residual now, in squares [1], and to this mean square
# over noise [1]: motions made small leave less as well.
RESIDUAL_WITH_FACTOR, SQUARES_WITH_FACTOR = 0.05, 100.0


def hint_of(name: str, joint: Any, system: System) -> Finding | None:
    """Find which signal's sign or unit, or which two exchanged, would close most of the equations; None where none would.

    Parameters
    ----------
    name, joint : of the rig, on the joint's side
    system : of the log
    """
    now = _left(joint, system)
    best, found = min(RESIDUAL_WITH_FACTOR * now, SQUARES_WITH_FACTOR * system.count), None
    for about, changed, there in _changed(joint, system):
        left = _left(changed, there)
        if left < best:
            best = left
            found = replace_struct(about, joint=name, value=min((now / left) ** 0.5, 100.0))
    return found


def _left(joint: Any, system: System) -> float:
    """Return what the equations leave of a joint, in squares of what noise makes of them there."""
    rows = system.averaged(joint)
    noise = np.mean([(copy.averaged(joint) - rows) ** 2 for copy in system.noisy], axis=(0, 1))
    return float(np.sum(rows**2 / (noise + np.diag(system.exact))))


def _changed(joint: Any, system: System) -> Iterator[tuple[Finding, Any, System]]:
    """Yield what may be wrong, and the joint and the log with that corrected."""
    # A signal at rest has neither sign nor unit.
    roles = {role for role, values in system.channels.roles.items() if np.nanmax(values[0]) > np.nanmin(values[0])}
    positions = [r for r in roles if "position" in r or r.startswith("deflection")]
    sensed = [r for r in roles if r.startswith("torque_sensor") or r in positions]
    gains = {role: signal.gain for role, signal in offered_roles(joint).items()}
    for factor, of_angles in FACTORS.items():
        wrong = partial(
            Finding,
            code="rig.sign" if factor < 0.0 else "rig.unit",
            severity="invalidates",
            evidence={"factor": factor},
        )
        own = [[r] for r in sensed if r not in positions or of_angles]
        for those in own + ([positions] if len(positions) > 1 and of_angles else []):
            changed = joint
            for role in those:
                changed = with_signal(changed, role, gain=factor * gains[role])
            yield wrong(part="all positions" if len(those) > 1 else those[0]), changed, system
        for motor in motors_of(joint):
            if (role := torque_role(motor)) in roles:
                # What acts is the recorded torque times the gain: one that is recorded too large acts with less.
                gain = getattr(joint, motor).torque_gain / factor
                yield wrong(part=role), with_part(joint, motor, torque_gain=gain), system
    for a, b in (*combinations(sorted(positions), 2), *combinations(sorted(r for r in roles if "torque" in r), 2)):
        yield (
            Finding(code="rig.exchanged", part=f"{a} and {b}", severity="invalidates"),
            joint,
            _exchanged(system, a, b),
        )


def _exchanged(system: System, a: str, b: str) -> System:
    """Return a log of which two channels were taken for one another."""

    def other(channels: Channels) -> Channels:
        return replace(channels, roles={**channels.roles, a: channels.roles[b], b: channels.roles[a]})

    return replace(system, channels=other(system.channels), copies=tuple(other(copy) for copy in system.copies))
