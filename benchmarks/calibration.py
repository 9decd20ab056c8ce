"""How often the truth lies in the 95 % band of `stiffness_std`, over simulated logs whose noise alone differs.

    python -m benchmarks.calibration [--runs 200] [--seconds 20] [--preset sea --preset vsa2 ...] [--estimator NAME ...]

One motion of each preset is simulated, sensed with as many noises, and estimated; a row counts where it is `excited`, in the
second half of the log. Exits with 1 where the band of a method holds the truth less often than 90 % of the time on average.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from benchmarks.measure import machine
from vsalog.reproduce.measure import Setting, estimate, with_noise
from vsalog.rig import Rig
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

PRESETS, ESTIMATORS = ("sea", "vsa2", "awas"), ("direct", "residual-rls", "qr-rls")
BAND, LEAST = 1.96, 0.90
FIRST_SEED = 5000


def ideal(preset: str, seconds: float) -> tuple[str, Experiment]:
    """Return a preset's joint and its first experiment, without noise."""
    rig = Rig.preset(preset).file
    scenario = Scenario.find(f"{preset}-exp1", rig).lasting(seconds, None)
    experiment = simulate(rig, scenario.inputs(rig), seconds, period=scenario.file.period, ideal=True)
    return next(iter(rig.joint)), experiment


def scores(joint: str, experiment: Experiment, estimator: str) -> np.ndarray:
    """Return (estimate − truth) / standard deviation where it counts, of all transmissions."""
    trace, truth = estimate(experiment, Setting("", estimator, {}), joint), experiment.joints[joint].truth
    out = []
    for name in trace.transmissions:
        if name == "total":
            continue
        columns, sigma = trace[name], truth.get(f"stiffness_{name}", truth.get("stiffness"))
        stiffness, std = np.asarray(columns["stiffness"]), np.asarray(columns["stiffness_std"])
        counts = np.asarray(columns["excited"], dtype=bool) & (np.arange(stiffness.size) >= stiffness.size // 2)
        out.append(((stiffness - sigma[: stiffness.size]) / std)[counts])
    return np.concatenate(out)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--preset", action="append", choices=PRESETS)
    parser.add_argument("--estimator", action="append")
    given = parser.parse_args()
    print(machine("vsalog", "numba", "numpy"))
    print(
        f"\n{given.runs} runs of {given.seconds:g} s\n\n| preset | estimator | runs that count | in the 95 % band | rms of z |"
    )
    print("| --- | --- | --- | --- | --- |")
    missed = False
    for preset in given.preset or PRESETS:
        joint, motion = ideal(preset, given.seconds)
        for estimator in given.estimator or ESTIMATORS:
            runs = []
            for k in range(given.runs):
                (sensed,) = with_noise(motion, (FIRST_SEED + k,))
                z = scores(joint, sensed, estimator)
                if z.size:
                    runs.append((np.mean(np.abs(z) < BAND), np.mean(z**2)))
            if not runs:
                print(f"| {preset} | {estimator} | 0 | – | – |", flush=True)
                continue
            held, square = np.mean(runs, axis=0)
            missed |= held < LEAST
            print(f"| {preset} | {estimator} | {len(runs)} | {held:.1%} | {square**0.5:.2f} |", flush=True)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
