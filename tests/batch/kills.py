"""Twenty kills of a batch over sixty logs: ``python -m tests.batch.kills [--kills 20] [--logs 60]``.

Each run is killed, workers and all or the parent alone, at a random moment, and gone on with; after the last the data set must
equal that of a run that was never disturbed. Exits with 1 where it does not.
"""

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from batch_bench import batch, contents, make_logs, start


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--logs", type=int, default=60)
    parser.add_argument("--rows", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    moments = random.Random(asked.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_logs(folder / "logs", asked.logs, rows=asked.rows)
        (folder / "logs" / "day0" / "broken.csv").write_bytes(b"\x89PNG")
        began = time.monotonic()
        code, _, err = batch("logs", "-o", "whole", cwd=folder)
        taken = time.monotonic() - began
        assert code == 2, err
        print(f"undisturbed: {taken:.1f} s", flush=True)
        finished = 0
        for kill in range(asked.kills):
            resume = ["--resume"] if (folder / "out" / "batch.json").exists() else []
            process = start("logs", "-o", "out", *resume, cwd=folder, start_new_session=True)
            moment = moments.uniform(0.3, 3.0 + 4.0 * taken / asked.kills)
            time.sleep(moment)
            if kill % 2:
                os.killpg(process.pid, signal.SIGKILL)
            else:
                process.kill()
            process.communicate()
            before, finished = finished, len(list((folder / "out" / "records").glob("*.json")))
            halves = [p for p in (folder / "out").glob("traces/**/*.parquet") if p.read_bytes()[-4:] != b"PAR1"]
            print(f"kill {kill + 1:2} after {moment:4.1f} s: {before:3} -> {finished:3} finished", flush=True)
            assert not halves, halves
            assert finished >= before
        code, _, err = batch("logs", "-o", "out", "--resume", cwd=folder)
        assert code == 2, err
        one, two = contents(folder / "out"), contents(folder / "whole")
    differ = sorted(set(one) ^ set(two)) + [n for n in one if n in two and one[n] != two[n]]
    files = sum(isinstance(v, bytes) for v in two.values())
    print(f"{files} files byte for byte, {len(two) - files} row for row: {differ or 'equal'}")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
