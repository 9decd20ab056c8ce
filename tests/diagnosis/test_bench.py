"""Springs that are turned while both ends are held: their loops, against curves that are written out here."""

import numpy as np
import pytest
from restated import recorded

from vsalog.diagnosis.run import Options, diagnose

pytestmark = pytest.mark.share(3)

BENCH = """
[joint.spring]
kind = "elastic"
[joint.spring.transmission]
type = "linear"
stiffness = 40.0
[joint.spring.signals]
deflection = "deflection"
torque_sensor = "torque sensor"
"""
PERIOD = 2e-3
TORQUE, WIDTH, DRY = 0.4, 0.03, 0.25
TRAVEL = 1e-4  # [rad], over which dry friction turns


def wound(phi, width):
    """Towards ±1 over the way that is gone: the closed form of ż = (φ̇ − |φ̇| z) / w on one way."""
    z = np.zeros(phi.size)
    for k in range(1, phi.size):
        way = phi[k] - phi[k - 1]
        z[k] = np.sign(way) + (z[k - 1] - np.sign(way)) * np.exp(-abs(way) / width)
    return z


def turned(seconds, seed, loop, dry):
    """Sines of three amplitudes; the torque of a spring, an exponential loop and dry friction, with noise."""
    time = np.arange(0.0, seconds, PERIOD)
    amplitude = np.interp(time, [0.0, seconds / 2, seconds], [0.1, 0.3, 0.18])
    phi = amplitude * np.sin(2 * np.pi * 0.35 * time + seed)
    torque = 40.0 * phi + loop * wound(phi, WIDTH) + dry * wound(phi, TRAVEL)
    rng = np.random.default_rng(seed)
    roles = {
        "deflection": phi + 2e-6 * rng.standard_normal(time.size),
        "torque_sensor": torque + 0.02 * rng.standard_normal(time.size),
    }
    return time, roles


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("loop", "dry", "expected"),
    [
        (TORQUE, 0.0, {"torque": TORQUE, "width": WIDTH}),
        (0.0, DRY, {"torque": DRY}),
        (TORQUE, DRY, {"torque": TORQUE, "width": WIDTH, "slip_limit": DRY}),
    ],
    ids=["loop", "dry friction", "both"],
)
def test_loops_and_dry_friction_are_separated_with_their_sizes(tmp_path, loop, dry, expected):
    recorded(tmp_path, *turned(20.0, 0, loop, dry), BENCH)
    recorded(tmp_path, *turned(20.0, 1, loop, dry), BENCH, name="held")
    document = diagnose(tmp_path / "log.csv", tmp_path / "held.csv", Options()).diagnosis
    assert document.verdict == "explained"
    (cause,) = [c for c in document.causes if c.material]
    assert cause.cause == "transmission.hysteresis"
    assert ("slip_limit" in cause.parameters) == ("slip_limit" in expected)
    for name, value in expected.items():
        number = cause.parameters[name]
        assert abs(number.value - value) < max(4.0 * number.std, 0.02 * value), name
    (signal,) = document.gain.signals
    assert signal.rmse_after < 0.3 * signal.rmse_before


STIFFNESS, GAIN = "transmission.stiffness", "sensor.torque_gain"


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("spring", "sensor", "expected"),
    [("10 %", "0.1 %", STIFFNESS), ("30 %", "0.1 %", STIFFNESS), ("0.1 %", "10 %", GAIN), ("0 %", "1 %", GAIN)],
)
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_of_causes_that_a_bench_cannot_tell_the_wider_tolerance_is_believed(tmp_path, spring, sensor, expected):
    """A torque that is 8 % larger than the spring makes it: the spring or the sensor, not what is known exactly."""
    rig = BENCH.replace("stiffness = 40.0", f'stiffness = "40 N*m/rad ± {spring}"').replace(
        '"torque sensor"', f'{{ channel = "torque sensor", gain = "1 ± {sensor}" }}'
    )
    time, roles = turned(20.0, 0, 0.0, 0.0)
    recorded(tmp_path, time, {**roles, "torque_sensor": 1.08 * roles["torque_sensor"]}, rig)
    document = diagnose(tmp_path / "log.csv", None, Options()).diagnosis
    (cause,) = [c for c in document.causes if c.material]
    assert cause.cause == expected
    assert next(iter(cause.parameters.values())).value == pytest.approx(1.08, rel=1e-3)
