"""The set-point of a joint whose lever is fitted: an angle was recorded, and the lever makes it a length."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vsalog.binding.joint import offered_roles
from vsalog.binding.role_source import is_angle
from vsalog.core.recording import Recording
from vsalog.residuals.channels import Noise
from vsalog.residuals.windows import Windows
from vsalog.rig.schema import Lever, SerialJoint


def lever_of(recording: Recording, joint: Any, roles: set[str]) -> Lever | None:
    """Return the lever that bound a joint's set-point; none where a length is recorded, or nothing."""
    if not isinstance(joint, SerialJoint) or joint.lever is None or "setpoint" not in roles:
        return None
    signal = offered_roles(joint)["setpoint"]
    channel = None if signal.channel is None else recording.channels.get(signal.channel)
    return joint.lever if channel is not None and is_angle(channel, signal) else None


def bound_by(lever: Lever | None, windows: Windows, joint: Any) -> Windows:
    """Return windows with the set-point that the lever of a joint computes from the recorded angle.

    Parameters
    ----------
    lever : that made it what it is in the windows; none where no lever did
    windows : of the log
    joint : with other numbers
    """
    if lever is None or joint.lever == lever:
        return windows
    ratio, channels = joint.lever.travel / lever.travel, windows.channels
    start = np.array([[joint.lever.start - ratio * lever.start], [0.0], [0.0]])
    there = replace(
        channels,
        roles={**channels.roles, "setpoint": ratio * channels.roles["setpoint"] + start},
        raw={**channels.raw, "setpoint": ratio * channels.raw["setpoint"] + start[0]},
        noise={**channels.noise, "setpoint": _times(channels.noise["setpoint"], abs(ratio))},
    )
    scale = windows.scale
    if scale is not None and "setpoint" in scale:
        scale = {**scale, "setpoint": abs(ratio) * scale["setpoint"]}
    return replace(windows, channels=there, scale=scale)


def _times(noise: Noise, ratio: float) -> Noise:
    return replace(noise, deviation=ratio * noise.deviation, step=ratio * noise.step)
