"""The methods of Grioli and Bicchi: on a joint integrated here, against SciPy's filter, least squares and closed forms."""

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from scipy.signal import savgol_filter

import vsalog
from vsalog.binding.joint import bind, offered_roles
from vsalog.cli import cli
from vsalog.core.trace import Trace
from vsalog.estimators.device import device_of
from vsalog.estimators.registry import method
from vsalog.estimators.torque_rates import RateNoise
from vsalog.estimators.transmission_torque import LoadFriction, TransmissionTorque, Weight
from vsalog.estimators.tuning import Tuning, read_tuning
from vsalog.estimators.windows import WINDOWS, noisy_rates, suitable_windows
from vsalog.filters.derivative_weights import derivative_weights
from vsalog.filters.derivatives import Derivatives
from vsalog.filters.savitzky_golay import savgol_weights
from vsalog.simulation.experiments import awas_experiment, vsa2_experiment

pytestmark = pytest.mark.share(2)

T, COUNT = 1e-3, 8_000
INERTIA, DAMPING, WEIGHT = 0.03, 0.05, 0.4  # of the link
B, D = 0.02, 0.1  # of the motor
OFFSET = 2.0  # of the torque sensor


def spring(phi):
    return 60.0 * phi + 1000.0 * phi**3


def stiffness(phi):
    return 60.0 + 3000.0 * phi**2


def push(t):
    return 2.0 * np.sin(9.0 * t) + np.sin(23.0 * t)


def moved(t):
    """θ and its first two derivatives: the motor is moved, and its torque follows from its equation of motion."""
    parts = ((0.25, 7.0), (0.2, 2.3))
    return tuple(
        sum(a * w**n * np.sin(w * t + n * np.pi / 2) for a, w in parts)
        for n in range(3)
    )  # fmt: skip


RIG = f"""[joint.arm]
kind = "elastic"
motor = {{ inertia = {B}, damping = {D} }}
link = {{ inertia = {INERTIA}, damping = {DAMPING}, gravity_torque = {WEIGHT} }}
basis = {{ order = 2 }}
[joint.arm.signals]
link_position = "q"
motor_position = "theta"
motor_torque = "tau"
torque_sensor = "sensor"
external_torque = "push"
"""


@pytest.fixture(scope="module")
def joint(tmp_path_factory):
    """A hardening spring between a motor that is moved and a link that hangs and is pushed; the sensor has an offset."""
    rng, t = np.random.default_rng(1), np.arange(COUNT) * T

    def motion(s, y):
        acting = push(s) - spring(y[0] - moved(s)[0]) - DAMPING * y[1] - WEIGHT * np.sin(y[0])
        return [y[1], acting / INERTIA]

    q = solve_ivp(motion, (0.0, t[-1]), [0.0, 3.0], t_eval=t, rtol=1e-9, atol=1e-11).y[0]
    theta, velocity, acceleration = moved(t)
    phi, step = q - theta, 2 * np.pi / 2**17
    recorded = {
        "time": t,
        "q": np.round(q / step) * step,
        "theta": np.round(theta / step) * step,
        "tau": B * acceleration + D * velocity - spring(phi) + 0.01 * rng.standard_normal(COUNT),
        "sensor": spring(phi) + OFFSET + 0.01 * rng.standard_normal(COUNT),
        "push": push(t) + 0.01 * rng.standard_normal(COUNT),
    }
    path = tmp_path_factory.mktemp("grioli") / "arm.csv"
    np.savetxt(path, np.column_stack(list(recorded.values())), delimiter=",", header=",".join(recorded), comments="")
    path.with_suffix(".rig.toml").write_text(RIG)
    return path, recorded, phi


def signals_of(joint):
    path, _, _ = joint
    spec = vsalog.Rig.load(path.with_suffix(".rig.toml")).joints["arm"]
    return spec, bind([vsalog.read(path)], "arm", spec, tuple(offered_roles(spec)))


def estimated(path, rig, folder, *options):
    (folder / "rig.toml").write_text(rig)
    done = CliRunner().invoke(
        cli, ["estimate", str(path), "--rig", str(folder / "rig.toml"), "-o", f"{folder}/", "--json", *options]
    )
    assert done.exit_code == 0, done.output
    table = pq.read_table(folder / "arm.stiffness.parquet").to_pydict()
    rows = [i for i, name in enumerate(table["transmission"]) if name == "total"]
    return {name: np.array([v[i] for i in rows], dtype=float) for name, v in table.items() if name in NUMBERS}, json.loads(
        done.stdout
    )  # fmt: skip


NUMBERS = ("stiffness", "stiffness_std", "excited", "deflection", "flexibility_torque")


@pytest.mark.parametrize("side", ["motor", "link"])
@pytest.mark.parametrize("derivative", ["filter", "difference"])
def test_the_stiffness_is_followed_without_a_torque_sensor(joint, tmp_path, side, derivative):
    path, _, phi = joint
    rig = RIG.replace('torque_sensor = "sensor"\n', "")
    tune = ("--tune", f"side={side}", "--tune", f"derivative={derivative}", "--tune", "alpha=10")
    trace, _ = estimated(path, rig, tmp_path, "--estimator", "grioli-bicchi", *tune)
    excited = trace["excited"].astype(bool)
    assert excited.mean() > 0.7
    error, true = (trace["stiffness"] - stiffness(phi))[excited], stiffness(phi)[excited]
    assert np.median(np.abs(error / true)) < 0.05
    assert np.mean(np.abs(error) < 2.0 * trace["stiffness_std"][excited]) > 0.75
    torque = trace["flexibility_torque"]
    known = np.isfinite(torque)
    assert np.std((torque - spring(phi))[known]) < 0.05 * np.std(spring(phi))


def test_the_motor_s_side_is_taken_where_it_is_known_and_the_link_s_else(joint, tmp_path):
    path, _, phi = joint
    for rig, said in (
        (RIG, False),
        (RIG.replace('motor_torque = "tau"\n', "").replace('external_torque = "push"\n', ""), True),
    ):
        trace, document = estimated(path, rig, tmp_path, "--estimator", "grioli-bicchi")
        assert ("external_torque.missing" in json.dumps(document)) == said
        late = trace["excited"].astype(bool)
        off = np.abs(trace["stiffness"] / stiffness(phi) - 1.0)[late]
        # A push that nobody recorded is taken for the spring's.
        assert not late.any() or (np.median(off) < 0.05) != said


def test_auto_takes_the_link_s_side_only_where_nothing_else_tells_a_torque(joint, tmp_path):
    path, _, _ = joint
    pushed = RIG.replace('motor_torque = "tau"\n', "").replace('torque_sensor = "sensor"\n', "")
    _, document = estimated(path, pushed, tmp_path)
    assert document["joints"][0]["estimator"] == "smoother"
    (tmp_path / "rig.toml").write_text(pushed.replace('external_torque = "push"\n', ""))
    refused = CliRunner().invoke(cli, ["estimate", str(path), "--rig", str(tmp_path / "rig.toml")])
    assert refused.exit_code != 0


def test_the_torque_and_its_rate_are_those_of_the_equation_of_motion():
    """θ = sin 3t, q = cos 2t and τ = sin 5t, with all derivatives by hand."""
    t = np.linspace(0.0, 2.0, 50)
    of = {
        "motor_position": np.stack([3.0**n * np.sin(3 * t + n * np.pi / 2) for n in range(4)]),
        "link_position": np.stack([2.0**n * np.cos(2 * t + n * np.pi / 2) for n in range(4)]),
        "motor_torque": np.stack([np.sin(5 * t), 5 * np.cos(5 * t)]),
        "way:motor_torque": np.sign(np.sin(t))[None],
        "doubt:motor_torque": np.where(t < 1.0, 0.0, 9.0)[None],
    }
    spec = next(iter(vsa2_experiment(duration=0.01).rig.joint.values()))
    view = replace(device_of("x", spec).transmissions[0], motor_position="motor_position", deflection="deflection")
    motor = TransmissionTorque(view, {"motor_position": (0.0, D, B), "motor_torque": (-1.0,)})
    torque = -9 * B * np.sin(3 * t) + 3 * D * np.cos(3 * t) - np.sin(5 * t)
    rate = -27 * B * np.cos(3 * t) - 9 * D * np.sin(3 * t) - 5 * np.cos(5 * t)
    np.testing.assert_allclose(motor.torque(of), torque, atol=1e-12)
    np.testing.assert_allclose(motor.rate(of), rate, atol=1e-12)
    np.testing.assert_allclose(motor.deflection(of, 1), -2 * np.sin(2 * t) - 3 * np.cos(3 * t), atol=1e-12)
    link = TransmissionTorque(view, {"link_position": (0.0, -DAMPING, -INERTIA)}, weight=Weight(WEIGHT, 0.1))
    weight = WEIGHT * np.sin(np.cos(2 * t) - 0.1)
    np.testing.assert_allclose(link.torque(of), 4 * INERTIA * np.cos(2 * t) + 2 * DAMPING * np.sin(2 * t) - weight)
    numeric = np.gradient(link.torque(of), t, edge_order=2)
    np.testing.assert_allclose(link.rate(of)[1:-1], numeric[1:-1], atol=5e-3)
    rubbing = replace(motor, friction=LoadFriction("way:motor_torque", "doubt:motor_torque", 0.3, 1.0))
    borne = rubbing.torque(of)
    np.testing.assert_allclose(borne, torque + 0.3 * np.abs(borne) * np.sign(np.sin(t)), atol=1e-12)
    assert np.isnan(rubbing.rate(of)[t >= 1.0]).all()
    assert np.isfinite(rubbing.rate(of)[t < 1.0]).all()


@pytest.mark.parametrize("difference", [None, T])
def test_the_noise_of_rates_is_what_white_noise_makes_of_them(joint, difference):
    _, signals = signals_of(joint)
    rng = np.random.default_rng(2)
    noise = {"motor_position": 1e-4, "motor_torque": 0.2, "link_position": 2e-4}
    signals = replace(signals, roles={r: s * rng.standard_normal(len(signals)) for r, s in noise.items()})
    spec, _ = signals_of(joint)
    borne = TransmissionTorque(
        device_of("arm", spec).transmissions[0], {"motor_position": (0.0, D, B), "motor_torque": (-1.0,)}
    )
    filters = Derivatives(borne.orders(signals.roles), T, 0.05, 5)
    part = filters.whole(signals)
    if difference is None:
        rates = [borne.rate(part.of), borne.deflection(part.of, 1)]
    else:
        rates = [np.diff(v) / T for v in borne.samples(part)]
    torque, deflection = (r[np.isfinite(r)] for r in rates)
    told = borne.rate_noise(signals, filters.weights, difference)
    assert told.torque == pytest.approx(np.var(torque), rel=0.2)
    assert told.deflection == pytest.approx(np.var(deflection), rel=0.2)
    assert told.shared == pytest.approx(np.mean(torque * deflection), rel=0.3)
    assert told.left(50.0) == pytest.approx(np.var(torque - 50.0 * deflection), rel=0.2)


def test_noise_bends_a_followed_stiffness_as_much_as_is_reported():
    """White noise on both rates of a swinging spring, some of it shared: the observer's average over many noises."""
    rng, n, K = np.random.default_rng(9), 200_000, 30.0
    rate = np.cos(np.arange(n) * 0.01)
    e, own = 0.3 * rng.standard_normal(n), rng.standard_normal(n)
    noise = RateNoise(1.0 + 20.0**2 * 0.09, 0.09, 20.0 * 0.09)
    rates = rate + e, K * rate + own + 20.0 * e
    # The observer's average over all of it: Σ sgn φ̇ Σ̇ / Σ |φ̇|.
    found = np.sum(np.sign(rates[0]) * rates[1]) / np.sum(np.abs(rates[0]))
    speed = np.sum(rates[0] ** 2) / np.sum(np.abs(rates[0]))
    told = float(noise.bias(np.array(K))) / speed**2
    assert abs(found - K) > 0.3
    assert 1.0 < told / abs(found - K) < 4.0


@pytest.mark.parametrize("highest", [1, 3])
def test_rates_are_scipy_s_and_no_window_reaches_over_a_gap(joint, highest):
    _, signals = signals_of(joint)
    signals = signals[:3000]
    starts = signals.starts.copy()
    starts[[1000, 1030]] = True  # a run shorter than the window between two others
    signals = replace(signals, starts=starts)
    filters = Derivatives({"link_position": highest, "motor_torque": 1}, T, 0.05, 5)
    whole = filters.whole(signals)
    np.testing.assert_array_equal(whole.rows.stamps, signals.stamps)
    for role, order in (("link_position", highest), ("motor_torque", 1)):
        for n in range(order + 1):
            found = whole.of[role][n]
            for first, last in ((0, 1000), (1030, 3000)):
                x = signals.roles[role][first:last]
                expected = (
                    savgol_filter(x, 51, 5, deriv=n, delta=T)[25:-25]
                    if highest == 1
                    else np.correlate(x, derivative_weights(51, 5, highest, T)[n], "valid")
                )
                np.testing.assert_allclose(
                    found[first + 25 : last - 25], expected, rtol=1e-6, atol=1e-6 * np.ptp(expected)
                )
                assert np.isnan(found[first : first + 25]).all()
                assert np.isnan(found[last - 25 : last]).all()
            assert np.isnan(found[1000:1030]).all()


def assembled(name, spec, signals, **tune):
    module = method(name)
    tuning = read_tuning(module.TUNING, name, {k: str(v) for k, v in tune.items()})
    return module.build(device_of(signals.joint, spec, signals.roles), signals, tuning)


def run_in(fold, signals, size):
    state, parts = fold.start(), []
    for block in signals.blocks(size):
        state, traces = fold.step(state, block)
        parts += traces
    state, traces = fold.finish(state)
    return Trace.concatenate(parts + traces), state


def test_the_parameters_are_those_of_least_squares_and_an_offset_has_no_part_in_them(joint):
    """Σ̇ = k₁ dφ/dt + k₃ dφ³/dt, the rates by SciPy."""
    spec, signals = signals_of(joint)
    fold = assembled("grioli-parametric", spec, signals, window=0.05)
    trace, state = run_in(fold, signals, 10**9)
    (found,) = fold.model(state).transmission
    filtered = [
        savgol_filter(joint[1][n], 51, 5, deriv=d, delta=T)[25:-25] for n in ("q", "theta", "sensor") for d in (0, 1)
    ]
    phi, rate = filtered[0] - filtered[2], filtered[1] - filtered[3]
    scale = fold.device.basis.deflection_scale
    F = np.column_stack((rate / scale, 3.0 * phi**2 * rate / scale**3))
    expected, *_ = np.linalg.lstsq(F, filtered[5], rcond=None)
    np.testing.assert_allclose(found.coefficients, expected, rtol=2e-4)  # the prior's share
    np.testing.assert_allclose(np.array(found.coefficients) / scale ** np.array([1, 3]), [60.0, 1000.0], rtol=0.03)
    more = {**signals.roles, "torque_sensor": signals.roles["torque_sensor"] + 50.0}
    moved_up = replace(signals, roles=more)
    shifted, _ = run_in(assembled("grioli-parametric", spec, moved_up, window=0.05), moved_up, 10**9)
    np.testing.assert_allclose(shifted["1"]["stiffness"][100:], trace["1"]["stiffness"][100:], rtol=1e-4)
    excited = np.asarray(trace["1"]["excited"], bool)
    error = (trace["1"]["stiffness"] - stiffness(joint[2]))[excited]
    assert np.mean(np.abs(error) < 2.0 * trace["1"]["stiffness_std"][excited]) > 0.9
    assert np.median(np.abs(error)) < 1.0


def test_its_model_can_be_validated(joint, tmp_path, monkeypatch):
    """The model stands in the file like any other's; against the offset's own sensor its torque is off by the offset."""
    path, _, _ = joint
    monkeypatch.chdir(tmp_path)
    estimated(path, RIG, tmp_path, "--estimator", "grioli-parametric")
    model = vsalog.ModelFile.load(tmp_path / "arm.model.toml").joint["arm"]
    sigma, std = model.stiffness("1", np.array([0.0, 0.05]))
    assert np.all(np.abs(sigma - stiffness(np.array([0.0, 0.05]))) < 3.0 * std)
    done = CliRunner().invoke(cli, ["validate", str(tmp_path / "arm.model.toml"), str(path), "--json"])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize("experiment", [vsa2_experiment, awas_experiment])
@pytest.mark.parametrize("name", ["grioli-bicchi", "grioli-parametric"])
def test_blocks_of_any_size_give_the_same_bits(experiment, name):
    played = experiment(duration=1.5)
    ((label, spec),) = played.rig.joint.items()
    signals = bind([played.recording()], label, spec, tuple(offered_roles(spec)))
    starts = signals.starts.copy()
    starts[[600, 630]] = True
    roles = {r: v.copy() for r, v in signals.roles.items()}
    for values in roles.values():
        values[900:903] = np.nan
    signals = replace(signals, starts=starts, roles=roles)
    for tune in ({}, {"derivative": "difference", "alpha": 50.0} if name == "grioli-bicchi" else {"filter": "pair"}):
        fold = assembled(name, spec, signals, **tune)
        whole, _ = run_in(fold, signals, 10**9)
        np.testing.assert_array_equal(whole.stamps, signals.stamps)
        for size in (7, 1000):
            cut, _ = run_in(fold, signals, size)
            for part, columns in whole.transmissions.items():
                for column, values in columns.items():
                    np.testing.assert_array_equal(cut[part][column], values, err_msg=f"{size} {part} {column}")


def test_a_coarse_encoder_gets_a_longer_window_and_noise_is_reported(joint):
    spec, signals = signals_of(joint)
    device = device_of("arm", spec, signals.roles)
    weights = savgol_weights(WINDOWS[0], 5, 1, T)
    assert suitable_windows(device, signals, Tuning())[0] == WINDOWS[0]
    assert noisy_rates(device, signals, weights) == []
    rng = np.random.default_rng(0)
    coarse = {**signals.roles, "link_position": signals.roles["link_position"] + 2e-3 * rng.standard_normal(COUNT)}
    noisy = replace(signals, roles=coarse)
    assert suitable_windows(device, noisy, Tuning())[0] > WINDOWS[0]
    assert [finding.code for finding in noisy_rates(device, noisy, weights)] == ["filter.noisy_rate"]
    assert suitable_windows(device, noisy, Tuning(window=0.03)) == [31]


@pytest.mark.parametrize(
    ("estimator", "tune", "rig", "words"),
    [
        ("grioli-bicchi", ("--tune", "side=motor"), RIG.replace(f"inertia = {B}, ", ""), "motor's inertia"),
        ("grioli-bicchi", ("--tune", "side=link"), RIG.replace("link = {", "# {"), "link's inertia"),
        ("grioli-bicchi", ("--tune", "degree=2"), RIG, "degree"),
        ("grioli-bicchi", ("--tune", "filter=pair"), RIG, "filter"),
        ("grioli-parametric", ("--tune", "filter=kinematic"), RIG, "filter=pair"),
        ("grioli-parametric", (), RIG.replace("order = 2", "order = 2, branches = true"), "branches"),
        ("grioli-parametric", (), RIG.replace('torque_sensor = "sensor"\n', ""), "torque_sensor"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_words(joint, tmp_path, estimator, tune, rig, words):
    (tmp_path / "rig.toml").write_text(rig)
    options = ["--rig", str(tmp_path / "rig.toml"), "-o", f"{tmp_path}/", "--estimator", estimator, *tune]
    refused = CliRunner().invoke(cli, ["estimate", str(joint[0]), *options])
    assert refused.exit_code != 0
    assert words in str(refused.exception) + refused.output
    assert not list(tmp_path.glob("*.parquet"))


@pytest.mark.parametrize("name", ["grioli-bicchi", "impedance"])
def test_a_log_with_nothing_but_torn_windows_is_no_crash(tmp_path, run, samples, name):
    """A sample in a hundred is missing at random from every channel, independently: hardly a window is whole."""
    header, *lines = (samples / "sea_exp1.csv").read_text().splitlines()
    rng, rows = np.random.default_rng(0), [line.split(",") for line in lines]
    for row in rows:
        for i in range(1, len(row)):
            if rng.random() < 0.08:
                row[i] = "nan"
    (tmp_path / "log.csv").write_text("\n".join([header, *map(",".join, rows)]) + "\n")
    done = run("estimate", "log.csv", "--rig", samples / "sea_exp1.rig.toml", "-e", name)
    assert done.returncode in (0, 2)
    assert "bug" not in done.stderr
    assert "RuntimeWarning" not in done.stderr


@pytest.mark.parametrize("name", ["grioli-bicchi", "impedance"])
def test_a_log_of_a_single_window_is_no_crash(tmp_path, run, name):
    """51 samples."""
    made = run(
        "simulate", "vsa2", "--scenario", "multisine", "--rate", "1000", "--duration", "0.05", "-o", "short.mcap"
    )
    assert made.returncode == 0, made.stderr
    done = run("estimate", "short.mcap", "-e", name)
    assert "bug" not in done.stderr
    assert "RuntimeWarning" not in done.stderr
