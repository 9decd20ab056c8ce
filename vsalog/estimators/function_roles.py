"""The functions of a basis as signals of their own, formed before the filters.

A function of a filtered deflection is not the filtered function: where a spring stiffens and its motion is fast for the filter,
a torque behind the same filter belongs to the latter. Noise of the deflection, of variance σ², adds ½ σ² F″ to F on average,
which is subtracted (Stefanski, "The effects of measurement error on parameter estimation", Biometrika 72(3), 1985).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.basis import PolynomialBasis
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import TransmissionView, deflection_of
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.filters.conditioning import Preparation
from vsalog.filters.direction import direction_start, loading_block

Array = NDArray[np.float64]


def function_roles(view: TransmissionView, basis: PolynomialBasis) -> tuple[str, ...]:
    """Names of the signals of a transmission's functions."""
    return tuple(f"function:{view.name}:{i}" for i in range(basis.size))


@dataclass(frozen=True, slots=True)
class Functions:
    """Adds the functions of each transmission's deflection to the signals.

    Attributes
    ----------
    views : the transmissions
    basis : the functions
    noise : variance of each deflection's noise [rad²]
    before : what the signals go through first
    """

    views: tuple[TransmissionView, ...]
    basis: PolynomialBasis
    noise: tuple[float, ...]
    before: Preparation | None

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles that are added."""
        own = (role for view in self.views for role in function_roles(view, self.basis))
        return (*(() if self.before is None else self.before.roles), *own)

    def start(self) -> tuple[Any, Mapping[str, Array]]:
        """Return the state before the first sample: of what comes first, and each deflection's direction."""
        return None if self.before is None else self.before.start(), {}

    def step(self, state: tuple[Any, Mapping[str, Array]], block: JointSignals) -> tuple[Any, list[JointSignals]]:
        """Take a block; give the new state and what is ready."""
        before, ready = (None, [block]) if self.before is None else self.before.step(state[0], block)
        directions, out = self._added(state[1], ready)
        return (before, directions), out

    def finish(self, state: tuple[Any, Mapping[str, Array]]) -> tuple[Any, list[JointSignals]]:
        """Give out what is held back."""
        ready = [] if self.before is None else self.before.finish(state[0])[1]
        return self.start(), self._added(state[1], ready)[1]

    def _added(
        self, directions: Mapping[str, Array], blocks: list[JointSignals]
    ) -> tuple[Mapping[str, Array], list[JointSignals]]:
        new, out = dict(directions), []
        for piece in (piece for block in blocks for piece in block.between_gaps()):
            roles = dict(piece.roles)
            for view, noise in zip(self.views, self.noise, strict=True):
                phi, loading = deflection_of(piece.roles, view), None
                if self.basis.branches:
                    known = direction_start() if piece.starts[0] else new.get(view.name, direction_start())
                    band = NEGLIGIBLE_SHARE * self.basis.deflection_scale
                    new[view.name], loading = loading_block(known, phi, band)
                c = piece.roles["setpoint"] if self.basis.has_setpoint else None
                F = self.basis.rows(phi, c, 2, loading)
                columns = np.ascontiguousarray((F[:, 0] - 0.5 * noise * F[:, 2]).T)
                roles |= zip(function_roles(view, self.basis), columns, strict=True)
            out.append(replace(piece, roles=roles))
        return new, out
