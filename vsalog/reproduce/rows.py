"""What a reproduction comes out as: rows with a printed number and ours, and figures as data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Status = Literal["done", "not there yet"]
Verdict = Literal["better", "as printed", "worse", "holds", "does not hold", "not compared", "not there yet"]

ROUNDING = 0.005
"""Share within which a number is as printed: half of the last of the two or three digits."""


class Spread(msgspec.Struct, frozen=True):
    """A number over several noise seeds, so that no seed is picked to win.

    Attributes
    ----------
    median, low, high : over the seeds
    seeds : how many; 1 where nothing is random
    """

    median: float
    low: float
    high: float
    seeds: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Return median and range; a value that is not finite stays one."""
        v = np.asarray(values, dtype=np.float64)
        return cls(float(np.median(v)), float(np.min(v)), float(np.max(v)), len(values))


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One number of a paper, and ours.

    Attributes
    ----------
    item : name for `vsalog reproduce`
    paper, place : where it is printed, e.g. "Flacco 2012", "Table 1"
    quantity, unit : what it is; an empty unit for a bare number or a statement
    of : of which signal, e.g. "RESIDUAL, transmission 1"
    settings : whose tuning ours was found with
    estimator, tune : what it was found with, as for `vsalog estimate`; `powers` of the basis and variances `V_a`, `V_max`,
        `V_min` of the kinematic filter are no `--tune` of it
    printed : the number, or the statement in our words; None where the paper prints none for this row
    ours : the number over the seeds, or what is found of the statement; None where it is not there yet
    whole_run : the same counted from the first sample
    window : which samples count for `ours`
    conditions : what is simulated
    chosen : what the paper does not print and was chosen
    compare : how the two are compared: an error is the better the ``lower``, a parameter the ``closer`` to its true value;
        a statement ``holds`` or not; ``none`` where a comparison would mean nothing
    true_value : of a parameter
    holds : of a statement
    reason : why ours is worse, or why there is none
    remark : what else one should know of the printed number
    status : whether it can be computed
    """

    item: str
    paper: str
    place: str
    quantity: str
    unit: str = ""
    of: str = ""
    settings: str = ""
    estimator: str = ""
    tune: dict[str, str | float | bool] = {}
    printed: float | str | None = None
    ours: Spread | str | None = None
    whole_run: Spread | None = None
    window: str = ""
    conditions: str = ""
    chosen: str = ""
    compare: Literal["lower", "closer", "holds", "none"] = "lower"
    true_value: float | None = None
    holds: bool | None = None
    reason: str = ""
    remark: str = ""
    status: Status = "done"

    def with_values(self, **values: Any) -> Row:
        """Return the row with some of its fields changed."""
        return msgspec.structs.replace(self, **values)

    def because(self, reason: str) -> Row:
        """Return the row with that reason where ours is worse."""
        return msgspec.structs.replace(self, reason=reason) if self.verdict in ("worse", "does not hold") else self

    @property
    def verdict(self) -> Verdict:
        """How our median compares with the printed number."""
        if self.status != "done":
            return "not there yet"
        if self.compare == "holds":
            return "holds" if self.holds else "does not hold"
        if self.compare == "none" or not isinstance(self.printed, float) or not isinstance(self.ours, Spread):
            return "not compared"
        ours, printed = self.ours.median, self.printed
        within = False
        if self.compare == "closer" and self.true_value is not None:
            # What is printed is one draw of the noise: it is no better than ours where ours spread over it.
            within = self.ours.low <= printed <= self.ours.high
            ours, printed = abs(ours - self.true_value), abs(printed - self.true_value)
        if ours <= printed * (1.0 - ROUNDING):
            return "better"
        return "as printed" if within or ours <= printed * (1.0 + ROUNDING) else "worse"


class Curve(NamedTuple):
    """A line or points of a figure; `style` is solid, dashed, dotted, dashdot or points."""

    label: str
    x: Array
    y: Array
    style: str = "solid"


class Panel(msgspec.Struct, frozen=True, kw_only=True):
    """One pair of axes; `y_range` is shown where given, all else.

    Attributes
    ----------
    title, x_label, y_label : with units
    curves : what is drawn
    log_x, log_y : logarithmic axes
    """

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    title: str = ""
    log_x: bool = False
    log_y: bool = False
    y_range: tuple[float, float] | None = None


class Figure(msgspec.Struct, frozen=True):
    """A figure like one of the paper's; `name` becomes the file's."""

    name: str
    title: str
    panels: tuple[Panel, ...]


class Result(NamedTuple):
    """What an item comes out as."""

    rows: list[Row]
    figures: list[Figure]
