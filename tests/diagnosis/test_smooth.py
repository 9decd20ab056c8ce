"""Unknown functions next to the causes: found where the catalogue lacks an effect, over the right signal, and nowhere else."""

import numpy as np
import pytest
from click.testing import CliRunner
from written_out import Truth, channels, joint_of

from vsalog.cli import cli
from vsalog.diagnosis.linear import formed_of
from vsalog.diagnosis.run import Options, diagnose
from vsalog.diagnosis.selection import select
from vsalog.diagnosis.setting import setting_of
from vsalog.diagnosis.smooth import TERMS, SmoothSite
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.system import build_system

pytestmark = pytest.mark.share(3)


def selected(truth, seed=2):
    found = channels(truth, duration=10.0, seed=seed)
    system = build_system(joint_of(), found.thinned(), balance_for(joint_of()), 0.5 * found.period)
    return select(system, joint_of(), setting_of(joint_of(), system), frozenset(), {})


def functions(selection):
    return [(site, values) for site, values in selection.posterior.fit if isinstance(site, SmoothSite)]


def bump(a, _):
    """A motor torque that no cause has: it pulls at one place."""
    return 0.15 / (1.0 + (a / 0.2) ** 2)


def catching(a, da):
    """Friction that is stronger at one place."""
    return -0.15 * np.tanh(da / 0.02) / (1.0 + (a / 0.3) ** 2)


def jammed(q, dq):
    """The same of the link."""
    return -0.15 * np.tanh(dq / 0.02) / (1.0 + (q / 0.3) ** 2)


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("truth", "side", "variable", "rate"),
    [
        (Truth(at_motor=bump), "motor", "motor_position", ""),
        (Truth(at_motor=catching), "motor", "motor_position", "motor_velocity"),
        (Truth(at_link=jammed), "link", "link_position", "link_velocity"),
    ],
    ids=["bump", "catching", "jammed"],
)
def test_an_effect_that_the_catalogue_lacks_has_side_and_signal(truth, side, variable, rate):
    selection = selected(truth)
    sizes = {c.site.key: c.size for c in selection.choices}
    found = max((s for s, _ in functions(selection)), key=lambda s: sizes[s.key])
    assert (found.side, found.variable, found.rate) == (side, variable, rate)
    assert found.equation == side


def test_a_cause_of_the_catalogue_needs_no_unknown_function():
    """Coulomb friction, a stiffer spring and a heavier link: causes explain a log better than functions of its signals."""
    selection = selected(Truth(coulomb=0.05, stiffness=12.8, cubic=160.0, link_inertia=0.032))
    assert functions(selection) == []
    assert {c.site.cause for c in selection.choices if c.size >= 1.0} == {
        "motor.coulomb_friction", "transmission.stiffness", "link.inertia",
    }  # fmt: skip


def test_the_values_of_causes_stay_right_next_to_an_unknown_function():
    selection = selected(Truth(at_motor=bump, link_inertia=0.033))
    values = {site.cause: v for site, v in selection.posterior.fit}
    assert values["link.inertia"][0] == pytest.approx(0.033, rel=0.02)


def test_the_function_takes_away_most_of_what_is_wrong():
    """What the bump adds is many times the noise; a short series follows most of it."""
    selection = selected(Truth(at_motor=bump))
    system, fit = selection.system, selection.posterior.fit
    assert all(values.size == TERMS for _, values in functions(selection))
    without = [(s, v) for s, v in fit if not isinstance(s, SmoothSite)]
    left, before = (
        np.sum(system.white(formed_of(system, joint_of(), f)[0]) ** 2) / system.count for f in (fit, without)
    )
    assert left < 0.5 * before


def test_a_function_of_a_torque_does_not_take_its_noise_away(tmp_path):
    """A servo on a coarse encoder: its torque is all jitter, and a sound joint had five times its torque constant."""
    arguments = ["simulate", "sea", "--rate", "500", "--scenario", "servo", "-o", f"{tmp_path}/log.parquet"]
    assert CliRunner().invoke(cli, arguments).exit_code == 0
    assert diagnose(tmp_path / "log.parquet", None, Options()).diagnosis.verdict == "consistent"
