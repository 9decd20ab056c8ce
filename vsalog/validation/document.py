"""The structures of `report.json`: what a validation found. `docs/report.schema.json` is generated from them."""

from __future__ import annotations

from typing import Literal

import msgspec

from vsalog.core.finding import Finding

VERSION = 2
SCHEMA = ("Report", "vsalog validation report", "What 'vsalog validate' found.")

Verdict = Literal["holds", "fails", "undecided", "cannot be judged"]
Reference = Literal["sensor", "residual", "nominal", "truth"]


class _Part(msgspec.Struct, frozen=True, kw_only=True):
    """Values never change."""


class Figure(_Part, frozen=True):
    """A number with its 95 % interval from a block bootstrap; null where the data do not determine it.

    Attributes
    ----------
    value : of all samples
    low, high : ends of the interval
    """

    value: float | None
    low: float | None = None
    high: float | None = None


class Score(_Part, frozen=True):
    """How far a prediction is from its reference, over samples of one kind (inside the region, or outside).

    Attributes
    ----------
    samples : that were judged
    effective_samples : number of independent samples with the same information
    span : greatest minus least of the reference
    mse, rmse : mean square error and its root, in the unit (squared) of what is judged
    nrmse : rmse / span [%]
    msrep : mean square relative error, 100 · mean(((prediction − reference) / reference)²) [%] (Flacco 2012 eq. 46); of a torque,
        over samples where it is at least 5 % of its largest
    r2 : 1 − mse / variance of the reference
    bias : mean error
    largest : largest absolute error
    """

    samples: int
    effective_samples: float
    span: float
    mse: Figure
    rmse: Figure
    nrmse: Figure
    msrep: Figure
    r2: Figure
    bias: Figure
    largest: float


class Bin(_Part, frozen=True):
    """Error over one interval of a variable: its ends, samples, root mean square error and mean error."""

    low: float
    high: float
    samples: int
    rmse: Figure
    bias: Figure


class ErrorOver(_Part, frozen=True):
    """The error over a variable, of the samples inside the region.

    Attributes
    ----------
    on : ``deflection`` [rad], ``speed`` of the deflection [rad/s] or ``setpoint`` [rad or m]
    bins : intervals that hold equally many samples
    """

    on: str
    bins: tuple[Bin, ...]


class Dependence(_Part, frozen=True):
    """What the error depends on.

    Attributes
    ----------
    on : ``torque`` (a wrong gain), ``offset``, ``zero`` (of the deflection), ``side`` (the torque's size), ``gap`` (the
        deflection's sign), ``deflection``, ``position`` (of link or motor), ``setpoint``, ``velocity``, ``late`` (a position's
        velocity), ``direction`` (of the velocity), ``loading`` (loops), ``time``, ``zero over time``, ``gain over time``,
        ``resolution`` (the sensor's steps), ``stuck`` (the sensor), ``itself`` (not white)
    share : of the error's mean square that it explains in addition to those before it, 0 to 1
    p_value : probability of such a share by chance, with the effective number of samples
    slope : of the error over the variable, SI, where it is a straight line; else null
    code : of the finding that this is
    evidence : its numbers, by name
    words : the meaning, for people; made from the code when the report is written
    bins : error over the variable
    not_told_from : what would explain the error as well
    """

    on: str
    share: float
    p_value: float
    slope: float | None
    code: str
    evidence: dict[str, float] = {}
    words: str = ""
    bins: tuple[Bin, ...] = ()
    not_told_from: tuple[str, ...] = ()


class Comparison(_Part, frozen=True):
    """One prediction against one reference.

    Attributes
    ----------
    quantity : ``flexibility_torque`` or ``stiffness``
    unit : of it
    reference : of the comparison
    inside : score of samples inside the region that the model was fitted in; null where there is none
    outside : likewise outside: extrapolation, never mixed into the score
    """

    quantity: str
    unit: str
    reference: Reference
    inside: Score | None
    outside: Score | None


class ModalityScore(_Part, frozen=True):
    """An estimate of the same log by one modality (MODEL, SENSOR, RESIDUAL), against the same reference."""

    modality: str
    stiffness_low: float | None
    stiffness_high: float | None
    stiffness_std: float | None
    against_truth: Score | None
    torque: Score | None


class TransmissionReport(_Part, frozen=True):
    """The results for a transmission, or for the whole device (``total``).

    Attributes
    ----------
    transmission : name
    judged_on : the comparison that the verdict is based on; null where nothing can be judged
    comparisons : all there are, that one first
    inside_share : part of the samples inside the region that the model was fitted in
    gain : how many times the predicted torque is measured; null where it is not clearly other than one
    errors : over deflection, speed and set-point, of the comparison that the verdict is based on
    dependence : what the error depends on, strongest first
    modalities : of the same log, side by side
    """

    transmission: str
    judged_on: Reference | None
    comparisons: tuple[Comparison, ...]
    inside_share: float
    dependence: tuple[Dependence, ...]
    modalities: tuple[ModalityScore, ...] = ()
    gain: float | None = None
    errors: tuple[ErrorOver, ...] = ()


class StiffnessVerdict(_Part, frozen=True):
    """Whether the model's stiffness holds, which its torque alone does not show.

    Attributes
    ----------
    verdict : of the transmission whose stiffness is predicted worst
    reference : of the comparison: a simulator's truth in the log, else the rig's nominal transmission, which may be wrong
    reason : the error, in a finding
    sentence : the same in words
    """

    verdict: Verdict
    reference: Reference
    reason: Finding
    sentence: str = ""


class JointReport(_Part, frozen=True):
    """The results for a joint of a log.

    Attributes
    ----------
    joint : name
    verdict : whether the model's torque holds
    reasons : findings that the verdict is based on: why nothing can be judged; else the error, where it is, what it depends on
    findings : further ones
    duration, period : of the log [s]
    transmissions : one by one, then ``total`` where there are two
    sentences : the reasons, in words
    stiffness : the verdict on the stiffness; null without a truth in the log, or a nominal one in the rig and a torque that holds
    not_independent : the one that explains, in words, why a torque channel is no independent measurement; null for none
    warnings : the findings, in words
    """

    joint: str
    verdict: Verdict
    reasons: tuple[Finding, ...]
    findings: tuple[Finding, ...]
    duration: float
    period: float
    transmissions: tuple[TransmissionReport, ...]
    sentences: tuple[str, ...] = ()
    stiffness: StiffnessVerdict | None = None
    not_independent: str | None = None
    warnings: tuple[str, ...] = ()


class LogReport(_Part, frozen=True):
    """The results for one log: its name, SHA-256, and joints."""

    log: str
    sha256: str
    joints: tuple[JointReport, ...]


class Threshold(_Part, frozen=True):
    """A requested threshold, and whether it was met."""

    name: str
    limit: float
    met: bool


class Report(_Part, frozen=True):
    """A whole `report.json`.

    Attributes
    ----------
    version : of this structure
    vsalog : version that wrote it
    model : file name, and ``model_sha256`` of it
    model_logs : name → SHA-256 of the logs that the model was fitted to
    settings : of this run
    rig : as TOML text
    logs : what was found, log by log
    thresholds : as requested
    """

    version: int
    vsalog: str
    model: str
    model_sha256: str
    model_logs: dict[str, str]
    settings: dict[str, str]
    rig: str
    logs: tuple[LogReport, ...]
    thresholds: tuple[Threshold, ...] = ()
