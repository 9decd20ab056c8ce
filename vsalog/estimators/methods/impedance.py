"""impedance: stiffness, and inertia and damping of the link, from a joint torque sensor and the positions. No motor data.

Serio, Grioli, Sardellitti, Tsagarakis, Bicchi (2011), §III-B: a stiffness observer on the transmission's torque, and
next to it an extended Kalman filter on the link, which that torque drives. Neither needs the other's estimate.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, ClassVar

from msgspec import Meta

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device
from vsalog.estimators.link_impedance import LinkImpedance
from vsalog.estimators.needs import require
from vsalog.estimators.observer_fold import ObserverFold, ObserverState, ObserverTuning
from vsalog.estimators.screening import Screening, screened
from vsalog.estimators.state_observer import Columns
from vsalog.estimators.transmission_torque import TransmissionTorque
from vsalog.estimators.windows import keeping_window
from vsalog.filters.derivatives import Derivatives
from vsalog.filters.link_ekf import LinkState
from vsalog.filters.savitzky_golay import savgol_weights

NAME = "impedance"
SUMMARY = "stiffness, link inertia and damping from positions and a torque sensor (Serio 2011)"


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
    further = [role for role in ("link_position", "external_torque", "setpoint") if role in offered]
    return tuple(dict.fromkeys([*needed, *further]))


def build(device: Device, signals: JointSignals, tuning: ImpedanceTuning) -> ImpedanceFold:
    """Assemble the estimator for a joint's signals.

    Raises
    ------
    EstimatorError
        A signal never changes.
    """
    look = screened(device, signals, tuning)
    return ImpedanceFold(device, signals, keeping_window(device, signals, tuning, tuning.default_window), look)


class ImpedanceFold(ObserverFold):
    """Both observers as an estimator: that of the stiffness on measured torques, and next to it the link's filter."""

    def __init__(self, device: Device, signals: JointSignals, tuning: ImpedanceTuning, look: Screening) -> None:
        torques = [TransmissionTorque(v, {v.torque_sensor: (1.0,)}, measured=True) for v in device.transmissions]
        orders = {role: order for t in torques for role, order in t.orders(signals.roles).items()}
        conditioner = Derivatives(orders, signals.period, tuning.window_for(signals), tuning.degree)
        super().__init__(NAME, "SENSOR", device, signals, tuning, torques, conditioner, look)
        self.link: LinkImpedance | None = None
        if "link_position" in signals.roles:
            weights = savgol_weights(conditioner.window, tuning.degree, 2, signals.period)
            self.link = LinkImpedance(device, signals, weights, tuning.wander, tuning.memory)

    @property
    def derived(self) -> dict[str, float]:
        """The gain and the noise that were derived from the log."""
        noise = {} if self.link is None else {f"noise_{n}": float(v) for n, v in self.link.noise._asdict().items()}
        return {**super().derived, **noise}

    def start_further(self) -> LinkState | None:
        """Return the state of the link's filter before the first sample."""
        return None if self.link is None else self.link.start()

    def block_further(self, further: LinkState, rows: JointSignals, begins: bool) -> tuple[LinkState, Columns]:
        """Return the estimates of the link's filter, from the signals as recorded: it filters itself."""
        return (further, {}) if self.link is None else self.link.block(further, rows, begins)

    def findings(self, state: ObserverState) -> tuple[Finding, ...]:
        """Return findings, also those of the link's filter."""
        found = super().findings(state)
        if self.link is None:
            return (*found, Finding(code="link.inertia_not_estimated", joint=self.device.joint, severity="info"))
        return (*found, *self.link.findings(state.further))
