"""Signs and units that are wrong: no cause of the catalogue, but what a rig that was just written is most often wrong in."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from vsalog.binding import offered_roles
from vsalog.diagnosis.causes.base import with_part, with_signal
from vsalog.residuals.sensing import motors_of, torque_role
from vsalog.residuals.system import System

# What a sign or a unit makes of a signal, and what a person would have meant by it.
FACTORS = {
    -1.0: "the sign",
    180.0 / np.pi: "the unit (degrees for radians?)",
    np.pi / 180.0: "the unit (radians for degrees?)",
    1e3: "the unit (a thousand times too large)",
    1e-3: "the unit (a thousand times too small)",
}
ANGLES = (-1.0, 180.0 / np.pi, np.pi / 180.0)
# It is said where the equations would close with so much of what they leave now, in squares, and to this mean square: motions
# made small leave less as well.
CLOSES, NEAR = 0.05, 100.0


def hint_of(name: str, joint: Any, system: System) -> str | None:
    """Say which one signal's sign or unit, turned round, would close most of the equations; None where none would.

    Parameters
    ----------
    name, joint : of the rig, on the joint's side
    system : of the log
    """
    now = _left(joint, system)
    best, said = min(CLOSES * now, NEAR * system.count), None
    for what, factor, changed in _turned(joint, system):
        left = _left(changed, system)
        if left < best:
            best = left
            better = min((now / left) ** 0.5, 100.0)
            said = (
                f"joint '{name}': with {FACTORS[factor]} of {what} put right the equations would close some {better:.0f} times"
                " better: look at its sign and unit in the rig first; nothing else was looked for"
            )
    return said


def _left(joint: Any, system: System) -> float:
    """Return what the equations leave of a joint, in squares of what noise makes of them there."""
    rows = system.averaged(joint)
    noise = np.mean([(copy.averaged(joint) - rows) ** 2 for copy in system.noisy], axis=(0, 1))
    return float(np.sum(rows**2 / (noise + np.diag(system.exact))))


def _turned(joint: Any, system: System) -> Iterator[tuple[str, float, Any]]:
    """Yield what is turned round, the factor that the log has it by, and the joint with that said."""
    # What stands still has neither sign nor unit.
    roles = {role for role, values in system.channels.roles.items() if np.nanmax(values[0]) > np.nanmin(values[0])}
    positions = [r for r in roles if "position" in r or r.startswith("deflection")]
    sensed = [r for r in roles if r.startswith("torque_sensor") or r in positions]
    gains = {role: signal.gain for role, signal in offered_roles(joint).items()}
    for factor in FACTORS:
        for role in (r for r in sensed if r not in positions or factor in ANGLES):
            yield role, factor, with_signal(joint, role, gain=factor * gains[role])
        if len(positions) > 1 and factor in ANGLES:
            all_of_them = joint
            for role in positions:
                all_of_them = with_signal(all_of_them, role, gain=factor * gains[role])
            yield "all positions", factor, all_of_them
        for motor in motors_of(joint):
            if torque_role(motor) in roles:
                # What acts is the recorded torque times the gain: one that is recorded too large acts with less.
                yield (
                    torque_role(motor),
                    factor,
                    with_part(joint, motor, torque_gain=getattr(joint, motor).torque_gain / factor),
                )
