"""Reported visibility of an effect: none without one, the noise as predicted, and what each effect adds, in closed form."""

import numpy as np
import pytest
from scipy.ndimage import minimum_filter1d
from scipy.signal import oaconvolve

from tests.hidden_effects import motion
from tests.hidden_effects.alike import difference, fits_equally
from tests.hidden_effects.bench import Bench, Hidden
from tests.hidden_effects.cases import VARIANTS
from tests.hidden_effects.effects import EFFECTS, scales_of
from tests.hidden_effects.equations import Windows, left_over
from tests.hidden_effects.machines import DEVICES, GRAVITY, Sensors, random_machine
from tests.hidden_effects.sensors import Quality, ideal, random_qualities, recorded


def bench_of(device, seed=3, period=1e-3, missing=()):
    rng = np.random.default_rng(seed)
    machine = random_machine(device, rng)
    follow = motion.wanted(machine, 8.0, period, rng)
    truth = motion.happened(machine, follow)
    qualities = random_qualities(machine, truth, rng)
    return Bench(machine, follow, truth, qualities, scales_of(machine, truth), missing)


@pytest.fixture(scope="module")
def benches():
    return {device: bench_of(device) for device in DEVICES}


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("roles", VARIANTS)
def test_without_an_effect_nothing_is_left_over_but_the_noise(benches, device, roles):
    bench, missing = benches[device], VARIANTS[roles]
    said = {r: v for r, v in ideal(bench.truth, Sensors(), bench.nominal).items() if r not in missing}
    inside = slice(bench.truth.inside.start + 50, bench.truth.inside.stop - 50)
    for name, part in left_over(bench.nominal, said, bench.qualities, inside, 1e-3).items():
        assert part.ratio < 0.1, name
    # Rounding errors of an encoder that moves slowly are no white noise: the prediction is compared with white noise.
    white = {r: Quality(q.deviation, 0.0) for r, q in bench.qualities.items()}
    ratios = {}
    for seed in range(6):
        noisy = recorded(bench.truth, Sensors(), bench.nominal, white, np.random.default_rng(seed))
        noisy = {r: v for r, v in noisy.items() if r not in missing}
        for name, part in left_over(bench.nominal, noisy, bench.qualities, slice(50, -50), 1e-3).items():
            ratios.setdefault(name, []).append(part.ratio)
    for name, found in ratios.items():
        assert rms(np.array(found)) == pytest.approx(1.0, rel=0.05), name


def averaged(bench, effect_torque, changed):
    """Average a torque that is known at samples, as the equations are."""
    return oaconvolve(effect_torque, Windows.of(bench.truth.period).value, mode="same")[changed.inside]


# A seed whose elastic joint hangs in the vertical plane, behind a hardening spring.
HANGING = next(
    seed for seed in range(100)
    if (m := random_machine("elastic", np.random.default_rng(seed))).link[0]["gravity"] and m.springs[0]["k3"]
)  # fmt: skip


def bare(machine, phi):
    return machine.springs[0]["k1"] * phi + machine.springs[0]["k3"] * phi**3


# Effect → equation it enters, and what it adds there as a function of the true roles, their rates, time and its parameters.
CLOSED = {
    "motor.inertia": ("motor", lambda r, p, m: -(p["inertia"] - m.motors[0]["inertia"]) * r["ddtheta"]),
    "motor.viscous_friction": ("motor", lambda r, p, m: -(p["damping"] - m.motors[0]["damping"]) * r["dtheta"]),
    "motor.torque_constant": ("motor", lambda r, p, m: (p["gain"] - 1.0) * r["command"]),
    "motor.torque_offset": ("motor", lambda r, p, m: p["torque"] + 0.0 * r["q"]),
    "motor.cogging": (
        "motor",
        lambda r, p, m: p["torque"] * np.sin(p["order"] * m.motors[0]["gear"] * r["theta"] + p["phase"]),
    ),
    "motor.coulomb_friction": ("motor", lambda r, p, m: -p["torque"] * np.sign(r["dtheta"])),
    "motor.load_dependent_friction": ("motor", lambda r, p, m: -p["share"] * abs(r["torque"]) * np.sign(r["dtheta"])),
    "transmission.stiffness": ("transmission", lambda r, p, m: (p["factor"] - 1.0) * r["spring"]),
    "transmission.nonlinearity": ("transmission", lambda r, p, m: p["cubic"] * r["phi"] ** 3),
    "transmission.asymmetry": ("transmission", lambda r, p, m: p["asymmetry"] * np.sign(r["phi"]) * r["spring"]),
    "transmission.damping": (
        "transmission",
        lambda r, p, m: (p["damping"] - m.springs[0]["damping"]) * r["dphi"],
    ),
    "transmission.stiffness_drift": ("transmission", lambda r, p, m: p["rate"] * r["time"] * r["spring"]),
    "link.inertia": ("link", lambda r, p, m: -(p["inertia"] - m.link[0]["inertia"]) * r["ddq"]),
    "link.gravity": (
        "link",
        lambda r, p, m: -(p["torque"] - m.link[0]["gravity"]) * np.sin(r["q"] - m.link[0]["hangs_at"]),
    ),
    "link.payload": (
        "link",
        lambda r, p, m: (
            -p["mass"] * p["distance"] * (p["distance"] * r["ddq"] + GRAVITY * np.sin(r["q"] - m.link[0]["hangs_at"]))
        ),
    ),
    "link.viscous_friction": ("link", lambda r, p, m: -(p["damping"] - m.link[0]["damping"]) * r["dq"]),
    "link.coulomb_friction": ("link", lambda r, p, m: -p["torque"] * np.sign(r["dq"])),
    "link.contact": (
        "link",
        lambda r, p, m: (
            p["torque"]
            * np.sin(np.pi * np.clip((r["time"] - p["start"]) / p["duration"], 0.0, 1.0)) ** 2
        ),
    ),
    "sensor.torque_gain": ("transmission", lambda r, p, m: (p["gain"] - 1.0) * r["torque"]),
    "sensor.torque_offset": ("link", lambda r, p, m: p["offset"] + 0.0 * r["q"]),
    "sensor.torque_drift": ("motor", lambda r, p, m: -p["rate"] * r["time"]),
    "sensor.encoder_offset": (
        "transmission",
        lambda r, p, m: r["spring"] - bare(m, r["phi"] - p["offset"]),
    ),
}  # fmt: skip


@pytest.mark.parametrize("cause", CLOSED)
def test_an_effect_adds_to_its_equation_what_its_formula_says(cause):
    bench = bench_of("elastic", HANGING)
    assert bench.nominal.link[0]["gravity"] > 0.0
    effect, part = EFFECTS[cause], EFFECTS[cause].parts(bench.nominal)[0]
    rng = np.random.default_rng(2)
    high = effect.bounds(bench.nominal, part, bench.scales)[1]
    one = Hidden(effect, part, effect.shape(rng, bench.nominal, part, bench.scales), 0.2 * high)
    machine, sensors = bench.changed([one])
    truth = motion.happened(machine, bench.follow)
    said = ideal(truth, sensors, bench.nominal)
    period, name = truth.period, CLOSED[cause][0]
    found = left_over(bench.nominal, said, bench.qualities, truth.inside, period)[name]
    r = {"q": truth.roles["link_position"], "theta": truth.roles["motor_position"], "time": truth.time}
    r |= {"torque": truth.roles["torque_sensor"], "command": truth.roles["motor_torque"]}
    r["phi"] = r["q"] - r["theta"]
    for x in ("q", "theta", "phi"):
        r[f"d{x}"] = np.gradient(r[x], period)
        r[f"dd{x}"] = np.gradient(r[f"d{x}"], period)
    r["spring"] = bare(bench.nominal, r["phi"])
    if cause == "motor.torque_constant":
        r["command"] = 0.5 * (r["command"] + np.roll(r["command"], 1))
    expected = averaged(bench, CLOSED[cause][1](r, one.parameters, bench.nominal), truth)
    counts = np.ones(expected.size, dtype=bool)
    if "coulomb" in cause or "load" in cause:
        # Bristles give way before they slip: the formula holds where a part has been sliding for a while.
        sliding = abs(r["dtheta" if name == "motor" else "dq"][truth.inside])
        counts = minimum_filter1d(sliding, 61) > 0.2 * np.std(sliding)
    assert np.mean(counts) > 0.5
    assert rms((found.values - expected)[counts]) < 0.03 * rms(expected)


def rms(values):
    return np.sqrt(np.mean(values**2))


@pytest.mark.parametrize("device", DEVICES)
def test_effects_are_made_as_visible_as_asked(benches, device):
    bench = benches[device]
    for cause in ("motor.coulomb_friction", "transmission.stiffness", "sensor.torque_gain", "link.viscous_friction"):
        effect, part = EFFECTS[cause], EFFECTS[cause].parts(bench.nominal)[0]
        one = Hidden(effect, part, effect.shape(np.random.default_rng(0), bench.nominal, part, bench.scales), 0.0)
        assert bench.scaled(one, 6.0, 1.0)
        most = effect.bounds(bench.nominal, part, bench.scales)[1]
        assert one.size == pytest.approx(6.0, rel=0.17) or (one.size < 6.0 and one.strength > 0.99 * most)
        assert bench.size([one]) == pytest.approx(one.size)


def test_without_gravity_one_encoders_offset_is_the_others(benches):
    bench = benches["serial"]
    effect = EFFECTS["sensor.encoder_offset"]
    one = Hidden(effect, "motor_position", {}, 0.0)
    assert bench.scaled(one, 10.0, 1.0)
    rng = np.random.default_rng(0)
    assert difference(one, bench, "sensor.encoder_offset", "link_position", rng) < 0.5
    assert difference(one, bench, "transmission.stiffness", "transmission", rng) > 3.0


def test_one_encoders_eccentricity_is_the_others_turned_by_half(benches):
    bench = benches["serial"]
    one = Hidden(EFFECTS["sensor.encoder_eccentricity"], "motor_position", {"phase": 0.7}, 0.0)
    assert bench.scaled(one, 5.0, 1.0)
    rng = np.random.default_rng(0)
    assert difference(one, bench, "sensor.encoder_eccentricity", "link_position", rng) < 1.0
    assert fits_equally(one, bench, "sensor.encoder_eccentricity", rng)
    assert not fits_equally(one, bench, "transmission.stiffness@transmission", rng)
    assert fits_equally(one, bench, "link.payload", rng) is None


def test_the_window_is_a_mean_and_its_derivatives_are():
    windows = Windows.of(1e-3)
    time = np.arange(-200, 200) * 1e-3
    for values, expected in (
        (3.0 + 0.0 * time, (3.0, 0.0, 0.0)),
        (2.0 * time, (None, 2.0, 0.0)),
        (0.5 * time**2, (None, None, 1.0)),
    ):
        for kernel, number in zip((windows.value, windows.rate, windows.curve), expected, strict=True):
            if number is not None:
                middle = oaconvolve(values, kernel, mode="same")[100:-100]
                np.testing.assert_allclose(middle, number, atol=1e-6)
