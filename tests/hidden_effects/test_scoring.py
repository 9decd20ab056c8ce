"""The scorer against diagnoses written by hand."""

import pytest

from tests.hidden_effects.alike import ALIKE, split
from tests.hidden_effects.effects import EFFECTS
from tests.hidden_effects.report import by_device, confusion, document, markdown, summary
from tests.hidden_effects.scoring import score


def truth(*effects, case="single-0001", roles="full", outside=None):
    return {
        "case": case, "device": "elastic", "roles": roles, "seed": 1, "effects": list(effects), "outside": outside, "noise": {},
    }  # fmt: skip


def effect(cause="motor.coulomb_friction", part="motor", size=20.0, nominal=None, alike=None, **parameters):
    return {
        "cause": cause, "part": part, "parameters": parameters, "nominal": nominal or {}, "size": size, "alike": alike or {},
    }  # fmt: skip


def cause(name="motor.coulomb_friction", part="motor", others=(), **parameters):
    told = {k: {"value": v, "std": s, "unit": ""} for k, (v, s) in parameters.items()}
    return {"cause": name, "part": part, "parameters": told, "indistinguishable_from": list(others)}


def diagnosis(*causes, verdict="explained", **more):
    return {"verdict": verdict, "causes": list(causes), "simulation_error": [], **more}


def line(outcomes, words):
    found = [x for x in summary(outcomes) if words in x.what]
    assert len(found) == 1, words
    return found[0]


def test_the_right_name_at_the_right_part_is_right():
    outcome = score(truth(effect(torque=2.0)), diagnosis(cause(torque=(2.1, 0.06))))
    assert outcome.first
    assert outcome.right == [True]
    assert outcome.extra == 0
    estimate = outcome.estimates[0]
    assert estimate.covered
    assert estimate.error == pytest.approx(0.05)
    assert estimate.of_change == pytest.approx(0.05)


def test_the_right_name_at_another_part_is_not():
    outcome = score(truth(effect()), diagnosis(cause(part="secondary_motor")))
    assert not outcome.first
    assert outcome.cause_only
    assert outcome.extra == 1
    assert outcome.estimates == []


def test_what_is_named_second_is_named_but_not_first():
    outcome = score(truth(effect()), diagnosis(cause("link.inertia", "link"), cause()))
    assert not outcome.first
    assert outcome.right == [True]
    assert outcome.extra == 1


def test_an_interval_that_misses_is_counted():
    outcome = score(truth(effect(torque=2.0)), diagnosis(cause(torque=(2.2, 0.1))))
    assert not outcome.estimates[0].covered
    outcome = score(truth(effect(torque=2.0)), diagnosis(cause()))
    assert not outcome.estimates[0].covered
    assert outcome.estimates[0].error == float("inf")


def test_errors_of_a_changed_value_are_shown_next_to_the_change_too():
    hidden = effect("motor.inertia", inertia=1.1, nominal={"inertia": 1.0})
    estimate = score(truth(hidden), diagnosis(cause("motor.inertia", inertia=(1.12, 0.02)))).estimates[0]
    assert estimate.error == pytest.approx(0.02 / 1.1)
    assert estimate.of_change == pytest.approx(0.2)


@pytest.mark.parametrize(("torque", "phase"), [(0.5, 3.1 - 6.28318530718), (-0.5, 3.1 - 3.14159265359)])
def test_a_wave_may_be_told_with_either_sign(torque, phase):
    hidden = effect("motor.cogging", torque=0.5, order=4.0, phase=3.1)
    named = cause("motor.cogging", torque=(torque, 0.01), order=(4.0, 0.001), phase=(phase, 0.01))
    found = score(truth(hidden), diagnosis(named)).estimates
    assert all(e.covered for e in found)
    assert max(e.error for e in found) < 1e-6


def test_equal_physics_is_right_only_where_the_case_says_it_is_equal():
    named = diagnosis(cause("sensor.encoder_offset", "motor_position"))
    for difference, right in ((0.0, True), (0.3, True), (2.0, False)):
        alike = {"sensor.encoder_offset@motor_position": difference}
        hidden = effect("sensor.encoder_offset", "link_position", alike=alike, offset=0.01)
        assert score(truth(hidden), named).first == right


@pytest.mark.parametrize(("static", "right"), [(2.1, True), (3.0, False)])
def test_a_flat_stribeck_curve_is_coulomb_friction(static, right):
    named = cause("motor.stribeck_friction", torque=(2.0, 0.1), static=(static, 0.1), velocity=(0.1, 0.05))
    assert score(truth(effect(torque=2.0)), diagnosis(named)).first == right


def test_two_effects_need_two_names():
    pair = truth(effect(), effect("link.inertia", "link"), case="pair-0001")
    both = score(pair, diagnosis(cause("link.inertia", "link"), cause()))
    one = score(pair, diagnosis(cause("link.inertia", "link")))
    assert both.right == [True, True]
    assert both.first
    assert one.right == [False, True]
    assert line([both, one], "both named").value == 0.5


@pytest.mark.parametrize("member", ["motor.inertia", "motor.inertia@motor", "motor.inertia (motor)"])
def test_a_set_holds_its_members_however_they_are_written(member):
    hidden = truth(effect("motor.inertia", "motor"), case="reduced-0001", roles="no-torque-sensor")
    outcome = score(hidden, diagnosis(cause("motor.torque_constant", others=[member, "link.gravity"])))
    assert outcome.in_set
    assert not outcome.first
    assert outcome.set_size == 2
    assert split(member)[0] == "motor.inertia"
    assert not score(hidden, diagnosis(cause("link.gravity", "link", others=["motor.inertia@motor_2"]))).in_set


def test_a_false_alarm_is_one_on_a_clean_log_only():
    quiet = score(truth(case="clean-0001"), diagnosis(verdict="consistent"))
    loud = score(truth(case="clean-0002"), diagnosis(cause()))
    assert line([quiet, loud], "clean log: anything named").value == 0.5
    assert line([quiet, loud], "clean log: anything named").met is False


def test_a_command_that_failed_counts_against_every_number():
    outcomes = [
        score(truth(effect()), None, problem="failed: bug"),
        score(truth(effect(), case="pair-0001"), None, problem="failed: bug"),
        score(truth(case="clean-0001"), None, problem="failed: bug"),
    ]
    assert line(outcomes, "one effect, at 5 times").value == 0.0
    assert line(outcomes, "both named").value == 0.0
    assert line(outcomes, "anything named").value == 1.0
    assert line(outcomes, "command failed").value == 1.0


def test_faint_effects_are_counted_apart():
    outcomes = [score(truth(effect(size=4.0)), diagnosis(cause())), score(truth(effect(size=9.0)), diagnosis())]
    assert line(outcomes, "at 5 times the noise or more: named").value == 0.0
    assert line(outcomes, "below 5 times").value == 1.0


def test_the_gain_is_the_error_that_is_left_over_the_floor():
    gain = {"holdout": True, "signals": [
        {"joint": "knee", "signal": "link_position", "rmse_before": 4.0, "rmse_after": 1.1},
        {"joint": "knee", "signal": "torque_sensor", "rmse_before": 8.0, "rmse_after": 2.6},
    ]}  # fmt: skip
    errors = [
        {"joint": "knee", "signal": "link_position", "noise_floor": 1.0},
        {"joint": "knee", "signal": "torque_sensor", "noise_floor": 2.0},
    ]
    named = diagnosis(cause(), gain=gain) | {"simulation_error": errors}
    outcome = score(truth(effect()), named)
    assert outcome.gains == pytest.approx([1.1, 1.3])
    assert not outcome.worse
    for signal in gain["signals"]:
        signal["rmse_before"] = 1.0
    assert score(truth(effect()), named).worse
    assert line([outcome], "held-out error over the noise floor").value == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("verdict", "where", "depends_on", "good", "confident"),
    [
        ("unexplained", "motor", ["motor_position"], True, False),
        ("partly explained", "motor", ["time", "motor_position"], True, False),
        ("partly explained", "link", ["motor_position"], False, False),
        ("unexplained", "motor", ["link_velocity"], False, False),
        ("explained", None, [], False, True),
    ],
)
def test_what_is_outside_the_catalogue_has_to_stay_unexplained(verdict, where, depends_on, good, confident):
    outside = {"what": "magnetic detent", "side": "motor", "depends_on": ["motor_position"], "size": 20.0}
    named = diagnosis(verdict=verdict, unexplained={"fraction": 0.5, "where": where, "depends_on": depends_on})
    outcome = score(truth(case="outside-0001", outside=outside), named)
    assert all(outcome.outside[k] for k in ("unexplained", "side", "variable")) == good
    assert line([outcome], "explained by a wrong name").value == float(confident)
    assert line([outcome], "outside the catalogue").value == float(good)


def test_the_confusion_tells_a_wrong_part_from_a_wrong_name():
    outcomes = [
        score(truth(effect()), diagnosis(cause())),
        score(truth(effect()), diagnosis(cause(part="motor_2"))),
        score(truth(effect()), diagnosis(cause("link.inertia", "link"))),
        score(truth(effect()), diagnosis()),
        score(truth(case="clean-1"), diagnosis()),
    ]
    table = confusion(outcomes)
    assert dict(table["motor.coulomb_friction"]) == {
        "motor.coulomb_friction": 1, "motor.coulomb_friction elsewhere": 1, "link.inertia": 1, "(nothing)": 1,
    }  # fmt: skip
    assert table["(nothing)"]["(nothing)"] == 1
    text = markdown(outcomes, 7, "0.1")
    assert "Seed 7" in text
    assert "| motor.coulomb_friction | 1/4 |" in text
    assert "| elastic | 1/4 |" in by_device(outcomes)
    assert len(document(outcomes, 7, "0.1")["cases"]) == 5


def test_numbers_of_nothing_are_none():
    for x in summary([]):
        assert x.value is None
        assert x.met is None


def test_the_table_of_equal_physics_names_causes_that_can_be_hidden():
    for pair in ALIKE:
        assert pair.truth in EFFECTS
        assert pair.named in EFFECTS
        assert pair.reason
