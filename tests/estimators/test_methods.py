"""The assembled estimators: folds that give the same numbers however the log is cut, and the papers' results."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from vsalog.binding.joint import bind, offered_roles
from vsalog.core.errors import EstimatorError, FilterError
from vsalog.core.trace import Trace
from vsalog.estimation.summary import Summarizer
from vsalog.estimators.device import device_of
from vsalog.estimators.registry import method
from vsalog.estimators.tuning import read_tuning
from vsalog.rig.schema import AntagonisticJoint, LinearTransmission
from vsalog.simulation.experiments import awas_experiment, elastic_experiment, vsa2_experiment

pytestmark = pytest.mark.share(3)


def signals_of(experiment):
    ((label, joint),) = experiment.rig.joint.items()
    return bind([experiment.recording()], label, joint, tuple(offered_roles(joint)))


def assemble(experiment, name, signals=None, joint=None, **tune):
    signals = signals_of(experiment) if signals is None else signals
    ((label, own),) = experiment.rig.joint.items()
    joint = own if joint is None else joint
    module = method(name)
    tuning = read_tuning(module.TUNING, name, {k: str(v) for k, v in tune.items()})
    return module.build(device_of(label, joint, signals.roles), signals, tuning), signals


def trace_of(fold, signals, size=10**9):
    state = fold.start()
    for last in reversed(range(fold.passes)):
        parts = []
        for block in signals.blocks(size):
            state, traces = fold.step(state, block)
            parts += traces
        state, traces = fold.finish(state)
        parts += traces
        if last:
            state = fold.freeze(state)
    return Trace.concatenate(parts), state


def with_gaps(signals):
    """The same signals with two gaps, one shorter than any filter's window before it, and a few missing samples."""
    keep = np.ones(len(signals), dtype=bool)
    keep[300:400] = False
    keep[1500:1600] = False
    starts = signals.starts[keep].copy()
    starts[[300, 1400]] = True
    roles = {r: v[keep].copy() for r, v in signals.roles.items()}
    for values in roles.values():
        values[800:803] = np.nan
    return replace(
        signals,
        stamps=signals.stamps[keep],
        time=signals.time[keep],
        roles=roles,
        starts=starts,
        run=signals.run[keep],
    )


CASES = [
    ("residual-rls", {"modality": "RESIDUAL"}),
    ("residual-rls", {"modality": "SENSOR", "matched": False}),
    ("residual-rls", {"modality": "MODEL", "c": 1.0, "p0": 1e3}),
    ("residual-rls", {"filter": "pair", "window": 0.2, "degree": 6}),
    ("residual-rls", {"filter": "savitzky-golay", "window": 0.2, "degree": 6}),
    ("qr-rls", {"window": 0.2, "degree": 6}),
    ("qr-rls", {"filter": "kinematic", "forgetting": 0.99}),
    ("qr-rls", {"filter": "savitzky-golay", "window": 0.2, "degree": 6}),
    ("batch-ls", {"window": 0.2, "degree": 6}),
    ("smoother", {"window": 0.02}),
    ("algebraic", {}),
    ("algebraic", {"filter": "kinematic", "span": 0.05}),
    ("impedance", {}),
    ("impedance", {"derivative": "difference", "alpha": 50.0}),
    ("direct", {}),
    ("direct", {"solver": "qr", "filter": "kinematic", "forgetting": 0.999}),
]


@pytest.fixture(scope="module")
def short():
    return {
        "vsa2": vsa2_experiment(duration=1.8),
        "awas": awas_experiment(duration=2.5),
    }


@pytest.mark.every(3)
@pytest.mark.parametrize("device", ["vsa2", "awas"])
@pytest.mark.parametrize(("name", "tune"), CASES)
def test_blocks_of_any_size_give_the_same_bits_as_the_whole(short, device, name, tune):
    experiment = short[device]
    gappy = with_gaps(signals_of(experiment))
    fold, signals = assemble(experiment, name, gappy, **tune)
    whole, state = trace_of(fold, signals)
    np.testing.assert_array_equal(whole.stamps, signals.stamps)
    for size in (1, 7, 1000) if device == "vsa2" else (7, 1000):
        cut, cut_state = trace_of(fold, signals, size)
        np.testing.assert_array_equal(cut.stamps, whole.stamps)
        for transmission, columns in whole.transmissions.items():
            for column, values in columns.items():
                np.testing.assert_array_equal(
                    cut[transmission][column], values, err_msg=f"{size} {transmission} {column}"
                )
        a, b = fold.model(state), fold.model(cut_state)
        assert [t.coefficients for t in a.transmission] == [t.coefficients for t in b.transmission] or np.isnan(
            a.transmission[0].coefficients
        ).any()


@pytest.mark.parametrize("rate", [100, 200, 1000])
def test_the_default_has_no_bias_at_any_rate(rate):
    """A causal velocity lags by a share of a sample, which at 100 Hz costs a tenth of the stiffness; the default must not."""
    experiment = elastic_experiment(transmission=LinearTransmission(stiffness=50.0), period=1.0 / rate)
    fold, signals = assemble(experiment, "residual-rls")
    trace, _ = trace_of(fold, signals)
    late = (trace.time > 10.0) & trace["1"]["excited"]
    assert np.mean(trace["1"]["stiffness"][late]) == pytest.approx(50.0, rel=2e-3)


@pytest.mark.parametrize("kind", ["savitzky-golay", "pair"])
def test_the_lag_of_the_residual_is_not_called_a_misfit(kind):
    """A fast motion whose law is met exactly leaves nothing over, though the residual comes late."""
    experiment = elastic_experiment(transmission=LinearTransmission(stiffness=50.0), duration=10.0)
    fold, signals = assemble(experiment, "residual-rls", filter=kind, bandwidth=30.0)
    trace, _ = trace_of(fold, signals)
    summarizer = Summarizer(fold.device)
    summarizer.add(trace)
    (part, total) = summarizer.result(signals).transmissions
    late = trace.time > 5.0
    lag = np.nanstd((trace["1"]["flexibility_torque_fit"] - trace["1"]["residual"])[late])
    assert lag > 0.03 * np.nanstd(trace["1"]["residual"][late])
    assert part.fit_share < 0.01
    assert total.fit_share == pytest.approx(part.fit_share)


def test_missing_samples_are_masked_not_invented():
    experiment = elastic_experiment(duration=10.0)
    signals = signals_of(experiment)
    gone = (signals.time > 5.0) & (signals.time < 5.5)
    roles = {r: v.copy() for r, v in signals.roles.items()}
    roles["link_position"][gone] = np.nan
    for tune in ({}, {"filter": "kinematic"}, {"filter": "pair"}):
        fold, holed = assemble(experiment, "residual-rls", replace(signals, roles=roles), **tune)
        trace, _ = trace_of(fold, holed)
        assert np.isnan(trace["1"]["deflection"][gone]).all()
        assert np.isnan(trace["1"]["stiffness"][gone]).all()
        assert not trace["1"]["excited"][gone].any()


def test_the_pair_of_filters_claims_no_torque_for_a_row_it_does_not_belong_to():
    fold, signals = assemble(elastic_experiment(duration=5.0), "qr-rls", filter="pair", window=0.2)
    trace, _ = trace_of(fold, signals)
    assert np.isnan(trace["1"]["flexibility_torque"]).all()
    assert np.isfinite(trace["1"]["stiffness"][-1])


@pytest.mark.parametrize("kind", ["savitzky-golay", "pair", "kinematic"])
def test_a_set_point_that_stands_still_supports_the_estimate(kind):
    """What a filter rounds off it is no other set-point."""
    experiment = awas_experiment(duration=5.0)
    signals = signals_of(experiment)
    phi = signals.roles["link_position"] - signals.roles["motor_position"]
    still = {**signals.roles, "torque_sensor": 30.0 * phi, "setpoint": np.full(len(signals), 0.033)}
    ((_, joint),) = experiment.rig.joint.items()
    joint = msgspec.structs.replace(joint, basis=msgspec.structs.replace(joint.basis, order=1, setpoint_order=1))
    fold, signals = assemble(experiment, "direct", replace(signals, roles=still), joint, filter=kind)
    trace, state = trace_of(fold, signals)
    deflection = trace["1"]["deflection"]
    reached = slice(fold.conditioner.settle + fold.delay, 2000)
    again = (deflection >= deflection[reached].min()) & (deflection <= deflection[reached].max())
    again[:2000] = False
    assert again.sum() > 1000
    assert trace["1"]["excited"][again].all()
    (model,) = fold.model(state).transmission
    assert len(model.region) == 2


def test_loading_is_reported_afresh_after_a_gap():
    """Whichever way the joint went before the gap says nothing of where it goes after it."""
    time = np.arange(2000) * 1e-3
    experiment = elastic_experiment(duration=2.0)
    ((_, joint),) = experiment.rig.joint.items()
    joint = msgspec.structs.replace(joint, basis=msgspec.structs.replace(joint.basis, branches=True))
    # Up and up before the gap; after it, from further down, up again: a fold that remembers would call it unloading.
    phi = np.where(time < 1.0, 0.1 + 0.3 * time, 0.1 + 0.3 * (time - 1.0))
    signals = signals_of(experiment)[:2000]
    roles = {**signals.roles, "deflection": phi, "torque_sensor": 10.0 * phi}
    starts = signals.starts.copy()
    starts[1000] = True
    signals = replace(signals, roles={r: roles[r] for r in ("deflection", "torque_sensor")}, starts=starts)
    fold, _ = assemble(experiment, "direct", signals, joint, filter="kinematic", settle=0.0)
    state = fold.start()
    told = []
    for piece in signals.blocks(50):
        filters, ready = fold.conditioner.step(state.filters, piece)
        told += [fold._with_branches(state, block).loading_now["1"] for block in ready]
        state.filters = filters
    assert np.concatenate(told).all()


@pytest.mark.parametrize("device", ["vsa2", "awas"])
def test_branches_are_reported_alike_in_blocks(short, device):
    experiment = short[device]
    ((_, joint),) = experiment.rig.joint.items()
    joint = msgspec.structs.replace(joint, basis=msgspec.structs.replace(joint.basis, branches=True))
    fold, signals = assemble(experiment, "direct", joint=joint)
    whole, _ = trace_of(fold, signals)
    cut, _ = trace_of(fold, signals, 7)
    np.testing.assert_array_equal(cut["total"]["stiffness"], whole["total"]["stiffness"])


def test_qr_rls_on_ideal_signals():
    """Flacco 2014 §V: a drifting spring and a motor that is not as its data sheet says; printed 0.002 % after 2 s."""
    experiment = vsa2_experiment(ideal=True, drift=0.5e-6, inertia=7.5e-3, damping=0.9e-3)
    fold, signals = assemble(experiment, "qr-rls", forgetting=0.98, window=0.02, degree=6)
    trace, _ = trace_of(fold, signals)
    after = trace.time >= 2.0
    for i in ("1", "2"):
        sigma = experiment.truth[f"stiffness_{i}"]
        error = (trace[i]["stiffness"] - sigma)[after] / sigma[after]
        assert 100.0 * np.mean(error**2) <= 0.002
        assert trace[i]["motor_inertia"][-1] == pytest.approx(7.5e-3, rel=1e-3)
        assert trace[i]["motor_damping"][-1] == pytest.approx(0.9e-3, rel=1e-3)


def test_the_residual_method_suffers_from_a_wrong_data_sheet_and_qr_rls_does_not():
    """The point of Flacco 2014 (Table I): printed 0.07 % for the residual method, 0.002 % for QR-RLS."""
    experiment = vsa2_experiment(ideal=True, drift=0.5e-6, inertia=7.5e-3, damping=0.9e-3)
    sigma, msrep = experiment.truth["stiffness_1"], {}
    for name, tune in (
        ("residual-rls", {"p0": 1e6, "c": 1e-5}),
        ("qr-rls", {"forgetting": 0.98, "window": 0.02, "degree": 6}),
    ):
        fold, signals = assemble(experiment, name, **tune)
        trace, _ = trace_of(fold, signals)
        after = trace.time >= 2.0
        msrep[name] = 100.0 * np.mean(((trace["1"]["stiffness"] - sigma)[after] / sigma[after]) ** 2)
    assert msrep["qr-rls"] < 0.1 * msrep["residual-rls"]
    assert msrep["residual-rls"] <= 0.07


def test_one_sensor_for_both_transmissions():
    """A joint torque sensor sees the sum; with both deflections moving apart it tells the two stiffnesses all the same."""
    experiment = vsa2_experiment(duration=20.0)
    ((_, joint),) = experiment.rig.joint.items()
    assert isinstance(joint, AntagonisticJoint)
    signals = signals_of(experiment)
    roles = {r: v for r, v in signals.roles.items() if not r.startswith("torque_sensor")}
    roles["torque_sensor"] = signals.roles["torque_sensor_1"] + signals.roles["torque_sensor_2"]
    fold, signals = assemble(experiment, "direct", replace(signals, roles=roles))
    trace, _ = trace_of(fold, signals)
    after = trace.time >= 5.0
    sigma = experiment.truth["stiffness_total"]
    error, std = (trace["total"]["stiffness"] - sigma)[after], trace["total"]["stiffness_std"][after]
    assert np.sqrt(np.mean((error / sigma[after]) ** 2)) < 0.05
    assert np.mean(np.abs(error) < 3.0 * std) > 0.8
    fed, fit = trace["total"]["flexibility_torque"], trace["total"]["flexibility_torque_fit"]
    learnt = after & np.isfinite(fed)  # nothing is fed in the last half window
    assert learnt.sum() == after.sum() - 10
    np.testing.assert_allclose(fit[learnt], fed[learnt], atol=5e-3)


@pytest.mark.parametrize("make", [vsa2_experiment, awas_experiment, elastic_experiment])
@pytest.mark.parametrize("modality", ["SENSOR", "RESIDUAL"])
def test_the_uncertainty_is_honest(make, modality):
    """Over several noises, the truth is within two standard deviations most of the time, and these are not boundless."""
    within, share = [], []
    for seed in range(1, 5):
        experiment = make(seed=seed, duration=10.0)
        fold, signals = assemble(experiment, "residual-rls", modality=modality)
        trace, _ = trace_of(fold, signals)
        sigma = experiment.truth.get("stiffness_total", experiment.truth.get("stiffness"))
        rows = (trace.time >= 3.0) & trace["total"]["excited"]
        assert rows.any()
        error, std = trace["total"]["stiffness"][rows] - sigma[rows], trace["total"]["stiffness_std"][rows]
        within.append(np.mean(np.abs(error) <= 2.0 * std))
        share.append(np.sqrt(np.mean(std**2) / np.mean(error**2)))
    assert np.mean(within) > 0.7
    assert np.median(share) < 20.0


def test_nothing_is_supported_before_anything_was_learnt_and_what_is_early_is_true():
    experiment = vsa2_experiment(duration=3.0)
    fold, signals = assemble(experiment, "qr-rls")
    trace, _ = trace_of(fold, signals)
    for name in ("1", "2"):
        columns, early = trace[name], trace[name]["excited"] & (trace.time < 1.5)
        assert not columns["excited"][: fold.conditioner.window // 2 + 256].any()
        off = np.abs(columns["stiffness"] - experiment.truth[f"stiffness_{name}"])
        assert early.any()
        assert (off < 4.0 * columns["stiffness_std"])[early].all()


def test_unknown_estimators_and_tuning_are_refused_with_a_hint():
    with pytest.raises(EstimatorError, match="did you mean 'qr-rls'"):
        method("qr-rsl")
    module = method("direct")
    with pytest.raises(EstimatorError, match="did you mean 'forgetting'"):
        read_tuning(module.TUNING, "direct", {"forgeting": "0.9"})
    with pytest.raises(EstimatorError, match="forgetting"):
        read_tuning(module.TUNING, "direct", {"forgetting": "1.2"})


def test_a_run_shorter_than_the_window_is_refused():
    fold, signals = assemble(vsa2_experiment(duration=0.5), "qr-rls", window=1.0)
    with pytest.raises(FilterError, match="needs 1001"):
        fold.conditioner.check_length(len(signals))
