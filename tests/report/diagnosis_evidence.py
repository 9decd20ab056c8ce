"""Diagnoses made by hand, of signals in closed form."""

import numpy as np

from vsalog.diagnosis.document import (
    VERSION,
    Bin,
    Diagnosis,
    EquationError,
    FoundCause,
    Gain,
    Gains,
    Number,
    SignalError,
    Unexplained,
)
from vsalog.diagnosis.evidence import CauseEvidence, EquationEvidence, JointEvidence, SignalEvidence

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>\u2028<!--"
LEVEL, NOISE, PERIOD = 0.2, 0.004, 1e-3
RIG = 'name = "r"\n\n[joint.elbow.motor]\ninertia = 0.1\ndamping = 0.2\n'
EXTENDED = RIG + "\n[joint.elbow.motor.friction]\ncoulomb = 0.2\n"


def friction_evidence(count=20_000, joint="elbow", windows=None):
    """Coulomb friction of 0.2 N·m over a velocity of cos(t): position's error before is 0.01 sin(7 t), after 1e-4 sin(70 t)."""
    t = np.arange(count) * PERIOD
    measured = np.sin(t)
    before, after = measured + 0.01 * np.sin(7.0 * t), measured + 1e-4 * np.sin(70.0 * t)
    if windows is not None:
        measured, before, after = (np.where(windows, v, np.nan) for v in (measured, before, after))
    rows = t[12:-12:25]
    velocity = np.cos(rows)
    noise = NOISE * np.random.default_rng(1).standard_normal(rows.size)
    shape = -LEVEL * np.sign(velocity)
    cause = CauseEvidence("motor.coulomb_friction", "motor", "motor", "motor_velocity", shape + noise, shape)
    return JointEvidence(
        joint, t, {"motor_position": SignalEvidence("rad", measured, before, after)}, "log.mcap", rows,
        {"motor": EquationEvidence("motor", "N*m", shape + noise, noise, NOISE)},
        {"motor_velocity": (velocity, "rad/s"), "time": (rows, "s"), "deflection": (np.sin(rows), "rad")}, (cause,),
    )  # fmt: skip


def found_cause(name="motor.coulomb_friction", joint="elbow", **more):
    told = {
        "cause": name, "joint": joint, "part": "motor", "title": "Dry friction of the motor is missing",
        "parameters": {"torque": Number(value=0.2, std=0.001, unit="N*m")}, "common_with": (), "material": True, "size": 8.0,
        "confidence": 0.985, "class_confidence": 0.985, "indistinguishable_from": (), "error_removed": 0.91,
        "stiffness_change": 0.034,
        "why": "A level with the sign of the velocity.",
        "how_to_confirm": "Raise the torque slowly.", "tell_apart": "", "reference": "Armstrong (1994)",
    }  # fmt: skip
    return FoundCause(**(told | more))


def position_gain(**more):
    told = {
        "joint": "elbow", "signal": "motor_position", "unit": "rad", "rmse_before": 0.008, "rmse_after": 0.0004,
        "noise_floor": 0.0002, "reduction": 0.95, "ci95": (0.9, 0.975),
    }  # fmt: skip
    return Gain(**(told | more))


def diagnosis(**more):
    told = {
        "version": VERSION, "vsalog": "0", "log": "log.mcap", "log_sha256": "0" * 64, "holdout": None, "holdout_sha256": None,
        "rig": RIG, "settings": {"time": "auto"}, "verdict": "explained", "sentences": ("One.", "Two.", "Three."),
        "p_values": {"elbow": 0.001},
        "simulation_error": (
            SignalError(joint="elbow", signal="motor_position", unit="rad", rmse=0.008, noise_floor=0.0002, nrmse=0.4),
        ),
        "equations": (
            EquationError(joint="elbow", equation="motor", side="motor", unit="N*m", rms_before=0.2, rms_after=0.004,
                          noise=0.004),
        ),
        "causes": (found_cause(),),
        "gain": Gains(holdout=False, where="windows of the log itself", signals=(position_gain(),)),
        "unexplained": Unexplained(fraction=0.0, where=None, depends_on=()), "next_experiment": "", "findings": (),
    }  # fmt: skip
    return Diagnosis(**(told | more))


def remainder(**more):
    """A detent of 0.05 N·m between 0 and 0.1 rad."""
    curve = tuple(Bin(low=a, high=a + 0.1, mean=0.05 * (abs(a) < 0.05), std=0.001) for a in (-0.2, -0.1, 0.0, 0.1))
    told = {"fraction": 0.12, "where": "motor", "depends_on": ("motor_position",), "equation": "motor", "curve": curve,
            "unit": "rad"}  # fmt: skip
    return Unexplained(**(told | more))
