"""Evidence made by hand, with nothing in it to find out."""

import numpy as np
from test_page import HOSTILE, drawn, evidence, report, write_page

from vsalog.core.model import BasisSpec, JointModel, TransmissionModel
from vsalog.estimation.evidence import JointEvidence, TransmissionEvidence

__all__ = ["HOSTILE", "drawn", "evidence", "lever_arm_joint", "report", "write_page"]

COUNT = 20_000


def lever_arm_joint():
    """τ = (100 + 2000 c) φ over an ellipse of (φ, c), measured 0.25 N·m too high; the true stiffness is 0.5 N·m/rad above."""
    t = np.arange(COUNT) * 1e-3
    phi, c = 0.1 * np.sin(t), 0.05 + 0.02 * np.cos(t)
    torque, sigma = (100.0 + 2000.0 * c) * phi, 100.0 + 2000.0 * c
    measured = torque + 0.25
    measured[5000:6000] = np.nan
    angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    region = tuple(zip((0.1 * np.sin(angle)).tolist(), (0.05 + 0.02 * np.cos(angle)).tolist(), strict=True))
    fitted = TransmissionModel(
        name="1",
        coefficients=(100.0, 2000.0),
        covariance=((1.0, 0.0), (0.0, 1.0)),
        noise=0.1,
        samples=100,
        region=region,
    )
    basis = BasisSpec(powers=(1,), setpoint_order=2)
    model = JointModel(estimator="direct", modality="SENSOR", basis=basis, transmission=(fitted,))
    tenth, one = np.full(COUNT, 0.1), np.full(COUNT, 1.0)
    part = TransmissionEvidence(phi, torque, tenth, measured, "sensor", sigma, one, sigma + 0.5, t >= 2.0)
    return JointEvidence("wrist", t, c, "m", {"1": part}, model)
