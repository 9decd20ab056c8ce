"""Simulated experiments: rig → plant → sensors → recording, with the truth beside it."""

from vsalog.simulation.experiment import Experiment
from vsalog.simulation.experiments import (
    awas_experiment,
    awas_rig,
    elastic_experiment,
    elastic_rig,
    vsa2_experiment,
    vsa2_rig,
)
from vsalog.simulation.inputs import TorqueInput, sine, soft_square, sum_of
from vsalog.simulation.sensors import IDEAL, Sensors
from vsalog.simulation.simulate import simulate

__all__ = [
    "IDEAL",
    "Experiment",
    "Sensors",
    "TorqueInput",
    "awas_experiment",
    "awas_rig",
    "elastic_experiment",
    "elastic_rig",
    "simulate",
    "sine",
    "soft_square",
    "sum_of",
    "vsa2_experiment",
    "vsa2_rig",
]
