"""How often the truth is in the 95 % band of `stiffness_std`, over simulated logs whose noise alone differs.

    python -m benchmarks.calibration [--runs 200] [--seconds 20] [--motion 1] [--preset sea [--preset …]] [--estimator NAME …]

One motion of each preset is simulated, sensed with as many noises, the zeros of its encoders anywhere within a step each time,
and estimated; a row counts where it is `excited`, in the second half of the log. `--motion 0.05` makes the motors' torques so
much smaller, down to few encoder steps. Exits with 1 if the band of a method contains the truth less than 90 % of the time
on average.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

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


def ideal(preset: str, seconds: float, motion: float = 1.0) -> tuple[str, Experiment]:
    """Return a preset's joint and its first experiment, without noise and with its motors' torques `motion` times as large."""
    rig = Rig.preset(preset).file
    joint = next(iter(rig.joint))
    scenario = Scenario.find(f"{preset}-exp1", rig).lasting(seconds, None)
    inputs = scenario.inputs(rig)
    if motion != 1.0:
        inputs = {joint: {role: partial(_scaled, drive, motion) for role, drive in inputs[joint].items()}}
    return joint, simulate(rig, inputs, seconds, period=scenario.file.period, ideal=True)


def _scaled(drive: Callable[[np.ndarray], np.ndarray], share: float, t: np.ndarray) -> np.ndarray:
    return share * np.asarray(drive(t))


def encoders(joint: str, motion: Experiment) -> dict[str, float]:
    """Return the steps of a joint's encoders, role by role."""
    (recorded,) = with_noise(motion, (FIRST_SEED,))
    steps, truth = recorded.joints[joint].resolution, recorded.joints[joint].truth
    return {role: step for role, step in sorted(steps.items()) if role in truth and "position" in role}


def sensed(joint: str, motion: Experiment, steps: Mapping[str, float], seed: int) -> Experiment:
    """Return the motion as its sensors record it, the zeros of its encoders anywhere within a step."""
    rng, record = np.random.default_rng(seed), motion.joints[joint]
    zeros = {role: rng.uniform() * step for role, step in steps.items()}
    moved = {role: record.truth[role] + zero for role, zero in zeros.items()}
    (recorded,) = with_noise(replace(motion, joints={joint: replace(record, truth={**record.truth, **moved})}), (seed,))
    read = recorded.joints[joint].measured
    back = {**read, **{role: read[role] - zero for role, zero in zeros.items()}}
    return replace(recorded, joints={joint: replace(recorded.joints[joint], measured=back, truth=record.truth)})


def scores(joint: str, experiment: Experiment, estimator: str) -> tuple[np.ndarray, np.ndarray]:
    """Return (estimate − truth) / standard deviation, and (estimate − truth) / truth, where it counts, of all transmissions."""
    trace, truth = estimate(experiment, Setting("", estimator, {}), joint), experiment.joints[joint].truth
    out, errors = [], []
    for name in trace.transmissions:
        if name == "total":
            continue
        columns, sigma = trace[name], truth.get(f"stiffness_{name}", truth.get("stiffness"))
        stiffness, std = np.asarray(columns["stiffness"]), np.asarray(columns["stiffness_std"])
        counts = np.asarray(columns["excited"], dtype=bool) & (np.arange(stiffness.size) >= stiffness.size // 2)
        off = stiffness - sigma[: stiffness.size]
        out.append((off / std)[counts])
        errors.append((off / sigma[: stiffness.size])[counts])
    return np.concatenate(out), np.concatenate(errors)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--motion", type=float, default=1.0)
    parser.add_argument("--preset", action="append", choices=PRESETS)
    parser.add_argument("--estimator", action="append")
    given = parser.parse_args()
    print(machine("vsalog", "numba", "numpy"))
    print(
        f"\n{given.runs} runs of {given.seconds:g} s, {given.motion:g} times the motion\n\n"
        "| preset | estimator | runs that count | median error | in the 95 % band | rms of z |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    missed = False
    for preset in given.preset or PRESETS:
        joint, motion = ideal(preset, given.seconds, given.motion)
        steps = encoders(joint, motion)
        for estimator in given.estimator or ESTIMATORS:
            runs = []
            for k in range(given.runs):
                z, error = scores(joint, sensed(joint, motion, steps, FIRST_SEED + k), estimator)
                if z.size:
                    runs.append((np.mean(np.abs(z) < BAND), np.mean(z**2), np.median(np.abs(error))))
            if not runs:
                print(f"| {preset} | {estimator} | 0 | – | – | – |", flush=True)
                continue
            held, square, off = np.mean(runs, axis=0)
            missed |= held < LEAST
            print(f"| {preset} | {estimator} | {len(runs)} | {off:.2%} | {held:.1%} | {square**0.5:.2f} |", flush=True)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
