"""What can be tuned, estimator by estimator; each field is a `--tune NAME=VALUE` of the command line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta, inspect

from vsalog.core.errors import EstimatorError, did_you_mean
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, deflection_of, largest
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.filters.conditioning import Conditioner, FilterName, Preparation

# Functions of the basis beyond this, or below its reciprocal, cannot be squared and summed up safely.
LARGEST = 1e50
# Of the largest function of a basis, the least that counts as the usual one [1]; and as the second [1].
LEAST_USUAL, LEAST_SECOND = 1e-4, 0.1
# Parameters of a tuning that may be infinite: a prior without weight.
MAY_BE_INFINITE = ("p0",)

# The longest time that can be asked for [s], twelve days: longer than any log, and still a number of samples that can be counted.
LONGEST = 1e6

Positive = Annotated[float, Meta(gt=0.0)]
Seconds = Annotated[float, Meta(gt=0.0, le=LONGEST)]
T = TypeVar("T", bound="Tuning")


class Tuning(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning that every estimator has.

    Attributes
    ----------
    filter : ``savitzky-golay`` (non-causal), ``kinematic`` (causal) or ``pair`` (causal output, fitted to non-causally
        filtered signals, Flacco 2014 eq. 30)
    window : of the Savitzky–Golay filter [s]; when absent 51 samples, 21 for `direct`, and where a motor's torque is read as
        long as its encoder needs (`motor_window`)
    degree : of the Savitzky–Golay filter's polynomial
    shape : α of the MKKF, how sharply its measurement variance falls with speed (Flacco 2012 eq. 20)
    settle : time the MKKF gets after a start before its output is used [s]; 100 samples when absent
    """

    # Window where none is asked for, in samples; and parameters that this method does not use.
    default_window: ClassVar[int] = 51
    unused: ClassVar[tuple[str, ...]] = ()

    filter: FilterName = "savitzky-golay"
    window: Seconds | None = None
    degree: Annotated[int, Meta(ge=1, le=30)] = 5
    shape: Positive = 6.0
    settle: Annotated[float, Meta(ge=0.0, le=LONGEST)] | None = None

    def conditioner(
        self,
        roles: tuple[str, ...],
        signals: JointSignals,
        rates: tuple[str, ...] = (),
        before: Preparation | None = None,
        present: bool = True,
        exact: bool = False,
        near: float | None = None,
    ) -> Conditioner:
        """Return the filters these values describe; the other arguments as a `Conditioner` takes them."""
        return Conditioner(
            roles,
            signals,
            self.filter,
            window=self.window if self.window is not None else (self.default_window - 1) * signals.period,
            degree=self.degree,
            shape=self.shape,
            settle=self.settle,
            rates=rates,
            before=before,
            present=present,
            exact=exact,
            near=near,
        )


class RlsTuning(Tuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of the recursive least squares.

    Attributes
    ----------
    p0 : P(0) = p0 I (Flacco 2012 §7); when absent, such that the prior weighs as much as a small part of one sample at
        the log's largest deflection and set-point, see `usual_regressor`
    c : of the enhanced RLS (eq. 40–41); only the product p0·c matters, c = 1 is plain RLS
    """

    p0: Positive | None = None
    c: Annotated[float, Meta(gt=0.0, le=1.0)] = 1e-5

    def initial_covariance(
        self, device: Device, signals: JointSignals, samples: float, *, second: bool = False
    ) -> float:
        """Return p0, as given or such that the prior weighs as much as a number of samples of the `usual_regressor`."""
        if self.p0 is not None:
            return self.p0
        return 1.0 / (samples * self.c * usual_regressor(device, signals, second=second) ** 2)


def usual_regressor(device: Device, signals: JointSignals, *, second: bool = False) -> float:
    """Return what functions of the basis reach on a joint's signals, those of the set-point's powers on average.

    The set-point's unit may make its highest power thousands of times as large as the lowest (the AwAS' r² in mm). Where that
    counts alone, a prior is far too strong for the others: a stiffness that does not go with r² was taken for one that does, and
    up to 17 % off with 1 % claimed. The average is the geometric mean.

    Parameters
    ----------
    device, signals : of the joint
    second : of the powers of the deflection not the one that reaches most, but the one after it, or a tenth of the former where
        that is more: it gives a spring its shape, which the prior must not decide; unless a coefficient of the same size would
        change the stiffness by a hundredth only

    Raises
    ------
    EstimatorError
        The functions leave the range in which squares and their sums can be formed: a scale of the basis is far off.
    """
    if not device.transmissions:
        raise EstimatorError(f"joint '{device.joint}' is of kind 'pneumatic': there is no spring to fit anything to")
    corner = np.array([largest(signals.roles["setpoint"])]) if device.has_setpoint else None
    powers = device.basis.shapes, device.basis.setpoint_order
    reached = np.array(
        [
            device.basis.rows(np.array([largest(deflection_of(signals.roles, view))]), corner, 0).ravel()[
                : np.prod(powers)
            ]
            for view in device.transmissions
        ]
    )
    greatest = float(reached.max())
    if not 1.0 / LARGEST < greatest < LARGEST:
        raise EstimatorError(
            f"joint '{device.joint}': the functions of the basis reach {greatest:.3g} on this log: its deflection_scale"
            f" ({device.basis.deflection_scale:.3g} rad) or setpoint_scale ({device.basis.setpoint_scale:.3g}) is far from the"
            f" signals; leave them out of [joint.{device.joint}.basis] to have them taken from the log"
        )
    each = np.sort(np.exp(np.mean(np.log(np.maximum(reached.reshape(-1, *powers).max(axis=0), 1.0 / LARGEST)), axis=1)))
    usual, after = each[-1], each[-2:][0]
    # Of a cube the stiffness has three times the share that the torque has.
    if second and 3.0 * after > NEGLIGIBLE_SHARE * usual:
        usual = max(after, LEAST_SECOND * usual)
    return max(float(usual), LEAST_USUAL * greatest)


Modality = Literal["MODEL", "SENSOR", "RESIDUAL"]


def read_tuning(kind: type[T], estimator: str, values: Mapping[str, str]) -> T:
    """Turn NAME=VALUE texts into an estimator's tuning.

    Raises
    ------
    EstimatorError
        A name is unknown or a value impossible; the message names it and those there are.
    """
    known = [name for name in kind.__struct_fields__ if name not in kind.unused]
    for name in values:
        if name not in known:
            raise EstimatorError(
                f"{estimator} has nothing to tune named '{name}'{did_you_mean(name, known) or '.'}"
                f" It has: {', '.join(known)}"
            )
    try:
        tuned = msgspec.convert(dict(values), kind, strict=False)
    except msgspec.ValidationError as error:
        field = _field(error)
        reason = f"{field}={values[field]}: has to be {_expected(kind, field)}" if field in values else str(error)
        raise EstimatorError(f"{estimator}: --tune {reason}") from error
    for name in values:
        value = getattr(tuned, name)
        if name not in MAY_BE_INFINITE and isinstance(value, float) and not np.isfinite(value):
            raise EstimatorError(f"{estimator}: --tune {name}={values[name]}: has to be a finite number")
    return tuned


def _field(error: msgspec.ValidationError) -> str:
    """Return the name that an error points at; empty where it points at the values together."""
    text = str(error)
    return text.rsplit("$.", 1)[-1].rstrip("`") if "$." in text else ""


def _expected(kind: type[Tuning], name: str) -> str:
    """Return in words what a value of the tuning has to be."""
    (found,) = (field.type for field in _fields(kind) if field.name == name)
    options = found.types if isinstance(found, inspect.UnionType) else (found,)
    (one,) = (option for option in options if not isinstance(option, inspect.NoneType))
    if isinstance(one, inspect.LiteralType):
        return "one of: " + ", ".join(map(str, one.values))
    if isinstance(one, inspect.BoolType):
        return "true or false"
    bounds = [
        f"{words} {bound:g}"
        for words, bound in (
            ("above", getattr(one, "gt", None)),
            ("at least", getattr(one, "ge", None)),
            ("below", getattr(one, "lt", None)),
            ("at most", getattr(one, "le", None)),
        )
        if bound is not None
    ]
    number = "a whole number" if isinstance(one, inspect.IntType) else "a number"
    return " ".join((number, " and ".join(bounds))).rstrip()


def _fields(kind: type[Tuning]) -> tuple[inspect.Field, ...]:
    info = inspect.type_info(kind)
    assert isinstance(info, inspect.StructType)
    return info.fields
