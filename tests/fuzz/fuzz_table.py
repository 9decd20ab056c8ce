"""Fuzz target: text tables, plain and compressed."""

from __future__ import annotations

import bz2
import gzip
from pathlib import Path

import lz4.frame
import zstandard
from fuzz_contract import exercise, put

PACKED = (bytes, bytes, gzip.compress, zstandard.compress, bz2.compress, lz4.frame.compress)
ENCODINGS = (None, None, "utf-8-sig", "utf-16", "latin-1", "utf-16-be")
SAMPLES = Path(__file__).parents[2] / "sample_logs"


def one(data: bytes) -> None:
    """Read a table: how to read it, how it is compressed and encoded, and its text."""
    if len(data) < 2:
        return
    how, flags, content = data[0], data[1], data[2:]
    encoding = ENCODINGS[flags // 6 % 6]
    if encoding:
        mark = "\ufeff" if encoding == "utf-16-be" else ""  # which Python writes for the others itself
        content = (mark + content.decode("utf-8", "replace")).encode(encoding, "replace")
    packed = PACKED[flags % 6](content)
    exercise(put(packed[: len(packed) * 7 // 8] if flags >= 216 else packed, "log.csv"), how)


TEXTS = (
    "time,q [rad],tau [N*m]\n0.001,1,2\n0.002,1.5,-2e-3\n0.003,nan,inf\n",
    "t;x\n0,1;1,5\n0,2;-2,25e1\n0,3;;\n",
    '"time (ms)"\t"a ""b"" [deg]"\n1\t1\n2\t"2"\n3\t3\n',
    "%time,field.header.seq,field.header.stamp,field.position0\n1700000000000000000,1,1700000000000000000,0.1\n"
    "1700000000001000000,2,1700000000001000000,0.2\n",
    "header.stamp.sec,header.stamp.nanosec,x\n1700000000,5,1\n1700000000,1000005,2\n1700000001,5,3\n",
    "date,time,x\n2026-01-31,12:00:00.5,1\n2026-01-31,12:00:01,2\n",
    "Zeit,x\n31.01.2026 12:00:00,1\n31.01.2026 12:00:01Z,2\n2026/01/31T12:00:02+02:00,3\n",
    "# a remark\n# t x\n0 1\n0.5 2\n1 3\n",
    "__time,/a/x,/b/y\n0.1,1,\n0.2,,5\n0.3,2,\n0.4,,6\n0.5,3,\n",
    "motor,,link\nposition,effort,position\nrad,N*m,rad\n1,2,3\n4,5,6\n7,8,9\n",
    "# t,a\n0,1\n1,2\n2,3\n# a [deg],t\n1,3\n3,4\nt,a\nms,rad\n5000,1\n",
    "x\n1\n2\n3\n",
    "time,x\n-9223372036.854775808,1\n9223372036.854775807,2\n1e300,3\n1e19,4\n",
)


def seeds():
    """Yield tables of many dialects."""
    for i, text in enumerate(TEXTS):
        for flags in (0, 2 + 6 * (i % 6)):
            yield bytes([0x68 if flags else 0x38, flags]) + text.encode()
    for path in (SAMPLES / "sea_exp1.csv", *sorted((SAMPLES / "desr_foot").glob("*.csv"))[:1]):
        yield bytes([0x28, 0]) + path.read_bytes()[:1500]
