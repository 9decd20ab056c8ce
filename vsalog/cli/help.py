"""Help in addition to the commands' own texts: groups of options, and examples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import rich_click as click

GROUPS: Mapping[str, Sequence[str]] = {
    "Rig": ("--rig", "--joint", "--set", "--actual"),
    "Log": ("--rate", "--time", "--start", "--end"),
    "Results": ("--output", "--report", "--figures", "--plots", "--mcap", "--json", "--force"),
    "Messages": ("--quiet", "--verbose", "--debug", "--help"),
}
"""Groups of the options that commands share; what is a command's own comes first."""

# One use each with its purpose, no longer than a terminal's line.
EXAMPLES: Mapping[str, Sequence[str]] = {
    "": (
        "vsalog simulate sea -o exp1.mcap  # a log to begin with",
        "vsalog inspect exp1.mcap",
        "vsalog estimate exp1.mcap",
        "vsalog estimate --help  # options and examples of a command",
    ),
    "batch": (
        "vsalog batch 'logs/**/*.mcap' -o out/  # a data set of all logs",
        "vsalog batch logs/ -o out/ --resume  # continue one that was stopped",
        "vsalog batch logs/ -o out/ --do validate --model exp1.model.toml",
    ),
    "compare": (
        "vsalog compare exp1.mcap  # all estimators that the log allows",
        "vsalog compare exp1.mcap -e smoother,qr-rls:forgetting=0.98",
        "vsalog compare exp1.mcap --report page.html  # in one figure",
    ),
    "diagnose": (
        "vsalog diagnose exp1.mcap --holdout exp2.mcap -o diagnosis/",
        "vsalog diagnose exp1.mcap --suggest  # propose the next experiment",
        "vsalog diagnose may.mcap june.mcap --differs link.payload",
    ),
    "estimate": (
        "vsalog estimate exp1.mcap  # with the rig in the log or next to it",
        "vsalog estimate exp1.csv --rig rig.toml --report page.html",
        "vsalog estimate exp1.mcap -e residual-rls --tune forgetting=0.99",
    ),
    "explain": (
        "vsalog explain sampling.too_slow  # a finding's code",
        "vsalog explain motor.cogging link.payload  # causes",
    ),
    "export": (
        "vsalog export sea --to mjcf -o sea.xml  # for MuJoCo",
        "vsalog export rig.toml --to urdf --unsupported comment -o robot.urdf",
    ),
    "identify": (
        "vsalog identify exp1.mcap --holdout exp2.mcap",
        "vsalog identify exp1.mcap --free 'motor.friction.*' --fix motor.inertia",
    ),
    "init": (
        "vsalog init exp1.mcap -o rig.toml",
        "vsalog init exp1.csv --preset sea > rig.toml  # the rest of a known rig",
    ),
    "inspect": (
        "vsalog inspect exp1.mcap",
        "vsalog inspect exp1.csv --head 5 --rate 1000",
        "vsalog inspect broken.mcap --repair sound.mcap",
        "vsalog inspect exp1.mcap --report page.html  # with its signals over time",
    ),
    "plan": (
        "vsalog plan rig.toml  # which causes its sensors separate",
        "vsalog plan sea --max-speed '90 deg/s' -o next.toml",
        "vsalog simulate sea --scenario next.toml  # run the proposed motion",
    ),
    "plot": (
        "vsalog plot exp1.mcap -o stiffness.pdf  # estimate, then draw",
        "vsalog plot exp1.stiffness.parquet --kind torque-over-deflection -o torque.svg",
    ),
    "reproduce": (
        "vsalog reproduce --list",
        "vsalog reproduce flacco2012-table1 --plots figures/",
    ),
    "simulate": (
        "vsalog simulate --list",
        "vsalog simulate awas --truth -o log.mcap",
        "vsalog simulate rig.toml --actual joint.elbow.link.inertia=0.2",
        "vsalog simulate --replay exp1.mcap --window 0.5",
    ),
    "validate": (
        "vsalog validate exp1.model.toml exp2.mcap",
        "vsalog validate exp1.model.toml exp2.mcap --max-nrmse 5  # for CI",
        "vsalog validate exp1.model.toml exp*.mcap -o report/ --figures figures/",
    ),
    "warm": (
        "vsalog warm  # once, after an installation",
        "vsalog warm estimate",
    ),
}


def dress(group: click.Group) -> None:
    """Give the commands of a group their examples, and have help show groups of options at any width."""
    for name, command in {"": group, **group.commands}.items():
        if name in EXAMPLES:
            command.epilog = "\n\n".join(("Examples:", *EXAMPLES[name]))
    settings = click.rich_click
    settings.OPTIONS_TABLE_COLUMN_TYPES = ["opt_all_metavar", "help"]
    for path, command in ("vsalog", group), *((f"vsalog {name}", one) for name, one in group.commands.items()):
        settings.OPTION_GROUPS[path] = [
            {"name": name, "options": list(options)} for name, options in grouped(command).items()
        ]


def grouped(command: click.Command) -> dict[str, list[str]]:
    """Return the groups of a command's options by their long names, its own first, as "Options"."""
    options = [option.opts[-1] for option in command.params if option.param_type_name == "option"]
    place = {option: group for group, members in GROUPS.items() for option in members}
    groups = {"Options": [option for option in options if option not in place]}
    groups |= {group: [option for option in (*options, "--help") if place.get(option) == group] for group in GROUPS}
    return {group: own for group, own in groups.items() if own}
