"""Fuzz target: scenario files, up to the inputs that a machine is simulated with."""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
from fuzz_contract import empty, told

from vsalog.core.errors import VsalogError
from vsalog.rig.load import Rig, presets
from vsalog.simulation.scenario import Scenario, _built_in_text, built_in

TIME = np.linspace(0.0, 2.0, 9)


@cache
def rigs():
    return [Rig.preset(name).file for name in presets()]


def one(data: bytes) -> None:
    """Read a scenario; what it drives is a number at any time."""
    if not data:
        return
    folder = empty("scenario")
    (folder / "table.csv").write_text("time,x\n0,1\n1,2\n2,3\n")
    try:
        scenario = Scenario.from_toml(data[1:].decode("utf-8", "replace"), "scenario", folder)
        rig = rigs()[data[0] % len(rigs())]
        inputs = scenario.inputs(rig)
        scenario.controllers(rig)
    except VsalogError as error:
        told(error, "scenario")
        return
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        for roles in inputs.values():
            for signal in roles.values():
                at = getattr(signal, "reference", None) or getattr(signal, "position", None) or signal
                assert np.shape(at(TIME)) == TIME.shape


PARTS = (
    'type = "sine"\namplitude = "1 N*m"\nfrequency = "2 Hz"',
    'type = "square"\namplitude = 1\nfrequency = "2 Hz"\nduty = 0.3',
    'type = "chirp"\namplitude = 1\nstart_frequency = "0.1 Hz"\nend_frequency = "5 Hz"',
    'type = "steps"\ntimes = [0, 0.5, "1 s"]\nvalues = [0, "1 N*m", 2]\nrise = 0.1',
    'type = "multisine"\nrms = 1\nspacing = "0.5 Hz"\nhighest_frequency = 5\nseed = 1',
    'type = "csv"\nfile = "table.csv"\ncolumn = "x"',
    'type = "trapezoid"\namplitude = 1\nrise = 0.1\nhold = 0.2\nperiod = 1',
    'type = "constant"\nvalue = "1 N*m"',
)
OWN = """
duration = "2 s"
period = 0.001
[joint.{joint}]
[[joint.{joint}.external_torque]]
{part}
"""


def seeds():
    """Yield the scenarios that come with vsalog, and small ones for each rig."""
    machines = rigs()
    for name in sorted(built_in()):
        text = _built_in_text(name)
        fits = [i for i, rig in enumerate(machines) if all(f"joint.{joint}" in text for joint in rig.joint)]
        yield bytes(fits[:1] or [0]) + text.encode()
    for i, part in enumerate(PARTS):
        number = i % len(machines)
        yield bytes([number]) + OWN.format(joint=next(iter(machines[number].joint)), part=part).encode()
