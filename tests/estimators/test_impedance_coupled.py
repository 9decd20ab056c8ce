"""The coupled observers: the loop against one in matrices, and a joint integrated here, which it finds or says it does not."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from command_line import vsalog_run
from scipy.integrate import solve_ivp

from vsalog.cli import cli
from vsalog.filters.coupled_observer import CoupledNoise, coupled_start, observe_coupled

T, COUNT = 1e-3, 8_000
INERTIA, DAMPING, STIFFNESS = 0.03, 0.2, 60.0

RIG = f"""[joint.arm]
kind = "elastic"
link = {{ inertia = {2 * INERTIA}, damping = 0.1, gravity_torque = 0.4 }}
[joint.arm.signals]
link_position = "q"
motor_position = "theta"
external_torque = "push"
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A linear spring, 8 s at 1 kHz, whose link hangs and is pushed at three frequencies. The rig's link is twice too heavy."""
    rng, t = np.random.default_rng(1), np.arange(COUNT) * T

    def push(s):
        return 2.0 * np.sin(5.0 * s) + 2.0 * np.sin(13.0 * s) + 1.5 * np.sin(31.0 * s)

    def theta(s):
        return 0.25 * np.sin(7.0 * s) + 0.2 * np.sin(2.3 * s)

    def motion(s, y):
        acting = push(s) - STIFFNESS * (y[0] - theta(s)) - DAMPING * y[1] - 0.4 * np.sin(y[0])
        return [y[1], acting / INERTIA]

    q = solve_ivp(motion, (0.0, t[-1]), [0.0, 1.0], t_eval=t, rtol=1e-9, atol=1e-11).y[0]
    step = 2 * np.pi / 2**17
    columns = {
        "time": t,
        "q": np.round(q / step) * step,
        "theta": np.round(theta(t) / step) * step,
        "push": push(t) + 0.005 * rng.standard_normal(COUNT),
        "still": np.full(COUNT, 0.5),
    }
    path = tmp_path_factory.mktemp("coupled") / "arm.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


def estimated(log, folder, *tune, rig=RIG):
    (folder / "rig.toml").write_text(rig)
    options = ["--rig", str(folder / "rig.toml"), "-o", f"{folder}/", "--estimator", "impedance-coupled", "--json"]
    for value in tune:
        options += ["--tune", value]
    done = CliRunner().invoke(cli, ["estimate", str(log), *options])
    assert done.exit_code == 0, done.output
    table = pq.read_table(folder / "arm.stiffness.parquet")
    total = table.filter([name == "total" for name in table["transmission"].to_pylist()])
    names = (
        "stiffness",
        "stiffness_std",
        "excited",
        "link_inertia",
        "link_inertia_std",
        "link_damping",
        "link_damping_std",
    )
    return {n: np.array(total[n].to_pylist(), dtype=float) for n in names}, done.stdout


@pytest.mark.parametrize("tune", [(), ("derivative=difference",), (f"inertia={INERTIA / 2}", "damping=0.0")])
def test_stiffness_and_link_are_found_from_a_wrong_guess(log, tmp_path, tune):
    trace, said = estimated(log, tmp_path, *tune)
    late = trace["excited"].astype(bool) & (np.arange(COUNT) > COUNT // 2)
    assert late.sum() > 0.6 * COUNT / 2
    error, std = trace["stiffness"][late] - STIFFNESS, trace["stiffness_std"][late]
    assert np.median(np.abs(error)) < 0.05 * STIFFNESS
    assert np.mean(np.abs(error) < 2.0 * std) > 0.85
    for name, true in (("link_inertia", INERTIA), ("link_damping", DAMPING)):
        found, deviation = trace[name][late][-1], trace[f"{name}_std"][late][-1]
        assert abs(found - true) < 3.0 * deviation, name
    assert trace["link_inertia"][late][-1] == pytest.approx(INERTIA, rel=0.1)
    assert "link.guess_matters" not in said


PUSH = """
[joint.sea]
external_torque = [
  { type = "sine", amplitude = 3, frequency = 0.8 },
  { type = "sine", amplitude = 3, frequency = 2.1 },
  { type = "sine", amplitude = 2, frequency = 4.9 },
]
motor_position = [{ type = "sine", amplitude = 0.25, frequency = 1.1 }, { type = "sine", amplitude = 0.2, frequency = 0.37 }]
"""


def test_what_a_long_window_takes_of_a_high_derivative_is_doubted(tmp_path):
    """Coarse encoders ask for a window behind which less is left of q⃛ than of f, and I comes out too large."""
    (tmp_path / "push.toml").write_text(PUSH)
    coarse = [f"joint.sea.signals.{role}.resolution=2.4 deg" for role in ("link_position", "motor_position")]
    sets = ["joint.sea.transmission.cubic=0", "joint.sea.signals.external_torque=/push.data", *coarse]
    options = [x for change in sets for x in ("--set", change)]
    done = vsalog_run(
        "simulate", "sea", "--scenario", "push.toml", "--rate", "200", "--duration", "10 s", *options, "-o", "arm.mcap",
        cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    done = vsalog_run("estimate", "arm.mcap", "-e", "impedance-coupled", "-o", "t.parquet", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    table = pq.read_table(tmp_path / "t.parquet")
    told = np.array(table["excited"].to_pylist()) & (np.array(table["transmission"].to_pylist()) == "total")
    inertia, std = (
        np.array(table[name].to_pylist(), dtype=float)[told] for name in ("link_inertia", "link_inertia_std")
    )
    assert np.mean(np.abs(inertia - 0.05) < 1.96 * std) > 0.95
    stiffness, deviation = (
        np.array(table[name].to_pylist(), dtype=float)[told] for name in ("stiffness", "stiffness_std")
    )
    assert np.mean(np.abs(stiffness - 20.0) < 1.96 * deviation) > 0.95
    assert told.sum() > 500


def test_a_loop_that_depends_on_its_guess_says_so(log, tmp_path):
    """With a long memory each half believes the other for long."""
    trace, said = estimated(log, tmp_path, "alpha=2.0", "wander=0.0")
    assert "link.guess_matters" in [finding["code"] for finding in json.loads(said)["joints"][0]["findings"]]
    error = np.abs(trace["stiffness"] - STIFFNESS)[COUNT // 2 : -100]
    assert np.mean(error < 2.0 * trace["stiffness_std"][COUNT // 2 : -100]) > 0.9


@pytest.mark.parametrize(
    ("rig", "words"),
    [
        (RIG.replace('external_torque = "push"\n', ""), "the torque that pushes the link"),
        (RIG.replace('"push"', '"still"'), "never changes"),
        (RIG.replace("link = {", "# {"), "guess of the link's inertia"),
    ],
)
def test_what_cannot_be_is_refused_in_words(log, tmp_path, rig, words):
    (tmp_path / "rig.toml").write_text(rig)
    options = ["--rig", str(tmp_path / "rig.toml"), "-o", f"{tmp_path}/", "--estimator", "impedance-coupled"]
    refused = CliRunner().invoke(cli, ["estimate", str(log), *options])
    assert refused.exit_code != 0
    assert words in str(refused.exception) + refused.output
    assert not list(tmp_path.glob("*.parquet"))


def in_matrices(f, H, phi_dot, alpha, noise, guess):
    """Eq. 8 by the textbook's Kalman filter in Joseph's form, eq. 9 by the exact solution of dK̂/dt = α |φ̇| (Σ̇/φ̇ − K̂)."""
    x, P = np.array(guess), np.diag([noise.inertia, noise.damping]) ** 2
    Q = np.diag([(noise.wander * noise.inertia) ** 2, (noise.wander * noise.damping) ** 2]) * T
    total, weight, out = 0.0, 0.0, []
    for y, h, rate in zip(f, H, phi_dot, strict=True):
        P = P + Q
        if weight >= noise.filled:
            gain = P @ h / (h @ P @ h + noise.rate**2)
            x = x + gain * (y - total / weight * rate - h @ x)
            keep = np.eye(2) - np.outer(gain, h)
            P = keep @ P @ keep.T + np.outer(gain, gain) * noise.rate**2
        forget = np.exp(-alpha * abs(rate) * T)
        total = forget * total + (1.0 - forget) * (y - h @ x) / rate
        weight = forget * weight + 1.0 - forget
        out.append([total / weight, *x, *np.sqrt(np.diag(P))])
    return np.array(out)


def test_the_loop_is_the_textbook_s():
    rng, t = np.random.default_rng(5), np.arange(3000) * T
    H = np.column_stack((400.0 * np.sin(11.0 * t), 30.0 * np.cos(5.0 * t)))
    rate = 2.0 * np.cos(7.0 * t) + 0.5 * np.sin(19.0 * t) + 1e-3
    f = H @ [INERTIA, DAMPING] + STIFFNESS * rate + rng.standard_normal(t.size)
    noise, guess, use = CoupledNoise(3.0, 0.05, 0.3, 0.2, 0.9), (0.05, 0.1), np.ones(t.size, dtype=bool)
    start = coupled_start(*guess, noise)
    stiffness, link, _ = observe_coupled(start, f, *H.T, rate, use, 40.0, T, noise)
    expected = in_matrices(f, H, rate, 40.0, noise, guess)
    np.testing.assert_allclose(stiffness[:, 0], expected[:, 0], rtol=1e-8)
    np.testing.assert_allclose(link, expected[:, 1:], rtol=1e-8)
    assert stiffness[-1, 0] == pytest.approx(STIFFNESS, rel=0.05)
    assert link[-1, 0] == pytest.approx(INERTIA, rel=0.05)
    # In blocks, and with samples that are not used, which leave all as it is.
    state, parts = start, []
    for first in range(0, t.size, 700):
        part = slice(first, first + 700)
        found, _, state = observe_coupled(state, f[part], *H[part].T, rate[part], use[part], 40.0, T, noise)
        parts.append(found)
    np.testing.assert_array_equal(np.concatenate(parts), stiffness)
    _, _, same = observe_coupled(state, f, *H.T, rate, ~use, 40.0, T, noise)
    for before, after in zip(state, same, strict=True):
        np.testing.assert_array_equal(before, after)
