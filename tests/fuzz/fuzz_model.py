"""Fuzz target: the model files that `validate` is given."""

from __future__ import annotations

import warnings

import numpy as np
from fuzz_contract import put, told

from vsalog.core.errors import ReadError
from vsalog.core.region import inside_region
from vsalog.validation.frozen import frozen

PHI = np.array([-1e3, -0.1, 0.0, 0.1, 2.0])


def one(data: bytes) -> None:
    """Read a model; one that is sound can be evaluated anywhere."""
    path = put(data, "log.model.toml")
    try:
        file = frozen(path)
    except ReadError as error:
        told(error, path)
        return
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        for joint in file.joint.values():
            setpoint = np.full(PHI.size, 0.3) if joint.basis.setpoint_order > 1 else None
            for part in joint.transmission:
                for values in joint.torque_and_stiffness(part.name, PHI, setpoint):
                    assert all(v.shape == PHI.shape and v.dtype == np.float64 for v in values)
                assert inside_region(part.region, PHI, setpoint).shape == PHI.shape
    assert frozen(put(file.to_toml().encode(), "again.model.toml")).joint.keys() == file.joint.keys()


MODEL = """
vsalog = "0.1.0"
rig = 'preset = "{preset}"'
[units]
deflection = "rad"
flexibility_torque = "N*m"
stiffness = "N*m/rad"
[log]
"a.mcap" = "00"
[settings.{joint}]
estimator = "qr-rls"
window = 0.5
[joint.{joint}]
estimator = "qr-rls"
modality = "SENSOR"
[joint.{joint}.basis]
powers = [1, 3]
setpoint_order = {order}
deflection_scale = 0.5
setpoint_scale = 1.0
terms = []
[joint.{joint}.motor]
inertia_1 = 0.1
[[joint.{joint}.transmission]]
name = "total"
coefficients = {coefficients}
covariance = {covariance}
noise = 0.1
samples = 100
region = {region}
"""


def seeds():
    """Yield sound models, of a deflection and of a set-point next to it."""
    for preset, name, order in (("vsa2", "elbow", 1), ("awas", "joint", 2), ("sea", "knee", 1)):
        size = 2 * order
        yield MODEL.format(
            preset=preset,
            joint=name,
            order=order,
            coefficients=[1.0] * size,
            covariance=[[1.0 if i == k else 0.0 for i in range(size)] for k in range(size)],
            region="[[-0.5], [0.5]]" if order == 1 else "[[-0.5, 0.1], [0.5, 0.1], [0.0, 0.4]]",
        ).encode()
