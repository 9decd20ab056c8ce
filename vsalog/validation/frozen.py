"""Reading a model for validation: one with inconsistent numbers is refused before anything is done."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import ReadError, RigError
from vsalog.core.model import JointModel, ModelFile, TransmissionModel
from vsalog.core.precision import ROUNDING
from vsalog.core.printable import command
from vsalog.estimators.tuning import LARGEST
from vsalog.readers import open_reader
from vsalog.readers.own_files import is_trace, kind_of_toml, model_beside
from vsalog.rig import Rig

Array = NDArray[np.float64]

# Highest power of a deflection, and the most of a set-point, that can be evaluated [1].
HIGHEST_POWER = 100


def frozen(path: Path) -> ModelFile:
    """Read a model file and check that it can be evaluated.

    Raises
    ------
    ReadError
        It cannot be read, is no model file, contains no joint, or its numbers are inconsistent.
    """
    try:
        file = ModelFile.load(path)
    except ReadError:
        _name_another(path)
        raise
    except (RecursionError, ValueError) as error:
        # The TOML parser's own limits, of nesting and of digits.
        raise ReadError(f"{path}: is not a model file that 'vsalog estimate' writes: it is not valid TOML") from error
    try:
        Rig.from_toml(file.rig, f"{path}, the rig in it")
    except RigError as error:
        raise ReadError(f"{error}; write the model again with 'vsalog estimate'") from error
    if not file.joint:
        raise ReadError(f"{path}: contains no joint, so there is nothing to judge")
    for name, joint in file.joint.items():
        wrong = _basis_fault(joint) or next((w for t in joint.transmission if (w := _fault(joint, t))), None)
        if wrong is not None:
            raise ReadError(f"{path}: joint '{name}': {wrong}; write the model again with 'vsalog estimate'")
    return file


def _name_another(path: Path) -> None:
    """Refuse a trace, a rig or a log in place of a model.

    Raises
    ------
    ReadError
        It is one.
    """
    if is_trace(path):
        raise ReadError(f"{path}: is a trace, no model; give the model of the same run, {model_beside(path)}")
    if kind_of_toml(path) == "rig":
        fitted = command("estimate", "LOG", "--rig", path)
        raise ReadError(
            f"{path}: is a rig, no model; '{fitted}' fits a model to a log, and writes LOG.model.toml, to be given in its place"
        )
    if path.suffix == ".toml":
        return
    try:
        open_reader(path)
    except ReadError:
        return
    raise ReadError(
        f"{path}: is a log, no model; '{command('estimate', path)}' fits one to it and writes {path.stem}.model.toml, to be"
        " given in its place"
    )


def _basis_fault(joint: JointModel) -> str | None:
    basis = joint.basis
    if not basis.powers or not all(0 <= p <= HIGHEST_POWER for p in basis.powers):
        return f"the powers have to be whole numbers from 0 to {HIGHEST_POWER}, at least one"
    if not 0 <= basis.knots <= HIGHEST_POWER:
        return f"knots has to be between 0 and {HIGHEST_POWER}, not {basis.knots}"
    if not 1 <= basis.setpoint_order <= HIGHEST_POWER:
        return f"setpoint_order has to be between 1 and {HIGHEST_POWER}, not {basis.setpoint_order}"
    if len(basis.corners) > HIGHEST_POWER or not _usable(basis.corners):
        return f"corners have to be at most {HIGHEST_POWER} numbers"
    borders = np.array(basis.setpoint_knots)
    if borders.size and not (
        1 < borders.size <= HIGHEST_POWER + 1 and _usable(borders) and (np.diff(borders) > 0.0).all()
    ):
        return f"setpoint_knots have to be from two to {HIGHEST_POWER + 1} ascending numbers"
    for key in ("deflection_scale", "setpoint_scale"):
        if not ROUNDING <= getattr(basis, key) <= LARGEST:
            return f"{key} has to be a positive number, not {getattr(basis, key):g}"
    return None


def _fault(joint: JointModel, part: TransmissionModel) -> str | None:
    size = joint.basis.basis().size
    where = f"transmission '{part.name}'"
    if len(part.coefficients) != size:
        return f"{where} has {len(part.coefficients)} coefficients for {size} functions"
    if not _usable(part.coefficients):
        return f"{where} has coefficients that are not finite, or too large"
    if len(part.covariance) != size or any(len(row) != size for row in part.covariance):
        return f"{where} has a covariance that is not {size} by {size}"
    if any(part.covariance[i][i] < 0.0 for i in range(size)):
        return f"{where} has a negative variance"
    if not _is_covariance(np.array(part.covariance)):
        return f"{where} has an invalid covariance: it is not symmetric, or some direction has a negative variance"
    columns = {len(vertex) for vertex in part.region}
    if len(columns) > 1 or not columns <= {1, 2} or not all(_usable(vertex) for vertex in part.region):
        return f"{where} has a region that is no list of points (deflection) or (deflection, set-point)"
    return None


def _is_covariance(matrix: Array) -> bool:
    """Return whether a matrix is a covariance: symmetric, without a negative eigenvalue except for rounding, and no NaN."""
    if not np.isfinite(matrix).all():
        return True
    # In units of its standard deviations, since coefficients differ by orders of magnitude.
    deviations = np.sqrt(np.diagonal(matrix))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        scaled = matrix / deviations / deviations[:, None]
    known = deviations > 0.0
    scaled = scaled[np.ix_(known, known)]
    if not np.isfinite(scaled).all() or not np.allclose(scaled, scaled.T, rtol=0.0, atol=ROUNDING):
        return False
    return not matrix[~known].any() and bool(np.linalg.eigvalsh(scaled).min(initial=0.0) > -ROUNDING)


def _usable(values: Iterable[float]) -> bool:
    return all(math.isfinite(v) and abs(v) <= LARGEST for v in values)
