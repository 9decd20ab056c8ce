"""Record what a version does, and compare two records: what changed, and what is worse.

    python -m benchmarks.baseline record --logs DIR -o before.json [--product CHECKOUT] [--only SECTION …]
    python -m benchmarks.baseline compare before.json after.json

Sections: `structure`, the size of the code; `estimates`, traces, models and findings of the sample logs and of scenes of every
preset by every estimator; `calibration`, how often the truth is in the 95 % band; `findings`, those of sound logs and of
faults; `papers`, the rows of the papers' tables; `times`, CPU time of cold and warm commands, and readers; `battery`, hidden
effects and how many are found.

The logs are simulated by the first version that is recorded and lie in DIR; every other version gets the same files. Commands run
in CHECKOUT, the current folder when absent, which may be of any commit. A section is written as soon as it is done, and one that
the record has is kept unless `--again`. All sections take hours; `--seeds`, `--sound` and `--cases` say how many logs. `compare`
exits with 1 where something is worse.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from benchmarks.baseline.compare import compared
from benchmarks.baseline.product import Product
from benchmarks.baseline.record import SECTIONS, Asked
from benchmarks.measure import machine


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.baseline", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record")
    recording.add_argument("--logs", type=Path, required=True)
    recording.add_argument("-o", "--output", type=Path, required=True)
    recording.add_argument("--product", type=Path, default=Path.cwd())
    recording.add_argument("--only", action="append", choices=SECTIONS)
    recording.add_argument("--again", action="store_true")
    recording.add_argument("--workers", type=int, default=2)
    recording.add_argument("--seeds", type=int, default=100)
    recording.add_argument("--sound", type=int, default=500)
    recording.add_argument("--cases", type=int, default=60)
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.command == "compare":
        text, worse = compared(*(json.loads(path.read_text(encoding="utf-8")) for path in (given.before, given.after)))
        print(text)
        return int(worse)
    product = Product(given.product.resolve())
    asked = Asked(given.logs.resolve(), given.workers, given.seeds, given.sound, given.cases)
    kept = json.loads(given.output.read_text(encoding="utf-8")) if given.output.exists() else {}
    if kept and kept["commit"] != product.commit():
        sys.exit(f"{given.output} is a record of {kept['commit']}, not of {product.commit()}; name another file")
    document = kept | {"commit": product.commit(), "machine": machine("numba", "numpy", "scipy", "pyarrow")}
    for name in given.only or SECTIONS:
        if name not in document or given.again:
            start = time.monotonic()
            document[name] = SECTIONS[name](product, asked)
            given.output.write_text(json.dumps(document), encoding="utf-8")
            print(f"{name}: {time.monotonic() - start:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
