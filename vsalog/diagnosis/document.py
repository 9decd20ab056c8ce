"""The structures of `diagnosis.json`: what a diagnosis found. `docs/diagnosis.schema.json` is generated from them."""

from __future__ import annotations

from typing import Literal

import msgspec

from vsalog.core.finding import Finding

VERSION = 2
SCHEMA = ("Diagnosis", "vsalog diagnosis", "What 'vsalog diagnose' found.")

Verdict = Literal["consistent", "consistent as far as checked", "explained", "partly explained", "unexplained"]
Where = Literal["motor", "transmission", "link", "sensor", "pneumatic"]


class _Part(msgspec.Struct, frozen=True, kw_only=True):
    """Values never change."""


class Number(_Part, frozen=True):
    """A parameter of a cause.

    Attributes
    ----------
    value, std : with its standard deviation
    unit : SI
    determined : whether its 95 % interval excludes the rig's own value and zero; where it does not, the value means little
    rig : the rig's own value; null where it has none
    """

    value: float
    std: float | None
    unit: str
    determined: bool = True
    rig: float | None = None


class SignalError(_Part, frozen=True):
    """How far the rig's simulation is from one recorded signal.

    Attributes
    ----------
    joint : name
    signal : role
    unit : SI
    rmse : of windows of the log, each begun with the state that fits it best
    noise_floor : its value from the noise of this sensor and of the recorded inputs alone, if the rig were right
    nrmse : rmse / (greatest − least recorded) [%]
    rmse_whole_log : of the simulation that runs through from the log's first state; null where it does not get through
    """

    joint: str
    signal: str
    unit: str
    rmse: float
    noise_floor: float
    nrmse: float
    rmse_whole_log: float | None = None


class EquationError(_Part, frozen=True):
    """The residual of one equation of a joint.

    Attributes
    ----------
    joint : name
    equation : motor, motor_1, secondary_motor, transmission, link, deflection, …
    side : of the joint it is about
    unit : SI
    rms_before, rms_after : of its averages over a short bell, with the original rig and with the causes found
    noise : the same of noise alone
    """

    joint: str
    equation: str
    side: Where
    unit: str
    rms_before: float
    rms_after: float
    noise: float


class FoundCause(_Part, frozen=True):
    """A cause that was found.

    Attributes
    ----------
    cause : name of the catalogue
    joint : name
    part : of the joint: motor, transmission_1, link, or a sensor's role
    title : in words
    parameters : name → number
    common_with : other parts that have the same number, or the same factor on the rig's
    material : whether it matters: `size` is 1 or more
    size : RMS of what it changes in an equation that no other cause of the set explains, over the RMS of noise and model error;
        null where nothing was fitted
    confidence : 0 to 1, probability of this cause, against what replaces it in sets about as probable, or nothing
    class_confidence : the same of its class, itself and `indistinguishable_from`: that one of them is there
    indistinguishable_from : its equivalence class: causes that replace it in sets about as probable, with the part where
        that is the same cause elsewhere; the rig's tolerances chose among them; `unknown` is a smooth function of a signal, no
        cause of the catalogue
    error_removed : share of the rig's squared residual beyond noise that this cause removes; the shares add up
    stiffness_change : share by which the estimated stiffness changes, in root mean square, if the extended rig lacks this cause:
        by the motor's torque or by the torque sensor, whichever changes more; null where the cause is immaterial or no stiffness
        can be estimated
    why : the evidence in words
    how_to_confirm : an experiment
    tell_apart : which experiment would separate it from the others; empty where there are none
    reference : where the effect is described
    log : of several logs, the one in which it was found, where it may differ from log to log; else null
    """

    cause: str
    joint: str
    part: str
    title: str
    parameters: dict[str, Number]
    common_with: tuple[str, ...]
    material: bool
    size: float | None
    confidence: float
    class_confidence: float
    indistinguishable_from: tuple[str, ...]
    error_removed: float
    stiffness_change: float | None
    why: str
    how_to_confirm: str
    tell_apart: str
    reference: str
    log: str | None = None


class Gain(_Part, frozen=True):
    """What the causes are worth for one signal: simulation errors on data that was not used to fit them.

    Attributes
    ----------
    joint : name
    signal : role, or ``stiffness`` of a transmission
    unit : SI
    rmse_before, rmse_after : with the original rig, and extended
    noise_floor : its value from noise alone, if the rig were right
    reduction : 1 − rmse_after / rmse_before
    ci95 : interval of the reduction, from a bootstrap over windows
    """

    joint: str
    signal: str
    unit: str
    rmse_before: float
    rmse_after: float
    noise_floor: float
    reduction: float
    ci95: tuple[float, float]


class Gains(_Part, frozen=True):
    """The gain, and whether it was measured on data that was held out (another log, or blocks of this one)."""

    holdout: bool
    where: str
    signals: tuple[Gain, ...]


class LogError(_Part, frozen=True):
    """How far the simulation of a signal is from one of several logs that were looked at together.

    Attributes
    ----------
    log : its name
    begin : when it begins, ISO 8601; null where that is not known
    joint, signal, unit : as of `SignalError`
    rmse_before, rmse_after : with the original rig, and extended
    """

    log: str
    begin: str | None
    joint: str
    signal: str
    unit: str
    rmse_before: float
    rmse_after: float


class Trend(_Part, frozen=True):
    """A number of a cause that may differ from log to log.

    Attributes
    ----------
    joint, cause, part : whose
    number, unit : of the cause's parameters
    rig : the rig's own value
    logs, begins : names, and when each begins, ISO 8601; null where that is not known
    values, intervals : in each log, with its 95 % interval
    since : the log, in time, from which on it differs from the rig's value, the median; null where the last one does not
    since_interval : the first and the last log that may be that one, with 95 % probability; null for none
    per_day, per_day_interval : how fast it grows from there on, with its 95 % interval; null with fewer than three dates, or
        where it differs in one log at most
    """

    joint: str
    cause: str
    part: str
    number: str
    unit: str
    rig: float
    logs: tuple[str, ...]
    begins: tuple[str | None, ...]
    values: tuple[float, ...]
    intervals: tuple[tuple[float, float], ...]
    since: str | None
    since_interval: tuple[str | None, str | None]
    per_day: float | None
    per_day_interval: tuple[float, float] | None


class Bin(_Part, frozen=True):
    """The residual in one interval of a variable: its ends, mean residual, and the noise of that mean."""

    low: float
    high: float
    mean: float
    std: float


class Unexplained(_Part, frozen=True):
    """What no cause of the catalogue explains.

    Attributes
    ----------
    fraction : of the rig's squared residual beyond noise that is still there
    where : side of the joint it is on; null where nothing is left
    depends_on : signals it depends on, strongest first
    equation : in which it was looked at
    curve : over the first of these signals
    curve_back : over the same signal while the second one, a rate, is negative, and `curve` while it is positive; empty where the
        direction does not matter
    unit : of that signal
    """

    fraction: float
    where: Where | None
    depends_on: tuple[str, ...]
    equation: str | None = None
    curve: tuple[Bin, ...] = ()
    curve_back: tuple[Bin, ...] = ()
    unit: str = ""

    @property
    def loop(self) -> bool:
        """Whether it is a loop that the log passes once, so that time predicts as much as the direction does."""
        return bool(self.curve_back) and self.depends_on[-1] == "time"


class Diagnosis(_Part, frozen=True):
    """A whole `diagnosis.json`.

    Attributes
    ----------
    version : of this structure
    vsalog : version that wrote it
    log, log_sha256 : what was diagnosed
    holdout, holdout_sha256 : the other log; null where there is none
    rig : as given, TOML
    settings : of this run
    verdict : in a word
    sentences : what was found, in plain sentences; what makes a search of causes pointless first
    p_values : joint → probability of a log whose equations contradict the rig at least as much, were the rig right
    simulation_error : of the original rig, on the log
    equations : the residual of each
    causes : found, the weightiest first
    gain : of the extended rig
    unexplained : what no cause explains
    next_experiment : that would separate more; empty where nothing is open
    logs : of several logs, how far simulations are from each; empty for one
    trends : of causes that may differ from log to log
    findings : what the user should know
    warnings : the findings, in words
    """

    version: int
    vsalog: str
    log: str
    log_sha256: str
    holdout: str | None
    holdout_sha256: str | None
    rig: str
    settings: dict[str, str]
    verdict: Verdict
    sentences: tuple[str, ...]
    p_values: dict[str, float]
    simulation_error: tuple[SignalError, ...]
    equations: tuple[EquationError, ...]
    causes: tuple[FoundCause, ...]
    gain: Gains
    unexplained: Unexplained
    next_experiment: str
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...] = ()
    logs: tuple[LogError, ...] = ()
    trends: tuple[Trend, ...] = ()
