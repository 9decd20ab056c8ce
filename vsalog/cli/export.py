"""`vsalog export`: a rig as a model of another simulator."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from vsalog.cli import complete
from vsalog.cli.options import force_option
from vsalog.cli.pairs import pairs

if TYPE_CHECKING:
    from vsalog.effects.counterpart import Dialect


@click.command(short_help="Write a rig as a model for MuJoCo, or as URDF.")
@click.argument("rig", metavar="RIG|PRESET", shell_complete=complete.names(complete.presets, or_file=True))
@click.option(
    "--to", "dialect", type=click.Choice(["mjcf", "urdf"]), required=True, help="MuJoCo's XML, or a robot description."
)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="Write to this file, not to stdout."
)
@force_option
@click.option(
    "--unsupported",
    type=click.Choice(["refuse", "comment"]),
    default="refuse",
    show_default=True,
    help="What to do about keys of the rig that the format does not support: fail and name them, or leave them out and list"
    " them in the file and on stderr.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    callback=pairs,
    metavar="KEY=VALUE",
    help="Change the rig, e.g. joint.elbow.motor.friction.coulomb='20 N·mm'.",
)
def export(
    rig: str, dialect: Dialect, output: Path | None, force: bool, unsupported: str, settings: dict[str, str]
) -> None:
    """Write RIG, a rig file or a preset, as a model of another simulator.

    Motor and link become joints, inertias armatures, springs tendons with the spring's law, and so on for every effect; a motor's
    control is its torque on the joint's side of the gear, in N·m. `vsalog export sea --to mjcf -o sea.xml` is ready for
    MuJoCo; `vsalog export rig.toml --to urdf --unsupported comment -o robot.urdf` leaves out what URDF lacks, such as springs.
    """
    from vsalog.export.run import export as exported
    from vsalog.report.export import export_document
    from vsalog.report.outputs import keep_inputs, require_new
    from vsalog.report.progress import Progress
    from vsalog.report.terminal import console_for, print_document
    from vsalog.rig.find import given_rig
    from vsalog.writers.atomic import check_path, write_text

    replaced = require_new(output, force)
    if output is not None:
        check_path(output)
        keep_inputs([output], [Path(rig)])
    with Progress(replaced):
        source = given_rig(rig).with_settings(settings)
        model = exported(source, dialect, leave_out=unsupported == "comment")
    if output is None:
        click.echo(model.text, nl=False)
    else:
        write_text(output, model.text)
    print_document(export_document(model, dialect, output), console_for("stderr"))
