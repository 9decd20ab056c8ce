"""Makes `sample_logs/`: ``python -m vsalog.simulation.samples sample_logs [--desr DESR_Characterization_Data.mat]``.

Everything but the cut of a real recording is simulated with a fixed seed, so the files come out the same on every run.
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, savemat

from vsalog.core.errors import ReadError
from vsalog.core.recording import Recording
from vsalog.rig.load import preset_text
from vsalog.rig.schema import ElasticJoint, RigFile, Signal, SingleSignals
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.experiments import (
    awas_experiment,
    elastic_experiment,
    elastic_rig,
    vsa2_experiment,
)
from vsalog.writers.atomic import atomic_path, write_text
from vsalog.writers.recording_mcap import write_mcap
from vsalog.writers.recording_rosbags import write_rosbag1
from vsalog.writers.recording_tables import write_csv

# The first experiments run as long as the paper's, the validating ones half as long, to keep the folder small.
SECONDS = {1: 20.0, 2: 10.0}

# Names of the elastic joint's channels in the CSV, and in which units.
CSV_CHANNELS = {
    "motor_position": Signal(channel="motor position", unit="deg"),
    "link_position": Signal(channel="link position", unit="deg"),
    "motor_torque": Signal(channel="motor torque", unit="N·mm"),
    "torque_sensor": Signal(channel="torque sensor", unit="N·mm"),
}

DESR_SETTINGS = ("x00", "x10", "x20", "x25", "x30", "x33", "x35", "x40", "x45")
DESR_COLUMNS = ("timeJIM", "angleJIM", "torque")

DESR_RIG = """\
# Variable-stiffness prosthetic foot on a dynamometer: deflection and torque at nine settings of its slider.
# The dynamometer gives by 218 N·m/deg of its own, and its torque reads about 1.2 N·m high (its authors); both are taken off.
name = "DESR foot"

[joint.ankle]
kind = "serial"

[joint.ankle.basis]
odd = false              # the foot behaves differently in dorsi- and plantarflexion
branches = true          # and when it is unloaded: the loop is wide
order = 12               # the curve has knees
setpoint_order = 3

[joint.ankle.signals]
deflection = { channel = "DESR_N.{run}.angleJIM", unit = "rad", series_stiffness = "218 N·m/deg" }
torque_sensor = { channel = "DESR_N.{run}.torque", unit = "N·m", offset = "1.2 N·m" }
"""

DESR_README = """\
A cut of DESR_Characterization_Data.mat from https://github.com/UofMNeurobioncs/Decoupled-Energy-Storage-and-Release-Foot
at commit aad5f239508be4ef729f2debaad8beaf029a14c5, MIT licence (LICENSE), copyright 2021 UM Neurobionics.

Kept: the nine settings of both cams, DESR_N.x00 ... DESR_N.x45 (the slider's position in mm), each with timeJIM [s],
angleJIM [rad] and torque [N*m]. Of every 4 samples the first was kept, unfiltered: 3000 of 12000, about 208 Hz
instead of 833 Hz. Left out: the two single-cam tests (DESR_N_CAM1, DESR_N_CAM2) and the design torque curves.

Measured on hardware: a rotary dynamometer loads and unloads the foot once per setting. The angle includes the
dynamometer's own compliance (218 N*m/deg) and the torque an offset of about +1.2 N*m. The wide loop between loading and
unloading is partly intended: the foot switches between its two cams.
"""


def make_samples(folder: Path, desr: Path | None = None) -> None:
    """Write all sample logs.

    Parameters
    ----------
    folder : made when it is not there
    desr : DESR_Characterization_Data.mat, with its LICENSE next to it; no cut of it is made when absent

    Raises
    ------
    ReadError
        `desr` is not the expected file.
    WriteError
        A file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for run in (vsa2_experiment, awas_experiment):
        for number, seconds in SECONDS.items():
            experiment = run(number, seed=number, duration=seconds)
            path = folder / f"{experiment.name}.mcap"
            write_mcap(experiment.recording(), path, preset_text(experiment.joint))
    _write_csv_sample(folder)
    _write_bag_sample(folder)
    if desr is not None:
        _cut_desr(desr, folder / "desr_foot")


def _write_csv_sample(folder: Path) -> None:
    rig = _with_signals(elastic_rig(), SingleSignals(**CSV_CHANNELS))
    simulated = replace(elastic_experiment(1, seed=1, duration=SECONDS[1]), rig=rig)
    # Encoder steps are 0.01°, the converter's 1 N·mm: rounding removes the error of the conversion to rad and back.
    write_csv(_rounded(simulated), folder / "sea_exp1.csv", time="s")
    # The header states the units, so the rig need not.
    channels = "".join(f'{role} = "{signal.channel}"\n' for role, signal in CSV_CHANNELS.items())
    write_text(folder / "sea_exp1.rig.toml", f'preset = "sea"\n\n[joint.sea.signals]\n{channels}')


def _write_bag_sample(folder: Path) -> None:
    simulated = elastic_experiment(2, seed=2, duration=SECONDS[1])
    write_rosbag1(simulated.recording(), folder / "sea_exp2.bag")
    write_text(folder / "sea_exp2.rig.toml", 'preset = "sea"\n')


def _with_signals(rig: RigFile, signals: SingleSignals) -> RigFile:
    joint = rig.joint["sea"]
    assert isinstance(joint, ElasticJoint)
    return msgspec.structs.replace(rig, joint={"sea": msgspec.structs.replace(joint, signals=signals)})


def _rounded(experiment: Experiment) -> Recording:
    recording = experiment.recording()
    channels = {
        name: replace(channel, values=np.round(channel.values, 6)) for name, channel in recording.channels.items()
    }
    return replace(recording, channels=channels)


def _cut_desr(source: Path, folder: Path) -> None:
    try:
        runs = loadmat(source, squeeze_me=True, struct_as_record=False)["DESR_N"]
        cut: dict[str, dict[str, NDArray[np.float64]]] = {
            setting: {
                column: np.asarray(getattr(getattr(runs, setting), column), dtype=np.float64)[::4]
                for column in DESR_COLUMNS
            }
            for setting in DESR_SETTINGS
        }
    except (OSError, KeyError, AttributeError, ValueError, NotImplementedError) as error:
        raise ReadError(f"{source}: not the recording of the DESR foot: {error}") from error
    folder.mkdir(exist_ok=True)
    with atomic_path(folder / "desr_foot.mat") as temporary:
        savemat(str(temporary), {"DESR_N": cut}, appendmat=False, do_compression=True, oned_as="column")
        with temporary.open("r+b") as file:
            # The free text at the head would hold today's date, and the file differ on every run.
            # The header's text has 116 bytes.
            file.write(b"MATLAB 5.0 MAT-file, cut of DESR_Characterization_Data.mat".ljust(116))
    settings = (f'\n[[joint.ankle.run]]\nname = "{name}"\nsetpoint = "{int(name[1:])} mm"\n' for name in DESR_SETTINGS)
    write_text(folder / "desr_foot.rig.toml", DESR_RIG + "".join(settings))
    write_text(folder / "README.txt", DESR_README)
    with atomic_path(folder / "LICENSE") as temporary:
        shutil.copyfile(source.parent / "LICENSE", temporary)


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(prog="python -m vsalog.simulation.samples", description="Make the sample logs.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--desr", type=Path, help="DESR_Characterization_Data.mat, to cut the real sample from")
    arguments = parser.parse_args()
    make_samples(arguments.folder, arguments.desr)


if __name__ == "__main__":
    main()
