"""Contradictions between keys of a joint, which no single key shows."""

from __future__ import annotations

from collections.abc import Iterator

from vsalog.core.errors import did_you_mean
from vsalog.core.units import matching, shown
from vsalog.rig.decode import Path, refuse
from vsalog.rig.pneumatic import pneumatic_problem
from vsalog.rig.schema import (
    AntagonisticJoint,
    AwasTransmission,
    Chain,
    ElasticJoint,
    Friction,
    Joint,
    Motor,
    PneumaticJoint,
    PolynomialTransmission,
    RigFile,
    RigidJoint,
    Run,
    SerialJoint,
    Signal,
    Transmission,
    role_units,
)

RUN = "{run}"

JointWithRuns = ElasticJoint | SerialJoint | AntagonisticJoint | PneumaticJoint


def check_rig(rig: RigFile) -> None:
    """Refuse a rig whose keys contradict each other.

    Raises
    ------
    RigError
        With the path of the key.
    """
    if rig.chain is not None:
        _check_chain(rig, rig.chain)
    for name, joint in rig.joint.items():
        path = ("joint", name)
        for key, friction in frictions(joint):
            _check_friction(friction, (*path, *key, "friction"))
        _check_channels(joint, path)
        _check_sensors(joint, path)
        _check_transmissions(joint, path)
        if isinstance(joint, PneumaticJoint) and (problem := pneumatic_problem(joint)) is not None:
            refuse((*path, *problem[0]), problem[1])
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


def motors(joint: Joint) -> Iterator[tuple[str, Motor]]:
    """Yield the keys of the joint's motors, and the motors."""
    for key in ("motor", "motor_1", "motor_2", "secondary_motor"):
        motor = getattr(joint, key, None)
        if motor is not None:
            yield key, motor


def frictions(joint: Joint) -> Iterator[tuple[tuple[str, ...], Friction]]:
    """Yield the paths of the joint's friction, and the friction."""
    for key, motor in motors(joint):
        yield (key,), motor.friction
    if not isinstance(joint, PneumaticJoint) and joint.link is not None:
        yield ("link",), joint.link.friction


def _check_friction(friction: Friction, path: Path) -> None:
    if friction.static is not None:
        if friction.static < friction.coulomb:
            refuse((*path, "static"), "the break-away level cannot be below 'coulomb'")
        if friction.stribeck_velocity is None:
            refuse(path, "'static' needs a 'stribeck_velocity', over which the level falls to 'coulomb'")
    if friction.presliding_stiffness is None and friction.presliding_damping:
        refuse((*path, "presliding_damping"), "does nothing without a 'presliding_stiffness'")
    if friction.presliding_stiffness is not None and friction.breakaway == 0.0:
        refuse((*path, "presliding_stiffness"), "does nothing without a level: give 'coulomb'")


def _check_chain(rig: RigFile, chain: Chain) -> None:
    path = ("chain",)
    _three(chain.gravity, (*path, "gravity"))
    names: list[str] = []
    for i, link in enumerate(chain.link):
        at = (*path, "link", f"[{i}]")
        if link.joint not in rig.joint:
            refuse((*at, "joint"), f"there is no joint '{shown(link.joint)}'{did_you_mean(link.joint, rig.joint)}")
        if link.joint in names:
            refuse((*at, "joint"), f"joint '{shown(link.joint)}' moves another link already")
        _three(link.centre, (*at, "centre"))
        _three(link.inertia, (*at, "inertia"))
        if link.accelerometer is not None:
            _three(link.accelerometer.position, (*at, "accelerometer", "position"))
            _three(link.accelerometer.orientation, (*at, "accelerometer", "orientation"))
        names.append(link.joint)
    for i, coupling in enumerate(chain.coupling):
        at = (*path, "coupling", f"[{i}]")
        for key, name in (("link", coupling.link), ("motor", coupling.motor)):
            if name not in names:
                refuse((*at, key), f"'{shown(name)}' is not a joint of the chain{did_you_mean(name, names)}")
        if names.index(coupling.link) >= names.index(coupling.motor):
            refuse(at, "the motor's joint has to come after the link's: S is strictly upper triangular")


def _three(numbers: tuple[float, ...], path: Path) -> None:
    if len(numbers) != 3:
        refuse(path, f"{len(numbers)} numbers are given, but three are needed")


def _check_channels(joint: Joint, path: Path) -> None:
    taken: dict[str, str] = {}
    for role, channel in role_channels(joint):
        if channel in taken:
            refuse(
                (*path, "signals", role),
                f"two roles for one channel: '{channel}' is the {taken[channel]} already",
            )
        taken[channel] = role


def _check_sensors(joint: Joint, path: Path) -> None:
    for role in joint.signals.__struct_fields__:
        signal = getattr(joint.signals, role)
        if not isinstance(signal, Signal):
            continue
        for key in ("delay", "jitter"):
            # Stamps count nanoseconds in 64 bits.
            if abs(getattr(signal, key)) * 1e9 >= 2.0**63:
                refuse((*path, "signals", role, key), f"{getattr(signal, key):g} s are longer than any log")
        if signal.series_stiffness is not None and not role.startswith("deflection"):
            refuse((*path, "signals", role, "series_stiffness"), "only a deflection has a part in series")
        units, steepest = role_units(role), 0.0
        for table in signal.KEYS:
            at = (*path, "signals", role, table.name)
            for error in signal.tables(table):
                if units[0] != error.UNIT or (signal.unit is not None and matching(signal.unit, units) != error.UNIT):
                    refuse(at, f"this error is for sensors that measure in {error.UNIT}, and this one does not")
                steepest += error.largest[1]
                if steepest >= signal.gain:
                    refuse(
                        at,
                        f"its slope, {steepest:g}, has to be below the gain, {signal.gain:g}, or the reading falls as what is"
                        " measured rises",
                    )


def _check_transmissions(joint: Joint, path: Path) -> None:
    for key, transmission in transmissions(joint):
        if isinstance(transmission, PolynomialTransmission) and not transmission.coefficients:
            refuse((*path, key, "coefficients"), "at least one coefficient is needed")
        if isinstance(transmission, AwasTransmission) and not isinstance(joint, SerialJoint):
            refuse(
                (*path, key, "type"),
                'an "awas" transmission has a lever arm that a set-point moves; the joint needs kind = "serial"',
            )


def _check_runs(joint: JointWithRuns, path: Path) -> None:
    for role, channel in role_channels(joint):
        if RUN in channel and not any(run.name for run in joint.run):
            refuse(
                (*path, "signals", role),
                f"{RUN} is replaced by the name of a run, but no [[joint.{path[1]}.run]] has a name",
            )
    seen: set[tuple[str, str]] = set()
    for i, run in enumerate(joint.run):
        at = (*path, "run", f"[{i}]")
        _check_setpoint(joint, run, at)
        if (run.name, run.file) in seen:
            refuse(at, f'there is another run with name = "{run.name}" and file = "{run.file}"')
        seen.add((run.name, run.file))


def _check_setpoint(joint: JointWithRuns, run: Run, at: Path) -> None:
    if run.setpoint is None:
        return
    if not isinstance(joint, SerialJoint):
        refuse((*at, "setpoint"), 'only a joint of kind "serial" has a set-point')
    if joint.lever is not None and float(run.setpoint) <= 0.0:
        refuse(
            (*at, "setpoint"),
            f"the lever arm would be {float(run.setpoint):g} m; it has to be longer than 0 (r = start - travel * angle)",
        )
