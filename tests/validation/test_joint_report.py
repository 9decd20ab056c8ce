"""The verdict follows from numbers and from what findings say of them."""

import numpy as np
import pytest
from msgspec import structs

from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.validation.document import Comparison, Dependence, Figure, Score, TransmissionReport
from vsalog.validation.joint import Judged
from vsalog.validation.verdict import joint_report

N = 5000
STAMPS = np.arange(N) * 10**6
SIGNALS = JointSignals("arm", 1e-3, STAMPS, STAMPS * 1e-9, {}, STAMPS == 0, np.zeros(N, np.int32))


def judged(nrmse, not_independent=None, gain=None):
    error, other = Figure(value=nrmse, low=0.9 * nrmse, high=1.1 * nrmse), Figure(value=0.0)
    score = Score(
        samples=N, effective_samples=500.0, span=1.0, mse=other, rmse=other, nrmse=error, msrep=other, r2=other, bias=other,
        largest=0.0,
    )  # fmt: skip
    depends = Dependence(on="torque", share=0.9, p_value=0.0, slope=0.1, code="error.gain", evidence={"gain": 0.9})
    compared = Comparison(quantity="flexibility_torque", unit="N*m", reference="sensor", inside=score, outside=None)
    part = TransmissionReport(
        transmission="1",
        judged_on="sensor",
        comparisons=(compared,),
        inside_share=1.0,
        dependence=(depends,),
        gain=gain,
    )
    return Judged((part,), not_independent)


@pytest.mark.parametrize(
    ("nrmse", "severity", "verdict"),
    [
        (1.0, "warning", "holds"),
        (5.0, "warning", "undecided"),
        (20.0, "warning", "fails"),
        (1.0, "invalidates", "cannot be judged"),
        (20.0, "invalidates", "fails"),
    ],
)
def test_signals_that_tell_nothing_speak_for_no_model(nrmse, severity, verdict):
    doubt = Finding(code="deflection.still", joint="arm", severity=severity)
    report = joint_report(judged(nrmse), SIGNALS, {}, [doubt])
    assert report.verdict == verdict
    assert [finding.code for finding in report.reasons] == [
        "validation.error",
        "validation.inside_region",
        "error.gain",
    ]
    assert report.findings == (doubt,)


def test_a_model_is_judged_by_no_computed_torque_and_not_by_its_own_log():
    computed = Finding(code="torque.function", joint="arm", part="torque_sensor", severity="invalidates")
    report = joint_report(judged(20.0, computed), SIGNALS, {}, [])
    assert (report.verdict, report.reasons[0]) == ("cannot be judged", computed)
    for nrmse, verdict, code in ((1.0, "cannot be judged", "validation.own_log"), (20.0, "fails", "validation.error")):
        report = joint_report(judged(nrmse), SIGNALS, {}, [], learnt_from=True)
        assert (report.verdict, report.reasons[0].code) == (verdict, code)


@pytest.mark.parametrize(("gain", "verdict"), [(1.07, "holds"), (0.93, "holds"), (1.15, "fails"), (0.85, "fails")])
def test_a_torque_that_is_off_by_more_than_a_tenth_is_another_springs(gain, verdict):
    assert joint_report(judged(1.0, gain=gain), SIGNALS, {}, []).verdict == verdict


@pytest.mark.parametrize(("nrmse", "verdict"), [(4.0, "holds"), (6.0, "fails")])
def test_a_model_holds_up_to_five_percent_of_the_span(nrmse, verdict):
    assert joint_report(judged(nrmse), SIGNALS, {}, []).verdict == verdict


@pytest.mark.parametrize(
    ("truth", "nominal", "reference", "verdict"),
    [
        (9.0, 50.0, "truth", "holds"),
        (12.0, 1.0, "truth", "fails"),
        (10.0, 1.0, "truth", "undecided"),
        (None, 9.0, "nominal", "holds"),
        (None, 50.0, "nominal", "undecided"),
    ],
)
def test_a_stiffness_holds_up_to_a_tenth_of_itself(truth, nominal, reference, verdict):
    plain = judged(1.0)
    report = joint_report(_with_stiffness(plain, truth, nominal), SIGNALS, {}, [])
    assert (report.stiffness.reference, report.stiffness.verdict) == (reference, verdict)
    assert report.stiffness.reason.value == pytest.approx(nominal if truth is None else truth)
    assert report.verdict == "holds"  # of the torque
    assert joint_report(plain, SIGNALS, {}, []).stiffness is None


@pytest.mark.parametrize(
    ("nrmse", "learnt_from", "verdict"),
    [(20.0, False, "fails"), (5.0, False, "undecided"), (1.0, True, "cannot be judged")],
)
def test_a_nominal_stiffness_is_no_reference_unless_the_torque_holds(nrmse, learnt_from, verdict):
    there = _with_stiffness(judged(nrmse), None, 1.0)
    report = joint_report(there, SIGNALS, {}, [], learnt_from=learnt_from)
    assert (report.verdict, report.stiffness) == (verdict, None)
    true = _with_stiffness(judged(nrmse), 1.0, 50.0)
    assert joint_report(true, SIGNALS, {}, [], learnt_from=learnt_from).stiffness.verdict == "holds"


def _with_stiffness(plain, truth, nominal):
    """Return results with comparisons of the stiffness, whose intervals are 0.9 to 1.1 times the root mean square [%]."""

    def compared(percent, reference):
        value, low, high = (((scale * percent) / 100.0) ** 2 * 100.0 for scale in (1.0, 0.9, 1.1))
        other = Figure(value=0.0)
        score = Score(
            samples=N, effective_samples=500.0, span=1.0, mse=other, rmse=other, nrmse=other,
            msrep=Figure(value=value, low=low, high=high), r2=other, bias=other, largest=0.0,
        )  # fmt: skip
        return Comparison(quantity="stiffness", unit="N*m/rad", reference=reference, inside=score, outside=None)

    there = [compared(p, r) for p, r in ((nominal, "nominal"), (truth, "truth")) if p is not None]
    part = plain.transmissions[0]
    return Judged((structs.replace(part, comparisons=(*part.comparisons, *there)),), None)
