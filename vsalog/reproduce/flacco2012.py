"""Tables 1 and 2 of Flacco, De Luca, Sardellitti, Tsagarakis, IJRR 31(13), 2012: the VSA-II and the AwAS, three modalities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vsalog.core.trace import Trace
from vsalog.reproduce.measure import Setting, Study, estimate, stiffness_errors, with_noise
from vsalog.reproduce.rows import Curve, Figure, Panel, Result, Row, Spread
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.experiments import awas_experiment, vsa2_experiment

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

# §6.1 and §6.2. The residual's regressors are not passed through its lag, and learning begins with the first sample.
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
    settings : what is tried, with the modalities it is tried for
    reasons : settings' label → why it may be worse than printed
    remark : what else one should know of the printed values
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
        "the paper's, but with the lag matched": "the MKKF's lag, and what is left of the transient: after 3 s it is far"
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
    " the joint moves by less than the encoders' step for the first 20 ms or so, and no estimator learns from that",
)


def table1(study: Study) -> Result:
    """Table 1: MSE and MSREP of the VSA-II, with Figs. 6 and 8."""
    study.say("flacco2012-table1: VSA-II")
    experiments = with_noise(vsa2_experiment(ideal=True), study.seeds)
    rows, traces = _table(VSA2_TABLE, experiments, study)
    first = traces[VSA2_PAPER.label]
    truth, time = experiments[0].truth, experiments[0].time
    panels = [
        Panel(
            title=title,
            x_label="time [s]",
            y_label="stiffness [N·mm/rad]",
            y_range=(0.0, 1.3e3 * float(truth[name].max())),
            curves=(
                Curve("actual", time, 1e3 * truth[name], "dashed"),
                *(
                    Curve(m, time, 1e3 * np.asarray(first[m][part]["stiffness"]), style)
                    for m, style in (("MODEL", "dotted"), ("SENSOR", "dashdot"), ("RESIDUAL", "solid"))
                ),
            ),
        )
        for part, name, title in (
            ("1", "stiffness_1", "first transmission"),
            ("2", "stiffness_2", "second transmission"),
            ("total", "stiffness_total", "device"),
        )
    ]
    figure6 = Figure("flacco2012-fig6", "VSA-II: stiffness (Flacco 2012, Fig. 6)", tuple(panels))
    return Result(rows, [figure6, _characteristic(experiments[0], first["RESIDUAL"])])


def _characteristic(experiment: Experiment, trace: Trace) -> Figure:
    """Flexibility torque over deflection as finally estimated, and the residuals it was learnt from (Fig. 8)."""
    panels = []
    for part in ("1", "2"):
        phi, residual = (np.asarray(trace[part][c]) for c in ("deflection", "residual"))
        final = [float(np.asarray(trace[part][f"coefficient_{h}"])[-1]) for h in range(4)]
        grid = np.linspace(np.nanmin(phi), np.nanmax(phi), 200)
        fitted = sum(a * grid ** (2 * h + 1) for h, a in enumerate(final))
        panels.append(
            Panel(
                title=f"transmission {part}",
                x_label="deflection [rad]",
                y_label="flexibility torque [N·mm]",
                curves=(
                    Curve("residual", phi[::50], 1e3 * residual[::50], "points"),
                    Curve("final model", grid, 1e3 * np.asarray(fitted)),
                ),
            )
        )
    return Figure("flacco2012-fig8", "VSA-II: characteristic curves (Flacco 2012, Fig. 8)", tuple(panels))


def table2(study: Study) -> Result:
    """Table 2: MSE and MSREP of the AwAS, with Figs. 11 and 14."""
    study.say("flacco2012-table2: AwAS")
    experiments = with_noise(awas_experiment(ideal=True), study.seeds)
    rows, traces = _table(AWAS_TABLE, experiments, study)
    truth, time = experiments[0].truth, experiments[0].time
    # Coefficient 2 is that of φ r², with r in millimetres and the torque in N·m: its number is the one in kN/mm.
    final = [estimate(e, AWAS_PAPER) for e in experiments]
    dominant = [float(np.asarray(t["1"]["coefficient_2"])[-1]) for t in final]
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
    figures = [
        Figure(
            "flacco2012-fig11",
            "AwAS: deflection (Flacco 2012, Fig. 11)",
            (
                Panel(
                    x_label="time [s]",
                    y_label="deflection [rad]",
                    curves=(Curve("actual", time, truth["deflection"]),),
                ),
            ),
        ),
        Figure(
            "flacco2012-fig14",
            "AwAS: stiffness (Flacco 2012, Fig. 14)",
            (
                Panel(
                    x_label="time [s]",
                    y_label="stiffness [N·m/rad]",
                    y_range=(0.0, 1.3 * float(truth["stiffness"].max())),
                    curves=(
                        Curve("actual", time, truth["stiffness"], "dashed"),
                        *(
                            Curve(m, time, np.asarray(traces[AWAS_PAPER.label][m]["total"]["stiffness"]), style)
                            for m, style in (("MODEL", "dotted"), ("SENSOR", "dashdot"), ("RESIDUAL", "solid"))
                        ),
                    ),
                ),
            ),
        ),
    ]
    return Result(rows, figures)


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
            traces = [estimate(e, own) for e in experiments]
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
