"""The results of a reproduction: rows with a printed number and ours, and figures."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np

from vsalog.reproduce.drawing import Figure

Verdict = Literal[
    "better", "better after the transient", "as printed", "as printed after the transient", "within our spread", "worse",
    "below, conditions differ", "above, conditions differ", "holds", "does not hold", "not compared",
]  # fmt: skip


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

    def around(self, true: float | None) -> tuple[float, float, float]:
        """Return median, low and high, or of a parameter their distances to its true value: of the median, least, largest."""
        if true is None:
            return self.median, self.low, self.high
        ends = abs(self.low - true), abs(self.high - true)
        return abs(self.median - true), 0.0 if self.low <= true <= self.high else min(ends), max(ends)


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
    ours : the number over the seeds, or our finding on the statement
    whole_run : the same counted from the first sample
    window : which samples count for `ours`
    window_printed : whether the paper leaves out the same samples, and states it
    conditions : of the simulation
    chosen : conditions that the paper does not print
    differs : how the conditions depart from the printed ones where they do, so that neither number is better
    compare : how the two are compared: an error is the better the ``lower``, a parameter the ``closer`` to its true value;
        a statement ``holds`` or not; ``none`` where a comparison would mean nothing
    true_value : of a parameter
    holds : of a statement
    reason : why ours is worse
    remark : remark on the printed number
    reproducible : whether equal seeds give equal numbers; a computing time is not
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
    window_printed: bool = False
    conditions: str = ""
    chosen: str = ""
    differs: str = ""
    compare: Literal["lower", "closer", "holds", "none"] = "lower"
    true_value: float | None = None
    holds: bool | None = None
    reason: str = ""
    remark: str = ""
    reproducible: bool = True

    def with_values(self, **values: Any) -> Row:
        """Return the row with some of its fields changed."""
        return msgspec.structs.replace(self, **values)

    def because(self, reason: str) -> Row:
        """Return the row with that reason where ours is worse, or above the printed number of other conditions."""
        worse = self.verdict in ("worse", "does not hold", "above, conditions differ")
        return msgspec.structs.replace(self, reason=reason) if worse else self

    @property
    def verdict(self) -> Verdict:
        """How ours compares with the printed number.

        It is as printed where the median rounds to the printed digits. Else an error is better or worse where all seeds agree,
        and within our spread where they do not agree: what is printed is one draw of the noise. Where samples are left out that
        the paper does not state as left out, and the whole run is above the printed number, both hold after the transient only.
        """
        if self.compare == "holds":
            return "holds" if self.holds else "does not hold"
        if self.compare == "none" or not isinstance(self.printed, float) or not isinstance(self.ours, Spread):
            return "not compared"
        true = self.true_value if self.compare == "closer" else None
        printed, (ours, low, high) = self.printed, self.ours.around(true)
        off = printed if true is None else abs(printed - true)
        if self.differs:
            return "below, conditions differ" if ours < off else "above, conditions differ"
        whole = None if self.window_printed else self.whole_run
        later = whole is not None and not whole.median < printed
        if abs(self.ours.median - printed) <= last_digit(printed) / 2.0:
            return "as printed after the transient" if later else "as printed"
        if not (high < off or low > off or not np.isfinite(ours)):
            return "within our spread"
        if not ours < off:
            return "worse"
        return "better after the transient" if later else "better"


def last_digit(printed: float) -> float:
    """Return the size of one in the last digit of a number as it is printed: 0.01 of 7.24."""
    exponent = Decimal(repr(printed)).as_tuple().exponent
    assert isinstance(exponent, int)
    return float(10.0**exponent)


class Result(NamedTuple):
    """The results of an item."""

    rows: list[Row]
    figures: list[Figure]
