"""Channels that a rig names and a log lacks."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from vsalog.binding.joint import offered_roles, wanted_channels
from vsalog.core.errors import near_names
from vsalog.core.finding import Finding
from vsalog.readers import open_reader


def without_channels(
    log: Path, rate: float | None, missing: Collection[str], name: str, joint: Any
) -> tuple[Any, list[Finding]]:
    """Return a joint without the roles whose channel a log does not have, and a finding for each.

    Parameters
    ----------
    log, rate : as for `open_reader`
    missing : names of channels that are not in it, or have no row
    name, joint : of the rig
    """
    named = {role: wanted_channels(joint, log.name, [role]) & set(missing) for role in offered_roles(joint)}
    lacking = [(role, channel) for role, channels in named.items() for channel in sorted(channels)]
    known = list(open_reader(log, rate).catalogue().channels) if lacking else []
    found = []
    for role, channel in lacking:
        near = " or ".join(f"'{n}'" for n in near_names(channel, known)) if channel not in known else ""
        code = "channel.empty" if channel in known else "channel.misnamed" if near else "channel.missing"
        found.append(Finding(code=code, joint=name, part=role, evidence={"channel": channel, "near": near}))
    signals = replace(joint.signals, **{role: None for role, _ in lacking})
    return replace(joint, signals=signals), found
