"""What a diagnosis made of a case, next to what was hidden in it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .alike import BELOW, split

VERDICTS = ("consistent", "explained", "partly explained", "unexplained")
# A 95 % interval is so many standard deviations to either side.
SIDES = 1.96
# An effect counts as plainly visible from this size on.
PLAIN = 5.0
# A diagnosed Stribeck curve that falls by no more than this share says the same as Coulomb friction.
FLAT = 0.15
# The ways an outside variable may be put: any of these words in what a diagnosis depends on.
WORDS = {
    "time": ("time",),
    "motor_position": ("motor_position", "motor angle", "motor_angle", "theta"),
    "motor_velocity": ("motor_velocity", "motor_speed", "motor velocity", "theta_dot"),
    "link_position": ("link_position", "link angle", "link_angle", "q"),
    "link_velocity": ("link_velocity", "link_speed", "link velocity", "q_dot"),
}


@dataclass
class Estimate:
    """A parameter that was diagnosed next to its truth.

    Attributes
    ----------
    name : cause and parameter
    covered : whether the 95 % interval contains the truth
    error : relative to the truth
    of_change : relative to how far the truth is from what the rig states; of a phase, to half a turn
    """

    name: str
    covered: bool
    error: float
    of_change: float


@dataclass
class Outcome:
    """How a case went.

    Attributes
    ----------
    case, kind, device, roles : of the case
    truth : "cause@part" of what was hidden, the size of each
    sizes : of each
    ended : verdict, or why there is none
    named : "cause@part" in the diagnosis' order
    right : for each hidden effect, whether it was named anywhere
    first : whether the first that is named is one of them
    cause_only : the same, whatever the part
    extra : how many were named that were not hidden
    in_set : whether the truth is named first or is in what the first cannot be distinguished from
    set_size : of that
    estimates : of what was named rightly
    gains : per signal: error after over the noise floor, on held-out data
    worse : whether the held-out error became larger
    outside : for what is outside the catalogue: unexplained or partly explained, side right, variable right
    seconds : the diagnosis took
    equal : for each member of the set, whether it really fits as well; where that was looked at
    """

    case: str
    kind: str
    device: str
    roles: str
    truth: list[str]
    sizes: list[float]
    ended: str
    named: list[str] = field(default_factory=list)
    right: list[bool] = field(default_factory=list)
    first: bool = False
    cause_only: bool = False
    extra: int = 0
    in_set: bool = False
    set_size: int = 0
    members: list[str] = field(default_factory=list)
    estimates: list[Estimate] = field(default_factory=list)
    gains: list[float] = field(default_factory=list)
    worse: bool = False
    outside: dict[str, bool] = field(default_factory=dict)
    seconds: float = 0.0
    equal: list[bool] = field(default_factory=list)

    @property
    def failed(self) -> bool:
        """Whether there is no diagnosis."""
        return self.ended not in VERDICTS


def score(
    truth: Mapping[str, Any], diagnosis: Mapping[str, Any] | None, seconds: float = 0.0, problem: str = ""
) -> Outcome:
    """Hold a diagnosis against the truth.

    Parameters
    ----------
    truth : of the sealed file
    diagnosis : of diagnosis.json; none where the command failed
    seconds : it took
    problem : why there is no diagnosis
    """
    effects = truth["effects"]
    outcome = Outcome(
        case=truth["case"],
        kind=truth["case"].split("-")[0],
        device=truth["device"],
        roles=truth["roles"],
        truth=[_key(e) for e in effects] or ([truth["outside"]["what"]] if truth["outside"] else []),
        sizes=[e["size"] for e in effects] or ([truth["outside"]["size"]] if truth["outside"] else []),
        ended=problem or "no diagnosis",
        seconds=seconds,
    )
    if diagnosis is None:
        outcome.right = [False] * len(effects)
        return outcome
    causes = diagnosis["causes"]
    outcome.ended, outcome.named = diagnosis["verdict"], [_key(c) for c in causes]
    outcome.right = [any(_is(c, e) for c in causes) for e in effects]
    outcome.extra = sum(not any(_is(c, e) for e in effects) for c in causes)
    outcome.first = bool(causes) and any(_is(causes[0], e) for e in effects)
    outcome.cause_only = bool(causes) and any(causes[0]["cause"] == e["cause"] for e in effects)
    if causes and effects:
        outcome.members = list(causes[0].get("indistinguishable_from", []))
        outcome.set_size = len(outcome.members)
        outcome.in_set = outcome.first or any(_listed(m, e) for m in outcome.members for e in effects)
    outcome.estimates = [x for e in effects for c in causes if _same(c, e) for x in _estimates(c, e)]
    outcome.gains, outcome.worse = _gains(diagnosis)
    if truth["outside"]:
        outcome.outside = _outside(truth["outside"], diagnosis)
    return outcome


def _key(cause: Mapping[str, Any]) -> str:
    return f"{cause['cause']}@{cause.get('part', '')}"


def _same(named: Mapping[str, Any], effect: Mapping[str, Any]) -> bool:
    return named["cause"] == effect["cause"] and named.get("part") in (None, effect["part"])


def _is(named: Mapping[str, Any], effect: Mapping[str, Any]) -> bool:
    """Tell whether a named cause is what was hidden, or is the same physics (see `alike`)."""
    if _same(named, effect):
        return True
    if effect.get("alike", {}).get(_key(named), np.inf) < BELOW:
        return True
    if (named["cause"], effect["cause"]) == ("motor.stribeck_friction", "motor.coulomb_friction"):
        # Bristles give way before they slip, so a curve that hardly falls is Coulomb friction by another name.
        told = {k: v["value"] for k, v in named.get("parameters", {}).items()}
        flat = told.get("static", np.inf) <= (1.0 + FLAT) * told.get("torque", 0.0)
        return bool(flat and named.get("part") in (None, effect["part"]))
    return False


def _listed(member: str, effect: Mapping[str, Any]) -> bool:
    """Tell whether a member of a set, "cause", "cause@part" or "cause (part)", is what was hidden."""
    cause, part = split(member)
    if cause != effect["cause"]:
        return False
    return part in ("", effect["part"]) or effect.get("alike", {}).get(f"{cause}@{part}", np.inf) < BELOW


def _estimates(named: Mapping[str, Any], effect: Mapping[str, Any]) -> list[Estimate]:
    out = []
    told = named.get("parameters", {})
    for name, true in effect["parameters"].items():
        label = f"{effect['cause']}.{name}"
        if name not in told or told[name].get("value") is None:
            out.append(Estimate(label, False, float("inf"), float("inf")))
            continue
        value, std = float(told[name]["value"]), float(told[name].get("std") or 0.0)
        change = abs(true - effect.get("nominal", {}).get(name, 0.0)) or abs(true)
        if name == "phase":
            value, change = _turned(value, true, told, effect), np.pi
        elif name in ("torque", "amplitude") and "phase" in effect["parameters"]:
            value = abs(value)
            true = abs(true)
        off = abs(value - true)
        size = np.pi if name == "phase" else abs(true) or change
        out.append(Estimate(label, bool(off <= SIDES * std), off / size, off / change))
    return out


def _turned(value: float, true: float, told: Mapping[str, Any], effect: Mapping[str, Any]) -> float:
    """Return a phase within half a turn of the true one; a negative amplitude is half a turn more."""
    for name in ("torque", "amplitude"):
        if told.get(name, {}).get("value", 0.0) * effect["parameters"].get(name, 0.0) < 0.0:
            value += np.pi
    return true + float(np.remainder(value - true + np.pi, 2.0 * np.pi) - np.pi)


def _gains(diagnosis: Mapping[str, Any]) -> tuple[list[float], bool]:
    """Return error after over noise floor of each signal, and whether the extension made the errors larger in all."""
    gain = diagnosis.get("gain") or {}
    floors = {(s.get("joint"), s["signal"]): s.get("noise_floor") for s in diagnosis.get("simulation_error", [])}
    ratios, changes = [], []
    for signal in gain.get("signals", []):
        if signal["signal"].startswith("stiffness"):
            continue  # what an estimate of the stiffness gains is reported next to the simulation's
        floor = signal.get("noise_floor") or floors.get((signal.get("joint"), signal["signal"]))
        if floor and signal.get("rmse_after") is not None:
            ratios.append(float(signal["rmse_after"]) / float(floor))
        if signal.get("rmse_before") and signal.get("rmse_after"):
            changes.append(np.log(signal["rmse_after"] / signal["rmse_before"]))
    worse = bool(diagnosis["causes"] and changes and np.mean(changes) > 0.0)
    return ratios, worse


def _outside(outside: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> dict[str, bool]:
    left = diagnosis.get("unexplained") or {}
    said = " ".join(str(v) for v in left.get("depends_on") or []).lower()
    words = [w for variable in outside["depends_on"] for w in WORDS[variable]]
    return {
        "unexplained": diagnosis["verdict"] in ("unexplained", "partly explained"),
        "side": left.get("where") == outside["side"],
        "variable": any(word in said for word in words),
        "confident": diagnosis["verdict"] == "explained",
    }


def read(folder: Path) -> dict[str, Any] | None:
    """Read a folder's diagnosis.json; none where there is none."""
    path = folder / "diagnosis.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def share(flags: Sequence[bool]) -> float | None:
    """Return how many of them are true, as a share; none of nothing."""
    return float(np.mean(flags)) if len(flags) else None


def median(values: Sequence[float]) -> float | None:
    """Return the median; none of nothing."""
    return float(np.median(values)) if len(values) else None
