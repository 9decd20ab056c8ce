"""How often faults of recordings are detected, and how often one is reported in a sound log.

    python -m benchmarks.recording_faults faults [--seeds 2] [--presets sea,awas]
    python -m benchmarks.recording_faults sound [--count 500]

Logs are simulated by `vsalog simulate`, faults are put into them by `tests/recording_faults/inject.py`, and `vsalog inspect`
looks at them without a rig. A fault between channels counts only if `tests/recording_faults/observable.py` detects it. Exits with
1 if fewer than 98 % are detected, or more than 1 % of the sound logs have a finding.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from tests.recording_faults.inject import Injected, injected
from tests.recording_faults.observable import left_by_equations, noticed
from vsalog.core.recording import Recording
from vsalog.inspection.run import inspect_recording
from vsalog.readers.sampling import read_sample
from vsalog.rig.guess import guess_roles

PRESETS = ("sea", "awas", "vsa2", "cubic-antagonist", "vsa2-2r", "kuka-kr15", "pam")
MOTIONS = ("own", "multisine", "sines", "chirp", "steps", "sawtooth", "square", "servo")
NAMED, FALSE_ALARMS = 0.98, 0.01

# What names each kind: codes of findings, and what a guessed rig says of a role.
NAMES = {
    "unsigned torque": {"torque.unsigned"},
    "current called torque": {"signal.scale"},
    "gravity taken out": {"torque.without_gravity"},
    "wrong sign": {"signal.sign", "sign = -1"},
    "other side of the gear": {"signal.scale", 'side = "rotor"'},
    "wrong unit": {"signal.unit", 'unit = "deg"'},
    "encoder counts": {"encoder.counts", "guess.raw_counts"},
    "late": {"signal.late"},
    "two clocks": {"signal.clock_rate"},
    "held": {"sensor.repeated"},
    "interpolated": {"signal.interpolated"},
    "exchanged": {"signal.exchanged", "signal.joints_exchanged"},
    "computed": {"torque.computed"},
    "clipped": {"sensor.clipped", "sensor.saturated"},
    "stuck": {"sensor.stuck", "sensor.frozen", "encoder.stuck", "torque.stuck", "torque.stuck_while_moving"},
    "wrapped": {"encoder.wrapped"},
}
ALONE = {"encoder counts", "held", "interpolated", "computed", "clipped", "stuck", "wrapped"}
"""Kinds that one channel shows, whatever the others say."""
FAULTS = set().union(*NAMES.values())


def simulated(preset: str, motion: str, seed: int, folder: Path, more: tuple[str, ...] = ()) -> Recording | None:
    """Return a simulated log; None where the motion does not suit the machine."""
    log = folder / f"{preset}-{motion}-{seed}.mcap"
    if not log.exists():
        command = [sys.executable, "-m", "vsalog", "simulate", preset, "-o", str(log), "--seed", str(seed), *more]
        if subprocess.run(
            command + ([] if motion == "own" else ["--scenario", motion]), capture_output=True
        ).returncode:
            return None
    return read_sample(log, "auto", None)[0]


def found_in(recording: Recording) -> list[str]:
    """Return the codes of what `vsalog inspect` finds wrong with the channels."""
    guess = guess_roles(recording)
    report = inspect_recording(recording, guess)
    findings = [*report.findings, *(finding for joint in guess.joints for finding in joint.findings)]
    codes = [finding.code for finding in findings if finding.code in FAULTS]
    guessed = [one for joint in guess.joints for one in joint.roles.values()]
    codes += ["sign = -1" for one in guessed if one.sign < 0] + [
        'side = "rotor"' for one in guessed if one.side == "rotor"
    ]
    stated = {name: channel.unit for name, channel in recording.channels.items()}
    return codes + ['unit = "deg"' for one in guessed if one.unit == "deg" and stated.get(one.channel) != "deg"]


def roles_of(recording: Recording) -> dict[str, dict[str, str]]:
    """Return joint → role → channel, as they are guessed, of the channels that have a number at all times."""
    whole = {name for name, channel in recording.channels.items() if np.isfinite(channel.values).all()}
    return {
        joint.name: {role: one.channel for role, one in joint.roles.items() if one.channel in whole}
        for joint in guess_roles(recording).joints
    }


def observable(one: Injected, sound: Recording, roles: dict[str, dict[str, str]]) -> bool:
    """Tell whether a fault can be noticed in a log."""
    if one.kind in ALONE:
        return True
    joints = one.joint.split(" ") if one.joint not in roles else [one.joint]
    pairs = [(left_by_equations(r, roles[j]) for r in (sound, one.recording)) for j in joints]
    return all(noticed(*pair) for pair in pairs)


def faults(args: argparse.Namespace, folder: Path) -> bool:
    """Put every fault into every log, and count what is named."""
    counts, missed, unseen, slow = Counter[str](), Counter[str](), Counter[str](), (0.0, "")
    for preset in args.presets.split(","):
        for motion in args.motions.split(","):
            for seed in range(1, args.seeds + 1):
                sound = simulated(preset, motion, seed, folder)
                if sound is None:
                    continue
                roles = roles_of(sound)
                drawn = np.random.default_rng([seed, PRESETS.index(preset), MOTIONS.index(motion)])
                for one in injected(sound, roles, np.random.default_rng(seed)):
                    if drawn.random() >= args.share or (args.kinds and one.kind not in args.kinds.split(",")):
                        continue
                    if not observable(one, sound, roles):
                        unseen[one.kind] += 1
                        continue
                    begin = time.process_time()
                    codes = found_in(one.recording)
                    what = f"{preset} {motion} {seed}: {one.kind} in {one.joint} {one.role}"
                    slow = max(slow, (time.process_time() - begin, what))
                    counts[one.kind] += 1
                    if not NAMES[one.kind] & set(codes):
                        missed[one.kind] += 1
                        print(f"missed: {what}: {', '.join(codes) or 'nothing'}", flush=True)
    for kind in NAMES:
        print(f"{kind:25} {counts[kind] - missed[kind]:5} of {counts[kind]:5} named; {unseen[kind]} cannot be noticed")
    total, named = counts.total(), counts.total() - missed.total()
    print(f"{named} of {total} named, {named / max(total, 1):.2%}; the slowest took {slow[0]:.2f} s ({slow[1]})")
    return named >= NAMED * total


def sound(args: argparse.Namespace, folder: Path) -> bool:
    """Count sound logs of which something is reported."""
    alarms, done, seed = 0, 0, 0
    while done < args.count:
        seed += 1
        for preset in args.presets.split(","):
            for motion in args.motions.split(","):
                rng = np.random.default_rng([seed, PRESETS.index(preset), MOTIONS.index(motion)])
                rate = ("--rate", str(int(rng.choice([200, 500, 1000]))), "--duration", str(int(rng.integers(10, 31))))
                log = simulated(preset, motion, 1000 + seed, folder, rate if motion != "own" else ())
                if log is None:
                    continue
                done += 1
                if codes := found_in(log):
                    alarms += 1
                    print(f"alarm: {preset} {motion} {1000 + seed} {' '.join(rate)}: {', '.join(codes)}", flush=True)
                if not args.keep:
                    Path(log.path).unlink()
                if done >= args.count:
                    break
    print(f"{alarms} of {done} sound logs have a finding, {alarms / done:.2%}")
    return alarms <= FALSE_ALARMS * done


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("faults", "sound"))
    parser.add_argument("--presets", default=",".join(PRESETS))
    parser.add_argument("--motions", default=",".join(MOTIONS))
    parser.add_argument("--kinds", default="", help="those of the faults; all when absent")
    parser.add_argument("--share", type=float, default=1.0, help="part of the faults that are tried, drawn at random")
    parser.add_argument("--seeds", type=int, default=1, help="logs of each machine and motion that faults are put into")
    parser.add_argument("--count", type=int, default=500, help="sound logs")
    parser.add_argument("--logs", type=Path, help="a folder where logs are kept")
    args = parser.parse_args()
    args.keep = args.logs is not None
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.logs or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        return 0 if (faults if args.what == "faults" else sound)(args, folder) else 1


if __name__ == "__main__":
    sys.exit(main())
