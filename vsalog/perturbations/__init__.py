"""Perturbations of an estimate: changes of the signals or the tuning, and how far it moves with them; one per file."""

from __future__ import annotations

from vsalog.perturbations.drift import Drift
from vsalog.perturbations.prior import WeakerPrior
from vsalog.perturbations.quantisation import Quantisation
from vsalog.perturbations.sampling_rate import SamplingRate
from vsalog.perturbations.trials import Perturbation

PERTURBATIONS: tuple[Perturbation, ...] = (SamplingRate(), Quantisation(), WeakerPrior(), Drift())
