"""Flacco, De Luca, ICRA 2014: Table I on ideal signals, and the two cases with noise of §VII."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.core.trace import Trace
from vsalog.reproduce.drawing import Panel, figure, over
from vsalog.reproduce.flacco2012 import VSA2_CHOSEN, VSA2_CONDITIONS, VSA2_PAPER, VSA2_TABLE, vsa2_recordings
from vsalog.reproduce.measure import Errors, Setting, Study, column, estimate, stiffness_errors, with_noise
from vsalog.reproduce.rows import Result, Row, Spread
from vsalog.rig import Rig
from vsalog.rig.schema import RigFile
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.experiments import vsa2_experiment
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

PAPER = "Flacco 2014"

# Table I: method → (MSE [N²·mm²/rad²], MSREP [%]) of one transmission.
TABLE_1: Mapping[str, tuple[float, float]] = {
    "qr-rls": (0.58, 0.002),
    "batch-ls": (102.64, 0.224),
    "residual-rls": (31.60, 0.07),
}
# §V, of the same transmission: the motor by QR-RLS [N·mm·s²/rad], [N·mm·s/rad], and the true one.
TABLE_1_MOTOR = {"motor_inertia": (7.5135, 7.5), "motor_damping": (0.9148, 0.9)}
# §VII, total stiffness: (MSE, MSREP) of QR-RLS and of the method it is compared with; and the motors' parameters.
NOISY = {"qr-rls": (2.0919, 0.5162), "residual-rls": (92.2, 0.046)}
NOISY_MOTOR = {
    ("1", "motor_inertia"): (7.2360, 7.3),
    ("2", "motor_inertia"): (7.3022, 7.3),
    ("1", "motor_damping"): (0.9731, 1.0),
    ("2", "motor_damping"): (0.9980, 1.0),
}
TRANSIENT = 2.17
"""Seconds left out of §VII's numbers, which are not printed: with these the method printed along with QR-RLS has its printed MSE,
92.2; the one unknown is settled by a number that QR-RLS has no part in."""
# §VII, second case, in N·m: QR-RLS, and the method of Ménard et al. 2013 on the same machine.
CUBIC = {"qr-rls": (1.2583, 1.6936), "algebraic": (4.2, 0.7)}
CUBIC_MOTOR = {
    ("1", "motor_inertia"): (0.0023, 1e-4),
    ("2", "motor_inertia"): (7.1942e-4, 1e-4),
    ("1", "motor_damping"): (1.2843, 1.27),
    ("2", "motor_damping"): (1.2706, 1.27),
}
TITLES = {"motor_inertia": "motor inertia B", "motor_damping": "motor damping D"}

# §V: m = 7 polynomials φ¹ … φ⁷, λ = 0.98. Signals are ideal: the shortest filter that gives a velocity changes nothing.
SEVEN = tuple(range(1, 8))
TRANSPARENT: dict[str, str | float | bool] = {"window": 0.02, "degree": 6}
IDEAL_SETTINGS: Mapping[str, tuple[Setting, ...]] = {
    "qr-rls": (
        Setting("the paper's", "qr-rls", {**TRANSPARENT, "forgetting": 0.98, "p0": "inf"}, SEVEN),
        Setting("vsalog's default", "qr-rls", {}),
    ),
    "batch-ls": (
        Setting("the paper's", "batch-ls", TRANSPARENT, SEVEN),
        Setting("vsalog's default", "batch-ls", {}),
    ),
    "residual-rls": (
        Setting(
            "the paper's", "residual-rls", {**TRANSPARENT, "bandwidth": 300.0, "p0": 1e6, "c": 1e-5, "matched": False}
        ),
        Setting("vsalog's default", "residual-rls", {}),
    ),
}
IDEAL_CONDITIONS = (
    "VSA-II, ideal signals, 20 s at 1 kHz from rest, k drifting by 0.0005 N·mm/rad a second, B = 7.5 N·mm·s²/rad and D = 0.9"
    " N·mm·s/rad in the machine, 7.3 and 1.0 in the rig; with the paper's settings velocities come from a Savitzky–Golay filter"
    " of 20 ms, which changes next to nothing of ideal signals"
)
IDEAL_CHOSEN = "C = 1.8, link inertia 2 N·mm·s²/rad, m g l = 60 N·mm, link damping 5 N·mm·s/rad, 20 s"
NOT_THE_DRIFT = (
    "the paper attributes the batch solution's error to the drift, but 0.01 N·mm/rad in 20 s is a share of 2e-5 of k, and that"
    " alone an MSREP of 4e-8 %"
)

# §VII: window of 1 s, degree 20, no forgetting, no prior; the stiffness at the MKKF's (or KKF's) present deflection.
PAIR: dict[str, str | float | bool] = {"filter": "pair", "window": 1.0, "degree": 20, "p0": "inf"}
NOISY_SETTINGS = (Setting("the paper's", "qr-rls", PAIR), Setting("vsalog's default", "qr-rls", {}))
CUBIC_SETTINGS = (
    Setting("the paper's", "qr-rls", PAIR, kalman=(1e10, 1e4, 1e4)),
    Setting("vsalog's default", "qr-rls", {}),
    Setting("vsalog's default", "algebraic", {}),
)
# Heavy noise by quantity [rad, N·m rms]: it makes the motors' inertias as wrong as they are printed.
NOISE = {"position": 0.01, "torque": 0.2}
CUBIC_CONDITIONS = (
    "antagonistic joint with cubic springs, B = 1e-4 kg·m², D = 1.27 N·m·s/rad, white noise on all signals, 20 s at"
    " 1 kHz, fitted with φ and φ³"
)
CUBIC_CHOSEN = (
    "springs, torques and link of the preset and scenario cubic-antagonist (σ of each spring spans a factor of three), noise of"
    f" {NOISE['position']:g} rad rms on positions and {NOISE['torque']:g} N·m rms on torques, what counts as transient"
)
NOT_IDENTIFIED = (
    "B θ̈ is less than a thousandth of the torque and far below its noise: no method can find B in these signals, and neither"
    " number means anything"
)
STARTING = (
    "the window of 1 s is filled at 1 s and the coefficients begin without a prior, so 2 s is one second into the fit; after"
    " 2.4 s the MSE is at the printed one"
)
PRIOR = (
    "the transient, which affects the MSE more than the MSREP: the coefficients begin at zero with a prior, which after 2 s still"
    " weighs where the deflection is large. After 3 s the MSE is below the printed one, and with a weaker prior (p0 a hundred"
    " times larger) after 2 s already"
)
LEARNING = (
    "the transient, which affects the MSE more than the MSREP: after 2 s the deflection has hardly covered its range once, and"
    f" noise decides. Where {TRANSIENT} s are left out the MSE is at or below the printed one"
)
MOTOR_NOISE = (
    "noise of the positions enters the regressors; another seed is off by another amount, and what is printed is one"
)
ORDER_ONLY = (
    "springs, torques and noise are chosen, so no more than orders of magnitude can be compared: a larger noise would make any"
    " number of ours as large as the printed one"
)
ODD_PAIR = (
    "the printed MSE and MSREP do not fit each other: an MSE of 2.09 with an MSREP of 0.516 % is a stiffness of some 20 N·mm/rad,"
    " but the VSA-II's is above 320, as the other pair, 92.2 and 0.046 %, shows"
)


def table1(study: Study) -> Result:
    """Table I: three methods on ideal signals of a VSA-II whose data sheet is slightly wrong, with Fig. 2."""
    study.say("flacco2014-table1: simulating")
    experiment = vsa2_experiment(ideal=True, drift=0.5e-6, inertia=7.5e-3, damping=0.9e-3)
    rows: list[Row] = []
    panels: list[Panel] = []
    for name, settings in IDEAL_SETTINGS.items():
        for setting in settings:
            study.say(f"flacco2014-table1: {name}, {setting.label}")
            trace = estimate(experiment, setting)
            common = _common("flacco2014-table1", "Table I", setting, IDEAL_CONDITIONS, IDEAL_CHOSEN, 2.0)
            # The paper leaves out the first 2 s here, and states it.
            common = common.with_values(window_printed=True)
            remark = NOT_THE_DRIFT if name == "batch-ls" else ""
            for part in ("1", "2"):
                errors = stiffness_errors([experiment], [trace], part, f"stiffness_{part}", 2.0, scale=1e6)
                # One transmission is printed, without stating which; the drift is printed of the first.
                printed = TABLE_1[name] if part == "1" else (None, None)
                rows += _errors(common, f"{name}, transmission {part}", printed, errors, "N²·mm²/rad²", PRIOR, remark)
            if name == "qr-rls" and setting is settings[0]:
                for parameter, (found, true) in TABLE_1_MOTOR.items():
                    rows.append(
                        _motor(common, [trace], "1", parameter, found, true, 1e3, "N·mm·s²/rad", "N·mm·s/rad", name)
                    )
            if setting is settings[0]:
                lines = {"estimated": column(trace, "stiffness", "1"), "actual": experiment.truth["stiffness_1"]}
                panels.append(over(experiment.time, lines, "stiffness [N·mm/rad]", scale=1e3, title=name, by="actual"))
    drawn = figure(PAPER, 2, "VSA-II, ideal signals: stiffness", tuple(panels), IDEAL_CONDITIONS, IDEAL_CHOSEN)
    return Result(rows, [drawn])


def noisy(study: Study) -> Result:
    """§VII, first case: the VSA-II with the noise of Flacco 2012, with Fig. 3."""
    study.say("flacco2014-noisy: simulating")
    experiments = vsa2_recordings(study)
    settings = (*NOISY_SETTINGS, VSA2_PAPER.with_tune(modality="RESIDUAL"))
    return _case(
        study,
        "flacco2014-noisy",
        experiments,
        settings,
        NOISY,
        NOISY_MOTOR,
        (VSA2_CONDITIONS, VSA2_CHOSEN),
        1e6,
        ("N²·mm²/rad²", "N·mm·s²/rad", "N·mm·s/rad", "N·mm/rad"),
        (3, "VSA-II with noise: total stiffness"),
        after=(2.0, TRANSIENT, 3.0, 5.0),
        remark=ODD_PAIR,
    )


def cubic(study: Study) -> Result:
    """§VII, second case: the machine of Ménard et al. 2013 with cubic springs, with Fig. 4."""
    study.say("flacco2014-cubic: simulating")
    rig = cubic_rig()
    inputs = Scenario.find("cubic-antagonist-exp1", rig).inputs(rig)
    experiments = with_noise(simulate(rig, inputs, 20.0, ideal=True), study.seeds)
    return _case(
        study,
        "flacco2014-cubic",
        experiments,
        CUBIC_SETTINGS,
        CUBIC,
        CUBIC_MOTOR,
        (CUBIC_CONDITIONS, CUBIC_CHOSEN),
        1.0,
        ("N²·m²/rad²", "kg·m²", "N·m·s/rad", "N·m/rad"),
        (4, "Cubic springs with noise: total stiffness"),
        after=(2.0, 5.0),
        differs=ORDER_ONLY,
    )


def cubic_rig() -> RigFile:
    """Return the preset ``cubic-antagonist`` with heavy white noise on all signals."""
    rig = Rig.preset("cubic-antagonist").file
    joint = rig.joint["cubic"]
    signals = {
        role: replace(signal, noise=NOISE["torque" if "torque" in role else "position"])
        for role in joint.signals.__struct_fields__
        if (signal := getattr(joint.signals, role)) is not None
    }
    return replace(rig, joint={"cubic": replace(joint, signals=replace(joint.signals, **signals))})


def _case(
    study: Study,
    item: str,
    experiments: Sequence[Experiment],
    settings: Sequence[Setting],
    printed: Mapping[str, tuple[float, float]],
    motor: Mapping[tuple[str, str], tuple[float, float]],
    stated: tuple[str, str],
    scale: float,
    units: tuple[str, str, str, str],
    numbered: tuple[int, str],
    *,
    after: Sequence[float],
    remark: str = "",
    differs: str = "",
) -> Result:
    """Return the rows of a case with noise: total stiffness after each of some times, motor parameters at the end."""
    rows: list[Row] = []
    curves: dict[str, NDArray[np.float64]] = {}
    size = scale**0.5
    for setting in settings:
        study.say(f"{item}: {setting.estimator}, {setting.label}")
        traces = [estimate(e, setting) for e in experiments]
        curves[f"{setting.estimator}, {setting.label}"] = column(traces[0], "stiffness")
        for left_out in after:
            common = _common(item, "§VII", setting, *stated, left_out).with_values(differs=differs)
            errors = stiffness_errors(experiments, traces, "total", "stiffness_total", left_out, scale=scale)
            of = f"{setting.estimator}, total"
            own = "" if setting.estimator == "residual-rls" else remark
            reason = _reason(setting)
            rows += _errors(common, of, printed[setting.estimator], errors, units[0], reason, own)
        if setting.estimator != "qr-rls":
            continue
        for (part, parameter), (found, true) in motor.items():
            common = _common(item, "§VII", setting, *stated, 0.0).with_values(differs=differs)
            row = _motor(common, traces, part, parameter, found, true, size, units[1], units[2], setting.estimator)
            rows.append(row.with_values(compare="none", reason="") if differs else row)
    curves["actual"] = experiments[0].truth["stiffness_total"]
    panel = over(experiments[0].time, curves, f"total stiffness [{units[3]}]", scale=size, by="actual")
    number, title = numbered
    return Result(rows, [figure(PAPER, number, title, (panel,), *stated)])


def _reason(setting: Setting) -> str:
    if setting.estimator == "residual-rls":
        return VSA2_TABLE.reasons[VSA2_PAPER.label]
    return STARTING if setting.label == VSA2_PAPER.label else LEARNING


def _common(item: str, place: str, setting: Setting, conditions: str, chosen: str, after: float) -> Row:
    return Row(
        item=item,
        paper=PAPER,
        place=place,
        quantity="",
        settings=setting.label,
        estimator=setting.estimator,
        tune=setting.whole_tune,
        window=f"after {after:g} s",
        conditions=conditions,
        chosen=chosen,
    )


def _errors(
    common: Row,
    of: str,
    printed: tuple[float | None, float | None],
    errors: Errors,
    unit: str,
    reason: str,
    remark: str,
) -> list[Row]:
    rows = []
    for quantity, units, value, ours, whole in (
        ("MSREP of the stiffness", "%", printed[1], errors.msrep, errors.msrep_whole),
        ("MSE of the stiffness", unit, printed[0], errors.mse, errors.mse_whole),
    ):
        row = common.with_values(
            quantity=quantity, of=of, unit=units, printed=value, ours=ours, whole_run=whole, remark=remark
        )
        rows.append(row.because(reason))
    return rows


def _motor(
    common: Row,
    traces: Sequence[Trace],
    part: str,
    parameter: str,
    printed: float,
    true: float,
    scale: float,
    inertia_unit: str,
    damping_unit: str,
    name: str,
) -> Row:
    values = [scale * float(np.asarray(t[part][parameter])[-1]) for t in traces]
    identified = not (parameter == "motor_inertia" and true < 1e-3)
    row = common.with_values(
        quantity=TITLES[parameter],
        of=f"{name}, motor {part}",
        unit=inertia_unit if parameter == "motor_inertia" else damping_unit,
        printed=printed,
        ours=Spread.of(values),
        window="at the end",
        compare="closer" if identified else "none",
        true_value=true,
        remark="" if identified else NOT_IDENTIFIED,
    )
    return row.because(MOTOR_NOISE)
