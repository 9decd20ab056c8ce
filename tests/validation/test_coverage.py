"""The interval of a validation holds the true value as often as it says, over simulated second experiments."""

import numpy as np
import pytest
from msgspec.structs import replace

from vsalog.binding.joint import bind
from vsalog.core.model import ModelFile
from vsalog.estimators.device import device_of
from vsalog.rig import Rig
from vsalog.rig.schema import CubicTransmission
from vsalog.simulation import simulate
from vsalog.simulation.inputs import multisine
from vsalog.validation.joint import judge, prepare

pytestmark = pytest.mark.share(3)

ROLES = ("motor_position", "link_position", "torque_sensor")


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("spring", "count"),
    [(None, 60), (CubicTransmission(stiffness=24.0, cubic=1500.0), 20)],
    ids=["right model", "another spring"],
)
def test_many_second_experiments(spring, count, models):
    """Other inputs and other noise each time; the mean square error of all is the true one of each."""
    model = ModelFile.load(models["sea"]).joint["sea"]
    rig = Rig.preset("sea").file
    joint = rig.joint["sea"]
    played = joint if spring is None else replace(joint, transmission=spring)
    scores, device = [], device_of("sea", joint)
    for seed in range(count):
        torque = multisine(1.2, np.arange(1, 16) * 0.1, seed=seed)
        machine = replace(rig, joint={"sea": played})
        experiment = simulate(machine, {"sea": {"motor_torque": torque}}, 10.0, period=2e-3, seed=seed)
        recording = experiment.recording()
        signals = bind([recording], "sea", joint, ROLES)
        part = judge(model, joint, device, prepare(device, signals), recording.channels).transmissions[0]
        scores.append(next(c.inside for c in part.comparisons if c.reference == "sensor"))
    mse = np.mean([s.mse.value for s in scores])
    hits = [s.nrmse.low <= 100.0 * np.sqrt(mse) / s.span <= s.nrmse.high for s in scores]
    assert np.mean(hits) >= 0.90
    if spring is None:
        assert np.mean(hits) <= 0.98
    # A wrong spring's error follows the motion, and these motions all have the same size: their errors differ less from one
    # another than blocks of one of them do, and the interval is wider than it would have to be.
