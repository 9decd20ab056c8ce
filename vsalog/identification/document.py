"""The structures of what `identify` found. `docs/identification.schema.json` is generated from them."""

from __future__ import annotations

from typing import Literal

import msgspec

from vsalog.core.finding import Finding

SCHEMA = ("Identification", "vsalog identification", "What 'vsalog identify' found.")

Determined = Literal["alone", "in combination", "not"]


class _Part(msgspec.Struct, frozen=True, kw_only=True):
    """Values never change."""


class IdentifiedNumber(_Part, frozen=True):
    """A number of a joint that was fitted.

    Attributes
    ----------
    joint : name
    key : of the rig, below the joint
    unit : SI; empty where it has none
    rig : the rig's own value
    value, low, high : identified, and its 95 % interval
    determined : alone: the log determines it as well as a rig usually knows it; in combination: it would if others were known;
        not: not even then
    correlated_with : key of the number whose estimate depends most on its own; null where there is a single one
    correlation : of both estimates
    """

    joint: str
    key: str
    unit: str
    rig: float
    value: float
    low: float
    high: float
    determined: Determined
    correlated_with: str | None
    correlation: float | None


class Combination(_Part, frozen=True):
    """Numbers that can change together and leave the simulation nearly as it is.

    Attributes
    ----------
    joint : name
    keys : of the numbers
    changes : of each, where the first one changes by 1 %; relative to its own value, or to its half-width where it is at an end
        of its range [%]
    """

    joint: str
    keys: tuple[str, ...]
    changes: tuple[float, ...]


class SimulationError(_Part, frozen=True):
    """How far simulations are from a recorded signal that nothing was fitted to.

    Attributes
    ----------
    joint : name
    where : the log
    part : "whole", "last third" where no log was held out, of a fit to the rest; "itself" where it is too short for that
    signal : role
    unit : SI
    rig, identified : root mean square error of the original rig, and with the numbers that were identified
    noise_floor : error from noise alone
    spread : standard deviation of what was recorded
    """

    joint: str
    where: str
    part: Literal["whole", "last third", "itself"]
    signal: str
    unit: str
    rig: float
    identified: float
    noise_floor: float
    spread: float


class Identification(_Part, frozen=True, kw_only=True):
    """What `vsalog identify` found.

    Attributes
    ----------
    version : of this structure
    vsalog : version that made it
    log, log_sha256 : that was fitted
    holdouts : logs that were held out
    rig : as TOML, with what was identified; a joint that a finding invalidates keeps its numbers
    settings : what was asked for
    numbers, combinations, errors : what was found; none of a joint that a finding invalidates
    correlations : joint → matrix of the estimates, in the order of `numbers`
    findings : what the user should know
    """

    version: int = 1
    vsalog: str
    log: str
    log_sha256: str
    holdouts: tuple[str, ...]
    rig: str
    settings: dict[str, str]
    numbers: tuple[IdentifiedNumber, ...]
    combinations: tuple[Combination, ...]
    errors: tuple[SimulationError, ...]
    correlations: dict[str, tuple[tuple[float, ...], ...]]
    findings: tuple[Finding, ...] = ()
