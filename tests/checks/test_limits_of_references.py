"""What an estimate is compared with: the rig's own spring, and averages of other sensors."""

from types import SimpleNamespace

import numpy as np
import pytest

from vsalog.checks.cross_check import CrossCheck
from vsalog.checks.nominal import NominalSpring
from vsalog.estimators.device import device_of
from vsalog.rig import Rig

ROLES = {role: np.zeros(2) for role in ("link_position", "motor_position", "torque_sensor")}
JOINT = Rig.from_toml("""
[joint.arm]
kind = "elastic"
[joint.arm.motor]
inertia = 0.1
[joint.arm.transmission]
type = "linear"
stiffness = 100.0
[joint.arm.signals]
link_position = "q"
motor_position = "theta"
torque_sensor = "tau"
""").joints["arm"]
DEVICE = device_of("arm", JOINT, ROLES)


@pytest.mark.parametrize(("ratio", "found"), [(2.5, False), (4.0, True), (0.4, False), (0.25, True)])
def test_a_stiffness_is_of_another_scale_where_ten_times_the_rig_s_is_nearer(ratio, found):
    watch = NominalSpring().start(SimpleNamespace(device=DEVICE, look=None, read=()))
    count, (view,) = 10, DEVICE.transmissions
    columns = {
        "deflection": np.linspace(-0.1, 0.1, count),
        "stiffness": np.full(count, 100.0 * ratio),
        "excited": np.ones(count, dtype=bool),
    }
    watch.add(SimpleNamespace(transmissions={view.name: columns}, time=np.arange(count) * 1e-3))
    assert [finding.code for finding in watch.findings()] == ["stiffness.scale"] * found


@pytest.mark.parametrize(
    ("ratio", "noise", "offset", "found"),
    [
        (2.5, 0.0, 0.0, False), (4.0, 0.0, 0.0, True), (0.4, 0.0, 0.0, False), (0.25, 0.0, 0.0, True),
        (0.25, 0.5, 0.0, True), (0.25, 2.0, 0.0, False), (1.0, 0.0, 30.0, False),
    ],
)  # fmt: skip
def test_a_torque_is_of_another_scale_where_ten_times_the_rig_s_is_nearer(ratio, noise, offset, found):
    """Unless noise, as of a position that is differentiated twice, is most of what is expected; a spring's zero is no scale.

    There are two logs, and the clock of the second begins earlier.
    """
    count, (view,) = 1000, DEVICE.transmissions
    phi = 0.1 * np.sin(np.arange(count) * 0.01)
    expected = 3.0 + 3.0 * np.sin(np.arange(count) * 0.017)
    recorded = ratio * expected
    blurred = expected + offset + noise * np.random.default_rng(1).normal(0.0, np.std(expected), count)
    rows = np.arange(count)
    run, stamps = (rows >= 600).astype(np.int32), np.where(rows < 600, rows + 5000, rows) * 1_000_000
    look = SimpleNamespace(stamps=stamps, run=run, roles={view.motor_torque: recorded}, period=1e-3)
    watch = NominalSpring().start(SimpleNamespace(device=DEVICE, look=look, read=(view.motor_torque,)))
    columns = {
        "deflection": phi,
        "flexibility_torque": 100.0 * phi + blurred - recorded,
        "stiffness": np.full(count, 100.0),
        "excited": np.zeros(count, dtype=bool),
    }
    for part in (slice(0, 300), slice(300, count)):
        block = {name: values[part] for name, values in columns.items()}
        watch.add(
            SimpleNamespace(
                transmissions={view.name: block}, stamps=stamps[part], run=run[part], time=1e-9 * stamps[part]
            )
        )
    assert [(f.code, f.part) for f in watch.findings()] == [("motor_torque.scale", view.motor_torque)] * found
    if found and not noise:
        assert [f.value for f in watch.findings()] == [pytest.approx(ratio)]


@pytest.mark.parametrize(("period", "samples"), [(1e-3, 50), (5e-4, 100)])
def test_a_twentieth_of_a_second_is_averaged(period, samples):
    """Longer than what a filter makes of a quick change."""
    assert CrossCheck((), DEVICE, JOINT, tuple(ROLES), period).box == samples
