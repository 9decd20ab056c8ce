"""What stands in for the papers' experiments: another machine than the rig states, and the settings printed."""

import numpy as np
import pytest

from vsalog.reproduce import flacco2012_experiment, serio2011, shin_parameters
from vsalog.reproduce.flacco2012 import AWAS_PAPER, coefficients
from vsalog.reproduce.measure import estimate, with_noise
from vsalog.simulation.experiments import awas_experiment, awas_rig


@pytest.fixture(scope="module")
def recording():
    return with_noise(flacco2012_experiment._played(flacco2012_experiment.FIRST), [101])[0]


def test_the_machine_of_flacco_2012_has_the_spring_that_is_found_and_the_rig_the_data_sheets(recording):
    truth = recording.truth
    phi, r = truth["deflection"], truth["lever_arm"]
    np.testing.assert_allclose(truth["stiffness"], 2.0 * 10.7e3 * r**2 * np.cos(2.0 * phi), rtol=1e-12)
    assert recording.rig == awas_rig()
    np.testing.assert_allclose(
        flacco2012_experiment.nominal_stiffness(recording)[:1000], 2.0 * 14.22e3 * r[:1000] ** 2, rtol=0.02
    )


def test_sensor_and_residual_find_the_spring_and_model_the_data_sheets(recording):
    """§8: k_s = 0.0107 kN/mm from η₀,₂, where the nominal one is 0.01422."""
    for modality, spring in (("MODEL", 0.01422), ("SENSOR", 0.0107), ("RESIDUAL", 0.0107)):
        trace = estimate(recording, AWAS_PAPER.with_tune(modality=modality))
        assert trace["1"]["coefficient_2"][-1] / 2.0 == pytest.approx(spring, rel=0.03), modality
    curve = coefficients(trace.time, trace)[2].curves[0]
    assert curve.label == "η₀,₂ (φ r²)"
    np.testing.assert_array_equal(curve.y, trace["1"]["coefficient_2"])


def test_the_links_filter_is_the_textbooks():
    """Eq. 21–25 again, one recording and one sample at a time, with the Jacobian by differences."""
    e = awas_experiment(ideal=True, torques=serio2011.TORQUES, duration=0.3)
    q, u, T = e.measured["link_position"], -e.measured["torque_sensor"], e.period
    tuning = serio2011.SIMULATED
    velocity = np.append(0.0, np.diff(q)) / T

    def f(x, u):
        return np.array([x[0] + T * x[1], x[1] + T * (x[2] * u - x[3] * x[1]), x[2], x[3]])

    x, P, H = np.zeros(4), tuning.P0 * np.eye(4), np.eye(4)[:2]
    states = []
    for k in range(q.size):
        if k > 0:
            F = np.column_stack([(f(x + d, u[k - 1]) - f(x - d, u[k - 1])) / 2e-3 for d in 1e-3 * np.eye(4)])
            x, P = f(x, u[k - 1]), F @ P @ F.T + tuning.Q * np.eye(4)
        S = H @ P @ H.T + tuning.R * np.eye(2)
        K = np.linalg.solve(S, H @ P).T
        x = x + K @ (np.array([q[k], velocity[k]]) - H @ x)
        P = (np.eye(4) - K @ H) @ P
        states.append(x)
    two = serio2011.link_filter(np.stack([q, 2.0 * q]), np.stack([u, 2.0 * u]), T, tuning)
    np.testing.assert_allclose(two[0], states, rtol=1e-6, atol=1e-9)
    # Both signals twice as large are those of the same link.
    assert 1.0 / two[1, -1, 2] == pytest.approx(0.1, rel=0.05)


def test_parameters_move_the_model_as_the_text_says_where_it_can():
    """Shin 2021 §II-C: friction shortens the steady angle, orifices and k₁ speed up the transient."""
    joint = shin_parameters.Rig.preset("pam").file.joint["pam"]
    plain = shin_parameters.step_response(joint)
    for name, (change, kind) in shin_parameters.PARAMETERS.items():
        if name in ("μ_s", "A₀"):
            more = shin_parameters.step_response(change(joint, 2.0))
            time = 1e-3 * np.arange(more.size)
            if kind == "steady":
                assert more[-1] < plain[-1]
            else:
                assert shin_parameters.rise_time(time, more) < shin_parameters.rise_time(time, plain)
