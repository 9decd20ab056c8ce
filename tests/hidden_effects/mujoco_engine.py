"""A second engine: MuJoCo simulates elastic and rigid joints."""

from __future__ import annotations

from .machines import Machine
from .motion import Truth, Wanted


def simulates(machine: Machine) -> bool:
    """Tell whether MuJoCo has what a machine is made of."""
    return False


def happened(machine: Machine, follow: Wanted) -> Truth | None:
    """Let a machine follow."""
    raise NotImplementedError
