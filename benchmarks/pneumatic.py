"""`pam-smoother` next to `pam-ukf`: errors, and how often the truth is in the 95 % band, over simulated pneumatic joints.

    python -m benchmarks.pneumatic [--seeds 10] [--seconds 20] [--hour]

Machines that are as their rigs state, each with a noise of its own (scenarios `pam-exp1` and `pam-range`), and machines that are
not, as `vsalog reproduce shin` draws them. Root mean square over all runs of the error and of the standard deviation, and the
share of the samples whose truth is within ±1.96 deviations, the least of a run in brackets: of the first half of the runs, in
which the filter learns the angle, and of the second. At last the CPU time of each, warm, on the first log,
and with `--hour` time and memory of `vsalog estimate` on an hour.
Exits with 1 if on machines that equal their rigs the smoother is worse in the second half than the filter, or its band contains
the truth less than 90 % of the time.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.measure import machine, side_by_side, usage_of
from vsalog.reproduce.measure import Setting, estimate
from vsalog.reproduce.shin_machines import recorded
from vsalog.rig import Rig
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

ESTIMATORS, BAND, LEAST = ("pam-ukf", "pam-smoother"), 1.96, 0.90
SIGNALS = {
    "angle [mrad]": ("link_position", "link_position", 1e3),
    "torque [N·mm]": ("flexibility_torque", "transmission_torque", 1e3),
    "stiffness [N·mm/rad]": ("stiffness", "stiffness", 1e3),
}


def as_the_rig_says(scenario: str, seed: int, seconds: float) -> Experiment:
    """Return a run of the preset `pam` with a noise of its own."""
    rig = Rig.preset("pam").file
    return simulate(rig, Scenario.find(scenario, rig).inputs(rig), seconds, seed=seed, steps=2)


def off_and_deviation(experiment: Experiment, estimator: str, signal: str) -> tuple[np.ndarray, np.ndarray]:
    """Return error and standard deviation of a signal, sample by sample, where both are reported."""
    column, truth, scale = SIGNALS[signal]
    trace = estimate(experiment, Setting("", estimator, {}), "pam")["total"]
    off = scale * (np.asarray(trace[column]) - experiment.joints["pam"].truth[truth])
    std = scale * np.asarray(trace[f"{column}_std"])
    told = np.isfinite(off) & np.isfinite(std)
    return off[told], std[told]


class Half(NamedTuple):
    """Root mean square of the errors and of the deviations of all runs, and each run's share in the band."""

    error: float
    deviation: float
    held: list[float]

    @property
    def cells(self) -> tuple[str, str, str]:
        """The cells of a table."""
        return f"{self.error:.3g}", f"{self.deviation:.3g}", f"{np.mean(self.held):.0%} ({min(self.held):.0%})"


def half_of(runs: Sequence[tuple[np.ndarray, np.ndarray]], half: int) -> Half:
    """Return what one half of the runs' samples tells."""
    cut = [tuple(np.array_split(part, 2)[half] for part in run) for run in runs]
    off, std = (float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for parts in zip(*cut, strict=True))
    return Half(off, std, [float(np.mean(np.abs(o) < BAND * s)) for o, s in cut])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--hour", action="store_true")
    given = parser.parse_args()
    print(machine("vsalog", "numba", "numpy"))
    seeds = range(given.seeds)
    runs = {
        "as the rig, pam-exp1": [as_the_rig_says("pam-exp1", seed, given.seconds) for seed in seeds],
        "as the rig, pam-range": [as_the_rig_says("pam-range", seed, given.seconds) for seed in seeds],
        "others, pam-range": [recorded(seed, clamped=False, duration=given.seconds) for seed in seeds],
    }
    print(f"\n{given.seeds} runs of {given.seconds:g} s each; first half, second half\n")
    print(
        "| machines | | estimator | rms error | rms deviation | in the 95 % band |\n| --- | --- | --- | --- | --- | --- |"
    )
    missed = False
    for name, experiments in runs.items():
        for signal in SIGNALS:
            late = []
            for estimator in ESTIMATORS:
                found = [off_and_deviation(experiment, estimator, signal) for experiment in experiments]
                halves = [half_of(found, 0), half_of(found, 1)]
                cells = [", ".join(cell) for cell in zip(*(h.cells for h in halves), strict=True)]
                print(f"| {name} | {signal} | {estimator} | {' | '.join(cells)} |", flush=True)
                late.append(halves[1])
            sound = name.startswith("as the rig")
            missed |= sound and (late[1].error > late[0].error or float(np.mean(late[1].held)) < LEAST)
    (first, *_) = runs["as the rig, pam-exp1"]
    times = side_by_side({e: lambda e=e: estimate(first, Setting("", e, {}), "pam") for e in ESTIMATORS}, 9)
    print("\nCPU time: " + ", ".join(f"{e} {t.least:.3f} s" for e, t in times.items()))
    if given.hour:
        with tempfile.TemporaryDirectory() as folder:
            vsalog, log = (sys.executable, "-m", "vsalog"), Path(folder) / "hour.parquet"
            usage_of((*vsalog, "simulate", "pam", "--duration", "3600 s", "-o", log))
            for e in ESTIMATORS:
                used = usage_of((*vsalog, "estimate", log, "-e", e, "-o", Path(folder) / "trace.parquet"))
                print(f"an hour: {e} {used.cpu:.0f} s of CPU time, {used.memory / 1e6:.0f} MB")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
