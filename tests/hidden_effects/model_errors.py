"""Effects that the catalogue lacks and that real machines have: a flexible base, ripple, uneven friction, late drives, jitter."""

from __future__ import annotations

import numpy as np

from .effects import Effect, effect, link, link_of, main_motors, motor_of, presliding, within

MODEL_ERRORS: dict[str, Effect] = {}


def _model_error(name: str, parts, bounds, shape):
    return effect(name, parts, bounds, shape, MODEL_ERRORS)


def _base(rng, machine, part, scales):
    return {"frequency": rng.uniform(8.0, 15.0), "loss": rng.uniform(0.02, 0.1)}


@_model_error("flexible base", link, within(0.0, 1.0), _base)
def _(s, shape, machine, sensors, part, scales):
    row, omega = link_of(machine), 2.0 * np.pi * shape["frequency"]
    if s > 0.0:
        row["base_inertia"] = inertia = float(row["inertia"]) / s
        row["base_stiffness"] = inertia * omega**2
        row["base_damping"] = 2.0 * shape["loss"] * inertia * omega
    return {"share": s, **shape}


def _waves(rng, machine, part, scales):
    gear = float(motor_of(machine, part)["gear"])
    low, high = scales.turn[part]
    possible = [n for n in (2, 4, 6, 12, 18, 36) if 6.0 < n * gear * (high - low) < 900.0]
    return {"order": float(rng.choice(possible or [1])), "phase": rng.uniform(-np.pi, np.pi)}


@_model_error("ripple of the drive's torque", main_motors, within(0.0, 0.15), _waves)
def _(s, shape, machine, sensors, part, scales):
    row = motor_of(machine, part)
    row["ripple"], row["ripple_order"], row["ripple_phase"] = s, shape["order"], shape["phase"]
    return {"share": s, **shape}


def _places(rng, machine, part, scales):
    low, high = scales.turn[part]
    return {
        "order": 2.0 * np.pi * rng.uniform(0.6, 3.0) / (high - low),
        "phase": rng.uniform(-np.pi, np.pi),
        "uneven": rng.uniform(0.6, 0.95),
    }


@_model_error("friction that depends on the position", main_motors, within(0.0, 0.25), _places)
def _(s, shape, machine, sensors, part, scales):
    row = motor_of(machine, part)
    # It comes on top of what Coulomb friction is there.
    row["level"] += s * scales.torque[part]
    row["breakaway"], row["stribeck"] = (
        max(float(row["breakaway"]), float(row["level"])),
        max(float(row["stribeck"]), 1e-3),
    )
    row["presliding"] = presliding(scales, part)
    row["uneven"], row["uneven_order"], row["uneven_phase"] = shape["uneven"], shape["order"], shape["phase"]
    return {"torque": s * scales.torque[part], **shape}


@_model_error("filter in the drive", main_motors, within(0.0, 0.02), lambda *_: {})
def _(s, shape, machine, sensors, part, scales):
    motor_of(machine, part)["lag"] = s
    return {"time": s}


@_model_error("stamps that jitter", lambda machine: ["stamps"], within(0.0, 4e-4), lambda *_: {})
def _(s, shape, machine, sensors, part, scales):
    sensors.jitter = s
    return {"deviation": s}
