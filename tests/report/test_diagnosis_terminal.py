"""What `vsalog diagnose` says: everything that was found, at any width, and nothing that acts on a terminal."""

import json
import re

import msgspec
import pytest
from diagnosis_evidence import diagnosis, found_cause, position_gain, remainder
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from vsalog.core.finding import Finding
from vsalog.core.finding_texts import sentence
from vsalog.core.notation import share_text, with_interval
from vsalog.diagnosis.document import Gains, Number
from vsalog.figures.dot_plots import reduction_text
from vsalog.report.diagnose import diagnosis_document
from vsalog.report.diagnosis_sentences import confidence_text, parameter_text, unexplained_words
from vsalog.report.html import page_of
from vsalog.report.terminal import print_data, print_document

NO_EXPERIMENT = Finding(code="diagnosis.no_experiment", severity="info", evidence={"reason": "Beware of x"})


FILES = {"report": "diagnosis.html", "data": "diagnosis.json"}


def printed(told, capsys, monkeypatch, columns=160, files=None):
    monkeypatch.setenv("COLUMNS", str(columns))
    extended = {"extended rig": "extended.rig.toml"} if told.causes else {}
    print_document(diagnosis_document(told, files or FILES | extended))
    out = capsys.readouterr()
    return out.out, out.err


def flat(text):
    return " ".join(text.split())


def full():
    title = "The transmission transmits more torque as it is loaded than as it is unloaded"
    account = "What the simulation gets wrong is explained in a sentence that is longer than eighty columns are wide."
    hysteresis = found_cause(
        "transmission.hysteresis", part="transmission", title=title,
        parameters={"torque": Number(value=1.204, std=0.031, unit="N*m"), "width": Number(value=0.0123, std=None, unit="rad")},
        confidence=0.62, error_removed=0.081, indistinguishable_from=("transmission.damping", "link.coulomb_friction"),
        how_to_confirm="Load it slowly.", tell_apart="Load it at two speeds.",
    )  # fmt: skip
    gains = (position_gain(), position_gain(signal="torque_sensor", unit="N*m", reduction=-0.25, ci95=(-0.4, -0.1)))
    return diagnosis(
        verdict="partly explained", causes=(found_cause(), hysteresis), unexplained=remainder(), findings=(NO_EXPERIMENT,),
        gain=Gains(holdout=True, where="the held-out log", signals=gains), next_experiment="Sweep it.",
        sentences=(account, "B.", "C."),
    )  # fmt: skip


@pytest.mark.parametrize("columns", [80, 110, 160])
def test_everything_is_reported_within_the_width(capsys, monkeypatch, columns):
    out, err = printed(full(), capsys, monkeypatch, columns)
    assert max(map(len, out.splitlines())) <= columns
    for part in ("log.mcap: partly explained", "torque 0.2000 ± 0.0020 N·m", "torque 1.204 ± 0.061 N·m", "width 0.0123 rad",
                 "98 %", "91 %", "62 %", "8 %", "motor.coulomb_friction", "transmission.damping", "link.coulomb_friction",
                 "0.008", "0.0004", "0.0002", "95 % (90 … 98)", "−25 % (−40 … −10)", "torque sensor [N·m]",
                 "on the held-out log", "12 % of the error beyond noise is unexplained; it is on the motor side and depends on",
                 "Raise the torque slowly.", "Load it at two speeds.", "Sweep it.", "longer than eighty columns are wide.",
                 "diagnosis.html", "diagnosis.json", "extended.rig.toml"):  # fmt: skip
        assert part in flat(out), part
    assert "Beware" not in out
    assert flat(err) == f"note: {sentence(NO_EXPERIMENT)}"


def test_words_are_not_cut_in_two_at_80_columns(capsys, monkeypatch):
    told = full()
    out, _ = printed(told, capsys, monkeypatch, 80)
    words = set(out.split())
    for text in (*told.sentences, *(c.title for c in told.causes)):
        assert set(text.split()) <= words


def test_a_consistent_log_has_its_errors_next_to_the_noise(capsys, monkeypatch):
    told = diagnosis(verdict="consistent", causes=(), gain=Gains(holdout=False, where="", signals=()))
    out, err = printed(told, capsys, monkeypatch, 80)
    assert re.search(r"motor position \[rad\] +0\.008 +0\.0002 +0\.4 %", out)
    assert "The residuals of this log's equations are noise." in out
    assert "Causes" not in out
    assert "extended.rig.toml" not in out
    assert err == ""


def test_what_became_of_the_extended_rig(capsys, monkeypatch):
    for what, said in (("extended rig", "extended.rig.toml"), ("note", "extended.rig.toml is from before")):
        out, _ = printed(diagnosis(), capsys, monkeypatch, 160, FILES | {what: said})
        assert f"{what}: {said}" in out
    out, _ = printed(diagnosis(), capsys, monkeypatch, 160, FILES)
    assert "extended.rig.toml" not in out


@pytest.mark.parametrize("columns", [80, 160])
def test_names_that_would_act_on_a_terminal_stay_text(capsys, monkeypatch, columns):
    bad = "[bold red]x[/] [/]\x1b[31m\x07"
    told = diagnosis(
        log=bad, sentences=(bad,), findings=(NO_EXPERIMENT, replace(NO_EXPERIMENT, severity="warning", evidence={"reason": bad})),
        next_experiment=bad,
        causes=(found_cause(joint=bad, title=bad, indistinguishable_from=(bad,), how_to_confirm=bad),
                found_cause(joint="other")),
        gain=Gains(holdout=False, where=bad, signals=(position_gain(joint=bad, signal=bad, unit=bad),)),
    )  # fmt: skip
    out, err = printed(told, capsys, monkeypatch, columns)
    for text in (out, err):
        assert "[bold red]x[/]" in text
        assert "\x1b" not in text
        assert "\x07" not in text


def test_json_is_the_document(capsysbinary):
    told = full()
    print_data(diagnosis_document(told))
    assert msgspec.convert(json.loads(capsysbinary.readouterr().out), type(told)) == told


@given(
    st.floats(-1e9, 1e9).filter(lambda v: abs(v) > 1e-12),
    st.floats(1e-4, 10.0),
)
def test_an_interval_is_printed_to_two_digits_of_its_half(value, relative):
    half = abs(value) * relative
    text = with_interval(value, half).replace("−", "-")
    scale = 1.0
    found = re.fullmatch(r"\((.*)\) × 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", text)
    if found:
        text = found[1]
        scale = 10.0 ** int(found[2].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
    told, spread = (float(part) * scale for part in text.split(" ± "))
    assert spread == pytest.approx(half, rel=0.051)  # two digits: half of the second is 5 % of 1.0
    assert abs(told - value) <= 0.051 * half + 1e-9 * abs(value)


def test_numbers_in_words():
    assert parameter_text(Number(value=1.234e-7, std=2e-9, unit="kg*m^2")) == "(1.234 ± 0.039) × 10⁻⁷ kg·m²"
    assert parameter_text(Number(value=1.1, std=0.0, unit="1")) == "1.1 ± 0"
    assert parameter_text(Number(value=1.1, std=0.01, unit="N*m", rig=0.9)) == "1.100 ± 0.020 N·m (rig: 0.9)"
    assert parameter_text(Number(value=float("nan"), std=None, unit="s")) == "– s"
    assert with_interval(9.9, 0.0996) == "9.90 ± 0.10"
    assert [share_text(s) for s in (0.996, 0.99999, 1.0, 0.004, 0.0, 0.5)] == [
        "99.6 %",
        "100 %",
        "100 %",
        "0.4 %",
        "0 %",
        "50 %",
    ]
    assert confidence_text(found_cause(confidence=1.0)) == "> 99 %"
    member = found_cause(confidence=0.4, class_confidence=0.97, indistinguishable_from=("link.inertia",))
    assert confidence_text(member) == "40 %, its class 97 %"
    assert reduction_text(position_gain(reduction=0.981, ci95=(0.976, 0.985))) == "98.1 % (97.6 … 98.5)"
    worse = position_gain(rmse_after=0.328, reduction=-40.0, ci95=(-50.0, -30.0))
    assert reduction_text(worse) == "worse, more than tenfold"
    assert reduction_text(position_gain(reduction=float("nan"))) == "–"


def test_the_remainder_in_words():
    assert unexplained_words(remainder(depends_on=("time", "motor_velocity", "deflection"))).endswith(
        "on the motor side and depends on time, motor velocity and deflection."
    )
    loop = remainder(depends_on=("deflection", "deflection_rate", "time"), curve_back=remainder().curve)
    assert "a loop over deflection: up and down differ" in unexplained_words(loop)
    assert unexplained_words(remainder(depends_on=())).endswith("depends on none of the signals checked.")
    assert unexplained_words(remainder(where=None, depends_on=())) == "12 % of the error beyond noise is unexplained."


@pytest.mark.parametrize("columns", [80, 160])
def test_what_does_not_matter_is_marked(capsys, monkeypatch, columns):
    told = diagnosis(verdict="explained", causes=(found_cause(), found_cause("link.inertia", material=False)))
    out, _ = printed(told, capsys, monkeypatch, columns)
    assert "link.inertia, immaterial" in flat(out)
    assert "coulomb_friction, immaterial" not in flat(out)
    assert flat(page_of(diagnosis_document(told))).count(">link.inertia, immaterial<") == 1
