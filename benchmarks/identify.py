"""`vsalog identify` next to `mujoco.sysid` on a simulated machine, and next to a usual five-parameter fit on real servos.

    python -m benchmarks.identify [--seconds 20] [--rounds 3] [--seed 0]
    python -m benchmarks.identify --so101 FOLDER [--motion chirp_sweep] [--joint Rotation [--joint …]]

The first simulates a series elastic joint by MuJoCo (a motor, a tendon as its spring, a link that hangs; RK4 at 1 kHz), adds
noise and steps to its channels, and lets both fit the same six numbers to the same log from the same guess, 30 % off. It prints
the errors of the numbers, and the time on processors and on the wall, in turn in the same run. Exits with 1 where vsalog takes
longer or its median error is larger.

FOLDER has a folder per motion of an SO-101 arm. Each joint is fitted on one motion, by `identify` and by the usual method for a
joint in a simulator: armature, damping, friction loss, bias and delay below a proportional loop, found by CMA-ES (Hansen 2016,
arXiv 1604.00772) over a simulation at 1 ms. Prints the errors of both on all other motions in which the joint moves. Exits with 1
where the ratio is above a half for more than two joints.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line has it, before numpy is there
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit
from scipy.signal import savgol_filter

from benchmarks.measure import machine
from vsalog.core.errors import VsalogError
from vsalog.identification.document import Identification
from vsalog.identification.run import Options, identify
from vsalog.readers import read
from vsalog.rig import Rig

GRAVITY, DISTANCE, PERIOD = 9.81, 0.1, 1e-3
TRUE = {
    "armature": 0.08,
    "motor damping": 0.4,
    "stiffness": 60.0,
    "link inertia": 0.05,
    "link damping": 0.1,
    "weight": 3.0,
}
KEYS = (
    "motor.inertia",
    "motor.damping",
    "transmission.stiffness",
    "link.inertia",
    "link.damping",
    "link.gravity_torque",
)
OFF, NOISE, STEP = 0.3, 0.02, np.deg2rad(0.01)
# Samples of a window that mujoco.sysid plays from the smoothed state, and of the smoother.
WINDOW, SMOOTHED = 1000, 101
HALF, ENOUGH_JOINTS = 0.5, 4

SEA = """
[joint.a]
kind = "elastic"
[joint.a.motor]
inertia = {0!r}
damping = {1!r}
[joint.a.transmission]
type = "linear"
stiffness = {2!r}
[joint.a.link]
inertia = {3!r}
damping = {4!r}
gravity_torque = {5!r}
[joint.a.signals]
motor_position = {{ channel = "theta", unit = "rad" }}
motor_torque = {{ channel = "torque", unit = "N*m" }}
link_position = {{ channel = "q", unit = "rad" }}
"""
SERVO = """
[joint.a]
kind = "rigid"
[joint.a.motor]
inertia = "1 kg*m^2 ± 0"
damping = 20
friction = {{ coulomb = 1.0 }}
[joint.a.link]
inertia = "0.001 kg*m^2 ± 0"
gravity_torque = 1.0
gravity_angle = 0.0
[joint.a.drive]
kind = "position-servo"
kp = 400.0
kd = 10.0
delay = "50 ms"
acceleration_limit = 40
[joint.a.signals]
commanded_position = {{ channel = "control.positions[{name}]", unit = "rad" }}
link_position = {{ channel = "state_motor.positions[{name}]", unit = "rad" }}
"""
JOINTS = ("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw")


def mjcf(numbers: np.ndarray) -> str:
    """Return the machine of six numbers, in the order of TRUE, as MJCF."""
    armature, damping, stiffness, inertia, link_damping, weight = (float(x) for x in numbers)
    mass = weight / GRAVITY / DISTANCE
    own = inertia - mass * DISTANCE**2
    return (
        f'<mujoco><option timestep="{PERIOD}" integrator="RK4" gravity="0 0 {-GRAVITY}"><flag contact="disable"/></option>'
        '<compiler boundmass="0" boundinertia="0"/><worldbody>'
        f'<body><joint name="motor" type="hinge" axis="0 1 0" armature="{armature!r}" damping="{damping!r}"/>'
        '<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/></body>'
        f'<body name="link"><joint name="link" type="hinge" axis="0 1 0" damping="{link_damping!r}"/>'
        f'<inertial pos="0 0 {-DISTANCE}" mass="{mass!r}" diaginertia="{own!r} {own!r} {own!r}"/></body></worldbody>'
        f'<tendon><fixed name="spring" stiffness="{stiffness!r}"><joint joint="link" coef="1"/><joint joint="motor" coef="-1"/>'
        '</fixed></tendon><actuator><motor name="torque" joint="motor"/></actuator>'
        '<sensor><jointpos name="theta" joint="motor"/><jointpos name="q" joint="link"/></sensor></mujoco>'
    )


def recorded(seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Return times, recorded torque, and recorded positions of motor and link, shape (N,) each."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(mjcf(np.array(list(TRUE.values()))))
    data, t = mujoco.MjData(model), np.arange(0.0, seconds, PERIOD)
    torque = (
        3.0 * np.sin(2.0 * np.pi * 0.4 * t)
        + 2.0 * np.sin(2.0 * np.pi * (0.5 + 0.15 * t) * t)
        + np.sign(np.sin(5.0 * t))
    )
    angles = np.empty((t.size, 2))
    for k in range(t.size):
        angles[k] = data.qpos
        data.ctrl[0] = torque[k]
        mujoco.mj_step(model, data)
    noisy = torque + NOISE * rng.standard_normal(t.size)
    return t, noisy, *(np.round(angles / STEP) * STEP).T


def by_sysid(log: tuple[np.ndarray, ...], guess: np.ndarray) -> np.ndarray:
    """Return the numbers that mujoco.sysid finds."""
    import mujoco
    from mujoco import sysid

    t, torque, theta, q = log
    spec = mujoco.MjSpec.from_string(mjcf(guess))

    def stiffness(s, p):
        tendon = s.tendons[0]
        values = np.zeros_like(np.atleast_1d(tendon.stiffness))
        values[0] = p.value[0]
        tendon.stiffness = values if values.size > 1 else float(values[0])

    modifiers = {
        "armature": lambda s, p: setattr(s.joint("motor"), "armature", p.value[0]),
        "motor damping": lambda s, p: _first(s.joint("motor"), "damping", p.value[0]),
        "stiffness": stiffness,
        "own inertia": lambda s, p: setattr(s.body("link"), "inertia", np.full(3, p.value[0])),
        "link damping": lambda s, p: _first(s.joint("link"), "damping", p.value[0]),
        "mass": lambda s, p: setattr(s.body("link"), "mass", p.value[0]),
    }
    mass = guess[5] / GRAVITY / DISTANCE
    begin = np.array([*guess[:3], guess[3] - mass * DISTANCE**2, guess[4], mass])
    parameters = sysid.ParameterDict()
    for (name, modifier), value in zip(modifiers.items(), begin, strict=True):
        parameters.add(sysid.Parameter(name, value, 0.05 * value, 20.0 * value, modifier=modifier))
    model = spec.compile()
    positions = np.stack([theta, q], axis=1)
    velocities = savgol_filter(positions, SMOOTHED, 3, deriv=1, delta=PERIOD, axis=0)
    sequences = []
    for k in range(0, t.size - WINDOW + 1, WINDOW):
        one = slice(k, k + WINDOW)
        start = sysid.create_initial_state(model, positions[k], velocities[k], np.zeros(0))
        sensors = sysid.TimeSeries.from_names(t[1:WINDOW], positions[one][1:], model)
        torques = sysid.TimeSeries(t[:WINDOW], torque[one, None])
        sequences.append(sysid.ModelSequences(f"sea {k}", spec, f"log {k}", start, torques, sensors))
    residual = sysid.build_residual_fn(models_sequences=sequences)
    found, _ = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False)
    x = found.as_vector()
    return np.array([*x[:3], x[3] + x[5] * DISTANCE**2, x[4], x[5] * GRAVITY * DISTANCE])


def _first(part, name: str, value: float) -> None:
    """Set a coefficient, or the first where MuJoCo has several of it."""
    now = getattr(part, name)
    if np.ndim(now):
        now = np.array(now)
        now[0] = value
        setattr(part, name, now)
    else:
        setattr(part, name, value)


def by_vsalog(log: Path, guess: np.ndarray) -> np.ndarray:
    """Return the numbers that `identify` finds."""
    found, _ = identify(log, [], Options(rig=Rig.from_toml(SEA.format(*map(float, guess)), "the guess")))
    return np.array([next(n.value for n in found.numbers if n.key == key) for key in KEYS])


def next_to_sysid(seconds: float, rounds: int, seed: int) -> bool:
    """Compare with mujoco.sysid; tell whether vsalog is as fast and as exact."""
    true = np.array(list(TRUE.values()))
    taken: dict[str, list[tuple[float, float, np.ndarray]]] = {"vsalog": [], "mujoco.sysid": []}
    with tempfile.TemporaryDirectory() as folder:
        for k in range(rounds + 1):
            rng = np.random.default_rng([seed, k])
            guess = true * np.exp(OFF * rng.standard_normal(true.size))
            guess[5] = min(guess[5], 0.9 * guess[3] * GRAVITY / DISTANCE)  # the link has an inertia of its own
            log, path = recorded(seconds, rng), Path(folder) / "log.csv"
            head = "time [s],torque,theta,q"
            np.savetxt(path, np.stack(log, axis=1), delimiter=",", header=head, comments="", fmt="%.12g")
            ways: dict[str, Callable[[], np.ndarray]] = {
                "vsalog": lambda path=path, guess=guess: by_vsalog(path, guess),
                "mujoco.sysid": lambda log=log, guess=guess: by_sysid(log, guess),
            }
            for name, way in ways.items():
                wall, cpu = time.perf_counter(), time.process_time()
                found = way()
                if k:  # the first compiles
                    taken[name].append(
                        (time.process_time() - cpu, time.perf_counter() - wall, np.abs(found / true - 1.0))
                    )
    print(f"\n{seconds:g} s at 1 kHz, {len(KEYS)} numbers, {rounds} logs and guesses\n")
    print(f"| | CPU s | wall s | {' | '.join(TRUE)} | all |\n|{' --- |' * (len(TRUE) + 4)}")
    rows = {}
    for name, runs in taken.items():
        errors = np.median([e for _, _, e in runs], axis=0)
        rows[name] = np.array([*np.median([r[:2] for r in runs], axis=0), *errors, np.median([e for _, _, e in runs])])
        print(
            f"| {name} | {rows[name][0]:.2f} | {rows[name][1]:.2f} | {' | '.join(f'{e:.3%}' for e in rows[name][2:])} |"
        )
    ratios = rows["mujoco.sysid"] / rows["vsalog"]
    print(f"| sysid / vsalog | {' | '.join(f'{r:.2f}' for r in ratios)} |")
    return bool(ratios[0] >= 1.0 and ratios[-1] >= 1.0)


@njit(cache=True)
def _loop(
    commands: np.ndarray, first: float, period: float, kp: float, armature: float, damping: float, friction: float, bias: float,
    delay: float,
) -> np.ndarray:  # fmt: skip
    """Return the position at each sample: a proportional loop on a held, late command, semi-implicit Euler, Coulomb stiction."""
    steps = round(period / 1e-3)
    h = period / steps
    out = np.empty(commands.size)
    q, v = first, 0.0
    for k in range(commands.size):
        out[k] = q
        for j in range(steps):
            late = int(np.floor((k * steps + j) / steps - delay / period))
            torque = kp * (commands[max(late, 0)] - q) - bias
            free = v + h * (torque - damping * v) / armature
            held = h * friction / armature
            v = 0.0 if abs(free) <= held else free - held * np.sign(free)
            q += h * v
    return out


KP = 17.8
"""Of the proportional loop [N·m/rad]: torques are relative to it, any would do."""


def five_parameters(commands: np.ndarray, positions: np.ndarray, period: float, seed: int = 1) -> np.ndarray:
    """Fit (armature, damping, friction, bias, delay) by CMA-ES."""
    import cma

    def values(x: np.ndarray) -> np.ndarray:
        # Logarithms of what is positive, next to a usual servo's; the bias as it is.
        return np.array([0.05 * np.exp(x[0]), 1.0 * np.exp(x[1]), 0.1 * np.exp(x[2]), x[3], 0.04 * np.exp(x[4])])

    def loss(x: np.ndarray) -> float:
        there = _loop(commands, positions[0], period, KP, *values(x))
        error = float(np.mean((there - positions) ** 2))
        return error if np.isfinite(error) else 1e6

    options = {"seed": seed, "verbose": -9, "maxfevals": 4000, "bounds": [[-5, -5, -5, -5, -4], [5, 5, 5, 5, 2]]}
    best = min(
        (cma.fmin2(loss, np.zeros(5), 1.0, options | {"seed": seed + k}) for k in range(3)), key=lambda f: f[1].best.f
    )
    return values(np.asarray(best[0]))


def motion(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Return commands and positions of a joint on even samples, shape (N,), and their period."""
    channels = {f"{kind}.positions[{name}]" for kind in ("control", "state_motor")}
    there = read(folder, channels, "auto", None, None, None).channels
    stamps = {c: (there[c].stamps - there[f"state_motor.positions[{name}]"].stamps[0]) * 1e-9 for c in channels}
    t = stamps[f"state_motor.positions[{name}]"]
    period = float(np.median(np.diff(t)))
    even = np.arange(0.0, t[-1], period)
    control = f"control.positions[{name}]"
    # What is commanded is held until the next.
    index = np.clip(np.searchsorted(stamps[control], even + 1e-9, side="right") - 1, 0, stamps[control].size - 1)
    positions = np.interp(even, t, np.asarray(there[f"state_motor.positions[{name}]"].values))
    return np.ascontiguousarray(np.asarray(there[control].values)[index]), positions, period


def next_to_five_parameters(folder: Path, learned: Path, joints: list[str]) -> bool:
    """Compare on the servos of an arm; tell whether errors are half as large for enough joints."""
    others = sorted(p for p in folder.iterdir() if p.is_dir() and p != learned)
    print(f"\n| joint | CPU s | {' | '.join(p.name for p in others)} | all | ratio |\n|{' --- |' * (len(others) + 4)}")
    met = 0
    for name in joints:
        commands, positions, period = motion(learned, name)
        cpu = time.process_time()
        values = five_parameters(commands, positions, period)
        plain_time, cpu = time.process_time() - cpu, time.process_time()
        held = [p for p in others if np.ptp(motion(p, name)[0]) > 0.0]
        found = _identified(learned, held, name)
        own_time = time.process_time() - cpu
        errors, cells = [], []
        for path in others:
            error = next((e for e in found.errors if e.where == path.name), None)
            if error is None:
                cells.append("–")
                continue
            c, q, t = motion(path, name)
            plain = float(np.sqrt(np.mean((_loop(c, q[0], t, KP, *values) - q) ** 2)))
            errors.append((error.identified, plain, q.size))
            cells.append(f"{error.identified:.5f}, {plain:.5f}")
        own, plain = (
            float(np.sqrt(np.average([e[i] ** 2 for e in errors], weights=[e[2] for e in errors]))) for i in (0, 1)
        )
        met += own <= HALF * plain
        print(
            f"| {name} | {own_time:.1f}, {plain_time:.1f} | {' | '.join(cells)} | {own:.5f}, {plain:.5f} | {own / plain:.2f} |",
            flush=True,
        )
    print(
        f"\nvsalog, five parameters [rad]; at most {HALF:g} for {met} of {len(joints)} joints, wanted {ENOUGH_JOINTS} of 6"
    )
    return met >= min(ENOUGH_JOINTS, len(joints))


def _identified(log: Path, held: list[Path], name: str) -> Identification:
    options = Options(rig=Rig.from_toml(SERVO.format(name=name), name), free=("link.gravity_angle",))
    try:
        return identify(log, held, options)[0]
    except VsalogError as error:
        sys.exit(f"{name}: {error}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--so101", type=Path, metavar="FOLDER")
    parser.add_argument("--motion", default="chirp_sweep", help="the folder that is learned from")
    parser.add_argument("--joint", action="append", choices=JOINTS)
    given = parser.parse_args()
    print(machine("vsalog", "numba", "numpy", "scipy", "mujoco", "cma"))
    if given.so101 is not None:
        return 0 if next_to_five_parameters(given.so101, given.so101 / given.motion, given.joint or list(JOINTS)) else 1
    return 0 if next_to_sysid(given.seconds, given.rounds, given.seed) else 1


if __name__ == "__main__":
    sys.exit(main())
