"""The physics as pure functions on arrays, in SI."""

from vsalog.mechanics.transmissions import elastic_energy, flexibility_torque, reaction_torque, stiffness

__all__ = ["elastic_energy", "flexibility_torque", "reaction_torque", "stiffness"]
