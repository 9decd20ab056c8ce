"""Columns and options that promise nothing: deviations that nothing tells, deflections of two springs, tuning without effect."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run

pytestmark = pytest.mark.share(3)


def vsalog(*args, cwd):
    done = vsalog_run(*args, cwd=cwd)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Short logs of muscles and of a series elastic joint."""
    folder = tmp_path_factory.mktemp("honest")
    weight = ("--set", "joint.sea.link.gravity_torque=2.0")
    load = ("--set", "joint.sea.link.payload.mass=1.5", "--set", "joint.sea.link.payload.distance=0.2")
    for args in (
        ("pam", "--duration", "2 s", "-o", "pam.parquet"),
        ("sea", "--duration", "6 s", *weight, *load, "-o", "loaded.parquet"),
    ):
        code, _, err = vsalog("simulate", *args, cwd=folder)
        assert code == 0, err
    return folder


def test_a_model_alone_has_no_deviation_and_is_supported_by_nothing(folder):
    code, out, err = vsalog("estimate", "pam.parquet", "-e", "pam-model", "-o", "model.parquet", "--json", cwd=folder)
    assert code == 0, err
    table = pq.read_table(folder / "model.parquet")
    deviations = [name for name in table.column_names if name.endswith("_std")]
    assert {"stiffness_std", "flexibility_torque_std", "link_position_std"} <= set(deviations)
    for name in deviations:
        assert np.isnan(table[name].to_numpy(zero_copy_only=False).astype(float)).all(), name
    assert not any(table["excited"].to_pylist())
    assert json.loads(out)["joints"]


def test_two_springs_have_no_deflection_together(folder, samples):
    code, _, err = vsalog("estimate", samples / "vsa2_exp1.mcap", "-e", "impedance", "-o", "v.parquet", cwd=folder)
    assert code == 0, err
    table = pq.read_table(folder / "v.parquet")
    part = np.array(table["transmission"].to_pylist())
    deflection = table["deflection"].to_numpy(zero_copy_only=False).astype(float)
    assert np.isnan(deflection[part == "total"]).all()
    assert np.isfinite(deflection[part == "1"]).mean() > 0.9


def test_a_payload_s_weight_is_taken_off_the_link(folder):
    """The link's inertia is that of both, 0.2² · 1.5 more than the rig's link alone; its weight does not bend it."""
    code, _, err = vsalog("estimate", "loaded.parquet", "-e", "impedance", "-o", "i.parquet", cwd=folder)
    assert code == 0, err
    table = pq.read_table(folder / "i.parquet")
    found = table["link_inertia"].to_numpy(zero_copy_only=False).astype(float)
    truth = 0.05 + 1.5 * 0.2**2
    assert np.nanmedian(found[-1000:]) == pytest.approx(truth, rel=0.02)


@pytest.mark.parametrize(
    ("method", "name"),
    [("impedance", "settle"), ("impedance", "shape"), ("grioli-bicchi", "memory"), ("grioli-parametric", "settle")],
)
def test_what_has_no_effect_cannot_be_tuned(folder, samples, method, name):
    code, _, err = vsalog("estimate", samples / "sea_exp1.csv", "-e", method, "--tune", f"{name}=1", cwd=folder)
    assert code == 2
    assert f"nothing to tune named '{name}'" in err


def test_a_refused_name_of_the_automatic_choice_says_which_estimator_has_it(folder):
    code, _, err = vsalog("estimate", "loaded.parquet", "--tune", "modality=SENSOR", cwd=folder)
    assert code == 2
    assert "--estimator residual-rls --tune modality=SENSOR" in err
    code, _, err = vsalog("estimate", "loaded.parquet", "--tune", "no_such_name=1", cwd=folder)
    assert code == 2
    assert "smoother has nothing to tune named 'no_such_name'" in err


@pytest.mark.parametrize("estimator", ["smoother", "direct", "impedance"])
def test_missing_samples_leave_nearly_all_of_a_log(folder, estimator):
    rng, table = np.random.default_rng(6), pq.read_table(folder / "loaded.parquet")
    for i, name in enumerate(table.column_names):
        if name == "stamp":
            continue
        values = table[name].to_numpy(zero_copy_only=False).astype(float)
        for first in rng.choice(values.size - 5, values.size // 500, replace=False):
            values[first : first + 5] = np.nan
        values[rng.random(values.size) < 0.03] = np.nan
        table = table.set_column(i, table.schema.field(i), pa.array(values, from_pandas=True))
    pq.write_table(table, folder / "lacking.parquet")
    found = {}
    for log in ("loaded", "lacking"):
        trace = folder / f"{log}_{estimator}.parquet"
        code, _, err = vsalog("estimate", f"{log}.parquet", "-e", estimator, "-o", trace, cwd=folder)
        assert code == 0, err
        rows = pq.read_table(trace).to_pandas()
        found[log] = rows[rows.transmission != "total"]
    whole, lacking = found["loaded"], found["lacking"]
    assert lacking.excited.mean() > 0.9 * whole.excited.mean() > 0.3
    both = whole.excited.to_numpy() & lacking.excited.to_numpy()
    error = np.abs(lacking.stiffness.to_numpy() - whole.stiffness.to_numpy())[both]
    assert np.mean(error < 1.96 * lacking.stiffness_std.to_numpy()[both]) > 0.9


@pytest.mark.parametrize("estimator", ["residual-rls", "direct", "algebraic", "grioli-parametric", "qr-rls"])
def test_nothing_is_reported_before_anything_is_learnt(folder, estimator):
    code, _, err = vsalog("estimate", "loaded.parquet", "-e", estimator, "-o", f"{estimator}.parquet", cwd=folder)
    assert code == 0, err
    table = pq.read_table(folder / f"{estimator}.parquet").to_pandas()
    table = table[table.transmission != "total"]
    first = int(np.argmax(np.isfinite(table.stiffness)))
    assert 0 < first < 200
    assert table.stiffness[:first].isna().all()
    assert np.abs(table.stiffness[first:]).min() > 0.0
    assert not table.excited[: first + 1].any()


def test_a_model_without_a_spring_is_not_validated_and_a_window_longer_than_the_log_is_named(folder):
    code, _, err = vsalog("estimate", "loaded.parquet", "-e", "grioli-bicchi", "-o", "followed.parquet", cwd=folder)
    assert code == 0, err
    code, _, err = vsalog("validate", "followed.model.toml", "loaded.parquet", cwd=folder)
    assert code == 2
    assert "grioli-bicchi follows the stiffness" in err
    code, _, err = vsalog("estimate", "loaded.parquet", "-e", "impedance", "--tune", "window=100", cwd=folder)
    assert code == 2
    assert "filter needs" in err
