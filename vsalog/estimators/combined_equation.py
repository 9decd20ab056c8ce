"""The torque sensor's, the motors' and the link's equations: all of the same coefficients that a joint's roles allow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.basis import PolynomialBasis
from vsalog.effects.hysteresis import BoucWen, SlipElement
from vsalog.estimators.device import TransmissionView, deflection_of
from vsalog.estimators.equation import GAIN, NEGLIGIBLE_SHARE, EquationRows, Part
from vsalog.estimators.equations import IntegratedMotorEquation, TorqueEquation, regressors
from vsalog.estimators.link_equation import LinkEquation, LinkRows
from vsalog.estimators.loops import Element
from vsalog.filters.conditioning import Conditioned
from vsalog.mechanics.hysteresis import loop_block, loop_level, loop_start
from vsalog.rig.parts import LinearTransmission, Transmission

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Unknowns of an equation in addition to the coefficients: a torque's offset and the part by which its gain is off; corrections of
# the rig's inertia and damping; dry friction.
SENSOR_UNKNOWNS, MOTOR_UNKNOWNS = ("offset", GAIN), ("offset", "inertia", "damping", "friction", GAIN)
LINK_UNKNOWNS = ("offset", "inertia", "damping", "friction", GAIN)
# Those of a motor that the rig does not know.
UNKNOWN_MOTOR = MOTOR_UNKNOWNS[:3]


@dataclass(frozen=True, slots=True)
class CombinedEquation:
    """F(φ, c) α = τ_e by each of several equations, none of which is integrated.

    Attributes
    ----------
    transmissions, basis : of the equations
    sensor : that of the torque sensor, None for none
    motors : one of each transmission's motor, or none
    link : that of the link, None for none
    known : whether the rig has the motors' inertias; else these and the dampings are unknowns
    elements : friction elements of a transmission, each with a stiffness that is unknown
    wait : an element that has to have forgotten what was before the log
    reach : largest deflection of each transmission, in that of the largest [1]: its element slips after as much less
    slack : how far noise may move a deflection [rad]
    """

    transmissions: tuple[TransmissionView, ...]
    basis: PolynomialBasis
    sensor: TorqueEquation | None
    motors: tuple[IntegratedMotorEquation, ...]
    link: LinkEquation | None
    known: bool
    elements: tuple[Element, ...] = ()
    wait: Element | None = None
    reach: tuple[float, ...] = ()
    slack: float = 0.0

    motor: ClassVar[None] = None

    @property
    def leading(self) -> int:
        """Unknowns before the coefficients: those of a motor that the rig does not know."""
        return len(UNKNOWN_MOTOR) if self.motors and not self.known and len(self.transmissions) == 1 else 0

    @property
    def parameters(self) -> tuple[str, ...]:
        """Those that have a column."""
        return IntegratedMotorEquation.parameters if self.leading else ()

    @property
    def coefficients(self) -> int:
        """Number of coefficients of all transmissions."""
        return self.basis.size * len(self.transmissions)

    @property
    def size(self) -> int:
        """Number of unknowns that functionals are of."""
        return self.leading + self.coefficients

    @property
    def unknowns(self) -> tuple[tuple[str, ...], ...]:
        """Unknowns of each equation, in the order of `parts`."""
        of = {"torque_sensor": SENSOR_UNKNOWNS, "motor_torque": MOTOR_UNKNOWNS, "external_torque": LINK_UNKNOWNS}
        return tuple(of[torque] for torque, _ in self.parts)

    @property
    def parts(self) -> tuple[tuple[str, str], ...]:
        """Each equation's torque, and the transmissions that transmit it."""
        names = [view.name for view in self.transmissions]
        every = " and ".join(names)
        return (
            *((("torque_sensor", every),) if self.sensor is not None else ()),
            *(("motor_torque", name) for name, _ in zip(names, self.motors, strict=False)),
            *((("external_torque", every),) if self.link is not None else ()),
        )

    def inertia_of(self, torque: str, part: str) -> float | None:
        """Return the inertia that the rig has of what one of `parts` moves [kg·m²]; None where it has none."""
        if torque == "external_torque":
            return None if self.link is None else self.link.inertia
        motors = [
            view.motor for view in self.transmissions if view.name == part and torque == "motor_torque" and self.known
        ]
        return motors[0].reflected_inertia if motors else None

    @property
    def loops(self) -> tuple[Transmission, ...]:
        """One friction element of stiffness one per unknown, each as the hysteresis of a transmission."""
        return tuple(_loop_of(element) for element in self.elements) * len(self.transmissions)

    def with_basis(self, basis: PolynomialBasis) -> CombinedEquation:
        """Return the same equations of other functions."""
        sensor = None if self.sensor is None else replace(self.sensor, basis=basis)
        link = None if self.link is None else replace(self.link, pushed=replace(self.link.pushed, basis=basis))
        motors = tuple(replace(motor, basis=basis) for motor in self.motors)
        return replace(self, basis=basis, sensor=sensor, link=link, motors=motors)

    def start(self) -> tuple[Any, ...]:
        """Return the states of the equations before the first sample."""
        sensor = None if self.sensor is None else self.sensor.start()
        link = None if self.link is None else self.link.start()
        return (
            sensor,
            tuple(motor.start() for motor in self.motors),
            tuple(loop_start(one) for one in (*self.loops, *self._memory)),
            link,
            np.zeros((1, len(self.loops))),
            np.full((1, len(self.transmissions)), np.nan),
        )

    def rows(self, state: tuple[Any, ...], block: Conditioned) -> tuple[tuple[Any, ...], EquationRows]:
        """Form the equations for a block."""
        sensor, states, first, parts = state[0], [], None, []
        slipping, loops, settled = self._slipping(state[2], block)
        # Motor and link equation may be formed from each sample to the next.
        seen = np.vstack((state[4], loops))
        exact = any(motor.exact for motor in self.motors) or (self.link is not None and self.link.exact)
        halfway = loops if exact else 0.5 * (seen[1:] + seen[:-1])
        slopes = np.hstack([regressors(self.basis, block, view, 1) for view in self.transmissions])
        if self.sensor is not None:
            sensor, rows = self.sensor.rows(sensor, block)
            # A gain multiplies what the coefficients add up to, which is not known yet.
            offset, gain = np.ones_like(rows.y), np.zeros_like(rows.y)
            parts.append(Part(np.column_stack((rows.F, loops, offset, gain, rows.y)), rows.use, slopes))
            first = rows
        for i, (motor, own) in enumerate(zip(self.motors, state[1], strict=True)):
            after, rows = motor.rows(own, block)
            states.append(after)
            parts.append(self._motor_part(i, rows, halfway, slopes))
            first = self._fed(rows, i) if first is None else first
        link = state[3]
        if self.link is not None:
            link, moved = self.link.rows(link, block)
            parts.append(self._link_part(moved, halfway, slopes))
            first = self._borne(moved, block) if first is None else first
        assert first is not None
        # At rest an encoder repeats its rounding error, which does not average out.
        phi = np.column_stack([deflection_of(block.fit, view) for view in self.transmissions])
        moves = (np.diff(phi, axis=0, prepend=state[5]) != 0.0).any(axis=1)
        parts = [part._replace(use=part.use & settled & moves) for part in parts]
        F = np.hstack((np.zeros((len(block.rows), self.leading)), parts[0].columns[:, : self.coefficients]))
        given = EquationRows(
            F, parts[0].columns[:, -1], first.use, block.rows.starts, first.fed, first.extra,
            first.dynamics if self.leading and self.sensor is None else np.zeros((len(F), self.leading)),
            first.doubted, motion=first.motion, plain=first.plain if self.leading else None, parts=tuple(parts),
        )  # fmt: skip
        return (sensor, tuple(states), slipping, link, seen[-1:], phi[-1:]), given

    def _slipping(self, state: tuple[Array, ...], block: Conditioned) -> tuple[tuple[Array, ...], Array, Flags]:
        """Return the friction elements' state, how far each is strained [rad], and where they have forgotten what was before."""
        after, strains = [], np.zeros((len(block.rows), len(self.loops)))
        settled = np.ones(len(strains), dtype=np.bool_)
        for j, (loop, own) in enumerate(zip((*self.loops, *self._memory), state, strict=True)):
            i = j // len(self.elements) if j < len(self.loops) else j - len(self.loops)
            phi = deflection_of(block.fit, self.transmissions[i])
            new, strain, doubt = loop_block(loop_start(loop) if block.rows.starts[0] else own, loop, phi, self.slack)
            after.append(new)
            if j < len(self.loops):
                strains[:, j] = strain
            else:
                settled &= doubt < NEGLIGIBLE_SHARE * loop_level(loop)
        return tuple(after), strains, settled

    @property
    def _memory(self) -> tuple[Transmission, ...]:
        """The friction element of each transmission that remembers longest; none where none is waited for."""
        if self.wait is None:
            return ()
        return tuple(_loop_of(self.wait._replace(slip=own * self.wait.slip)) for own in self.reach)

    def _motor_part(self, i: int, rows: EquationRows, loops: Array, slopes: Array) -> Part:
        assert rows.plain is not None
        F, torque = rows.plain
        view, n = self.transmissions[i], self.basis.size
        inertia, damping = _rig_motor(view) if self.known else (0.0, 0.0)
        columns = np.zeros((len(torque), self.coefficients + loops.shape[1] + len(MOTOR_UNKNOWNS) + 1))
        columns[:, i * n : (i + 1) * n] = -F[:, 3:]
        own = slice(i * len(self.elements), (i + 1) * len(self.elements))
        columns[:, self.coefficients :][:, own] = loops[:, own]
        moved = inertia * F[:, 1] + damping * F[:, 2]
        columns[:, -6], columns[:, -5:-3], columns[:, -3] = 1.0, -F[:, 1:3], -np.sign(F[:, 2])
        columns[:, -2], columns[:, -1] = -moved, moved - torque
        steep = np.zeros_like(slopes)
        steep[:, i * n : (i + 1) * n] = slopes[:, i * n : (i + 1) * n]
        return Part(columns, rows.use & np.isfinite(columns).all(axis=1), steep)

    def _link_part(self, rows: LinkRows, loops: Array, slopes: Array) -> Part:
        offset = np.ones_like(rows.torque)
        return Part(np.column_stack((rows.F, loops, offset, rows.motion, rows.moving, rows.torque)), rows.use, slopes)

    def _borne(self, rows: LinkRows, block: Conditioned) -> EquationRows:
        """Return rows with the torque that the transmissions transmit."""
        alone = len(self.transmissions) == 1
        fed = {view.name: rows.torque if alone else np.full_like(rows.torque, np.nan) for view in self.transmissions}
        fed |= {} if alone else {"total": rows.torque}
        position = block.fit["link_position"], block.fit["velocity:link_position"]
        return EquationRows(rows.F, rows.torque, rows.use, block.rows.starts, fed, {}, motion=position)

    def _fed(self, rows: EquationRows, i: int) -> EquationRows:
        """Return rows with the torque that the rig's motor transmits, not only that of its drive."""
        if rows.dynamics is None or not self.known:
            return rows
        inertia, damping = _rig_motor(self.transmissions[i])
        known = inertia * rows.dynamics[:, 1] + damping * rows.dynamics[:, 2]
        return replace(rows, fed={name: fed + known for name, fed in rows.fed.items()})


def _loop_of(element: Element) -> Transmission:
    """Return a transmission whose hysteresis is a friction element of stiffness one."""
    slip = element.slip
    if element.is_sudden:
        return LinearTransmission(stiffness=1.0, slip=(SlipElement(stiffness=1.0, limit=slip),))
    loop = BoucWen(torque=slip, width=slip, exponent=1.0 / element.sharpness, shape=element.shape)
    return LinearTransmission(stiffness=1.0, bouc_wen=loop)


def _rig_motor(view: TransmissionView) -> tuple[float, float]:
    """Return inertia [kg·m²] and damping [N·m·s/rad] that the rig has of a transmission's motor, zero where it has none."""
    return view.motor.reflected_inertia or 0.0, view.motor.reflected_damping or 0.0
