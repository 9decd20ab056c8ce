"""Torque and stiffness against derivatives taken numerically from the energy, and against hand-computed values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from vsalog.core.errors import RigError, VsalogError
from vsalog.mechanics import elastic_energy, flexibility_torque, reaction_torque, stiffness
from vsalog.rig.schema import (
    AwasTransmission,
    CubicTransmission,
    LinearTransmission,
    Transmission,
    UnknownTransmission,
    Vsa2Transmission,
)

Array = NDArray[np.float64]

LINEAR = LinearTransmission(stiffness=35.0)
CUBIC = CubicTransmission(stiffness=20.0, cubic=300.0)
VSA2 = Vsa2Transmission(stiffness=0.5, geometry=1.8)
AWAS = AwasTransmission(spring_stiffness=14_220.0)
CASES = [(LINEAR, None, 1.0), (CUBIC, None, 1.0), (VSA2, None, 0.9), (AWAS, 0.07, 0.7)]


def derivative(f: Callable[[Array], Array], x: Array, h: float = 2e-3) -> Array:
    """Eight-point central difference: error of order h⁸."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    return sum(w * (f(x + i * h) - f(x - i * h)) for i, w in weights.items()) / h  # type: ignore[return-value]


@pytest.mark.parametrize(("transmission", "arm", "reach"), CASES)
def test_torque_is_the_derivative_of_the_energy(transmission: Transmission, arm: float | None, reach: float) -> None:
    phi = np.linspace(-reach, reach, 101)
    expected = derivative(lambda x: elastic_energy(transmission, x, arm), phi)
    torque = flexibility_torque(transmission, phi, arm)
    np.testing.assert_allclose(torque, expected, rtol=1e-9, atol=1e-10 * np.abs(torque).max())


@pytest.mark.parametrize(("transmission", "arm", "reach"), CASES)
def test_stiffness_is_the_derivative_of_the_torque(transmission: Transmission, arm: float | None, reach: float) -> None:
    phi = np.linspace(-reach, reach, 101)
    expected = derivative(lambda x: flexibility_torque(transmission, x, arm), phi)
    np.testing.assert_allclose(stiffness(transmission, phi, arm), expected, rtol=1e-8)


@pytest.mark.parametrize(("transmission", "arm", "reach"), CASES)
def test_no_torque_without_deflection_and_odd_symmetry(
    transmission: Transmission, arm: float | None, reach: float
) -> None:
    phi = np.linspace(0.0, reach, 50)
    torque = flexibility_torque(transmission, phi, arm)
    assert torque[0] == 0.0
    assert elastic_energy(transmission, 0.0, arm) == 0.0
    np.testing.assert_array_equal(flexibility_torque(transmission, -phi, arm), -torque)
    assert np.all(stiffness(transmission, phi, arm) > 0.0)


@given(geometry=st.floats(1.05, 5.0), k=st.floats(0.01, 100.0))
def test_vsa2_at_rest_has_its_small_deflection_stiffness(geometry: float, k: float) -> None:
    # β ≈ (C − 1) φ / 2 for small φ, hence U ≈ k (C − 1)² φ² / 4 and σ(0) = k (C − 1)² / 2.
    transmission = Vsa2Transmission(stiffness=k, geometry=geometry)
    assert float(stiffness(transmission, 0.0)) == pytest.approx(k * (geometry - 1.0) ** 2 / 2.0)


@given(phi=st.floats(-20.0, 20.0), geometry=st.floats(1.01, 6.0))
def test_vsa2_is_nan_from_its_singularity_on_and_finite_before(phi: float, geometry: float) -> None:
    transmission = Vsa2Transmission(stiffness=1.0, geometry=geometry)
    values = [f(transmission, phi) for f in (elastic_energy, flexibility_torque, stiffness)]
    limit = 2.0 * np.arcsin(1.0 / geometry)
    if abs(phi) < limit * (1.0 - 1e-12):
        assert np.all(np.isfinite(values))
    elif abs(phi) > limit * (1.0 + 1e-12):
        assert np.all(np.isnan(values))


def test_vsa2_guards_the_singularity_without_warnings() -> None:
    with np.errstate(all="raise"):
        torque = flexibility_torque(VSA2, [-4.0, 0.0, 2.0 * np.arcsin(1.0 / 1.8), 2.0, 7.0])
    np.testing.assert_array_equal(np.isnan(torque), [True, False, True, True, True])


def test_awas_by_hand() -> None:
    # k_s r² sin 2φ and 2 k_s r² cos 2φ with k_s = 14 220 N/m, r = 0.1 m, φ = π/12: 142.2 · ½ and 284.4 · √3/2.
    assert float(flexibility_torque(AWAS, np.pi / 12.0, 0.1)) == pytest.approx(71.1)
    assert float(stiffness(AWAS, np.pi / 12.0, 0.1)) == pytest.approx(284.4 * np.sqrt(3.0) / 2.0)


def test_awas_reaction_is_the_energy_s_derivative_in_the_secondary_angle() -> None:
    start, travel = 0.1, 2.5e-3 / (2.0 * np.pi)
    angle, phi = np.linspace(0.0, 120.0, 7)[:, None], np.linspace(-0.3, 0.3, 13)
    expected = derivative(lambda c: elastic_energy(AWAS, phi, start - travel * c), angle, h=0.5)
    result = reaction_torque(AWAS, phi, start - travel * angle, travel)
    np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-12)
    assert np.all(result <= 0.0)


def test_shapes_broadcast_and_nan_passes_through() -> None:
    arms = np.array([[0.05], [0.1]])
    phi = np.array([0.0, np.nan, 0.1])
    assert stiffness(AWAS, phi, arms).shape == (2, 3)
    for transmission in (LINEAR, CUBIC, VSA2):
        np.testing.assert_array_equal(np.isnan(flexibility_torque(transmission, phi)), [False, True, False])


@pytest.mark.parametrize("function", [flexibility_torque, stiffness, elastic_energy])
def test_what_cannot_be_computed_is_reported(function: Callable[..., Array]) -> None:
    with pytest.raises(RigError, match="'unknown'"):
        function(UnknownTransmission(), [0.1])
    with pytest.raises(VsalogError, match="lever arm"):
        function(AWAS, [0.1])
