"""What `simulate --replay` says: how far the simulation is from what was measured."""

from __future__ import annotations

import json
from collections.abc import Mapping

from rich.console import Console

from vsalog.core.units import shown
from vsalog.simulation.replay_job import JointReplay, ReplayJob, position_of, unit_of


def say_replayed(job: ReplayJob, joints: Mapping[str, JointReplay]) -> None:
    """Say on stderr what was written, what drove it, and how far it is off."""
    console = Console(stderr=True, markup=False, highlight=False)
    rig = "" if job.files.rig is None else f"; its rig: {shown(str(job.files.rig))}"
    console.print(f"{shown(str(job.files.log))}: {shown(job.log.name)} replayed{rig}", soft_wrap=True)
    for name, joint in joints.items():
        drives = ", ".join(_drive(role, how) for role, how in joint.driven.items()) or "nothing"
        begun = "once" if joint.restarts == 1 else f"{joint.restarts} times"
        console.print(f"  {shown(name)}: driven by {drives}; begun {begun} from the measured state", soft_wrap=True)
        for role in joint.compared():
            console.print(f"    {role}: {_off(joint, role)}", soft_wrap=True)
    for name, why in job.left_out.items():
        console.print(f"  {shown(name)}: left out: it {why}", soft_wrap=True)


def _drive(role: str, how: str) -> str:
    return role if how == "torque" else f"the measured {position_of(role)}"


def _off(joint: JointReplay, role: str) -> str:
    rms, spread = joint.error(role)
    share = f", {100.0 * rms / spread:.2g} % of its spread" if spread > 0.0 else ""
    return f"{rms:.3g} {unit_of(role)} rms off{share}"


def as_document(job: ReplayJob, joints: Mapping[str, JointReplay]) -> str:
    """Return what was written as JSON."""
    return json.dumps(
        {
            "log": str(job.files.log),
            "format": job.files.format,
            "rig_file": None if job.files.rig is None else str(job.files.rig),
            "rig": job.rig.name,
            "replayed": str(job.log),
            "window": job.options.window,
            "joints": {
                name: {
                    "samples": len(joint.signals),
                    "driven": dict(joint.driven),
                    "restarts": joint.restarts,
                    "rms_error": {role: joint.error(role)[0] for role in joint.compared()},
                    "spread": {role: joint.error(role)[1] for role in joint.compared()},
                }
                for name, joint in joints.items()
            },
            "left_out": dict(job.left_out),
        },
        indent=2,
    )
