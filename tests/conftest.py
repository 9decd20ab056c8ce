"""What the tests share: where the sample logs are, and a way to run the command line as a user does."""

import os
from pathlib import Path

# Tests run side by side, one to a core: linear algebra with threads of its own would make them wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# pytest-xdist states a width to its workers, which a pipe has not.
os.environ.pop("COLUMNS", None)

import pytest
from command_line import vsalog_run
from hypothesis import settings

# The first call of a compiled loop takes as long as its compilation: no deadline would be fair to it.
settings.register_profile("vsalog", deadline=None, max_examples=50)
settings.load_profile("vsalog")

ROOT = Path(__file__).parent.parent

EVERY = {
    "tests/diagnosis/test_rigid.py::test_what_is_hidden_is_named_with_its_numbers_and_its_gain": 3,
    "tests/estimators/test_methods.py::test_blocks_of_any_size_give_the_same_bits_as_the_whole": 3,
    "tests/validation/test_validate.py::test_the_leading_finding_is_the_hidden_effect": 3,
    "tests/checks/test_residual_over_deflection.py::test_a_spring_that_it_can_follow_is_left_alone": 5,
    "tests/diagnosis/test_balance_pneumatic.py::test_each_cause_is_named_with_its_size": 3,
    "tests/diagnosis/test_units.py::test_what_is_found_beside_counts_is_told_in_the_joints_units": 3,
    "tests/diagnosis/test_selection.py::test_the_hidden_cause_is_found_alone_and_with_its_size": 3,
    "tests/diagnosis/test_common_causes.py::test_springs_that_are_both_stiffer_have_one_factor": 2,
    "tests/diagnosis/test_predicted.py::test_other_devices_that_lack_a_part_are_predicted_to_their_noise": 2,
    "tests/diagnosis/test_predicted.py::test_what_is_wrong_has_a_gain_on_the_held_out_log": 3,
    "tests/diagnosis/test_predicted.py::test_a_sound_log_is_predicted_to_its_noise": 3,
    "tests/diagnosis/test_unknown_spring.py::test_motor_and_link_tell_whose_the_torque_at_rest_is": 3,
    "tests/perturbations/test_prior.py::test_a_set_point_of_reversed_sign_is_told_and_with_what_is_advised_it_is_no_matter": 3,
    "tests/estimators/test_known_effects.py::test_an_extended_rig_is_estimated_as_well_as_a_plain_one": 2,
    "tests/estimators/test_known_effects.py::test_blocks_of_any_size_give_the_same_bits": 5,
    "tests/checks/test_residual_over_position.py::test_an_even_encoder_is_left_alone": 5,
    "tests/checks/test_cross_check.py::test_a_sound_log_agrees": 2,
    "tests/readers/test_window_index.py::test_little_more_is_read_than_asked_for": 5,
    "tests/readers/test_alternating.py::test_vibrations_and_pulses_as_fast_are_those_of_one": 3,
    "tests/checks/test_residual_over_deflection.py::test_what_the_basis_cannot_follow_is_found_with_its_size": 2,
    "tests/checks/test_residual_over_deflection.py::test_where_encoders_are_too_coarse_for_a_shape_that_is_a_finding": 2,
    "tests/validation/test_references_known.py::test_a_known_effect_costs_nothing_and_an_unknown_one_does": 2,
    "tests/validation/test_validate.py::test_a_hidden_effect_fails_and_is_named": 2,
    "tests/cli/test_refusals.py::test_magnitudes_that_cannot_be": 2,
    "tests/test_estimator_pages.py::test_the_example_does_what_it_says": 2,
    "tests/diagnosis/test_selection.py::test_nothing_is_found_in_a_clean_log": 2,
    "tests/diagnosis/test_balance_pneumatic.py::test_nothing_is_found_where_nothing_is_wrong": 2,
    "tests/diagnosis/test_bench.py::test_loops_and_dry_friction_are_told_apart_with_their_sizes": 3,
    "tests/diagnosis/test_trajectory.py::test_values_are_nearer_to_the_truth_and_as_sure_as_is_said": 3,
    "tests/checks/test_cross_check.py::test_a_motor_with_another_inertia_is_found": 2,
    "tests/checks/test_cross_check.py::test_a_link_with_another_inertia_is_found": 3,
    "tests/diagnosis/test_units.py::test_equations_and_noise_are_those_of_the_plain_rig": 3,
    "tests/cli/test_refusals.py::test_options_that_cannot_be": 2,
    "tests/perturbations/test_prior.py::test_a_lever_that_begins_elsewhere_is_no_matter": 3,
    "tests/cli/test_simulate.py::test_every_preset_plays_every_scenario_for_it": 2,
    "tests/checks/test_residual_over_position.py::test_a_link_encoder_that_errs_several_times_a_turn_is_found": 2,
    "tests/estimators/test_impedance.py::test_an_encoder_s_steps_are_no_motion_of_the_link": 2,
    "tests/diagnosis/test_selection.py::test_torques_that_are_held_and_such_that_are_not_are_told_apart_where_that_is_little": 3,
    "tests/readers/test_window_index.py::test_stamps_that_are_not_as_they_should_be": 3,
    "tests/checks/test_standstill.py::test_an_encoder_of_a_soft_spring_that_is_stuck_once": 2,
    "tests/checks/test_standstill.py::test_an_end_that_is_held_while_the_spring_gives_way": 2,
    "tests/hidden_effects/test_cases.py::test_the_log_and_the_nominal_rig_are_what_vsalog_reads": 2,
}
"""Tests of which `make test` runs every second to fifth case, to end in time on two slow cores; `make test ALL=1` runs all."""


def pytest_addoption(parser):
    parser.addoption("--all-cases", action="store_true", help="every case of every test")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--all-cases"):
        return
    seen: dict[str, int] = {}
    kept, left = [], []
    for item in items:
        name = item.nodeid.partition("[")[0]
        seen[name] = seen.get(name, -1) + 1
        (left if seen[name] % EVERY.get(name, 1) else kept).append(item)
    # Who asks for one case gets it.
    if len(kept) > len(EVERY):
        config.hook.pytest_deselected(items=left)
        items[:] = kept


@pytest.fixture(scope="session")
def samples() -> Path:
    return ROOT / "sample_logs"


@pytest.fixture
def run(tmp_path):
    """Run `vsalog ARGS` in an empty folder; returns the finished process with text output."""

    def run(*args, cwd=tmp_path):
        return vsalog_run(*args, cwd=cwd)

    return run


@pytest.fixture
def refused(run):
    """Run a command that must be refused: exit code 2, one line on stderr, nothing on stdout, no file left behind."""

    def refused(*args, cwd):
        before = set(cwd.rglob("*"))
        done = run(*args, cwd=cwd)
        assert done.returncode == 2, done.stderr
        assert "Traceback" not in done.stderr
        assert done.stdout == ""
        assert set(cwd.rglob("*")) == before
        return done.stderr

    return refused
