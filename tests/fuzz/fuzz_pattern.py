"""Fuzz target: what people type and what headers say: patterns of logs, moments, units, sizes, names of files."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from urllib.parse import unquote

from fuzz_contract import empty, told

from vsalog.batch.names import device_name, encoded, readable
from vsalog.batch.plan import make_plan
from vsalog.core.errors import VsalogError
from vsalog.core.units import parse_quantity, parse_unit, split_header
from vsalog.readers.time_window import Moment
from vsalog.rig.template import toml_string

PATTERN, NAMES, MOMENT, UNIT, HEADER = range(5)


def one(data: bytes) -> None:
    """The first byte says what the rest is taken for."""
    if not data:
        return
    which, rest = data[0] % 5, data[1:]
    text = rest.decode("utf-8", "surrogateescape").replace("\0", "")
    if which == PATTERN:
        pattern(text)
    elif which == NAMES:
        names(rest)
    elif which == MOMENT:
        try:
            moment = Moment.parse(text, "start")
        except VsalogError as error:
            told(error)
        else:
            assert abs(moment.time) < 2**63
    elif which == UNIT:
        unit(text)
    else:
        name, stated = split_header(text)
        assert stated is None or (name in text and stated in text)


def pattern(text: str) -> None:
    """Logs are found below the folder they are looked for in, and no file is two logs."""
    folder = empty("logs")
    for name in ("a.csv", "b/c.csv", "b/[d].mcap", "out/e.csv"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("x")
    # Nothing beyond the folder is looked at: it may be large.
    word = text.replace("..", "_").replace("~", "_").replace("//", "/").strip("/")
    if not word or "://" in word or "::" in word or max(map(len, os.fsencode(word).split(b"/"))) > 255:
        return
    try:
        plan = make_plan([f"{folder}/{word}"], str(folder / "out"))
    except VsalogError as error:
        told(error)
    else:
        assert len({log.name for log in plan.logs}) == len(plan.logs)
        assert all(os.fsdecode(log.where).startswith(str(folder)) for log in plan.logs)


def names(raw: bytes) -> None:
    """Any name is one harmless name of a folder."""
    text = readable(raw or b"x")
    assert unquote(encoded(text)) == text
    folder = encoded(device_name(text))
    assert "/" not in folder
    assert not folder.startswith(".")
    toml_string(text)


def unit(text: str) -> None:
    """A unit is known or not."""
    with suppress(VsalogError):
        parsed = parse_unit(text)
        assert math.isfinite(parsed.factor)
        assert all(map(math.isfinite, parsed.dimension))
    with suppress(VsalogError):
        assert math.isfinite(parse_quantity(text, "N*m"))


def seeds():
    """Yield what people type."""
    for word in ("*.csv", "**/*.csv", "b/[[]d].mcap", "b", "a.csv", "{a,b}.csv", "?.csv", "[!a]*"):
        yield bytes([PATTERN]) + word.encode()
    for name in (b"exp 1.csv", b"\xff\xfe", b"../../x", b"x" * 300, "ü€".encode()):
        yield bytes([NAMES]) + name
    for moment in ("5", "2 min", "2026-01-31T12:00:05.5Z", "1700000000.5", "1e400", "-5 s", "nan"):
        yield bytes([MOMENT]) + moment.encode()
    for name in ("kg*m^2", "N m/rad", "7.3 kg*m*mm", "1e3 deg/s**2", "µm", "(m/s)^-2", "furlong/fortnight", "m²·s⁻¹"):
        yield bytes([UNIT]) + name.encode()
    for header in ("torque [N·m]", "q (rad)", "a_deg", "x.y [1/s] (z)", "[]"):
        yield bytes([HEADER]) + header.encode()
