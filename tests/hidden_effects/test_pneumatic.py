"""The hidden pneumatic joint against scipy's integrator and closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.ndimage import minimum_filter1d

from tests.hidden_effects import _air, pneumatic
from tests.hidden_effects.bench import Bench, Hidden
from tests.hidden_effects.effects import EFFECTS
from tests.hidden_effects.machines import Sensors
from tests.hidden_effects.pneumatic_effects import scales_of
from tests.hidden_effects.sensors import Quality, ideal, random_qualities, recorded

PERIOD = 1e-3


@pytest.fixture(scope="module")
def bench():
    rng = np.random.default_rng(2)
    machine = pneumatic.random_machine("pneumatic", rng)
    follow = pneumatic.wanted(machine, 8.0, PERIOD, rng)
    truth = pneumatic.happened(machine, follow)
    return Bench(machine, follow, truth, random_qualities(machine, truth, rng), scales_of(machine, truth), ())


def test_steps_agree_with_scipy(bench):
    machine = bench.nominal.copy()
    machine.muscles["leak"] = 1e-9
    machine.seesaw["presliding"] = 1e-3  # so that scipy's steps need not be tiny
    voltages = np.ascontiguousarray(bench.follow.values[2000:2400, :, 0])
    x = np.array([0.02, 0.1, 0.4e6, 0.3e6, 0.3, 0.0])
    states, _ = _air.play(machine.air, machine.muscles, machine.seesaw, machine.maps, voltages, PERIOD, 2.5e-4, x)
    openings = np.zeros(2)

    def rate(_, x):
        out = np.zeros(_air.STATES)
        _air.rates(machine.air, machine.muscles, machine.seesaw, x, openings, out)
        return out

    for k in range(150):
        for i in range(2):
            openings[i] = np.interp(voltages[k, i], *machine.maps[i])
        x = solve_ivp(rate, (0.0, PERIOD), x, method="DOP853", rtol=1e-9, atol=1e-9).y[:, -1]
    assert np.max(np.abs(x - states[150]) / (np.ptp(states, axis=0) + 1e-9)) < 1e-4


def test_a_shut_muscle_keeps_p_v_to_the_index(bench):
    machine = bench.nominal.copy()
    machine.muscles["inflow"] = machine.muscles["outflow"] = 0.0
    x0 = np.array([0.1, 0.0, 0.4e6, 0.3e6, 0.0, 0.0])
    states, _ = _air.play(
        machine.air, machine.muscles, machine.seesaw, machine.maps, np.full((500, 2), 5.0), PERIOD, 2.5e-4, x0
    )
    travel = machine.seesaw[0]["radius"] * np.sin(states[:, 0])
    for i, sign in enumerate((-1.0, 1.0)):
        m = machine.muscles[i]
        length = m["length"] + sign * travel
        volume = (m["d1"] * length + m["d2"]) * length + m["d3"]
        kept = states[:, 2 + i] * volume ** machine.air[0]["volume_index"]
        assert np.ptp(volume) > 1e-7
        np.testing.assert_allclose(kept, kept[0], rtol=1e-6)


def test_a_choked_orifice_lets_through_what_the_book_says():
    air = np.zeros(1, _air.AIR)
    air[0] = (7e5, 1.013e5, 1.1, 0.45, 1.4, 287.0 * 293.0)
    # ṁ = A p √(k/(RT)) (2/(k+1))^((k+1)/(2(k−1))) of a choked nozzle.
    expected = 7e5 * np.sqrt(1.4 / (287.0 * 293.0)) * (2.0 / 2.4) ** (2.4 / 0.8)
    assert _air.flow(air[0], 7e5, 1.013e5) == pytest.approx(expected, rel=1e-9)
    assert _air.flow(air[0], 7e5, 3e5) == pytest.approx(expected, rel=1e-9)
    assert 0.0 < _air.flow(air[0], 7e5, 6.9e5) < 0.5 * expected
    assert _air.flow(air[0], 3e5, 7e5) == pytest.approx(-expected, rel=1e-9)


def test_without_an_effect_nothing_is_left_over_but_the_noise(bench):
    for name, part in pneumatic.left_over(
        bench.nominal, ideal(bench.truth, Sensors(), bench.nominal), bench.qualities, bench.truth.inside, PERIOD
    ).items():
        assert part.ratio < (0.1 if name == "seesaw" else 0.05), name
    white = {r: Quality(q.deviation, 0.0) for r, q in bench.qualities.items()}
    ratios = {}
    for seed in range(4):
        noisy = recorded(bench.truth, Sensors(), bench.nominal, white, np.random.default_rng(seed))
        found = pneumatic.left_over(bench.nominal, noisy, bench.qualities, slice(50, -50), PERIOD)
        for name, part in found.items():
            ratios.setdefault(name, []).append(part.ratio)
    for name, found in ratios.items():
        assert np.sqrt(np.mean(np.square(found))) == pytest.approx(1.0, rel=0.1 if name == "seesaw" else 0.05), name


@pytest.mark.parametrize(
    ("cause", "part", "equation", "formula"),
    [
        (
            "pneumatic.force_gain",
            "muscle_1",
            "transmission",
            lambda r, p, m: (p["gain"] - 1.0) * r["turning"] * r["f1"],
        ),
        (
            "pneumatic.pressure_offset",
            "pressure_2",
            "transmission",
            lambda r, p, m: p["offset"] * r["turning"] * r["v2"],
        ),
        ("sensor.torque_offset", "torque_sensor", "transmission", lambda r, p, m: p["offset"] + 0.0 * r["f1"]),
        (
            "pneumatic.leak",
            "muscle_1",
            "pressure_1",
            lambda r, p, m: -m.air[0]["inflow_index"] * m.air[0]["gas"] * p["area"] * r["out1"] / r["volume1"],
        ),
        (
            "pneumatic.orifice_area",
            "valve_1",
            "pressure_1",
            lambda r, p, m: (
                (p["scale"] - 1.0) * m.air[0]["inflow_index"] * m.air[0]["gas"] * r["valve1"] / r["volume1"]
            ),
        ),
    ],
)
def test_an_effect_adds_to_its_equation_what_its_formula_says(bench, cause, part, equation, formula):
    effect = EFFECTS[cause]
    high = effect.bounds(bench.nominal, part, bench.scales)[1]
    one = Hidden(effect, part, {}, 0.2 * high)
    machine, sensors = bench.changed([one])
    truth = pneumatic.happened(machine, bench.follow)
    found = pneumatic.left_over(
        bench.nominal, ideal(truth, sensors, bench.nominal), bench.qualities, truth.inside, PERIOD
    )[equation]
    air, m1, m2 = bench.nominal.air[0], *bench.nominal.muscles
    psi, p1 = truth.roles["link_position"], truth.roles["pressure_1"]
    travel = bench.nominal.seesaw[0]["radius"] * np.sin(psi)
    l1, l2 = m1["length"] - travel, m2["length"] + travel
    r = {"turning": bench.nominal.seesaw[0]["radius"] * np.cos(psi)}
    r["f1"] = (m1["pv1"] * l1 + m1["pv2"]) * p1 + m1["pw1"] * l1 + m1["pw2"]
    r["v2"] = m2["pv1"] * l2 + m2["pv2"]
    r["volume1"] = (m1["d1"] * l1 + m1["d2"]) * l1 + m1["d3"]
    r["out1"] = np.array([_air.flow(air, x, air["outside"]) for x in p1])
    alpha = np.interp(truth.roles["valve_1"], *bench.nominal.maps[0])
    r["valve1"] = np.array([_air.valve_flow(air, m1, a, x) for a, x in zip(alpha, p1, strict=True)])
    expected = formula(r, one.parameters, bench.nominal)
    smooth = np.convolve(expected, np.hanning(27)[1:-1] / np.hanning(27).sum(), mode="same")[truth.inside]
    assert np.sqrt(np.mean(smooth**2)) > 0.0
    assert np.sqrt(np.mean((found.values - smooth) ** 2)) < 0.03 * np.sqrt(np.mean(smooth**2))


def test_friction_holds_and_slips_at_its_level(bench):
    psi, torque = bench.truth.roles["link_position"], bench.truth.roles["torque_sensor"]
    p1, p2 = bench.truth.roles["pressure_1"], bench.truth.roles["pressure_2"]
    row, air = bench.nominal.seesaw[0], bench.nominal.air[0]
    rate = np.gradient(psi, PERIOD)
    rest = torque - row["return_stiffness"] * psi - row["inertia"] * np.gradient(rate, PERIOD) - row["viscous"] * rate
    travel = row["radius"] * np.sin(psi)
    m1, m2 = bench.nominal.muscles
    f1 = _pull(m1, p1, m1["length"] - travel)
    f2 = _pull(m2, p2, m2["length"] + travel)
    level = row["shaft_radius"] * row["shaft_coefficient"] * np.abs(f1 + f2 - row["mass"] * row["gravity"])
    level += row["muscle"] * ((p1 - air["outside"]) ** -2.0 + (p2 - air["outside"]) ** -2.0)
    assert np.max(np.abs(rest) / level) < 1.02
    sliding = minimum_filter1d(np.abs(rate), 41) > 0.05
    assert np.mean(sliding) > 0.1
    np.testing.assert_allclose((rest / level)[sliding], np.sign(rate)[sliding], atol=0.02)


def _pull(m, p, length):
    return (m["pv1"] * length + m["pv2"]) * p + m["pw1"] * length + m["pw2"]
