"""What is wrong with the channels of joints that were guessed, by the checks that the other commands use."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

import numpy as np

from vsalog.binding.joint import bind, offered_roles
from vsalog.checks.recording_faults import findings_of, read_roles
from vsalog.core.errors import VsalogError
from vsalog.core.finding import Finding
from vsalog.core.recording import Recording
from vsalog.rig import Rig
from vsalog.rig.guess_types import Guess
from vsalog.rig.schema import Joint
from vsalog.rig.template import rig_template


def joint_faults(recording: Recording, guess: Guess) -> Iterator[Finding]:
    """Yield what is wrong with the channels of the joints that were guessed, as they were recorded."""
    try:
        joints = Rig.from_toml(rig_template(recording, guess), "the guessed rig").joints
    except VsalogError:
        return
    for name, joint in joints.items():
        currents = [role for role, signal in offered_roles(joint).items() if signal.unit == "A"]
        plain = _as_recorded(joint)
        roles = [role for role in read_roles(offered_roles(plain)) if _is_recorded(recording, plain, role)]
        try:
            signals = bind([recording], name, plain, roles, acting=False)
        except VsalogError:
            continue  # what cannot be bound is said by those who need it
        yield from findings_of(signals, currents)


def _as_recorded(joint: Joint) -> Joint:
    """Return a guessed joint without what the guess did about signs and gears."""
    plain = {role: replace(signal, sign=1, side="joint") for role, signal in offered_roles(joint).items()}
    return replace(joint, signals=replace(joint.signals, **plain))


def _is_recorded(recording: Recording, joint: Joint, role: str) -> bool:
    channel = recording.channels.get(offered_roles(joint)[role].channel or "")
    return channel is not None and bool(np.isfinite(channel.values).any())
