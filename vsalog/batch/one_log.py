"""The work on one log: `estimate`, `validate` or `diagnose`, as the commands do it, into files of a batch."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from vsalog.batch.key_figures import of_diagnosis, of_estimate, of_validation
from vsalog.batch.names import PART, device_name, encoded, trace_name
from vsalog.batch.records import Log, Settings
from vsalog.diagnosis.run import Options as DiagnoseOptions
from vsalog.estimation.job import Options as EstimateOptions
from vsalog.estimation.job import prepare
from vsalog.estimation.joint import PRESET, choose_all, pick_joints
from vsalog.estimators.registry import method
from vsalog.estimators.tuning import read_tuning
from vsalog.readers.time_window import Window
from vsalog.report.diagnose import write_diagnosis
from vsalog.report.estimate import write_estimate
from vsalog.report.outputs import Outputs
from vsalog.report.validate import write_validation
from vsalog.rig import Rig
from vsalog.validation.frozen import frozen
from vsalog.validation.run import Options as ValidateOptions
from vsalog.writers.dataset import day, in_dataset

Files = dict[str, tuple[Path, str]]
"""What → (file in the scratch folder, name in the batch)."""
Said = dict[str, Any]
"""Fields of a log's record (`vsalog.batch.records.Record`)."""


def check(settings: Settings) -> None:
    """Check the options before any log is opened.

    Raises
    ------
    VsalogError
        An option is impossible whatever the log.
    """
    asked = settings.options
    Window.parse(asked.get("start"), asked.get("end"))
    if settings.model is not None:
        with tempfile.TemporaryDirectory(prefix="vsalog-") as folder:
            frozen(_model(settings, Path(folder)))
    rig, estimator, tune = _rig(settings), asked.get("estimator", "auto"), asked.get("tune", {})
    if rig is not None:
        rig = rig.with_settings({k: v for k, v in asked.get("set", {}).items() if k != "setpoint"})
        joints = pick_joints(rig.joints, asked.get("joints", ()))
        if settings.do == "estimate":
            choose_all(joints, estimator, tune, rig.file)
    elif estimator != "auto":
        read_tuning(method(estimator).TUNING, estimator, {k: v for k, v in tune.items() if k != PRESET})


def estimate(log: Log, path: Path, settings: Settings, scratch: Path) -> tuple[Files, Said]:
    """Estimate the joints of a log: a trace, a model and, on request, a page.

    Raises
    ------
    VsalogError
        The log is at fault, or a file cannot be written.
    """
    job = prepare([path], EstimateOptions(rig=_rig(settings), **settings.options))
    name, page = encoded(log.name), scratch / "estimate.html" if settings.report else None
    outputs = Outputs(scratch / PART, scratch / "model.toml", page=page)
    provenance = job.provenance()
    estimates = write_estimate(job, outputs, provenance, layout=in_dataset)
    device, date = _device(job.rig), day(outputs.trace)
    files = {
        "trace": (outputs.trace, trace_name(device, date, log.name)),
        "model": (outputs.model, f"models/{name}.model.toml"),
    }
    if page is not None:
        files["report"] = (page, f"reports/{name}/estimate.html")
    fields = {
        "device": device,
        "date": date,
        "joints": tuple(of_estimate(job, e) for e in estimates),
        "warnings": job.warnings,
        "rig_sha256": _sha256(provenance["vsalog.rig"]),
        "input_sha256": next(iter(json.loads(provenance["vsalog.input"]).values()), ""),
    }
    return files, fields


def validate(log: Log, path: Path, settings: Settings, scratch: Path) -> tuple[Files, Said]:
    """Test the model on a log: a report and its page.

    Raises
    ------
    VsalogError
        The log or the model is at fault, or a file cannot be written.
    """
    options = ValidateOptions(rig=_rig(settings), **settings.options)
    report, files = write_validation(_model(settings, scratch), [path], options, scratch / "report")
    fields = {
        "device": _device(Rig.from_toml(report.rig, "rig")),
        "joints": tuple(of_validation(report)),
        "rig_sha256": _sha256(report.rig),
        "input_sha256": report.logs[0].sha256,
        "met": all(t.met for t in report.thresholds),
    }
    return _reports(log, files), fields


def diagnose(log: Log, path: Path, settings: Settings, scratch: Path) -> tuple[Files, Said]:
    """Compare the rig's simulation with a log: a diagnosis, its page and, where causes were found, the extended rig.

    Raises
    ------
    VsalogError
        The log or the rig is at fault, or a file cannot be written.
    """
    options = DiagnoseOptions(rig=_rig(settings), **settings.options)
    diagnosis, files = write_diagnosis(path, None, options, scratch / "report")
    joints = tuple(of_diagnosis(diagnosis))
    own = {joint.joint for joint in joints}
    fields = {
        "device": _device(Rig.from_toml(diagnosis.rig, "rig")),
        "joints": joints,
        "findings": tuple(msgspec.to_builtins(f) for f in diagnosis.findings if f.joint not in own),
        "warnings": diagnosis.warnings,
        "rig_sha256": _sha256(diagnosis.rig),
        "input_sha256": diagnosis.log_sha256,
        "met": not settings.fail_on_cause or diagnosis.verdict.startswith("consistent"),
    }
    return _reports(log, files), fields


COMMANDS: dict[str, Callable[[Log, Path, Settings, Path], tuple[Files, Said]]] = {
    "estimate": estimate,
    "validate": validate,
    "diagnose": diagnose,
}


def _rig(settings: Settings) -> Rig | None:
    return None if settings.rig is None else Rig.from_toml(settings.rig, settings.rig_name)


def _model(settings: Settings, folder: Path) -> Path:
    """Write the model to validate into a folder."""
    assert settings.model is not None
    (folder / "model").mkdir()
    file = folder / "model" / settings.model_name
    file.write_text(settings.model, encoding="utf-8")
    return file


def _reports(log: Log, files: Mapping[str, str]) -> Files:
    """Return the files of a report by their names in the batch."""
    kinds = {"report": "report", "data": "document", "extended rig": "rig"}
    found = {kinds[what]: Path(file) for what, file in files.items() if what in kinds}
    return {what: (file, f"reports/{encoded(log.name)}/{file.name}") for what, file in found.items()}


def _device(rig: Rig) -> str:
    """Return the name of the machine in the data set: the rig's name, else its joints'."""
    return device_name(rig.name or "+".join(rig.joints))


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
