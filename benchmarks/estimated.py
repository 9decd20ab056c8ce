"""Shared by the benchmarks of memory: a motion with known stiffness, and an estimate in its own process."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

VSALOG = str(Path(sys.executable).with_name("vsalog"))
RATE, START = 1000, 1_700_000_000 * 10**9
MIB = 2**20
# The encoders' step, the torque's noise, and the motor.
STEP, NOISE = 2.0 * np.pi / 36_000, 0.02
INERTIA, DAMPING = 0.08, 0.4


def measured(t, torque_of, rng) -> dict[str, np.ndarray]:
    """Return what the sensors say at times t [s], by role: two sines per coordinate, steps and noise.

    Parameters
    ----------
    t : array
        Times [s].
    torque_of : function
        Flexibility torque [N·m] of the deflection [rad].
    rng : numpy.random.Generator
        Makes the noise.
    """

    def motion(*sines):
        """Return value, first and second derivative of a sum of (amplitude, frequency)."""
        w = [(a, 2.0 * np.pi * f) for a, f in sines]
        value = sum(a * np.sin(v * t) for a, v in w)
        return value, sum(a * v * np.cos(v * t) for a, v in w), sum(-a * v * v * np.sin(v * t) for a, v in w)

    phi, phi_1, phi_2 = motion((0.06, 0.2), (0.02, 1.3))
    q, q_1, q_2 = motion((0.5, 0.2), (0.1, 1.3))
    motor = INERTIA * (q_2 - phi_2) + DAMPING * (q_1 - phi_1) - torque_of(phi)
    return {
        "motor_position": np.round((q - phi) / STEP) * STEP,
        "motor_torque": motor + NOISE * rng.normal(size=t.size),
        "link_position": np.round(q / STEP) * STEP,
    }


@dataclass(frozen=True)
class Estimated:
    """What a run of `vsalog estimate` took: time [s], the peak of resident memory [bytes]; and where the trace is."""

    seconds: float
    peak: int
    trace: Path


def estimate(log: Path, estimator: str, *options: str) -> Estimated:
    """Run the command on a log in a process of its own; its temporary files go next to the log."""
    trace = log.with_suffix(".stiffness.parquet")
    start = time.perf_counter()
    process = subprocess.Popen(
        [VSALOG, "estimate", str(log), "-e", estimator, "-o", str(trace), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(log.parent)},
    )
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        sys.exit(f"vsalog estimate failed: {said.decode()}")
    unit = 1 if sys.platform == "darwin" else 1024
    return Estimated(time.perf_counter() - start, usage.ru_maxrss * unit, trace)


def make_apart(module: str, log: Path, count: int) -> None:
    """Let a benchmark make a log in a process of its own: a child's peak counts from that of the parent it was forked from."""
    subprocess.run([sys.executable, "-m", module, "--make", str(log), str(count)], check=True)
