"""A servo of an SO-101 arm on motions that nothing was fitted to: `vsalog identify` beside a fit of five parameters by CMA-ES.

    python -m benchmarks.servos FOLDER [--fit chirp_sweep] [--joint Rotation]

FOLDER holds a folder per motion, as the arm writes them (docs/tables.md, "A folder of tables"). Both fit one motion and simulate
the others. The five are those of most sim-to-real scripts: armature, damping, friction, bias and delay of a proportional loop
whose gain is the unit of torque, found by CMA-ES (Hansen 2016, arXiv:1604.00772, package `cma`) on the root mean square error of
the whole motion. Exits with 1 where the error is more than half of theirs for more than two of six joints.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import cma
import numpy as np
from numba import njit

from vsalog.diagnosis.run import Options as Read
from vsalog.diagnosis.run import bound_as_recorded, read_wanted
from vsalog.identification.run import Options, identified
from vsalog.identification.unknowns import as_felt
from vsalog.readers import read
from vsalog.residuals.channels import channels_of
from vsalog.residuals.windows import begun, windows_of
from vsalog.rig import Rig
from vsalog.rig.guess import guess_roles
from vsalog.rig.template import rig_template

STEP = 1e-3
LARGEST, LEAST_GOOD = 0.5, 4


@njit(cache=True)
def loop(stamps, command, begin, armature, damping, friction, bias, delay, out):
    """Semi-implicit Euler steps of a millisecond; the command is held; what sticks stays."""
    x, v, k = begin, 0.0, 0
    out[0] = x
    for i in range(stamps.size - 1):
        steps = max(1, int((stamps[i + 1] - stamps[i]) / STEP + 0.5))
        h = (stamps[i + 1] - stamps[i]) / steps
        for s in range(steps):
            while k < stamps.size - 1 and stamps[k + 1] <= stamps[i] + s * h - delay:
                k += 1
            free = v + h * (command[k] - x - bias - damping * v) / armature
            rub = h * friction / armature
            v = 0.0 if abs(free) <= rub else free - (rub if free > 0.0 else -rub)
            x += h * v
        out[i + 1] = x
    return out


def five(stamps, command, position):
    """Return the five parameters that fit a motion best."""

    def error(u):
        armature, damping, friction = np.exp(u[:3])
        found = loop(stamps, command, position[0], armature, damping, friction, u[3], abs(u[4]), np.empty(stamps.size))
        off = float(np.sqrt(np.mean((found - position) ** 2)))
        return off if np.isfinite(off) else 1e3

    begin = np.array([np.log(1.0 / 400.0), np.log(0.1), np.log(0.003), 0.0, 0.05])
    options = {"verbose": -9, "seed": 1, "maxfevals": 4000, "CMA_stds": [1.0, 1.0, 1.0, 0.02, 0.02]}
    best = cma.fmin2(error, begin, 1.0, options)[0]
    return (*np.exp(best[:3]), best[3], abs(best[4]))


def columns(recording, joint):
    command, position = (recording.channels[f"{t}.positions[{joint}]"] for t in ("control", "state_motor"))
    return position.stamps * 1e-9, np.asarray(command.values), np.asarray(position.values)


def main() -> int:
    asked = argparse.ArgumentParser()
    asked.add_argument("folder", type=Path)
    asked.add_argument("--fit", default="chirp_sweep")
    asked.add_argument("--joint", action="append")
    given = asked.parse_args()
    logs = {path.name: path for path in sorted(given.folder.iterdir()) if path.is_dir()}
    recordings = {name: read(path) for name, path in logs.items()}
    fitted = recordings[given.fit]
    rig = Rig.from_toml(rig_template(fitted, guess_roles(fitted)))
    good, tried = 0, 0
    print("joint        motion                 five parameters   vsalog identify   ratio   [rad rms]")
    for name, joint in rig.joints.items():
        channel = joint.signals.link_position
        label = channel.split("[")[1].rstrip("]")
        if given.joint and label not in given.joint:
            continue
        start = time.process_time()
        simple = five(*columns(fitted, label))
        middle = time.process_time()
        signals = bound_as_recorded(fitted, name, joint, gains=False)
        found = identified(name, joint, given.fit, signals, {"": signals}, rig.tolerances[name], Options()).identified
        end = time.process_time()
        squares, count = np.zeros(2), 0
        for motion, path in logs.items():
            stamps, command, position = columns(recordings[motion], label)
            if motion == given.fit or np.ptp(command) < 0.02:
                continue
            bound = bound_as_recorded(read_wanted(path, rig.joints, Read()), name, joint, gains=False)
            windows = windows_of(as_felt(found), channels_of(bound), hold=False)
            samples = np.concatenate([np.arange(a, b) for a, b in windows.spans])
            simulated = loop(stamps, command, position[0], *simple, np.empty(stamps.size))
            inside = (stamps >= stamps[0] + 2.0) & (stamps <= stamps[-1] - 0.1)
            ours = begun(as_felt(found), windows).errors["link_position"][samples]
            errors = np.array([np.mean((simulated - position)[inside] ** 2), np.mean(ours**2)])
            one, two = np.sqrt(errors)
            print(f"{label:12} {motion:22} {one:15.5f} {two:17.5f} {two / one:7.2f}", flush=True)
            squares, count = squares + errors, count + 1
        whole = np.sqrt(squares / max(count, 1))
        tried, good = tried + 1, good + int(whole[1] <= LARGEST * whole[0])
        print(
            f"{label:12} {'all':22} {whole[0]:15.5f} {whole[1]:17.5f} {whole[1] / whole[0]:7.2f}"
            f"   CPU {middle - start:.0f} s, {end - middle:.0f} s", flush=True,
        )  # fmt: skip
    print(f"{good} of {tried} joints are at {LARGEST:g} × or less")
    return int(tried == 6 and good < LEAST_GOOD)


if __name__ == "__main__":
    sys.exit(main())
