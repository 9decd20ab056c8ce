"""Observers and filters that lose the machine report it, give no numbers meanwhile, and find it again."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import vsalog_run

from vsalog.rig.load import preset_text


def ran(*args, cwd):
    done = vsalog_run(*args, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


def one_accelerometer():
    """Return the arm of the preset with the accelerometer of its last link alone."""
    lines = preset_text("kuka-kr15").splitlines()
    mounted = [line for line in lines if line.startswith("accelerometer = ")]
    left_out = ("/accelerometer_axis1/", "/accelerometer_axis2/")
    return "\n".join(line for line in lines if line not in mounted[:2] and not any(name in line for name in left_out))


def test_an_arm_that_one_accelerometer_sees_in_part_does_not_run_away(tmp_path):
    """While it sees next to nothing of two axes these are lost, and make the third's acceleration wrong, and that them."""
    (tmp_path / "arm.toml").write_text(one_accelerometer())
    ran(
        "simulate",
        "arm.toml",
        "--scenario",
        "kuka-kr15-exp1",
        "--duration",
        "9",
        "--truth",
        "-o",
        "arm.parquet",
        cwd=tmp_path,
    )
    said = ran("estimate", "arm.parquet", "-e", "acceleration-observer", "-o", "states.parquet", "--json", cwd=tmp_path)
    assert "observer.diverged" in said
    table, truth = pq.read_table(tmp_path / "states.parquet"), pq.read_table(tmp_path / "arm.parquet")
    true_stamps = truth["stamp"].to_numpy()
    for joint in ("axis1", "axis2", "axis3"):
        own = table.filter(np.array([name == joint for name in table["joint"].to_pylist()]))
        rows = np.searchsorted(true_stamps, own["stamp"].to_numpy())
        q, std = own["link_position"].to_numpy(), own["link_position_std"].to_numpy()
        off = np.abs(q - truth[f"/truth/{joint}/link_position.data"].to_numpy()[rows])
        told = np.isfinite(off)
        # It comes back after each stretch in which it is not seen.
        assert told.mean() > 0.3
        assert told[-1000:].any()
        assert off[told].max() < 0.05
        assert np.mean(off[told] > 3.0 * std[told]) < 0.02


VENTED = "\n".join(f'[[joint.pam.valve_{i}]]\ntype = "constant"\nvalue = "{{}} V"' for i in (1, 2))


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("volts", "told"), [((0.0, 0.0), False), ((1.5, 1.5), False), ((0.0, 10.0), False), ((4.0, 4.0), True)]
)
def test_vented_muscles_tell_no_angle(tmp_path, volts, told):
    (tmp_path / "vented.toml").write_text('duration = "3 s"\n' + VENTED.format(*volts))
    ran("simulate", "pam", "--scenario", "vented.toml", "--truth", "-o", "vented.parquet", cwd=tmp_path)
    (joint,) = json.loads(ran("estimate", "vented.parquet", "-o", "told.parquet", "--json", cwd=tmp_path))["joints"]
    table, truth = pq.read_table(tmp_path / "told.parquet"), pq.read_table(tmp_path / "vented.parquet")
    assert ("pressure.angle_unknown" in [finding["code"] for finding in joint["findings"]]) != told
    excited = table["excited"].to_numpy(zero_copy_only=False)
    if not told:
        assert not excited.any()
        assert np.isnan(table["link_position"].to_numpy()).mean() > 0.9
        return
    assert excited.mean() > 0.9
    (name,) = (n for n in truth.column_names if n.startswith("/truth/stiffness") and "isobaric" not in n)
    rows = np.searchsorted(truth["stamp"].to_numpy(), table["stamp"].to_numpy())
    off = np.abs(table["stiffness"].to_numpy() - truth[name].to_numpy()[rows])[excited]
    assert np.median(off) < 0.02 * np.median(truth[name].to_numpy())
