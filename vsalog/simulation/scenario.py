"""Scenarios: the inputs of a rig's joints over time, from TOML to the inputs of `simulate`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from vsalog.core.documents import read_text
from vsalog.core.errors import RigError, SimulationError, UnitError, VsalogError, did_you_mean
from vsalog.core.toml import parse_toml
from vsalog.core.units import parse_quantity, parse_unit, shown, split_quantity
from vsalog.rig.decode import Path as KeyPath
from vsalog.rig.decode import decode, key_path, refuse
from vsalog.rig.load import Rig, presets
from vsalog.rig.roles import COMMANDS
from vsalog.rig.schema import AntagonisticJoint, Joint, RigFile, SerialJoint
from vsalog.simulation.control import Controller, controller_of
from vsalog.simulation.inputs import Input, Motion, Servo
from vsalog.simulation.machine import drive_of
from vsalog.simulation.scenario_generic import GENERIC, generic
from vsalog.simulation.scenario_parts import sum_of_parts
from vsalog.simulation.scenario_schema import (
    Csv,
    Drives,
    Multisine,
    Part,
    Parts,
    PiControlDrive,
    ScenarioFile,
    ServoDrive,
    StateFeedbackDrive,
    Steps,
    StiffnessControlDrive,
    Trapezoid,
)

MOST_SINES = 2000
"""Sines of a multisine, at most: a finer spectrum than a log of minutes resolves, which costs as many evaluations per sample."""

# The SI unit of a role's input, by how the role's name begins or ends.
TORQUE, ANGLE, VELOCITY, VOLTAGE, STIFFNESS = "N*m", "rad", "rad/s", "V", "N*m/rad"
# Keys of a part that are in the role's unit.
_ROLE_KEYS = ("value", "amplitude", "offset", "rms")
_FREQUENCY_KEYS = ("frequency", "start_frequency", "end_frequency", "spacing", "lowest_frequency", "highest_frequency")
# The roles that a controller drives, of several the first that the joint has.
COMMANDED = {
    "state_feedback": (("motor_torque",),),
    "pi_control": (("valve_1", "valve_2"),),
    "stiffness_control": (("motor_torque_1", "motor_torque_2"), ("motor_torque", "secondary_torque")),
}


@dataclass(frozen=True, slots=True)
class Scenario:
    """A scenario that was read and checked, all values in SI.

    Attributes
    ----------
    file : its structures
    where : its name in messages
    folder : that its paths are relative to
    """

    file: ScenarioFile
    where: str = "scenario"
    folder: Path = Path()

    @classmethod
    def load(cls, source: str | Path) -> Scenario:
        """Load a scenario file, or one that comes with vsalog, by its name.

        Raises
        ------
        SimulationError
            There is no such file or scenario, or its content is not possible.
        """
        path = Path(source)
        if path.is_file():
            return cls.from_toml(read_text(path, "scenario file", SimulationError), path.name, path.parent)
        if isinstance(source, str) and source in built_in():
            return cls.from_toml(_built_in_text(source), f"scenario {source}")
        raise SimulationError(
            f"there is no scenario '{shown(str(source))}'{did_you_mean(str(source), [*built_in(), *GENERIC]) or '.'}"
            " ('vsalog simulate --list' names those that come with vsalog; a file is a path to a TOML file)"
        )

    @classmethod
    def from_toml(cls, text: str, where: str = "scenario", folder: Path = Path()) -> Scenario:
        """Load from TOML text.

        Raises
        ------
        SimulationError
            The text is no TOML, or its content is not possible; the message names the key.
        """
        try:
            tables = parse_toml(text)
        except ValueError as error:
            raise SimulationError(f"{where}: is not valid TOML: {shown(str(error))}") from error
        try:
            file = decode(_in_si(tables), ScenarioFile)
            _check(file)
        except RigError as error:
            raise SimulationError(f"{where}: {error}") from None
        return cls(file, where, folder)

    @classmethod
    def find(cls, source: str | None, rig: RigFile, period: float | None = None) -> Scenario:
        """Load what was asked for, a generic one sized to the rig, or the one that suits the rig when nothing was.

        Parameters
        ----------
        source : a file, or the name of a scenario; the first experiment of the preset that has the rig's joints, else
            ``sines``, when absent
        rig : the machine
        period : sample time that is asked for, which bounds the gains of generic servos [s]

        Raises
        ------
        SimulationError
            As `load`.
        """
        name = source or usual_scenario(rig)
        if name in GENERIC and not Path(name).is_file():
            return cls(generic(name, rig, period or 1e-3), f"scenario {name}")
        return cls.load(name)

    def lasting(self, duration: float | None, period: float | None) -> Scenario:
        """Return the scenario with another duration or sample time [s]; None leaves its own."""
        file = self.file
        return replace(
            self,
            file=msgspec.structs.replace(
                file,
                duration=file.duration if duration is None else duration,
                period=file.period if period is None else period,
            ),
        )

    def files(self) -> list[Path]:
        """Return the files that the scenario reads."""
        parts = (
            p for drives in self.file.joint.values() for key in Drives.__struct_fields__ for p in _all(drives, key)
        )
        return [self.folder / part.file for part in parts if isinstance(part, Csv)]

    def inputs(self, rig: RigFile) -> dict[str, dict[str, Input]]:
        """Return joint → role → input, as `simulate` takes them.

        Raises
        ------
        SimulationError
            The rig has no such joint, the joint no such role, or a file's column cannot be used.
        """
        inputs: dict[str, dict[str, Input]] = {}
        for name, drives in self.file.joint.items():
            if name not in rig.joint:
                raise SimulationError(
                    f"{self.where}: joint.{key_path((name,))}: rig '{shown(rig.name)}' has no such joint"
                    f"{did_you_mean(name, rig.joint) or '; it has ' + ', '.join(map(shown, rig.joint))}"
                )
            try:
                inputs[name] = self._joint(name, drives, rig.joint[name])
            except VsalogError as error:
                raise SimulationError(f"{self.where}: {error}") from error
        return inputs

    def controllers(self, rig: RigFile) -> dict[str, Controller]:
        """Return joint → controller, as `simulate` takes them.

        Raises
        ------
        SimulationError
            The joint is of a kind that the controller is not for.
        """
        found: dict[str, Controller] = {}
        for name, drives in self.file.joint.items():
            for key in COMMANDED:
                drive = getattr(drives, key)
                if drive is None or name not in rig.joint:
                    continue
                path = ("joint", name, key)
                known = driven_roles(rig.joint[name])
                try:
                    if not any(set(roles) <= set(known) for roles in COMMANDED[key]):
                        roles = min(COMMANDED[key], key=lambda roles: len(set(roles) - set(known)))
                        lacking = next(role for role in roles if role not in known)
                        refuse(path, f"it drives {' and '.join(roles)}, and this joint has no {lacking}")
                    units = _reference_units(key, drive.of if isinstance(drive, PiControlDrive) else "")
                    references = {
                        its: sum_of_parts(getattr(drive, its), unit, self.file.duration, self.folder, (*path, its))
                        for its, unit in units.items()
                    }
                except VsalogError as error:
                    raise SimulationError(f"{self.where}: {error}") from error
                found[name] = controller_of(drive, references)
        return found

    def _joint(self, name: str, drives: Drives, joint: Joint) -> dict[str, Input]:
        known = driven_roles(joint)
        inputs: dict[str, Input] = {}
        for key in Drives.__struct_fields__:
            drive = getattr(drives, key)
            if not drive or key in COMMANDED:
                continue
            path, role = ("joint", name, key), role_of(key)
            if role not in known:
                refuse(path, f"this joint has no such input; it has {', '.join(known) or 'none'}")
            if isinstance(drive, tuple):
                signal = sum_of_parts(drive, unit_of(key), self.file.duration, self.folder, path)
                moved = key.split("_")[1] == "position" and key != role
                inputs[role] = Motion(signal) if moved else signal
            else:
                at = (*path, "reference")
                reference = sum_of_parts(drive.reference, ANGLE, self.file.duration, self.folder, at)
                limit = float("inf") if drive.limit is None else drive.limit
                inputs[role] = Servo(reference, drive.stiffness, drive.damping, limit)
        return inputs


def built_in() -> dict[str, str]:
    """Return the scenarios that come with vsalog as files: name → description."""
    found = {}
    for entry in sorted(_folder().iterdir(), key=lambda e: e.name):
        if entry.name.endswith(".toml"):
            tables = parse_toml(entry.read_text(encoding="utf-8"))
            found[entry.name.removesuffix(".toml")] = str(tables.get("description", ""))
    return found


def usual_scenario(rig: RigFile) -> str:
    """Return the first experiment of the preset whose joints have the names and kinds of the rig's; else ``sines``."""
    joints = {name: type(joint) for name, joint in rig.joint.items()}
    for preset in presets():
        if f"{preset}-exp1" in built_in():
            theirs = Rig.preset(preset).joints
            if {name: type(joint) for name, joint in theirs.items()} == joints:
                return f"{preset}-exp1"
    return "sines"


def driven_roles(joint: Joint) -> tuple[str, ...]:
    """Return the roles of a joint that can be driven."""
    signals = joint.signals.__struct_fields__
    valves = tuple(role for role in ("valve_1", "valve_2") if role in signals)
    if valves:
        return (*valves, "external_torque")
    if isinstance(joint, AntagonisticJoint):
        return ("motor_torque_1", "motor_torque_2", "external_torque")
    commanded = COMMANDS if drive_of(joint) is not None else ()
    secondary = ("secondary_torque",) if isinstance(joint, SerialJoint) else ()
    return ("motor_torque", *commanded, *secondary, "external_torque")


def role_of(key: str) -> str:
    """Return the role that a key of `Drives` drives: a motor's servo and its position replace its torque."""
    return key if key in COMMANDS else key.replace("_servo", "_torque").replace("_position", "_torque")


def unit_of(key: str) -> str:
    """Return the SI unit of the parts of a key of `Drives`."""
    if key.startswith("valve"):
        return VOLTAGE
    if key == "commanded_velocity":
        return VELOCITY
    return TORQUE if "torque" in key else ANGLE


def _all(drives: Drives, key: str) -> Parts:
    """Return the parts of a key, those of a servo's or a controller's references included."""
    return tuple(part for parts in _by_path(drives, key).values() for part in parts)


def _by_path(drives: Drives, key: str) -> dict[KeyPath, Parts]:
    """Return the parts of a key by their place below it."""
    drive = getattr(drives, key)
    if isinstance(drive, ServoDrive | StateFeedbackDrive | PiControlDrive | StiffnessControlDrive):
        return {(its,): getattr(drive, its) for its in _reference_units(key, "")}
    return {(): drive or ()}


def _folder() -> Any:
    return resources.files("vsalog.simulation") / "scenarios"


def _built_in_text(name: str) -> str:
    text: str = (_folder() / f"{name}.toml").read_text(encoding="utf-8")
    return text


def _in_si(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Turn the texts whose unit depends on the role into SI; whatever has another shape is left for the decoder to refuse."""
    out = dict(tables)
    if isinstance(joints := out.get("joint"), dict):
        out["joint"] = {
            name: {key: _drive(value, key, ("joint", name, key)) for key, value in drives.items()}
            if isinstance(drives, dict)
            else drives
            for name, drives in joints.items()
        }
    return out


def _drive(value: Any, key: str, path: KeyPath) -> Any:
    if key not in Drives.__struct_fields__:
        return value
    if "servo" not in key and key not in COMMANDED:
        return _parts(value, unit_of(key), path)
    if isinstance(value, dict):
        units = _reference_units(key, str(value.get("of", "")))
        parts = {its: _parts(value[its], unit, (*path, its)) for its, unit in units.items() if its in value}
        return {**value, **parts}
    return value


def _reference_units(key: str, of: str) -> dict[str, str]:
    """Return the SI units of a servo's or a controller's references, by their keys."""
    if key == "stiffness_control":
        return {"position": ANGLE, "stiffness": STIFFNESS}
    return {"reference": TORQUE if key == "pi_control" and of == "torque_sensor" else ANGLE}


def _parts(value: Any, unit: str, path: KeyPath) -> list[Any]:
    if isinstance(value, dict):  # one part may be written as a table
        return [_part(value, unit, path)]
    if not isinstance(value, list):
        refuse(path, f'tables are wanted here: write [[{key_path(path)}]] and type = "sine" or another below it')
    return [_part(item, unit, (*path, f"[{i}]")) for i, item in enumerate(value)]


def _part(value: Any, unit: str, path: KeyPath) -> Any:
    if not isinstance(value, dict):
        return value
    out = dict(value)
    for key, item in value.items():
        if key in _ROLE_KEYS and isinstance(item, str):
            out[key] = _quantity(item, unit, (*path, key))
        elif key == "values" and isinstance(item, list):
            out[key] = [
                _quantity(v, unit, (*path, key, f"[{i}]")) if isinstance(v, str) else v for i, v in enumerate(item)
            ]
        elif key in _FREQUENCY_KEYS and isinstance(item, str):
            _check_frequency(item, (*path, key))
    return out


def _quantity(text: str, unit: str, path: KeyPath) -> float:
    try:
        return parse_quantity(text, unit)
    except UnitError as error:
        refuse(path, str(error))


def _check_frequency(text: str, path: KeyPath) -> None:
    """Refuse rpm and rad/s, whose angle would be dropped and the number be wrong by 2π."""
    try:
        _, unit = split_quantity(text)
        angular = parse_unit(unit).dimension[-1] != 0.0
    except UnitError as error:
        refuse(path, str(error))
    if angular:
        refuse(path, f"'{shown(unit)}' is an angular velocity, but a frequency (Hz, 1/s) is wanted")


def _check(file: ScenarioFile) -> None:
    """Refuse errors that no single key shows."""
    for name, drives in file.joint.items():
        taken: dict[str, str] = {}
        for key in Drives.__struct_fields__:
            drive = getattr(drives, key)
            if not drive:
                continue
            path = ("joint", name, key)
            drives_motor = key in COMMANDS
            commanded = [role for roles in COMMANDED.get(key, ((role_of(key),),)) for role in roles]
            for role in ("motor_torque",) if drives_motor else commanded:
                if role in taken and not {key, taken[role]} <= set(COMMANDS):
                    what = "valve" if role.startswith("valve") else "motor"
                    refuse(path, f"'{taken[role]}' drives the same {what}; keep one of them")
                taken[role] = key
            for below, parts in _by_path(drives, key).items():
                for i, part in enumerate(parts):
                    _check_part(part, (*path, *below, f"[{i}]"))


def _check_part(part: Part, path: KeyPath) -> None:
    if isinstance(part, Steps):
        if len(part.times) != len(part.values):
            refuse(path, f"{len(part.times)} times are given for {len(part.values)} values")
        if any(b <= a for a, b in zip(part.times, part.times[1:], strict=False)):
            refuse((*path, "times"), "each time has to be later than the one before")
    if isinstance(part, Trapezoid) and part.period is not None:
        whole = part.rise + part.hold + (part.rise if part.fall is None else part.fall)
        if part.period < whole:
            refuse((*path, "period"), f"is shorter than the trapezoid itself, which takes {whole:g} s")
    if isinstance(part, Multisine):
        lowest = part.spacing if part.lowest_frequency is None else part.lowest_frequency
        if part.highest_frequency < max(lowest, part.spacing):
            refuse((*path, "highest_frequency"), "there is no multiple of 'spacing' up to it")
        if part.highest_frequency / part.spacing > MOST_SINES:
            refuse((*path, "spacing"), f"makes more than {MOST_SINES} sines; take a wider one")
