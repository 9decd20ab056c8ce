"""Hold what `vsalog plan` predicts against diagnoses of simulated logs: ``python -m docs.make_plan [--causes N] [--seed S]``.

For rigs, sensors and motions a cause is hidden in the machine, its log is simulated and diagnosed, and the class of causes that
the diagnosis cannot separate is compared with the predicted one. Where it is ambiguous and a motion may tell more, the proposed
motion is simulated with the same machine and diagnosed. The counts go to docs/battery/plan.json,
the table into docs/performance/planning.md.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from vsalog.binding.joint import offered_roles
from vsalog.core.errors import VsalogError
from vsalog.core.significance import SIGNIFICANCE
from vsalog.diagnosis.isolability import Isolation, Key, isolations
from vsalog.diagnosis.joint import JointDiagnosis, diagnose_joint
from vsalog.diagnosis.linear import placed
from vsalog.diagnosis.plan import Options, plan_joint, planned, signals_of, subject_of
from vsalog.diagnosis.priors import felt
from vsalog.diagnosis.suggest_range import Limits
from vsalog.residuals.sensing import at_joint
from vsalog.rig import Rig
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

HERE = Path(__file__).parent
KEPT, PAGE = HERE / "battery" / "plan.json", HERE / "performance" / "planning.md"
BEGIN, END = "<!-- written by python -m docs.make_plan -->", "<!-- end of what docs.make_plan writes -->"
RIGID = """
name = "rigid"
[joint.arm]
kind = "rigid"
[joint.arm.motor]
inertia = 0.02
damping = 0.05
gear_ratio = 10.0
[joint.arm.motor.friction]
coulomb = 0.2
[joint.arm.link]
inertia = 0.05
gravity_torque = 1.5
[joint.arm.signals]
motor_position = { channel = "motor position", resolution = 1e-4 }
motor_torque = { channel = "motor torque", noise = 5e-3 }
"""
TORQUES = ("torque_sensor", "torque_sensor_1", "torque_sensor_2")
SENSORS: dict[str, tuple[str, ...]] = {
    "all": (),
    "no torque sensor": TORQUES,
    "no motor torque": ("motor_torque", "motor_torque_1", "motor_torque_2"),
    "no link encoder": ("link_position",),
}
MACHINES = ("rigid", "sea", "vsa2", "awas", "cubic-antagonist")
DURATION, PERIOD = 8.0, 2e-3


@dataclass(frozen=True)
class Setup:
    """A machine with some of its sensors, and a motion."""

    machine: str
    sensors: str
    motion: str
    rig: Rig
    joint: str
    scenario: Scenario
    limits: Limits

    @property
    def label(self) -> str:
        """What it is called in the table."""
        return f"{self.machine}, {self.sensors}, {self.motion}"


def setups(only: str | None) -> Iterator[Setup]:
    """Yield the setups; a motion is the machine's usual one, or a small one of a single frequency."""
    for machine in MACHINES:
        if only not in (None, machine):
            continue
        whole = Rig.from_toml(RIGID, "rigid") if machine == "rigid" else Rig.preset(machine)
        (name,) = whole.joints
        joint = at_joint(whole.joints[name])
        for sensors, dropped in SENSORS.items():
            gone = {role: None for role in dropped if getattr(joint.signals, role, None) is not None}
            if dropped and (not gone or machine == "rigid"):
                continue
            fewer = msgspec.structs.replace(joint, signals=msgspec.structs.replace(joint.signals, **gone))
            rig = whole.with_joints({name: fewer}, machine)
            for motion in ("usual", "small"):
                usual = Scenario.find("servo" if motion == "small" else None, rig.file, PERIOD)
                scenario = planned(usual.lasting(DURATION, PERIOD), rig, [name])
                if motion == "usual":
                    limits = taken(rig, name, scenario)
                scenario = small(scenario) if motion == "small" else scenario
                yield Setup(machine, sensors, motion, rig, name, scenario, limits)


def taken(rig: Rig, name: str, scenario: Scenario) -> Limits:
    """Return the torque, speed and angle that a motion takes: those of the usual one are the limits of what is proposed."""
    file = scenario.file
    truth = simulate(rig.file, scenario.inputs(rig.file), file.duration, period=file.period).joints[name].truth

    def most(*words: str) -> float:
        sizes = [np.max(np.abs(x)) for key, x in truth.items() if all(w in key for w in words)]
        return float(max(sizes))

    angle, speed = (max(most("motor", what), most("link", what)) for what in ("position", "velocity"))
    return Limits(most("motor_torque"), speed, angle)


def small(scenario: Scenario) -> Scenario:
    """Return a scenario with its motors' sines at a fifth of their size and at one frequency of 0.5 Hz."""

    def part(one: Any) -> Any:
        return msgspec.structs.replace(one, amplitude=0.2 * one.amplitude, frequency=0.5, offset=0.2 * one.offset)

    joints = {}
    for name, drives in scenario.file.joint.items():
        loops = {
            key: msgspec.structs.replace(loop, reference=tuple(map(part, loop.reference)))
            for key, loop in msgspec.structs.asdict(drives).items()
            if key.startswith("motor_servo") and loop is not None
        }
        joints[name] = msgspec.structs.replace(drives, **loops)
    return replace(scenario, file=msgspec.structs.replace(scenario.file, joint=joints))


def diagnosed(setup: Setup, cause: Isolation, scenario: Scenario, seed: int) -> JointDiagnosis:
    """Diagnose a log of the machine with a cause in it."""
    joint = setup.rig.joints[setup.joint]
    machine = setup.rig.with_joints({setup.joint: placed(joint, cause.fit)})
    signals = signals_of(machine, setup.joint, scenario, joint, seed)
    return diagnose_joint(setup.joint, joint, signals, None, stated=felt(joint, setup.rig.tolerances[setup.joint]))


def class_in(found: JointDiagnosis, cause: Isolation) -> frozenset[Key] | None:
    """Return the class that a diagnosis has a cause in; none where it has it in none."""
    for one in found.found:
        sites = [one.site, *one.choice.rivals]
        keys = {s.key for s in sites} | {(double, "") for s in sites for double in s.doubles}
        if cause.site.key in keys:
            return frozenset(keys)
    return None


def case(setup: Setup, cause: Isolation, seed: int) -> dict[str, Any]:
    """Return what was predicted of a cause and what a diagnosis said."""
    got = class_in(diagnosed(setup, cause, setup.scenario, seed), cause)
    likely, sure, possible = (cause.members(p) for p in (0.5, 1.0 - SIGNIFICANCE, SIGNIFICANCE))
    equal = got == likely if cause.visible and got is not None else (got is None) == (not cause.visible)
    within = cause.seen <= 1.0 - SIGNIFICANCE if got is None else cause.seen >= SIGNIFICANCE and sure <= got <= possible
    return {
        "cause": list(cause.site.key), "predicted": sorted(map(list, likely)), "seen": round(cause.seen, 3),
        "diagnosed": None if got is None else sorted(map(list, got)), "equal": bool(equal), "within": bool(within),
    }  # fmt: skip


def run(setup: Setup, causes: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return the cases of a setup, and what became of ambiguous ones with the proposed motion."""
    began = time.perf_counter()
    subject = subject_of(setup.rig, setup.joint, setup.scenario, setup.rig.joints[setup.joint])
    found = isolations(subject.problem, subject.system)
    shuffled = [found[i] for i in rng.permutation(len(found))]
    # Half of them of those that are predicted to be confused, if there are so many: they are the harder ones.
    hard = [one for one in shuffled if one.visible and len(one.members(0.5)) > 1][: causes // 2]
    drawn = hard + [one for one in shuffled if one not in hard][: causes - len(hard)]
    out = {"setup": setup.label, "cases": [case(setup, one, 1 + i) for i, one in enumerate(drawn)], "resolved": []}
    ambiguous = {tuple(c["cause"]): c for c in out["cases"] if c["diagnosed"] is not None and len(c["diagnosed"]) > 1}
    there = next(iter(offered_roles(setup.rig.joints[setup.joint])))
    options = Options(limits=setup.limits, sensors={there: None})  # no further sensor is looked for
    plan = plan_joint(setup.rig, setup.joint, setup.scenario, options) if ambiguous else None
    if plan is not None and plan.proposed is not None:
        scenario = Scenario(plan.proposed.best.candidate.file)
        for confused in plan.classes:
            for one in confused.causes:
                if one.site.key not in ambiguous or not confused.structure.open(one):
                    continue
                rivals = {r.site.key for r in confused.structure.open(one)}
                before = frozenset(map(tuple, ambiguous[one.site.key]["diagnosed"]))
                if not before & rivals:
                    continue
                try:
                    after = class_in(diagnosed(setup, one, scenario, 101), one)
                except VsalogError:
                    after = None
                out["resolved"].append({
                    "cause": list(one.site.key), "promised": confused.by_motion, "seconds": scenario.file.duration,
                    "resolved": after is not None and not after & before & rivals,
                })  # fmt: skip
    out["seconds"] = round(time.perf_counter() - began, 1)
    return out


def table(kept: dict[str, Any]) -> str:
    """Return the counts as Markdown."""
    rows = ["| machine, sensors, motion | cases | equal | within | ambiguous | resolved, of promised | of all open |"]
    rows.append("| --- | --- | --- | --- | --- | --- | --- |")

    def row(name: str, setups: list[dict[str, Any]]) -> str:
        cases = [c for s in setups for c in s["cases"]]
        tried = [r for s in setups for r in s["resolved"]]
        promised = [r for r in tried if r["promised"]]
        some = sum(c["diagnosed"] is not None and len(c["diagnosed"]) > 1 for c in cases)
        shares = (sum(c["equal"] for c in cases), sum(c["within"] for c in cases), some)
        won = f"{sum(r['resolved'] for r in promised)}/{len(promised)}"
        return f"| {name} | {len(cases)} | {shares[0]} | {shares[1]} | {shares[2]} | {won} | " + (
            f"{sum(r['resolved'] for r in tried)}/{len(tried)} |"
        )

    rows += [row(s["setup"], [s]) for s in kept["setups"]]
    rows.append(row("**all**", kept["setups"]))
    return "\n".join(rows)


def page() -> str:
    """Return the text of docs/performance/planning.md with the table of what is kept."""
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    return f"{before}{BEGIN}\n\n{table(kept)}\n\n{END}{rest.split(END)[1]}"


def main() -> None:
    """Run what is asked for and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--causes", type=int, default=8, help="of each setup, drawn at random; 0 writes the table only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--machine", choices=MACHINES)
    asked = parser.parse_args()
    if asked.causes:
        known = json.loads(KEPT.read_text(encoding="utf-8"))["setups"] if asked.machine and KEPT.is_file() else []
        done = [one for one in known if not one["setup"].startswith(f"{asked.machine},")]
        for setup in setups(asked.machine):
            rng = np.random.default_rng([asked.seed, *setup.label.encode()])
            try:
                done.append(run(setup, asked.causes, rng))
            except VsalogError as error:
                print(f"{setup.label}: {error}", flush=True)
                continue
            print(table({"setups": done[-1:]}).splitlines()[2], done[-1]["seconds"], flush=True)
            kept = {"seed": asked.seed, "causes": asked.causes, "setups": done}
            KEPT.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    if PAGE.is_file():
        PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
