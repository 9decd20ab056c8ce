"""The external stiffness of a joint, σ + ∂g/∂q: that of the link from outside, with its weight (Flacco 2012 eq. 6).

With the motors and all other joints held, M q̈ + D_q q̇ + τ_e(q − θ) + g(q) = τ_ext (eq. 3) is τ_ext = τ_e + g(q) at rest, so that
∂τ_ext/∂q = σ + ∂g/∂q. A weight's torque on the axis that it turns about is a sine of the axis' angle, in an arm too, so that its
derivative is the torque itself a quarter of a turn on: ∂g_i/∂q_i (q) = g_i(q_i + π/2).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.joint import bind, offered_roles
from vsalog.binding.neighbours import Neighbours, own_and_others, role_of
from vsalog.checks.cross_check import Sensed
from vsalog.core.column import let_go
from vsalog.core.errors import VsalogError
from vsalog.core.recording import Recording
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.effects.gravity import holding_torque
from vsalog.estimators.device import Device
from vsalog.mechanics.links import link_weight
from vsalog.mechanics.rigid_body import inverse_dynamics
from vsalog.rig.parts import Link
from vsalog.rig.schema import Joint, RigFile
from vsalog.rig.tolerance import default_deviation

Array = NDArray[np.float64]

POSITION = "link_position"
COLUMN = "external_stiffness"


def position_roles(name: str, rig: RigFile | None, joint: Joint) -> tuple[str, ...]:
    """Return the link positions that a joint's gravity torque depends on, as `own_and_others` parts them; empty without gravity.

    That is the joint's own, or those of all joints of its chain. One of them that the rig does not name leaves none.
    """
    chain = None if rig is None else rig.chain
    if rig is not None and chain is not None and name in (names := [part.joint for part in chain.link]):
        joints = {part: rig.joint[part] for part in names}
    else:
        link: Link | None = getattr(joint, "link", None)
        joints = {name: joint} if link is not None and link_weight(link) else {}
    offered = (POSITION in offered_roles(its) for its in joints.values())
    return tuple(role_of(part, POSITION, name) for part in joints) if all(offered) else ()


@dataclass(frozen=True, slots=True)
class ExternalStiffness:
    """Adds the external stiffness to the `total` of a trace.

    Attributes
    ----------
    gravity : the torque g on the joint's axis for its position and that of others, role → (n,) [rad] → (n,) [N·m]
    roles : of these positions
    positions : signals that have them, on a grid of their own
    weight_share : one standard deviation of the weight, as a part of it
    angle_deviation : one standard deviation of the angle that the weight hangs at [rad]
    """

    gravity: Callable[[Mapping[str, Array]], Array]
    roles: tuple[str, ...]
    positions: JointSignals
    weight_share: float
    angle_deviation: float

    @classmethod
    def of(
        cls,
        recordings: Sequence[Recording],
        joint: Joint,
        device: Device,
        signals: JointSignals,
        stated: Mapping[str, float],
    ) -> ExternalStiffness | None:
        """Prepare for a joint; None where its rig has no gravity, or a link's position is not recorded.

        Parameters
        ----------
        recordings, joint, device : as the estimator has them
        signals : that it reads, used where they have the positions
        stated : how well the joint's quantities are known, as `Rig.tolerances` has it; the usual tolerances hold for the others
        """
        roles = position_roles(device.joint, device.rig, joint)
        if not roles:
            return None
        if not set(roles) <= signals.roles.keys():
            own, others = own_and_others(roles, {} if device.rig is None else device.rig.joint)
            found = _bound(recordings, device.joint, joint, own, others)
            if found is None:
                return None
            signals = found
        return cls(_gravity(device, roles), roles, signals, *_deviations(device, stated))

    def added(self, trace: Trace) -> Trace:
        """Return a block of a trace with the external stiffness and its standard deviation; NaN where a position is missing."""
        at = {role: self._at(role, trace) for role in self.roles}
        own = at[POSITION]
        torque, slope = self.gravity(at), self.gravity({**at, POSITION: own + 0.5 * np.pi})
        total = trace["total"]
        stiffness, std = (np.asarray(total[k], dtype=np.float64) for k in ("stiffness", "stiffness_std"))
        columns = {
            COLUMN: stiffness + slope,
            f"{COLUMN}_std": np.sqrt(std**2 + (self.weight_share * slope) ** 2 + (self.angle_deviation * torque) ** 2),
        }
        return replace(trace, transmissions={**trace.transmissions, "total": {**total, **columns}})

    def _at(self, role: str, trace: Trace) -> Array:
        """Return a position at the rows of a trace; of a long log only these rows are read."""
        held, out = self.positions, np.full(len(trace), np.nan)
        for run in np.unique(trace.run):
            rows = trace.run == run
            stamps = trace.stamps[rows]
            first, end = np.searchsorted(held.run, [run, run + 1])
            low, high = first + np.searchsorted(held.stamps[first:end], [stamps[0], stamps[-1]])
            part = slice(max(first, low - 1), min(end, high + 2))
            near, values = held.stamps[part], held.roles[role][part]
            out[rows] = Sensed(near, values, held.period).at(stamps)
            let_go(near, values)
        return out


def _bound(
    recordings: Sequence[Recording], name: str, joint: Joint, own: Sequence[str], others: Neighbours
) -> JointSignals | None:
    """Bind positions; None where that is not possible: the estimate does without."""
    try:
        return bind(recordings, name, joint, own, neighbours=others)
    except VsalogError:
        return None


def _gravity(device: Device, roles: Sequence[str]) -> Callable[[Mapping[str, Array]], Array]:
    """Return g of the joint's axis as a function of positions."""
    rig, link = device.rig, device.link
    chain = None if rig is None else rig.chain
    if rig is None or chain is None or device.joint not in (names := [part.joint for part in chain.link]):
        assert link is not None
        weight, angle = link_weight(link), link.gravity_angle
        return lambda at: np.asarray(holding_torque(weight, angle, at[POSITION]))
    links: dict[str, Link | None] = {name: getattr(rig.joint[name], "link", None) for name in names}
    payloads = {name: its.payload for name, its in links.items() if its is not None and its.payload is not None}
    place, still = names.index(device.joint), np.zeros(len(names))

    def torque(at: Mapping[str, Array]) -> Array:
        q = np.stack([at[role] for role in roles], axis=-1)
        return np.asarray(inverse_dynamics(chain, q, still, still, payloads)[:, place])

    return torque


def _deviations(device: Device, stated: Mapping[str, float]) -> tuple[float, float]:
    """Return how well a joint's weight is known, relative to it, and the angle at which it hangs [rad].

    For an arm, whose links determine the joints' gravity, the usual values of these are taken.
    """

    def known(key: str, value: float, scale: float) -> float:
        own = stated.get(f"link.{key}")
        return default_deviation(key, value, scale) if own is None else own

    chain = None if device.rig is None else device.rig.chain
    link = device.link
    if link is None or (chain is not None and device.joint in [part.joint for part in chain.link]):
        return default_deviation("gravity_torque", 1.0, 1.0), default_deviation("gravity_angle", 0.0, 0.0)
    weight, load = link_weight(link), link.payload
    parts = [known("gravity_torque", link.gravity_torque, abs(weight))]
    if load is not None:
        parts += [
            load.weight * known(f"payload.{key}", value, value) / value
            for key, value in (("mass", load.mass), ("distance", load.distance))
            if value
        ]
    return float(np.linalg.norm(parts)) / abs(weight), known("gravity_angle", link.gravity_angle, 0.0)
