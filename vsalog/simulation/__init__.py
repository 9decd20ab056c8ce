"""Simulated experiments: rig → plant → sensors → recording, along with the truth."""

from vsalog.simulation.experiment import Experiment, JointRecord
from vsalog.simulation.experiments import (
    awas_experiment,
    awas_rig,
    elastic_experiment,
    elastic_rig,
    vsa2_experiment,
    vsa2_rig,
)
from vsalog.simulation.inputs import Input, Motion, Servo, TorqueInput, sine, soft_square, sum_of
from vsalog.simulation.simulate import simulate

__all__ = [
    "Experiment",
    "Input",
    "JointRecord",
    "Motion",
    "Servo",
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
