"""Torque channels that are no measurements, told before anything is fitted to them."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsalog.checks.torque_independence import computed_from
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.diagnosis.causes.one_number import TORQUES
from vsalog.residuals.sensing import at_joint, each_sensor
from vsalog.rig.schema import AwasTransmission


def not_independent(signals: JointSignals, joint: Any) -> dict[str, Finding]:
    """Return torque sensor's role → the finding that it is no measurement.

    Parameters
    ----------
    signals : as recorded, in the joint's units
    joint : of the rig
    """
    # A formula in the drive or in the log has the positions, not what their sensors make of them.
    roles, found = each_sensor(at_joint(joint), signals), {}
    for role in (r for r in TORQUES if r in roles):
        suffix = role.removeprefix("torque_sensor")
        others = {f"deflection{suffix}": "the deflection", f"motor_torque{suffix}": "the motor's torque"}
        known = {what: roles[name] for name, what in others.items() if name in roles}
        position = f"motor_position{suffix}"
        if "link_position" in roles and position in roles:
            # Two encoders and a sensor of their difference may all be there; a torque was computed from one of them.
            name = "the deflection" if "the deflection" not in known else "the difference of the positions"
            known[name] = roles["link_position"] - roles[position]
        torque = np.asarray(roles[role])
        if isinstance(getattr(joint, f"transmission{suffix}", None), AwasTransmission) and "setpoint" in roles:
            # A formula has the lever arm squared in it (Flacco 2012 eq. 49).
            torque = torque / np.asarray(roles["setpoint"]) ** 2
        for what, x in known.items():
            own = np.asarray(roles[role]) if what == "the motor's torque" else torque
            why = computed_from(own, signals.joint, role, np.asarray(x), what)
            if why is not None:
                found[role] = why
                break
    return found
