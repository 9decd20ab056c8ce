"""How often the 95 % intervals of `vsalog identify` contain the truth, over machines that are simulated.

    python -m benchmarks.intervals [--runs 20] [--seed 0] [--seconds 20] [--machine sea [--machine …]] [--numbers]

The presets and a position servo are simulated by vsalog with a noise of their own in each run; elastic and rigid machines, drawn
at random, by MuJoCo, and these and others by the equations of tests/hidden_effects. The rig that `identify` begins with has each
of its numbers off by 30 % (log-normal), or by what its kind may be off where that is less. Counts, of numbers that are determined
alone and in combination, those whose interval contains the truth, and prints the CPU time of a run; `--numbers` prints each, with
(value - truth) / half-width. Exits with 1 where the share of all is not 95 %, by the binomial test, or a run fails.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from benchmarks.measure import machine
from tests.hidden_effects.cases import NotVisibleError, Plan, make_case, write_case
from vsalog.core.errors import VsalogError
from vsalog.identification.document import Identification
from vsalog.identification.run import Options, identify
from vsalog.identification.unknowns import Scales, unknowns_of
from vsalog.rig import Rig
from vsalog.rig.numbers import numbers_of, with_number
from vsalog.simulation.run import Options as Simulated
from vsalog.simulation.run import prepare

SERVO = Path(__file__).parents[1] / "sample_logs" / "so101_servo" / "so101.rig.toml"
PRESETS = {name: name for name in ("sea", "awas", "vsa2", "cubic-antagonist", "pam")} | {"position-servo": str(SERVO)}
DRAWN = {
    "mujoco": ("elastic", "rigid"),
    "equations": ("elastic", "rigid", "antagonistic", "serial", "pneumatic"),
}
MACHINES = (*PRESETS, *(f"{device} ({engine})" for engine, devices in DRAWN.items() for device in devices))
OFF, CONFIDENCE = 0.3, 0.95
SERVO_SECONDS = 60.0
# The sample's rig says nothing of its encoder: a step of 4096 in a turn, and a third of it as noise.
ENCODER = r'link_position = { channel = \1, resolution = "0.00153 rad", noise = "0.0005 rad" }'
# Probability of the binomial test below which a share is not called 95 %.
REJECTED = 0.01


@dataclass(frozen=True)
class Told:
    """A number that was identified: its key, how far it is determined, and (value − truth) in half-widths of its interval."""

    key: str
    determined: str
    off: float
    held: bool


def made(name: str, seed: int, seconds: float, folder: Path) -> tuple[Path, Rig]:
    """Write a log of a machine; return it and the rig as the machine truly is.

    Raises
    ------
    NotVisibleError
        No such machine moves well.
    """
    if name in PRESETS:
        servo, source = name == "position-servo", PRESETS[name]
        if servo:
            # Its loop is simulated in windows of ten seconds.
            seconds = max(seconds, SERVO_SECONDS)
            source = str(folder / "servo.rig.toml")
            text, changed = re.subn(r"link_position = (.+)", ENCODER, SERVO.read_text(encoding="utf-8"))
            assert changed == 1, f"{SERVO}: no link_position"
            Path(source).write_text(text, encoding="utf-8")
        log = folder / ("log.csv" if servo else "log.mcap")
        job = prepare(source, Simulated(seed=seed, duration=seconds, output=str(log)))
        job.write(job.run())
        return log, Rig.load(Path(source) if servo else source)
    device, engine = name.rstrip(")").split(" (")
    plan = Plan("case", device, seed, engine="mujoco" if engine == "mujoco" else "own")
    case = write_case(make_case(plan), folder)
    return case / "log.parquet", Rig.load(case / "rig.toml")


def disturbed(rig: Rig, rng: np.random.Generator) -> Rig:
    """Return a rig whose numbers are off."""
    joints = dict(rig.joints)
    for name, joint in rig.joints.items():
        for unknown in unknowns_of(joint, rig.tolerances[name], Scales(1.0, 1.0, 1.0)):
            number = unknown.number
            if number.value == 0.0:
                continue
            known = unknown.deviation if unknown.logarithmic else unknown.deviation / abs(number.value)
            value = number.value * float(np.exp(min(OFF, known) * rng.standard_normal()))
            joints[name] = with_number(joints[name], number.path, min(max(value, number.low), number.high))
    return rig.with_joints(joints)


def told(found: Identification, truth: Rig) -> Iterator[Told]:
    """Yield what was found of each number."""
    for n in found.numbers:
        true = next(x.value for x in numbers_of(truth.joints[n.joint]) if x.key == n.key)
        half = (n.high - n.value) if true > n.value else (n.value - n.low)
        yield Told(n.key, n.determined, (n.value - true) / half if half else np.inf, n.low <= true <= n.high)


def one_run(name: str, seed: int, seconds: float) -> tuple[list[Told], float, str]:
    """Return what was found of a machine, the CPU time [s], and what went wrong."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            log, truth = made(name, seed, seconds, Path(folder))
        except NotVisibleError:
            return [], 0.0, ""
        rig = disturbed(truth, np.random.default_rng([seed, 1]))
        begin = time.process_time()
        try:
            found, _ = identify(log, [], Options(rig=rig))
        except VsalogError as error:
            return [], time.process_time() - begin, str(error)
        return list(told(found, truth)), time.process_time() - begin, ""


def share(held: int, of: int) -> str:
    return f"{held} of {of}" + (f", {held / of:.1%}" if of else "")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=20.0, help="of a log of a preset")
    parser.add_argument("--machine", action="append", choices=MACHINES)
    parser.add_argument("--numbers", action="store_true", help="print each number of each run")
    given = parser.parse_args()
    print(machine("vsalog", "numba", "numpy", "scipy", "mujoco"))
    print("\n| machine | runs | alone | in combination | not told | CPU s, median | failed |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    held, of, failures = 0, 0, 0
    for name in given.machine or MACHINES:
        by_kind: dict[str, list[bool]] = defaultdict(list)
        times, failed, details = [], 0, []
        for seed in range(given.seed, given.seed + given.runs):
            found, seconds, problem = one_run(name, seed, given.seconds)
            if problem:
                failed += 1
                details.append(f"  {seed}: {problem}")
            if found:
                times.append(seconds)
            for one in found:
                by_kind[one.determined].append(one.held)
            if given.numbers:
                shown = ", ".join(f"{t.key} {t.off:+.2f}{'' if t.determined == 'alone' else '*'}" for t in found)
                print(f"  {name} {seed}: {seconds:.1f} s {shown} {problem}", flush=True)
        counts = {kind: (sum(v), len(v)) for kind, v in by_kind.items()}
        alone, combined, rest = (counts.get(k, (0, 0)) for k in ("alone", "in combination", "not"))
        held, of, failures = held + alone[0] + combined[0], of + alone[1] + combined[1], failures + failed
        median = float(np.median(times)) if times else float("nan")
        print(
            f"| {name} | {len(times)} | {share(*alone)} | {share(*combined)} | {rest[1]} | {median:.1f} | {failed} |",
            *details, sep="\n", flush=True,
        )  # fmt: skip
    test = binomtest(held, of, CONFIDENCE) if of else None
    print(f"\nall: {share(held, of)}")
    return int(test is None or test.pvalue < REJECTED or failures > 0)


if __name__ == "__main__":
    sys.exit(main())
