"""A model answers where it was fitted; elsewhere it warns and answers NaN, unless it is asked to extrapolate."""

import warnings

import numpy as np
import pytest

from vsalog.core.errors import EstimatorError
from vsalog.core.model import BasisSpec, JointModel, OutsideRegionWarning, TransmissionModel


def joint(region, setpoint_order=1):
    """τ = 20 φ + 400 φ³, or with a set-point (20 φ + 400 φ³)(1 + c)."""
    coefficients = (20.0, 400.0) if setpoint_order == 1 else (20.0, 20.0, 400.0, 400.0)
    n = len(coefficients)
    covariance = tuple(tuple(1e-4 * (i == j) for j in range(n)) for i in range(n))
    part = TransmissionModel(
        name="1", coefficients=coefficients, covariance=covariance, noise=0.0, samples=9, region=region
    )
    basis = BasisSpec(powers=(1, 3), setpoint_order=setpoint_order)
    return JointModel(estimator="direct", modality="SENSOR", basis=basis, transmission=(part,))


def test_outside_of_the_region_is_nan_with_one_warning():
    model = joint(((-0.1,), (0.1,)))
    phi = np.array([-0.2, -0.1, 0.0, 0.05, 0.1, 0.11, np.nan])
    for evaluate, exact in (
        (model.stiffness, 20.0 + 1200.0 * phi**2),
        (model.flexibility_torque, 20.0 * phi + 400.0 * phi**3),
    ):
        with pytest.warns(OutsideRegionWarning) as told:
            values, std = evaluate("1", phi)
        assert len(told) == 1
        assert told[0].filename == __file__  # where the caller is
        assert np.isnan(values).tolist() == np.isnan(std).tolist() == [True, False, False, False, False, True, True]
        np.testing.assert_allclose(values[1:5], exact[1:5], rtol=1e-12)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            everywhere, _ = evaluate("1", phi, extrapolate=True)
            evaluate("1", phi[1:5])
            evaluate("1", 0.05)
        np.testing.assert_allclose(everywhere, exact, rtol=1e-12)


def test_of_a_set_point_the_region_has_two_dimensions():
    # A triangle: only small deflections were reached at c = 1.
    model = joint(((-0.1, 0.0), (0.1, 0.0), (0.0, 1.0)), setpoint_order=2)
    with pytest.warns(OutsideRegionWarning):
        values, _ = model.stiffness("1", [0.08, 0.08], [0.0, 0.9])
    assert values[0] == pytest.approx(20.0 + 1200.0 * 0.08**2)
    assert np.isnan(values[1])
    assert model.stiffness("1", [0.0], 0.5)[0] == pytest.approx([30.0])


def test_a_model_without_a_region_was_fitted_nowhere():
    with pytest.warns(OutsideRegionWarning):
        assert np.isnan(joint(()).stiffness("1", 0.0)[0]).all()


def test_no_such_transmission_comes_first():
    with pytest.raises(EstimatorError):
        joint(()).stiffness("2", 0.0)
