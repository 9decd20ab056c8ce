"""impedance: stiffness, and inertia and damping of the link, from a joint torque sensor and the positions. No motor data.

Serio, Grioli, Sardellitti, Tsagarakis, Bicchi (2011), §III-B: a stiffness observer on the torque that the transmission bears, and
beside it an extended Kalman filter on the link, which that torque drives. Neither needs what the other finds.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from vsalog.estimators.borne_torque import BorneTorque
from vsalog.estimators.device import Device
from vsalog.estimators.following import Columns, ObserverFold, ObserverState, ObserverTuning
from vsalog.estimators.needs import require
from vsalog.estimators.sensor_error import LEAST_NOISE
from vsalog.estimators.windows import keeping_window, rms
from vsalog.filters.derivatives import Derivatives
from vsalog.filters.link_ekf import DECAY, MOBILITY, VELOCITY, LinkNoise, LinkState, anew, estimate_link, link_start
from vsalog.filters.savitzky_golay import savgol_filter
from vsalog.mechanics.links import link_weight
from vsalog.resolution import sensor_noise
from vsalog.signals import JointSignals

Array = NDArray[np.float64]

NAME = "impedance"
SUMMARY = "stiffness, link inertia and damping from positions and a torque sensor (Serio 2011)"
# 1/I and N/I may be so many times what accelerations, velocities and torques of the log are in proportion.
ROOM = 10.0
# 1/I is known when it is so many times its standard deviation: below, its inverse is anything.
KNOWN = 3.0
# What taking the torque between two samples as their mean may cost, as a share.
FLOOR = 1e-3


class ImpedanceTuning(ObserverTuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of impedance.

    Attributes
    ----------
    wander : share by which the link's inertia and damping may change within a second
    memory : time over which the innovations of the link's filter are averaged [s]
    """

    unused: ClassVar[tuple[str, ...]] = ("shape", "settle")

    wander: Annotated[float, Meta(ge=0.0)] = 1e-4
    memory: Annotated[float, Meta(gt=0.0)] = 10.0


TUNING = ImpedanceTuning


def printed(device: Device) -> dict[str, str]:
    """Return what Serio 2011 prints of the stiffness observer: eq. 15's differences, and the gain α of its experiment, §IV-C.

    §IV-B simulates with α = 2000 1/rad. A log is a recording, and so the gain is the one that suited the machine's encoders. The
    covariances Q, R and P(0) of §IV are of the link's filter, which takes its own from the log and has no tuning for them.
    """
    return {"derivative": "difference", "alpha": "8"}


def roles(device: Device, offered: Collection[str], tuning: ImpedanceTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    needed: list[str] = []
    for view in device.transmissions:
        needed += [*view.deflection_roles(offered), view.torque_sensor]
    require(NAME, device, needed, offered)
    beside = [role for role in ("link_position", "external_torque", "setpoint") if role in offered]
    return tuple(dict.fromkeys([*needed, *beside]))


def build(device: Device, signals: JointSignals, tuning: ImpedanceTuning) -> ImpedanceFold:
    """Assemble the estimator for a joint's signals.

    Raises
    ------
    EstimatorError
        A signal never changes.
    """
    return ImpedanceFold(device, signals, keeping_window(device, signals, tuning, tuning.default_window))


class ImpedanceFold(ObserverFold):
    """Both observers as an estimator: that of the stiffness on measured torques, and beside it the link's filter."""

    def __init__(self, device: Device, signals: JointSignals, tuning: ImpedanceTuning) -> None:
        torques = [BorneTorque(v, {v.torque_sensor: (1.0,)}, measured=True) for v in device.transmissions]
        orders = {role: order for t in torques for role, order in t.orders(signals.roles).items()}
        if "link_position" in signals.roles:
            orders["link_position"] = 2
        conditioner = Derivatives(orders, signals.period, tuning.window_for(signals), tuning.degree)
        super().__init__(NAME, "SENSOR", device, signals, tuning, torques, conditioner)
        self.memory = max(tuning.memory / signals.period, 10.0)
        self.noise = self._noise(signals, tuning) if "link_position" in signals.roles else None

    @property
    def derived(self) -> dict[str, float]:
        """The gain and the noise that were derived from the log."""
        noise = {} if self.noise is None else {f"noise_{n}": float(v) for n, v in self.noise._asdict().items()}
        return {**super().derived, **noise}

    def start_beside(self) -> LinkState:
        """Return the state of the link's filter before the first sample."""
        return link_start(self.noise or LinkNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))

    def block_beside(self, beside: LinkState, rows: JointSignals, begins: bool) -> tuple[LinkState, Columns]:
        """Return what the link's filter tells, from the signals as they were recorded: it filters itself."""
        if self.noise is None:
            return beside, {}
        x, P, _, after = estimate_link(
            anew(beside) if begins else beside, rows.roles["link_position"], self._acting(rows),
            self.period, self.noise, self.memory,
        )  # fmt: skip
        a, b = x[:, MOBILITY], x[:, DECAY]
        var_a, var_b, both = P[:, MOBILITY, MOBILITY], P[:, DECAY, DECAY], P[:, MOBILITY, DECAY]
        with np.errstate(divide="ignore", invalid="ignore"):
            known = a > KNOWN * np.sqrt(var_a)
            inertia, damping = 1.0 / a, b / a
            inertia_std = np.hypot(np.sqrt(var_a) / a**2, FLOOR * inertia)
            damping_std = np.sqrt(np.maximum(var_b - 2.0 * damping * both + damping**2 * var_a, 0.0)) / a
            damping_std = np.hypot(damping_std, FLOOR * damping)
        told = {
            "link_inertia": inertia,
            "link_inertia_std": inertia_std,
            "link_damping": damping,
            "link_damping_std": damping_std,
        }
        return after, {"link_velocity": x[:, VELOCITY], **{n: np.where(known, v, np.nan) for n, v in told.items()}}

    def warnings(self, state: ObserverState) -> tuple[str, ...]:
        """Say what the link's filter could not find."""
        if self.noise is None:
            return (
                f"joint '{self.device.joint}': without link_position the link's inertia and damping are not estimated",
            )
        excess = float(state.beside.last[1])
        if excess > 4.0:
            return (
                f"joint '{self.device.joint}': the link does not move as an inertia and a damping under the measured torque would"
                f" (innovations are {excess**0.5:.2g} times as large as noise makes them): weight, friction or a push may be"
                " missing in the rig, and the link's inertia and damping are as doubtful as their standard deviations say",
            )
        return ()

    def _acting(self, rows: JointSignals) -> Array:
        """Return the torque that turns the link: a push from outside, less its weight and what the transmissions take."""
        u = -np.sum([rows.roles[v.torque_sensor] for v in self.device.transmissions], axis=0)
        if "external_torque" in rows.roles:
            u = u + rows.roles["external_torque"]
        link = self.device.link
        if link is not None and link.gravity_torque:
            u = u - link_weight(link) * np.sin(rows.roles["link_position"] - link.gravity_angle)
        return np.asarray(u)

    def _noise(self, signals: JointSignals, tuning: ImpedanceTuning) -> LinkNoise:
        """Derive the noise of the link's filter from the log: its sensors', and what 1/I and N/I can be at most."""
        q, u = signals.roles["link_position"], self._acting(signals)
        _, rate, acceleration = savgol_filter(q, self.conditioner.weights)
        size = rms(acceleration)
        return LinkNoise(
            position=sensor_noise(q, signals.resolution.get("link_position", 0.0), LEAST_NOISE),
            torque=sensor_noise(u, 0.0, LEAST_NOISE),
            velocity=ROOM * rms(rate),
            mobility=ROOM * size / max(rms(u - np.nanmean(u)), 1e-300),
            decay=ROOM * size / max(rms(rate), 1e-300),
            wander=tuning.wander,
        )
