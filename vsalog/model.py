"""A fitted flexibility-torque function with its covariance and the region it was fitted in.

Frozen, it is what a second experiment is validated against (Flacco 2012 §8).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.basis import PolynomialBasis
from vsalog.errors import ReadError

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class _Base(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Unknown keys are refused, values never change."""


class BasisSpec(_Base, frozen=True):
    """The functions: products of (φ / deflection_scale)^power and (set-point / setpoint_scale)^0…(setpoint_order − 1)."""

    powers: tuple[int, ...]
    setpoint_order: int = 1
    deflection_scale: float = 1.0
    setpoint_scale: float = 1.0
    branches: bool = False
    terms: tuple[str, ...] = ()

    def basis(self) -> PolynomialBasis:
        """Return the basis these values describe."""
        return PolynomialBasis(
            self.powers, self.setpoint_order, self.deflection_scale, self.setpoint_scale, self.branches
        )


class TransmissionModel(_Base, frozen=True):
    """One transmission's flexibility torque τ_e(φ, set-point).

    Attributes
    ----------
    coefficients : of the basis, shape (n·m,) [N·m], for scaled φ and set-point
    covariance : of the coefficients, shape (n·m, n·m)
    noise : standard deviation of what the fit left over, in the unit of the equation fitted
    samples : number of samples learnt from
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
    modality : where the torque came from: MODEL, SENSOR, RESIDUAL, or INTEGRATED for the integrated motor equation
    basis : the functions
    transmission : the fitted transmissions
    motor : what was estimated of the motors, e.g. ``inertia_1`` [kg·m²], ``damping_1`` [N·m·s/rad]
    """

    estimator: str
    modality: str
    basis: BasisSpec
    transmission: tuple[TransmissionModel, ...]
    motor: dict[str, float] = {}

    def flexibility_torque(
        self, name: str, phi: Array, setpoint: Array | None = None, loading: Flags | None = None
    ) -> tuple[Array, Array]:
        """Evaluate τ_e of a transmission and its standard deviation [N·m], each of shape (N,).

        Parameters
        ----------
        name : of the transmission
        phi : shape (N,) [rad]
        setpoint : shape (N,), SI; where the basis has one
        loading : shape (N,), which branch; loading everywhere when absent
        """
        return self._evaluate(name, phi, setpoint, loading, 0)

    def stiffness(
        self, name: str, phi: Array, setpoint: Array | None = None, loading: Flags | None = None
    ) -> tuple[Array, Array]:
        """Evaluate σ = ∂τ_e/∂φ of a transmission and its standard deviation [N·m/rad], as `flexibility_torque` does."""
        return self._evaluate(name, phi, setpoint, loading, 1)

    def _evaluate(
        self, name: str, phi: Array, setpoint: Array | None, loading: Flags | None, derivative: int
    ) -> tuple[Array, Array]:
        part = next(t for t in self.transmission if t.name == name)
        rows = self.basis.basis().rows(np.atleast_1d(phi), setpoint, derivative, loading)[:, derivative]
        variance = np.einsum("ki,ij,kj->k", rows, np.array(part.covariance), rows)
        return rows @ np.array(part.coefficients), np.sqrt(variance)


class ModelFile(_Base, frozen=True):
    """A whole `LOG.model.toml`.

    Attributes
    ----------
    vsalog : version that wrote it
    units : of the coefficients' arguments and results
    log : name → SHA-256 of the logs it was learnt from
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
            The file cannot be read, is no TOML, or does not hold a model.
        """
        try:
            return msgspec.toml.decode(Path(path).read_bytes(), type=cls)
        except OSError as error:
            raise ReadError(f"{path}: cannot be read: {error.strerror}") from error
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise ReadError(f"{path}: is not a model file that 'vsalog estimate' writes: {error}") from error


def basis_spec(basis: PolynomialBasis) -> BasisSpec:
    """Describe a basis for the model file."""
    return BasisSpec(
        powers=basis.powers,
        setpoint_order=basis.setpoint_order,
        deflection_scale=basis.deflection_scale,
        setpoint_scale=basis.setpoint_scale,
        branches=basis.branches,
        terms=tuple(basis.terms),
    )


UNITS: Mapping[str, str] = {"deflection": "rad", "flexibility_torque": "N*m", "stiffness": "N*m/rad"}
