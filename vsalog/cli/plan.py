"""`vsalog plan`: which causes a rig's sensors can separate, and the sensor and the motion that separate more."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from vsalog.cli import complete
from vsalog.cli.options import force_option
from vsalog.cli.pairs import pairs
from vsalog.cli.quantity import positive


def _sensors(context: click.Context, parameter: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    """Return role → noise, an empty text where none is stated."""
    named = {value: "" for value in values if "=" not in value}
    return {
        v.partition("=")[0].strip(): named.get(v) or (v.partition("=")[2].strip() if "=" in v else "") for v in values
    }


@click.command(short_help="Predict which causes a rig's sensors separate, and which sensor or motion separates more.")
@click.argument("rig", metavar="RIG|PRESET", shell_complete=complete.names(complete.presets, or_file=True))
@click.option(
    "--joint", "joints", multiple=True, metavar="NAME", help="Plan for this joint only; may be repeated.",
    shell_complete=complete.joints,
)  # fmt: skip
@click.option(
    "--scenario",
    metavar="NAME|FILE",
    help="The motion to judge: a scenario's name or a TOML file. Default: as for 'vsalog simulate'.",
    shell_complete=complete.names(complete.scenarios, or_file=True),
)
@click.option(
    "--sensor",
    "sensors",
    multiple=True,
    callback=_sensors,
    metavar="ROLE[=NOISE]",
    help="A role that could be measured in addition, the cheapest first; may be repeated. NOISE is its standard deviation, as"
    " link_acceleration='0.5 rad/s^2'; default: that of the rig's best sensor of the same unit. Without --sensor: all roles of"
    " the joint's type.",
)
@click.option(
    "--max-torque",
    callback=positive("N*m", "a torque above zero"),
    metavar="TORQUE",
    help="Largest torque of a motor, on the joint's side, for the proposed motion. Default: that of the rig's drive, else what"
    " the judged motion takes.",
)
@click.option(
    "--max-speed",
    callback=positive("rad/s", "a speed above zero"),
    metavar="SPEED",
    help="Largest speed of motors and link, as --max-torque.",
)
@click.option(
    "--max-angle",
    callback=positive("rad", "an angle above zero"),
    metavar="ANGLE",
    help="Largest angle of motors and link to either side of zero; default: what the judged motion takes.",
)
@click.option(
    "--set", "settings", multiple=True, callback=pairs, metavar="KEY=VALUE", help="Change the rig for this run."
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the proposed motion to this file: a scenario for 'vsalog simulate RIG --scenario FILE'.",
)
@click.option(
    "--report", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="The plan as a page, too."
)
@force_option
@click.option("--json", "as_json", is_flag=True, help="Print the plan as one JSON document on stdout.")
def plan(
    rig: str,
    joints: tuple[str, ...],
    scenario: str | None,
    sensors: dict[str, str],
    max_torque: float | None,
    max_speed: float | None,
    max_angle: float | None,
    settings: dict[str, str],
    output: Path | None,
    report: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Predict which causes of a simulation's error the sensors of RIG can separate, before any experiment.

    Each cause of the catalogue is assumed to be as large as the rig's tolerance of it, on a motion that is simulated. For causes
    that would be confused the plan names the cheapest further sensor that separates them, and proposes one motion within
    the limits, no longer than needed.
    """
    from vsalog.diagnosis.plan import Options, sensors_in_si
    from vsalog.diagnosis.suggest_range import Limits
    from vsalog.report.outputs import keep_inputs, require_new
    from vsalog.report.plan import plan_document, write_plan
    from vsalog.report.progress import Progress
    from vsalog.report.terminal import print_out

    limits = Limits(max_torque, max_speed, max_angle)
    options = Options(joints, settings, scenario, limits, sensors_in_si(sensors))
    replaced = require_new((output, report), force)
    keep_inputs([path for path in (output, report) if path is not None], [Path(rig), Path(scenario or "")])
    with Progress(replaced) as progress, progress.saying_when_compiling():
        found, files = write_plan(rig, options, output, report, progress.say)
    print_out(plan_document(found, files), as_json)
