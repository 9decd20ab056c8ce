"""Tables 1 and 2 of Flacco, De Luca, Sardellitti, Tsagarakis, IJRR 31(13), 2012: the VSA-II and the AwAS, three modalities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.trace import Trace
from vsalog.estimators.regression import RegressionFold
from vsalog.filters.kinematic import kinematic_filter
from vsalog.reproduce.drawing import Curve, Figure, Panel, Surface, figure, over
from vsalog.reproduce.measure import Setting, Study, assemble, column, estimate, stiffness_errors, with_noise
from vsalog.reproduce.rows import Result, Row, Spread
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.experiments import awas_experiment, vsa2_experiment

Array = NDArray[np.float64]

PAPER = "Flacco 2012"
MODALITIES = ("MODEL", "SENSOR", "RESIDUAL")

# Table 1: modality → (MSE [N²·mm²/rad²], MSREP [%]) of transmission 1, transmission 2 and their total.
TABLE_1: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "MODEL": {"1": (20.1, 0.05), "2": (11.1, 0.02), "total": (50.1, 0.026)},
    "SENSOR": {"1": (21.8, 0.049), "2": (12.4, 0.02), "total": (55.2, 0.027)},
    "RESIDUAL": {"1": (37.4, 0.07), "2": (25.2, 0.05), "total": (92.2, 0.046)},
}
# Table 2: modality → (MSE [N²·m²/rad²], MSREP [%]).
TABLE_2: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "MODEL": {"total": (7.84, 0.005)},
    "SENSOR": {"total": (14.92, 0.01)},
    "RESIDUAL": {"total": (18.97, 0.05)},
}

# §6.1 and §6.2. The residual's regressors are not passed through its lag, and the fit begins with the first sample.
CAUSAL: dict[str, str | float | bool] = {
    "filter": "kinematic",
    "matched": False,
    "bandwidth": 300.0,
    "shape": 6.0,
    "settle": 0.0,
}
VSA2_PAPER = Setting("the paper's", "residual-rls", {**CAUSAL, "p0": 1e6, "c": 1e-5})
AWAS_PAPER = Setting("the paper's", "residual-rls", {**CAUSAL, "p0": 1e20, "c": 1e-20})
DEFAULT = Setting("vsalog's default", "residual-rls", {})

VSA2_CONDITIONS = (
    "VSA-II, 20 s at 1 kHz from rest, 50 sin 0.1πt and 50 sin 2πt N·mm, encoders of 4059 pulses per turn, fitted with"
    " 4 odd powers"
)
VSA2_CHOSEN = (
    "C = 1.8, link inertia 2 N·mm·s²/rad, m g l = 60 N·mm, link damping 5 N·mm·s/rad, torque noise 1 N·mm rms (command and"
    " sensor), 20 s, what counts as transient"
)
AWAS_CONDITIONS = (
    "AwAS, 20 s at 1 kHz from rest, 0.3 sin 0.2πt N·m on the rotor, encoders of 40000 pulses per turn and 1024 on the"
    " secondary motor, 6 odd powers times 3 powers of r"
)
AWAS_CHOSEN = (
    "a secondary torque of ±200 N·m on the joint's side, nearly square, 10 s period (Fig. 10 is drawn without numbers), torque"
    " noise 0.05 N·m rms (command and sensor), what counts as transient"
)


@dataclass(frozen=True, slots=True)
class Table:
    """A table of the paper and how it is simulated.

    Attributes
    ----------
    item, place : names
    printed : modality → transmission → (MSE, MSREP)
    truth : transmission → name of its true stiffness
    unit, scale : of the MSE, and its size in N²·m²/rad²
    after : end of the transient [s]
    settings : those to run, with their modalities
    reasons : settings' label → why it may be worse than printed
    remark : remark on the printed values
    """

    item: str
    place: str
    printed: Mapping[str, Mapping[str, tuple[float, float]]]
    truth: Mapping[str, str]
    unit: str
    scale: float
    after: float
    conditions: str
    chosen: str
    settings: Sequence[tuple[Setting, Sequence[str]]]
    reasons: Mapping[str, str]
    remark: str = ""


VSA2_TABLE = Table(
    "flacco2012-table1",
    "Table 1",
    TABLE_1,
    {"1": "stiffness_1", "2": "stiffness_2", "total": "stiffness_total"},
    "N²·mm²/rad²",
    1e6,
    2.0,
    VSA2_CONDITIONS,
    VSA2_CHOSEN,
    (
        (VSA2_PAPER, MODALITIES),
        (VSA2_PAPER.with_tune("the paper's, but with the lag matched", matched=True), ("RESIDUAL",)),
        (DEFAULT, MODALITIES),
    ),
    {
        VSA2_PAPER.label: "the residual is late by 1/K_I = 3.3 ms and the MKKF's velocity by a share of a sample, while"
        " the deflection it is compared with is not: with sensors without noise and steps the error stays, with the lag matched"
        " it falls below the printed MSREP, with the default filter below the printed MSE too; and what counts as transient is"
        " not printed: after 3 s these settings are at a fifth of it",
        "the paper's, but with the lag matched": "the MKKF's lag, and the rest of the transient: after 3 s the error is far"
        " below the printed value",
    },
)
AWAS_TABLE = Table(
    "flacco2012-table2",
    "Table 2",
    TABLE_2,
    {"total": "stiffness"},
    "N²·m²/rad²",
    1.0,
    1.0,
    AWAS_CONDITIONS,
    AWAS_CHOSEN,
    ((AWAS_PAPER, MODALITIES), (DEFAULT, MODALITIES)),
    {},
    "over the whole run a stiffness of zero at one sample of 20001 costs 0.005 % by itself, the value printed for MODEL; in ours"
    " the joint moves by less than the encoders' step for the first 20 ms or so, and no estimator can use that",
)


def vsa2_recordings(study: Study) -> list[Experiment]:
    """Return the VSA-II of §6.1 under the study's noises."""
    return study.once("vsa2", lambda: with_noise(vsa2_experiment(ideal=True), study.seeds))


def awas_recordings(study: Study) -> list[Experiment]:
    """Return the AwAS of §6.2 under the study's noises."""
    return study.once("awas", lambda: with_noise(awas_experiment(ideal=True), study.seeds))


def awas_residual(study: Study) -> list[Trace]:
    """Return the results of the RESIDUAL modality with the paper's settings."""
    setting = AWAS_PAPER.with_tune(modality="RESIDUAL")
    return study.once("awas-residual", lambda: [estimate(e, setting) for e in awas_recordings(study)])


def table1(study: Study) -> Result:
    """Table 1: MSE and MSREP of the VSA-II, with Figs. 4 to 8."""
    study.say("flacco2012-table1: VSA-II")
    experiments = vsa2_recordings(study)
    rows, traces = _table(VSA2_TABLE, experiments, study)
    (first, *_), found = experiments, traces[VSA2_PAPER.label]
    time, truth, residual = first.time, first.truth, found["RESIDUAL"]
    parts = {"1": "first transmission", "2": "second transmission", "total": "device"}
    panels = {
        "4": tuple(
            over(time, {"actual": truth[f"deflection_{i}"], "MKKF": column(residual, "deflection", i)}, "deflection [rad]",
                 title=parts[i])
            for i in "12"
        ),
        "5": tuple(
            over(time, torque_lines(residual, i, truth[f"flexibility_torque_{i}"], sensed(first, i)), "torque [N·mm]",
                 scale=1e3, title=title, by="actual")
            for i, title in parts.items()
        ),
        "6": tuple(
            over(time, {"actual": truth[f"stiffness_{i}"], **{m: column(t, "stiffness", i) for m, t in found.items()}},
                 "stiffness [N·mm/rad]", scale=1e3, title=title, by="actual")
            for i, title in parts.items()
        ),
        "7": tuple(
            over(time, {f"α{h}": column(residual, f"coefficient_{h}", i) for h in range(4)}, "α [N·mm, rad]",
                 scale=1e3, title=parts[i])
            for i in "12"
        ),
        "8": tuple(_characteristic(residual, i, parts[i]) for i in "12"),
    }  # fmt: skip
    titles = {
        "4": "VSA-II: deflection", "5": "VSA-II: flexibility torque", "6": "VSA-II: stiffness",
        "7": "VSA-II: coefficients of the model, RESIDUAL", "8": "VSA-II: characteristic curves, RESIDUAL",
    }  # fmt: skip
    return Result(rows, [figure(PAPER, n, titles[n], own, VSA2_CONDITIONS, VSA2_CHOSEN) for n, own in panels.items()])


def torque_lines(trace: Trace, part: str, actual: Array, sensor: Array) -> dict[str, Array]:
    """Return the flexibility torque as it is, and as the residual, the sensor and the fit to the residual have it."""
    return {
        "residual": column(trace, "residual", part),
        "sensor": sensor,
        "RLS fit": column(trace, "flexibility_torque_fit", part),
        "actual": actual,
    }


def sensed(experiment: Experiment, part: str, joint: str | None = None) -> Array:
    """Return the readings of an antagonistic joint's torque sensors, of one transmission or in total."""
    measured = experiment.joints[experiment.joint if joint is None else joint].measured
    return np.asarray(np.sum([measured[f"torque_sensor_{i}"] for i in ("12" if part == "total" else part)], axis=0))


def _characteristic(trace: Trace, part: str, title: str) -> Panel:
    """Flexibility torque over deflection as finally estimated, and the residuals it was fitted to."""
    phi, residual = column(trace, "deflection", part), column(trace, "residual", part)
    final = [column(trace, f"coefficient_{h}", part)[-1] for h in range(4)]
    grid = np.linspace(np.nanmin(phi), np.nanmax(phi), 200)
    fitted = np.sum([a * grid ** (2 * h + 1) for h, a in enumerate(final)], axis=0)
    points = Curve("residual", phi[::50], 1e3 * residual[::50], "points")
    return Panel(
        title=title, x_label="deflection [rad]", y_label="torque [N·mm]",
        curves=(points, Curve("final model", grid, 1e3 * fitted)),
    )  # fmt: skip


def table2(study: Study) -> Result:
    """Table 2: MSE and MSREP of the AwAS, with Figs. 10 to 16."""
    study.say("flacco2012-table2: AwAS")
    experiments = awas_recordings(study)
    rows, traces = _table(AWAS_TABLE, experiments, study)
    # Coefficient 2 is that of φ r², with r in millimetres and the torque in N·m: its number is the one in kN/mm.
    dominant = [column(t, "coefficient_2", "1")[-1] for t in awas_residual(study)]
    rows.append(
        Row(
            item=AWAS_TABLE.item,
            paper=PAPER,
            place="§6.2",
            quantity="η₀,₂, the coefficient of φ r²",
            unit="kN/mm",
            of="RESIDUAL",
            settings=AWAS_PAPER.label,
            estimator=AWAS_PAPER.estimator,
            tune=dict(AWAS_PAPER.tune),
            printed=0.0284,
            ours=Spread.of(dominant),
            window="at the end",
            conditions=AWAS_CONDITIONS,
            chosen=AWAS_CHOSEN,
            compare="closer",
            true_value=2.0 * 0.01422,
        ).because(
            "with noise in the torque the coefficients of φ, φ r and φ r² share what is one in the machine; the stiffness they"
            " add up to is far closer than each of them, and with MODEL's torque the coefficient is exact"
        )
    )
    return Result(rows, _awas_figures(experiments[0], traces[AWAS_PAPER.label]))


def _awas_figures(experiment: Experiment, found: Mapping[str, Trace]) -> list[Figure]:
    time, truth, residual = experiment.time, experiment.truth, found["RESIDUAL"]
    fold, _ = assemble(experiment, AWAS_PAPER.with_tune(modality="RESIDUAL"))
    assert isinstance(fold, RegressionFold)
    encoder = experiment.measured["motor_position"]
    _, velocity, _ = kinematic_filter(encoder, experiment.period, fold.conditioner.settings["motor_position"])
    stated = AWAS_CONDITIONS, AWAS_CHOSEN
    lines = torque_lines(residual, "1", truth["flexibility_torque"], experiment.measured["torque_sensor"])
    stiffness = {"actual": truth["stiffness"], **{m: column(t, "stiffness") for m, t in found.items()}}
    differences = np.gradient(encoder, experiment.period)
    velocities = {"differences of the encoder": differences, "MKKF": velocity, "actual": truth["motor_velocity"]}
    parts: list[tuple[str, str, tuple[Panel, ...]]] = [
        ("10", "AwAS: torque of the secondary motor",
         (over(time, {"commanded": truth["secondary_torque"]}, "torque behind the gear [N·m]"),)),
        ("11", "AwAS: deflection", (over(time, {"actual": truth["deflection"]}, "deflection [rad]"),)),
        ("12", "AwAS: motor velocity",
         (over(time, velocities, "velocity [rad/s]"),
          over(time[2000:2200], {n: v[2000:2200] for n, v in velocities.items()}, "velocity [rad/s]", title="0.2 s of it"))),
        ("13", "AwAS: flexibility torque", (over(time, lines, "torque [N·m]", by="actual"),)),
        ("14", "AwAS: stiffness", (over(time, stiffness, "stiffness [N·m/rad]", by="actual"),)),
        ("15", "AwAS: coefficients of the model, RESIDUAL", coefficients(time, residual)),
    ]  # fmt: skip
    figures = [figure(PAPER, n, title, panels, *stated) for n, title, panels in parts]
    surface = torque_surface(fold, residual, truth["lever_arm"], truth["deflection"], truth["flexibility_torque"])
    title = "AwAS: characteristic surface of the final model, RESIDUAL, and the actual torque"
    return [*figures, figure(PAPER, 16, title, (), *stated, surface=surface)]


def coefficients(time: Array, trace: Trace) -> tuple[Panel, ...]:
    """Return panels of the five coefficients that the paper shows of the AwAS; h and j are the powers' places."""
    # Power 2h + 1 of φ and j of r have the coefficient 3h + j.
    shown = {"η₀,₀ (φ)": 0, "η₀,₁ (φ r)": 1, "η₀,₂ (φ r²)": 2, "η₁,₁ (φ³ r)": 4, "η₁,₂ (φ³ r²)": 5}
    return tuple(
        over(time, {name: column(trace, f"coefficient_{i}", "1")}, "[N·m, mm, rad]") for name, i in shown.items()
    )


def torque_surface(fold: RegressionFold, trace: Trace, lever: Array, deflection: Array, torque: Array) -> Surface:
    """Return the final model of an AwAS over deflection and lever arm, with the torque at every 50th sample.

    Parameters
    ----------
    fold, trace : that estimated it
    lever, deflection, torque : shape (N,) [m], [rad], [N·m]
    """
    arms, phi = np.linspace(lever.min(), lever.max(), 30), np.linspace(deflection.min(), deflection.max(), 40)
    z = np.array([model_torque(fold, trace, phi, np.full(phi.size, r)) for r in arms])
    data = np.column_stack((deflection, 1e3 * lever, torque))[::50]
    return Surface(phi, 1e3 * arms, z, data, ("deflection [rad]", "lever arm [mm]", "torque [N·m]"))


def model_torque(fold: RegressionFold, trace: Trace, deflection: Array, lever: Array, dominant: bool = True) -> Array:
    """Return the torque of the final model of an AwAS [N·m], shape (N,).

    Parameters
    ----------
    fold, trace : that estimated it
    deflection, lever : shape (N,) [rad], [m]
    dominant : whether η₀,₂ counts, the coefficient of φ r²
    """
    rows = fold.device.basis.rows(deflection, lever, 0)[:, 0]
    final = np.array([column(trace, f"coefficient_{i}", "1")[-1] for i in range(rows.shape[1])])
    final[2] *= float(dominant)
    return np.asarray(rows @ final)


def _table(
    table: Table, experiments: Sequence[Experiment], study: Study
) -> tuple[list[Row], dict[str, dict[str, Trace]]]:
    """Return the rows of a table, and the traces of the first seed by settings and modality."""
    rows: list[Row] = []
    first: dict[str, dict[str, Trace]] = {}
    for setting, modalities in table.settings:
        for modality in modalities:
            study.say(f"{table.item}: {setting.label}, {modality}")
            own = setting.with_tune(modality=modality)
            shared = table is AWAS_TABLE and own == AWAS_PAPER.with_tune(modality="RESIDUAL")
            traces = awas_residual(study) if shared else [estimate(e, own) for e in experiments]
            first.setdefault(setting.label, {})[modality] = traces[0]
            for part, name in table.truth.items():
                errors = stiffness_errors(experiments, traces, part, name, table.after, scale=table.scale)
                mse, msrep = table.printed[modality][part]
                for quantity, unit, printed, ours, whole in (
                    ("MSREP of the stiffness", "%", msrep, errors.msrep, errors.msrep_whole),
                    ("MSE of the stiffness", table.unit, mse, errors.mse, errors.mse_whole),
                ):
                    row = Row(
                        item=table.item,
                        paper=PAPER,
                        place=table.place,
                        quantity=quantity,
                        unit=unit,
                        of=modality if len(table.truth) == 1 else f"{modality}, {_named(part)}",
                        settings=setting.label,
                        estimator=own.estimator,
                        tune=dict(own.tune),
                        printed=printed,
                        ours=ours,
                        whole_run=whole,
                        window=f"after {table.after:g} s",
                        conditions=table.conditions,
                        chosen=table.chosen,
                        remark=table.remark,
                    )
                    rows.append(row.because(table.reasons.get(setting.label, "")))
    return rows, first


def _named(part: str) -> str:
    return part if part == "total" else f"transmission {part}"
