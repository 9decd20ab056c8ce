"""Estimators run on simulated experiments, and how far off they are."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.joint import bind, offered_roles
from vsalog.binding.neighbours import own_and_others
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import device_of
from vsalog.estimators.fold import Fold
from vsalog.estimators.folding import estimated
from vsalog.estimators.registry import method
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.tuning import read_tuning
from vsalog.filters.kinematic import KinematicSettings
from vsalog.reproduce.rows import Spread
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.sensors import sense

Array = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Study:
    """Common to all items.

    Attributes
    ----------
    seeds : of the noise, none of them tried while settings were chosen; every number that depends on it is given over all
    say : called with the present step
    made : what items share, by a name of it and what it depends on
    """

    seeds: tuple[int, ...] = (11, 12, 13, 14, 15)
    say: Callable[[str], None] = lambda text: None
    made: dict[Hashable, Any] = field(default_factory=dict, compare=False, repr=False)

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what `make` gives, made when the study first asks for this key: items share simulations and estimates."""
        if key not in self.made:
            self.made[key] = make()
        return cast(T, self.made[key])


@dataclass(frozen=True, slots=True)
class Setting:
    """An estimator and how it is tuned.

    Attributes
    ----------
    label : whose tuning it is, for the report
    estimator : its name
    tune : as for `--tune`
    powers : exponents of the deflection instead of the rig's basis
    kalman : V_a, V_max, V_min of the kinematic filters, as the papers print them (only their ratios matter); when absent
        the ratios of Flacco 2012 §6.1
    """

    label: str
    estimator: str
    tune: Mapping[str, str | float | bool]
    powers: tuple[int, ...] | None = None
    kalman: tuple[float, float, float] | None = None

    @property
    def whole_tune(self) -> dict[str, str | float | bool]:
        """Return the tuning as a row states it, with settings that no `--tune` reaches."""
        whole = dict(self.tune)
        if self.powers is not None:
            whole["powers"] = " ".join(map(str, self.powers))
        if self.kalman is not None:
            whole |= dict(zip(("V_a", "V_max", "V_min"), self.kalman, strict=True))
        return whole

    def with_tune(self, label: str | None = None, **tune: str | float | bool) -> Setting:
        """Return the setting with some of its tuning changed."""
        return replace(self, label=self.label if label is None else label, tune={**self.tune, **tune})


def estimate(experiment: Experiment, setting: Setting, joint: str | None = None) -> Trace:
    """Run an estimator over an experiment's recording.

    Parameters
    ----------
    experiment : with a recording that has no gaps, so that the trace has a row per sample
    setting : the estimator
    joint : name in the rig, the first when absent

    Raises
    ------
    VsalogError
        The recording does not offer what the estimator needs.
    """
    fold, signals = assemble(experiment, setting, joint)
    return estimated(fold, signals)


def assemble(experiment: Experiment, setting: Setting, joint: str | None = None) -> tuple[Fold, JointSignals]:
    """Return an estimator for an experiment's recording, and the signals bound; arguments as for `estimate`."""
    name = experiment.joint if joint is None else joint
    spec = experiment.rig.joint[name]
    found = method(setting.estimator)
    tuning = read_tuning(found.TUNING, setting.estimator, {k: _text(v) for k, v in setting.tune.items()})
    offered = offered_roles(spec)
    read = found.roles(device_of(name, spec, rig=experiment.rig), offered, tuning)
    _, neighbours = own_and_others(read, experiment.rig.joint)
    signals = bind([experiment.recording()], name, spec, tuple(offered), neighbours=neighbours)
    device = device_of(name, spec, signals.roles, experiment.rig)
    if setting.powers is not None:
        device = replace(device, basis=replace(device.basis, powers=setting.powers))
    fold = found.build(device, signals, tuning)
    if setting.kalman is not None:
        assert isinstance(fold, RegressionFold)
        _retune(fold, setting.kalman)
    return fold, signals


def _text(value: str | float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _retune(fold: RegressionFold, kalman: tuple[float, float, float]) -> None:
    """Give the kinematic filters variances that no `--tune` reaches: the papers' other sets of them."""
    conditioner = fold.conditioner
    conditioner.settings = {
        role: KinematicSettings(*kalman, shape=s.shape, threshold_speed=s.threshold_speed)
        for role, s in conditioner.settings.items()
    }


def mean_square(error: Array) -> float:
    """Return the mean square, of the samples that have an estimate."""
    return float(np.mean(np.square(error[np.isfinite(error)])))


def mse(estimated: Array, true: Array, start: int = 0) -> float:
    """Return Σ (σ − σ̂)² / p over the samples from `start` on (Flacco 2012 eq. 45, Flacco 2014 eq. 26)."""
    return mean_square((estimated - true)[start:])


def msrep(estimated: Array, true: Array, start: int = 0) -> float:
    """Return 100 · Σ ((σ − σ̂)/σ)² / p [%] over the samples from `start` on (Flacco 2012 eq. 46, Flacco 2014 eq. 27)."""
    return 100.0 * mean_square(((estimated - true) / true)[start:])


def mean_relative(estimated: Array, true: Array) -> float:
    """Return the mean of |x̂ − x| / |x| [%], of the samples that have an estimate."""
    relative = np.abs((estimated - true) / true)
    return 100.0 * float(np.mean(relative[np.isfinite(relative)]))


def root_mean_square(estimated: Array, true: Array) -> float:
    """Return √(mean (x̂ − x)²), of the samples that have an estimate."""
    return float(np.sqrt(mean_square(estimated - true)))


def largest(estimated: Array, true: Array) -> float:
    """Return max |x̂ − x|, of the samples that have an estimate."""
    return float(np.nanmax(np.abs(estimated - true)))


def column(trace: Trace, name: str, part: str = "total") -> Array:
    """Return a column of a trace's transmission as numbers, shape (N,)."""
    return np.asarray(trace[part][name], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Errors:
    """MSE and MSREP of a stiffness over the seeds, after the transient and over the whole run."""

    mse: Spread
    msrep: Spread
    mse_whole: Spread
    msrep_whole: Spread


def stiffness_errors(
    experiments: Sequence[Experiment],
    traces: Sequence[Trace],
    part: str,
    truth: str,
    after: float,
    joint: str | None = None,
    scale: float = 1.0,
) -> Errors:
    """Compare traces with the truth, one of each per seed.

    Parameters
    ----------
    experiments, traces : in the same order
    part : transmission in the trace
    truth : name of its true stiffness
    after : when the transient is over [s]
    joint : name in the rig, the first when absent
    scale : of the MSE, from N²·m²/rad² to the unit that is printed
    """
    found: list[tuple[float, float, float, float]] = []
    for experiment, trace in zip(experiments, traces, strict=True):
        record = experiment.joints[experiment.joint if joint is None else joint]
        sigma, estimated = record.truth[truth], np.asarray(trace[part]["stiffness"], dtype=np.float64)
        start = round(after / experiment.period)
        # A sample without an estimate counts as the zero that the papers' recursions begin with.
        whole = np.nan_to_num(estimated, nan=0.0)
        found.append(
            (
                scale * mse(estimated, sigma, start),
                msrep(estimated, sigma, start),
                scale * mse(whole, sigma),
                msrep(whole, sigma),
            )
        )
    return Errors(*(Spread.of([f[i] for f in found]) for i in range(4)))


def with_noise(experiment: Experiment, seeds: Sequence[int]) -> list[Experiment]:
    """Return the same motion as its sensors record it under several noises.

    Parameters
    ----------
    experiment : its rig has the sensors
    seeds : one recording each
    """
    truths = {name: dict(record.truth) for name, record in experiment.joints.items()}
    return [replace(experiment, joints=sense(truths, experiment.rig, experiment.time, seed, False)) for seed in seeds]
