"""A fitted flexibility-torque function with its covariance and the region it was fitted in.

Frozen, it is what a second experiment is validated against (Flacco 2012 §8).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsalog.core.basis import PolynomialBasis, linear
from vsalog.core.errors import EstimatorError, ReadError
from vsalog.core.region import inside_region
from vsalog.core.toml import parse_toml

Array = NDArray[np.float64]


class OutsideRegionWarning(UserWarning):
    """A model was evaluated where it was not fitted."""


class _Base(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Unknown keys are refused, values never change."""


class BasisSpec(_Base, frozen=True):
    """The functions: products of (φ / deflection_scale)^power and (set-point / setpoint_scale)^0…(setpoint_order − 1).

    With `knots` and `setpoint_knots`, and pieces between these, and `corners` [rad]: see `PolynomialBasis`.
    """

    powers: tuple[int, ...]
    setpoint_order: int = 1
    deflection_scale: float = 1.0
    setpoint_scale: float = 1.0
    branches: bool = False
    knots: int = 0
    setpoint_knots: tuple[float, ...] = ()
    corners: tuple[float, ...] = ()
    terms: tuple[str, ...] = ()

    @property
    def has_setpoint(self) -> bool:
        """Whether functions depend on the set-point."""
        return self.basis().has_setpoint

    def basis(self) -> PolynomialBasis:
        """Return the basis these values describe."""
        return PolynomialBasis(
            self.powers, self.setpoint_order, self.deflection_scale, self.setpoint_scale, self.branches, self.knots,
            self.setpoint_knots, self.corners,
        )  # fmt: skip


class TransmissionModel(_Base, frozen=True):
    """One transmission's flexibility torque τ_e(φ, set-point).

    Attributes
    ----------
    coefficients : of the basis, shape (n·m,) [N·m], for scaled φ and set-point
    covariance : of the coefficients, shape (n·m, n·m)
    noise : standard deviation of the residual, in the unit of the equation fitted
    samples : number of fitted samples
    region : vertices (φ, set-point) of the convex hull of these samples, or the ends (φ,) of the interval
    """

    name: str
    coefficients: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    noise: float
    samples: int
    region: tuple[tuple[float, ...], ...]


class JointModel(_Base, frozen=True):
    """The transmissions of one joint and how they were fitted.

    Attributes
    ----------
    estimator : name of the method
    modality : source of the torque: MODEL, SENSOR, RESIDUAL, or INTEGRATED for the integrated motor equation
    basis : the functions
    transmission : the fitted transmissions
    motor : what was estimated of the motors: ``inertia_1`` [kg·m²], ``damping_1`` [N·m·s/rad] and their ``…_std``
    """

    estimator: str
    modality: str
    basis: BasisSpec
    transmission: tuple[TransmissionModel, ...]
    motor: dict[str, float] = {}

    def flexibility_torque(
        self, name: str, phi: ArrayLike, setpoint: ArrayLike | None = None, loading: ArrayLike | None = None,
        extrapolate: bool = False,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Evaluate τ_e of a transmission and its standard deviation [N·m], each of shape (N,).

        Outside of the region it was fitted in there is NaN, with an `OutsideRegionWarning`.

        Parameters
        ----------
        name : of the transmission
        phi : shape (N,) [rad]
        setpoint : shape (N,) or one number, SI; needed where the basis has one
        loading : shape (N,) or one, which branch; loading everywhere when absent
        extrapolate : evaluate it outside of that region too, where the error may exceed the standard deviation by far

        Raises
        ------
        EstimatorError
            There is no such transmission, the set-point is missing, or the shapes do not fit together.
        """
        found = self.torque_and_stiffness(name, phi, setpoint, loading)[0]
        return found if extrapolate else self._inside(name, phi, setpoint, found)

    def stiffness(
        self, name: str, phi: ArrayLike, setpoint: ArrayLike | None = None, loading: ArrayLike | None = None,
        extrapolate: bool = False,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Evaluate σ = ∂τ_e/∂φ of a transmission and its standard deviation [N·m/rad], as `flexibility_torque` does."""
        found = self.torque_and_stiffness(name, phi, setpoint, loading)[1]
        return found if extrapolate else self._inside(name, phi, setpoint, found)

    def _inside(
        self, name: str, phi: ArrayLike, setpoint: ArrayLike | None, found: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Return values with NaN outside of the region, and warn of them."""
        part = next(t for t in self.transmission if t.name == name)
        at = np.broadcast_to(np.asarray(phi, dtype=np.float64), found[0].shape)
        c = None if setpoint is None else np.broadcast_to(np.asarray(setpoint, dtype=np.float64), at.shape)
        inside = inside_region(part.region, at, c)
        outside = np.count_nonzero(~inside & np.isfinite(at))
        if outside:
            ends = [f"{min(x):.4g} to {max(x):.4g}" for x in zip(*part.region, strict=True)]
            bounds = " and ".join(
                f"{what} {span}" for what, span in zip(("deflection", "set-point"), ends, strict=False)
            )
            warnings.warn(
                f"transmission '{name}': {outside} of {at.size} points are outside of the region the model was fitted in"
                f" ({bounds or 'it has none'}), and NaN there; extrapolate=True evaluates them nevertheless",
                OutsideRegionWarning,
                stacklevel=3,
            )
        return np.where(inside, found[0], np.nan), np.where(inside, found[1], np.nan)

    def torque_and_stiffness(
        self, name: str, phi: ArrayLike, setpoint: ArrayLike | None = None, loading: ArrayLike | None = None
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Evaluate both in one go, each with its standard deviation, as `flexibility_torque` does, also outside of the region."""
        part = next((t for t in self.transmission if t.name == name), None)
        if part is None:
            known = ", ".join(f"'{t.name}'" for t in self.transmission)
            raise EstimatorError(f"the model has no transmission '{name}'; it has {known}")
        if self.basis.has_setpoint and setpoint is None:
            raise EstimatorError("the model depends on the set-point: give the one to evaluate it at (setpoint=…)")
        try:
            at, c, on = np.broadcast_arrays(
                np.atleast_1d(np.asarray(phi, dtype=np.float64)),
                0.0 if setpoint is None else np.asarray(setpoint, dtype=np.float64),
                True if loading is None else np.asarray(loading, dtype=np.bool_),
            )
        except ValueError as error:
            raise EstimatorError(f"the shapes of deflection, set-point and loading differ: {error}") from error
        if at.ndim != 1:
            raise EstimatorError(f"the deflection must be one number or a list of them, not of shape {at.shape}")
        rows = self.basis.basis().rows(at, None if setpoint is None else c, 1, on)
        coefficients, covariance = np.array(part.coefficients), np.array(part.covariance)
        torque, stiffness = (linear(np.ascontiguousarray(rows[:, d]), coefficients, covariance) for d in (0, 1))
        return torque, stiffness


class ModelFile(_Base, frozen=True):
    """A whole `LOG.model.toml`.

    Attributes
    ----------
    vsalog : version that wrote it
    units : of the coefficients' arguments and results
    log : name → SHA-256 of the logs it was fitted to
    settings : of the estimator
    rig : the rig as TOML text
    joint : the models by joint
    """

    vsalog: str
    units: dict[str, str]
    log: dict[str, str]
    settings: dict[str, dict[str, str | float | int | bool]]
    rig: str
    joint: dict[str, JointModel]

    def to_toml(self) -> str:
        """Return the file's text; values that are not finite are written as TOML's nan and inf."""
        import tomli_w

        return tomli_w.dumps(msgspec.to_builtins(self))

    @classmethod
    def load(cls, path: str | Path) -> ModelFile:
        """Read a model file.

        Raises
        ------
        ReadError
            The file cannot be read, is no TOML, or contains no model.
        """
        try:
            return msgspec.convert(parse_toml(Path(path).read_text(encoding="utf-8")), cls)
        except OSError as error:
            raise ReadError(f"{path}: cannot be read: {error.strerror}") from error
        except ValueError as error:  # of text that is none, or no TOML, and of msgspec
            raise ReadError(f"{path}: is not a model file that 'vsalog estimate' writes: {error}") from error


def basis_spec(basis: PolynomialBasis) -> BasisSpec:
    """Describe a basis for the model file."""
    return BasisSpec(
        powers=basis.powers,
        setpoint_order=basis.setpoint_order,
        deflection_scale=basis.deflection_scale,
        setpoint_scale=basis.setpoint_scale,
        branches=basis.branches,
        knots=basis.knots,
        setpoint_knots=basis.setpoint_knots,
        corners=basis.corners,
        terms=tuple(basis.terms),
    )


UNITS: Mapping[str, str] = {"deflection": "rad", "flexibility_torque": "N*m", "stiffness": "N*m/rad"}
