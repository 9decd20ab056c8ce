"""Rigs: from a file, a text, a log's own record or a preset, and back to TOML."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from vsalog.core.documents import read_text, toml_tables
from vsalog.core.errors import RigError, did_you_mean
from vsalog.core.printable import plural, printable
from vsalog.core.toml import parse_toml
from vsalog.core.units import shown
from vsalog.rig.checks import check_rig
from vsalog.rig.decode import decode_rig, key_path
from vsalog.rig.merge import Table, merged
from vsalog.rig.schema import Joint, RigFile
from vsalog.rig.uncertain import Path as KeyPath
from vsalog.rig.uncertain import Tolerance, put_stated, value_at


@dataclass(frozen=True, slots=True, repr=False)
class Rig:
    """A loaded rig: every value checked and in SI, the preset it started from worked in.

    Attributes
    ----------
    file : its structures
    where : its name in messages: the file's name, a log's name, or ``preset vsa2``
    stated : the tolerances it states, by the paths of their keys from the file's root; `tolerances` is easier to read
    path : of its file; None where it is in no file of its own
    """

    file: RigFile
    where: str = "rig"
    stated: Mapping[KeyPath, Tolerance] = field(default_factory=dict)
    path: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.file, RigFile):
            raise RigError(f"a {type(self.file).__name__} is no rig: Rig.load(PATH) and Rig.preset(NAME) load one")

    def __repr__(self) -> str:
        return f"<vsalog Rig: {printable(self.where)}, {plural(len(self.joints), 'joint')}>"

    def __str__(self) -> str:
        return self.where

    @classmethod
    def load(cls, source: str | Path) -> Rig:
        """Load from a file's path, a preset's name or TOML text.

        Raises
        ------
        RigError
            There is no such file or preset, or its content is not possible.
        """
        if isinstance(source, str) and ("\n" in source or "=" in source):
            return cls.from_toml(source, "rig")
        path = Path(source)
        if path.is_file():
            return replace(cls.from_toml(read_text(path, "rig file", RigError), path.name), path=path)
        if isinstance(source, str) and source in presets():
            return cls.preset(source)
        hint = did_you_mean(str(source), presets())
        raise RigError(
            f"there is no rig file '{shown(str(source))}'{hint or '.'}"
            f" (presets: {', '.join(presets())}; 'vsalog init LOG' writes a rig file)"
        )

    @classmethod
    def from_toml(cls, text: str, where: str = "rig") -> Rig:
        """Load from TOML text; `where` is its name in messages.

        Raises
        ------
        RigError
            The text is no TOML, or its content is not possible; the message names the key.
        """
        return _build(_parse(text, where), where)

    @classmethod
    def preset(cls, name: str) -> Rig:
        """Load one of the rigs that come with vsalog.

        Raises
        ------
        RigError
            There is no preset of that name.
        """
        return cls.from_toml(preset_text(name), f"preset {name}")

    @property
    def name(self) -> str:
        """The rig's name in reports."""
        return self.file.name

    @property
    def joints(self) -> Mapping[str, Joint]:
        """The joints by name."""
        return self.file.joint

    @property
    def tolerances(self) -> dict[str, dict[str, float]]:
        """The tolerances of each joint's quantities that the rig states.

        By joint, then by the key's path below it, such as ``motor.inertia`` or ``motor.cogging[0].torque``: one standard
        deviation in the unit and on the side of the gear of the rig's own value.
        """
        found: dict[str, dict[str, float]] = {name: {} for name in self.joints}
        for (top, *path), tolerance in self.stated.items():
            if top == "joint":
                found[path[0]][key_path(tuple(path[1:]))] = tolerance.deviation
        return found

    @property
    def chain_tolerances(self) -> dict[str, float]:
        """The same for the keys of the chain, such as ``link[0].mass``."""
        chain = {path[1:]: tolerance for path, tolerance in self.stated.items() if path[0] == "chain"}
        return {key_path(path): tolerance.deviation for path, tolerance in chain.items()}

    def with_joints(self, joints: Mapping[str, Joint], where: str | None = None) -> Rig:
        """Return the rig with other joints; a quantity whose value stays the same keeps its tolerance."""
        file = msgspec.structs.replace(self.file, joint=dict(joints))
        kept = {path: t for path, t in self.stated.items() if value_at(file, path) == value_at(self.file, path)}
        return replace(self, file=file, where=self.where if where is None else where, stated=kept)

    def to_toml(self) -> str:
        """Write the rig as TOML that loads to an equal rig: everything in SI, defaults left out, tolerances with ±."""
        import tomli_w  # only needed for writing

        return tomli_w.dumps(self._tables())

    def with_setting(self, key: str, value: str, where: str = "--set") -> Rig:
        """Return the rig with one key changed, as by `--set joint.elbow.motor.inertia="7.3 kg*m*mm"`.

        Parameters
        ----------
        key : its path as TOML writes it, e.g. ``joint.elbow.motor.inertia``; ``…run[0].setpoint`` for a run
        value : as TOML, or a text without quotes
        where : its name in messages

        Raises
        ------
        RigError
            There is no such key, or it cannot have that value.
        """
        return self.with_settings({key: value}, where)

    def with_settings(self, settings: Mapping[str, str], where: str = "--set") -> Rig:
        """Return the rig with keys changed, all at once: keys that need each other may come in any order.

        Parameters
        ----------
        settings : key → value, as for `with_setting`
        where : the name of the settings in messages

        Raises
        ------
        RigError
            There is no such key, or it cannot have that value.
        """
        if not settings:
            return self
        tables = self._tables()
        for key, value in settings.items():
            tables = _put(tables, _split_key(key, where), _setting(value), where, self.file)
        changed = _build(tables, where)
        return replace(self, file=changed.file, stated=changed.stated)

    def renamed(self, where: str) -> Rig:
        """Return the rig with another name for messages."""
        return replace(self, where=where)

    def _tables(self) -> Table:
        tables = toml_tables(self.file)
        put_stated(tables, self.file, self.stated)
        return tables


def presets() -> list[str]:
    """Return the names of the rigs that come with vsalog."""
    folder = resources.files("vsalog.rig") / "presets"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def preset_text(name: str) -> str:
    """Return a preset's TOML with its comments.

    Raises
    ------
    RigError
        There is no preset of that name.
    """
    known = presets()
    if name not in known:
        hint = did_you_mean(name, known)
        raise RigError(f"there is no preset '{shown(name)}'{hint or '.'} (presets: {', '.join(known)})")
    return (resources.files("vsalog.rig") / "presets" / f"{name}.toml").read_text(encoding="utf-8")


def _parse(text: str, where: str) -> Table:
    try:
        return parse_toml(text)
    except ValueError as error:
        # "At end of document" is of little help in a long one.
        why = shown(str(error)).replace("at end of document", f"at the end, line {len(text.splitlines())}")
        raise RigError(f"{where}: is not valid TOML: {why}") from error


def _build(tables: Table, where: str) -> Rig:
    try:
        tables, preset = _over_preset(tables)
    except RigError as error:
        raise RigError(f"{where}: {error}") from None
    try:
        file, stated = decode_rig(tables)
        check_rig(file)
    except RigError as error:
        raise RigError(f"{where}: {error}{preset}") from None
    return Rig(file, where, stated)


def _over_preset(tables: Table) -> tuple[Table, str]:
    """Merge the tables into the preset they name; also return the part of a message about the preset."""
    if "preset" not in tables:
        return tables, ""
    name = tables["preset"]
    if not isinstance(name, str):
        raise RigError('preset: give the name of a preset, such as "vsa2"')
    below = parse_toml(preset_text(name))
    above = {key: value for key, value in tables.items() if key != "preset"}
    joints = ", ".join(key_path((joint,)) for joint in below.get("joint", {}))
    return merged(below, above), f' (preset "{name}" has joint {joints})'


def _setting(text: str) -> Any:
    """Read a value as TOML, or else as the text it is."""
    try:
        table = parse_toml(f"value = {text}")
    except ValueError:
        return text
    return table["value"] if len(table) == 1 else text


def _put(tables: Table, path: list[str], value: Any, where: str, known: Any) -> Table:
    """Return the tables with the value put at the path; `known` is their structure, which also has the defaults."""
    for i, part in enumerate(path):
        if part.isdigit() and not isinstance(rows := _at(tables, path[:i]), dict):
            # Merging would replace a list as a whole: its other elements are kept.
            whole = _inside(known, path[:i])
            rows, row = rows or list(whole if isinstance(whole, tuple) else ()), int(part)
            if row >= len(rows):
                counted = f"{key_path(tuple(path[:i]))} are counted from 0 and there are {len(rows)}"
                raise RigError(
                    f"{where}: {counted}: {f'write …{path[i - 1]}[0]' if rows else 'set the list as a whole'}"
                )
            rest = path[i + 1 :]
            changed = _put(rows[row], rest, value, where, _inside(known, path[: i + 1])) if rest else value
            return merged(tables, _nested(path[:i], [*rows[:row], changed, *rows[row + 1 :]]))
    return merged(tables, _nested(path, value))


def _inside(known: Any, path: list[str]) -> Any:
    """Return the value at a path of structures, None where there is none."""
    for part in path:
        if isinstance(known, tuple):
            known = known[int(part)] if part.isdigit() and int(part) < len(known) else None
        else:
            known = known.get(part) if isinstance(known, Mapping) else getattr(known, part, None)
    return known


def _nested(path: list[str], value: Any) -> Any:
    for part in reversed(path):
        value = {part: value}
    return value


def _at(tables: Any, path: list[str]) -> Any:
    """Return the value at a path, None where there is none."""
    for part in path:
        if isinstance(tables, list) and part.isdigit() and int(part) < len(tables):
            tables = tables[int(part)]
        elif isinstance(tables, dict):
            tables = tables.get(part)
        else:
            return None
    return tables


def _split_key(key: str, where: str) -> list[str]:
    """Split a dotted key as TOML does, quotes included; ``run[0]`` becomes ``run``, ``0``."""
    parts = key.split('"')
    dotted = '"'.join(part if i % 2 else re.sub(r"\[(\d+)\]", r".\1", part) for i, part in enumerate(parts))
    try:
        node: Any = parse_toml(f"{dotted} = 0") if "\n" not in key and "=" not in key else None
    except ValueError:
        node = None
    path: list[str] = []
    while isinstance(node, dict) and len(node) == 1:
        ((part, node),) = node.items()
        path.append(part)
    if node != 0 or not path:
        raise RigError(f"{where}: '{shown(key)}' is not the path of a key, such as joint.elbow.motor.inertia")
    return path
