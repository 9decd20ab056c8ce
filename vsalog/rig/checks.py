"""What no single key can show to be wrong: keys of a joint that contradict each other."""

from __future__ import annotations

from collections.abc import Iterator

from vsalog.rig.decode import Path, refuse
from vsalog.rig.schema import (
    AntagonisticJoint,
    AwasTransmission,
    ElasticJoint,
    Joint,
    RigFile,
    RigidJoint,
    Run,
    SerialJoint,
    Signal,
    Transmission,
)

RUN = "{run}"


def check_rig(rig: RigFile) -> None:
    """Refuse a rig whose keys contradict each other.

    Raises
    ------
    RigError
        With the path of the key.
    """
    for name, joint in rig.joint.items():
        path = ("joint", name)
        _check_channels(joint, path)
        _check_transmissions(joint, path)
        if not isinstance(joint, RigidJoint):
            _check_runs(joint, path)


def role_channels(joint: Joint) -> Iterator[tuple[str, str]]:
    """Yield the joint's roles that are read from a channel, and the channel's name."""
    for role in joint.signals.__struct_fields__:
        spec = getattr(joint.signals, role)
        channel = spec.channel if isinstance(spec, Signal) else spec
        if isinstance(channel, str):
            yield role, channel


def transmissions(joint: Joint) -> Iterator[tuple[str, Transmission]]:
    """Yield the keys of the joint's transmissions, and the transmissions."""
    if isinstance(joint, ElasticJoint | SerialJoint):
        yield "transmission", joint.transmission
    if isinstance(joint, AntagonisticJoint):
        yield "transmission_1", joint.transmission_1
        yield "transmission_2", joint.transmission_2


def _check_channels(joint: Joint, path: Path) -> None:
    taken: dict[str, str] = {}
    for role, channel in role_channels(joint):
        if channel in taken:
            refuse(
                (*path, "signals", role),
                f"two roles for one channel: '{channel}' is the {taken[channel]} already",
            )
        taken[channel] = role


def _check_transmissions(joint: Joint, path: Path) -> None:
    if isinstance(joint, SerialJoint):
        return
    for key, transmission in transmissions(joint):
        if isinstance(transmission, AwasTransmission):
            refuse(
                (*path, key, "type"),
                'an "awas" transmission has a lever arm that a set-point moves; the joint needs kind = "serial"',
            )


def _check_runs(joint: ElasticJoint | SerialJoint | AntagonisticJoint, path: Path) -> None:
    for role, channel in role_channels(joint):
        if RUN in channel and not any(run.name for run in joint.run):
            refuse(
                (*path, "signals", role),
                f"{RUN} stands for the name of a run, but no [[joint.{path[1]}.run]] has a name",
            )
    seen: set[tuple[str, str]] = set()
    for i, run in enumerate(joint.run):
        at = (*path, "run", f"[{i}]")
        _check_setpoint(joint, run, at)
        if (run.name, run.file) in seen:
            refuse(at, f'there is another run with name = "{run.name}" and file = "{run.file}"')
        seen.add((run.name, run.file))


def _check_setpoint(joint: ElasticJoint | SerialJoint | AntagonisticJoint, run: Run, at: Path) -> None:
    if run.setpoint is None:
        return
    if not isinstance(joint, SerialJoint):
        refuse((*at, "setpoint"), 'only a joint of kind "serial" has a set-point')
    if joint.lever is not None and float(run.setpoint) <= 0.0:
        refuse(
            (*at, "setpoint"),
            f"the lever arm would be {float(run.setpoint):g} m; it has to be longer than 0 (r = start - travel * angle)",
        )
