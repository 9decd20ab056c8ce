"""The signature of each kind of cause in a torque's error.

A small effect shows to first order as its own function of the measured signals: a zero of the deflection that is wrong by δ
gives σ δ, a gap of width b gives σ times the deflection clipped at ± b/2, a drifting spring gives t τ.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.dependence import INTERVALS, hats
from vsalog.core.resolution import ENOUGH
from vsalog.mechanics.slip_elements import slip_deflections

Array = NDArray[np.float64]

# Half a gap, and the motion over which a loop changes sides, as parts of the largest deflection and of its span: for a shape
# between two successive ones, the nearer one has a residual below a tenth of the squares.
WIDTHS = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
# Names of positions begin like this.
POSITIONS = ("link_position", "motor_position")


@dataclass(frozen=True, slots=True)
class Signature:
    """The signature of one kind of cause: any combination of its columns.

    Attributes
    ----------
    on : what the error depends on; a key of `dependence.CODES`
    columns : shape (N, k)
    any_shape : whether the columns are those of a curve, which follows any smooth function, rather than an effect's own
    """

    on: str
    columns: Array
    any_shape: bool = False


def signatures(torque: Array, variables: Mapping[str, Array]) -> list[Signature]:
    """Return the shapes that these variables allow; one kind may have several.

    Parameters
    ----------
    torque : predicted, shape (N,)
    variables : as for `dependences`, shape (N,) each, all finite
    """
    found = [_of("offset", np.ones_like(torque))]
    if np.ptp(torque) == 0.0:
        return found
    found += [_of("torque", torque), _of("side", np.abs(torque))]
    for part in (_static, _moving, _over_time):
        found += part(torque, variables)
    return [s for s in found if bool(np.any(s.columns)) and bool(np.isfinite(s.columns).all())]


def _of(on: str, *columns: Array) -> Signature:
    return Signature(on, np.stack(columns, axis=1))


def _static(torque: Array, variables: Mapping[str, Array]) -> Iterator[Signature]:
    phi, sigma, setpoint = (variables.get(name) for name in ("deflection", "stiffness", "setpoint"))
    if phi is not None and np.ptp(phi) > 0.0:
        yield Signature("deflection", _curve(phi), True)
    if setpoint is not None and np.ptp(setpoint) > 0.0:
        curve = _curve(setpoint)
        yield Signature("setpoint", curve, True)
        # A wrong set-point makes the spring stiffer or softer than predicted.
        yield Signature("setpoint", curve * torque[:, None], True)
    if sigma is None or phi is None:
        return
    yield _of("zero", sigma)
    for share in WIDTHS:
        half = share * float(np.abs(phi).max())
        yield _of("gap", sigma * np.clip(phi, -half, half))
    for name, at in _positions(variables):
        yield _of("position", sigma * at)
        # The disc's turn begins anywhere, so that its mean over the motion is the encoder's zero.
        yield _of("position", sigma * np.sin(at), sigma * np.cos(at))
        rate = variables.get(f"velocity of {name}")
        if rate is not None:
            yield _of("late", sigma * rate)


def _positions(variables: Mapping[str, Array]) -> Iterator[tuple[str, Array]]:
    for name, values in variables.items():
        if name.startswith(POSITIONS) and np.ptp(values) > 0.0:
            yield name, values


def _moving(torque: Array, variables: Mapping[str, Array]) -> Iterator[Signature]:
    rate, loading, sigma = (variables.get(name) for name in ("velocity", "loading", "stiffness"))
    if rate is not None and np.ptp(rate) > 0.0:
        yield _of("velocity", rate)
        if sigma is not None:
            yield _of("velocity", sigma * rate)
        yield _of("direction", np.sign(rate))
    for name, values in variables.items():
        if name.startswith("loop"):
            yield _of("direction", values)
    if loading is not None and np.ptp(loading) > 0.0:
        yield _of("loading", np.sign(loading))


def _over_time(torque: Array, variables: Mapping[str, Array]) -> Iterator[Signature]:
    time, sigma = variables.get("time"), variables.get("stiffness")
    if time is None or np.ptp(time) == 0.0:
        return
    t = (time - time.min()) / np.ptp(time)
    yield _of("time", np.ones_like(t), t)
    yield _of("gain over time", torque, t * torque)
    if sigma is not None:
        yield _of("zero over time", sigma, t * sigma)


def _curve(x: Array) -> Array:
    """Return the functions of a curve of any shape, with equally many samples between its knots, shape (N, k)."""
    return hats(x, np.unique(np.quantile(x, np.linspace(0.0, 1.0, INTERVALS + 1))))


def loops(phi: Array, rows: NDArray[np.int64]) -> dict[str, Array]:
    """Return the states of springs that slip, −1 to 1, driven by a deflection: the signature of hysteresis of some width.

    Parameters
    ----------
    phi : shape (N,), of the whole log in its order; NaN stands still
    rows : shape (M,), the samples at which the states are wanted

    Returns
    -------
    Names → states, shape (M,)
    """
    known = np.flatnonzero(np.isfinite(phi))
    if known.size < 2 or np.ptp(phi[known]) == 0.0:
        return {}
    at = known[:: max(1, known.size // ENOUGH)]
    slips = float(np.ptp(phi[at])) * np.array(WIDTHS)
    states = slip_deflections(phi[at], slips, False) / slips[:, None]
    return {f"loop {share:g}": np.interp(rows, at, own) for share, own in zip(WIDTHS, states, strict=True)}
