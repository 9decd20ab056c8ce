"""Fuzz target: rig files, and settings over them."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from fuzz_contract import told

from vsalog.core.errors import VsalogError
from vsalog.rig.load import Rig, preset_text, presets

SCHEMA = Path(__file__).parents[2] / "docs" / "rig.schema.json"


def one(data: bytes) -> None:
    """Load a rig; one that loads is written to an equal one. What stands behind a zero byte are settings, KEY=VALUE."""
    text, *settings = data.decode("utf-8", "surrogateescape").split("\0")
    try:
        rig = Rig.from_toml(text, "rig.toml")
    except VsalogError as error:
        told(error, "rig.toml")
        return
    assert Rig.from_toml(rig.to_toml()).file == rig.file
    for setting in settings[:4]:
        key, _, value = setting.partition("=")
        with suppress(VsalogError):
            changed = rig.with_setting(key, value)
            assert Rig.from_toml(changed.to_toml()).file == changed.file


def seeds():
    """Yield the presets and the examples of the documentation."""
    for name in presets():
        yield preset_text(name).encode()
        yield f'preset = "{name}"\n'.encode()
    pages = sorted((SCHEMA.parent / "reference" / "rig").glob("*.md"))
    assert pages, "the examples of the documentation are elsewhere"
    for page in pages:
        for example in page.read_text(encoding="utf-8").split("```toml\n")[1:]:
            yield example.partition("```")[0].encode()
    yield b'preset = "vsa2"\n\0joint.elbow.motor_1.inertia=7.3 kg*m*mm\0joint.elbow.signals.link_position.offset=1 deg'


def words() -> list[str]:
    """Return the keys of the schema, for the fuzzer's dictionary."""
    found: set[str] = set()

    def walk(node) -> None:
        if isinstance(node, dict):
            found.update(node.get("properties", {}))
            found.update(v for v in (*node.get("enum", ()), node.get("const")) if isinstance(v, str))
            for value in node.values():
                walk(value)
        elif isinstance(node, list):
            for value in node:
                walk(value)

    walk(json.loads(SCHEMA.read_text(encoding="utf-8")))
    return sorted(found)
