"""Memory of `vsalog estimate` on a log of an hour.

    python -m benchmarks.memory [--minutes 60] [--format parquet|mcap] [--estimator NAME]

A log of an elastic joint at 1 kHz is made in a temporary folder, estimated in a process of its own, and that process' peak
of resident memory compared with the arrays that belong to the task: the input's columns and the output's. What a log of 20
seconds takes is the interpreter's and the libraries' share, and is taken off. Needs a Unix. Exits with 1 where the peak
grows beyond these arrays.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.estimated import MIB, RATE, START, estimate, make_apart, measured
from benchmarks.measure import machine

SHORT = 20 * RATE
ROLES = {"motor_position": "rad", "link_position": "rad", "motor_torque": "N*m"}


def make(path: Path, rows: int) -> None:
    """Write a log: the rig `sea` moving as two sines per coordinate, with encoders of 36 000 steps and torque noise."""
    ticks = np.arange(rows, dtype=np.int64)
    columns = measured(ticks / RATE, lambda phi: 20.0 * phi + 2000.0 * phi**3, np.random.default_rng(1))
    stamps = START + ticks * (10**9 // RATE)
    (_write_mcap if path.suffix == ".mcap" else _write_parquet)(path, stamps, columns)


def _write_parquet(path: Path, stamps, columns) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = [pa.field("time", pa.timestamp("ns"))]
    fields += [pa.field(role, pa.float64(), metadata={"unit": unit}) for role, unit in ROLES.items()]
    table = pa.Table.from_arrays(
        [pa.array(stamps, pa.timestamp("ns")), *(pa.array(columns[role]) for role in ROLES)], schema=pa.schema(fields)
    )
    pq.write_table(table, path, compression="zstd", row_group_size=65536)


def _write_mcap(path: Path, stamps, columns) -> None:
    from vsalog.writers.recording_mcap import write_topics_mcap
    from vsalog.writers.recording_topics import JOINT_STATE, Topic

    named = {
        ("position", "motor"): columns["motor_position"],
        ("position", "link"): columns["link_position"],
        ("effort", "motor"): columns["motor_torque"],
        ("effort", "link"): columns["motor_torque"] * float("nan"),
    }
    write_topics_mcap([Topic("/joint_states", JOINT_STATE, stamps, named)], path)


def write_rig(path: Path, kind: str) -> None:
    names = {role: role for role in ROLES}
    if kind == "mcap":
        names = {
            "motor_position": "/joint_states.position[motor]",
            "link_position": "/joint_states.position[link]",
            "motor_torque": "/joint_states.effort[motor]",
        }
    lines = ['preset = "sea"', "", "[joint.sea.signals]", *(f'{role} = "{name}"' for role, name in names.items())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def output_size(trace: Path) -> tuple[int, int, str]:
    """Return the bytes of the output's columns as arrays, those on disk, and the shape in words."""
    code = (
        "import sys, pyarrow as a, pyarrow.parquet as p; f = p.ParquetFile(sys.argv[1]); s = f.schema_arrow;"
        "w = sum(1 if a.types.is_boolean(t) else 4 if a.types.is_dictionary(t) else 8 for t in s.types);"
        "print(f.metadata.num_rows * w, f.metadata.num_rows, len(s))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(trace)], capture_output=True, text=True, check=True)
    size, rows, columns = map(int, done.stdout.split())
    return size, trace.stat().st_size, f"{rows} rows of {columns} columns"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--format", choices=("parquet", "mcap"), default="parquet")
    parser.add_argument("--estimator", default="residual-rls")
    parser.add_argument("--make", nargs=2, metavar=("PATH", "ROWS"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.make:
        make(Path(asked.make[0]), int(asked.make[1]))
        return 0
    rows = round(asked.minutes * 60 * RATE)
    print(machine("vsalog", "numba", "numpy", "scipy", "pyarrow", "pandas"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_rig(folder / "rig.toml", asked.format)
        peaks = {}
        for count in (SHORT, rows):
            log = folder / f"log-{count}.{asked.format}"
            make_apart("benchmarks.memory", log, count)
            options = (asked.estimator, "--rig", str(folder / "rig.toml"))
            if count == SHORT:  # compiles, where that is still to be done
                estimate(log, *options)
            done = estimate(log, *options)
            peaks[count] = done.peak
        size, on_disk, shape = output_size(done.trace)
        log_size = log.stat().st_size
    columns = rows * 8 * (len(ROLES) + 1)
    grown = peaks[rows] - peaks[SHORT]
    met = grown <= columns + size
    print(
        f"\n{asked.estimator} on {rows} samples of {len(ROLES)} channels at {RATE} Hz ({asked.format}): {done.seconds:.1f} s\n"
    )
    for text, value in (
        ("log on disk", log_size),
        ("input columns, float64, and one of stamps", columns),
        (f"output as arrays ({shape})", size),
        ("output on disk", on_disk),
        ("peak of resident memory", peaks[rows]),
        ("  of a log of 20 s", peaks[SHORT]),
        ("  what the length adds", grown),
    ):
        print(f"{text:64}{value / MIB:9.1f} MiB")
    print(f"{'  the same, in times the input columns':64}{grown / columns:9.2f}")
    print(f"\ntarget: no more than the input's columns and the output: {'met' if met else 'MISSED'}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
