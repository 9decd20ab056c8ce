"""What is done to one log: `estimate`, `validate` or `diagnose`, as the commands do it, into files of a batch."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from vsalog.batch.dataset import PART, day, in_dataset, trace_name
from vsalog.batch.figures import of_diagnosis, of_estimate, of_validation
from vsalog.batch.names import device_name, encoded
from vsalog.batch.records import Log, Settings
from vsalog.core.errors import ReadError
from vsalog.core.trace import Trace
from vsalog.diagnosis.run import Options as DiagnoseOptions
from vsalog.diagnosis.run import diagnose as run_diagnosis
from vsalog.estimation.job import Options as EstimateOptions
from vsalog.estimation.job import prepare
from vsalog.estimation.joint import PRESET, choose_all, pick_joints
from vsalog.estimators.registry import method
from vsalog.estimators.tuning import read_tuning
from vsalog.readers.window import Window
from vsalog.report import diagnose_files, diagnosis_sentences, validate_files, validation_words
from vsalog.report.estimate import write_estimate_page
from vsalog.report.joint_figures import Drawings
from vsalog.rig import Rig
from vsalog.validation.frozen import frozen
from vsalog.validation.run import Options as ValidateOptions
from vsalog.validation.run import validate as run_validation
from vsalog.writers.atomic import write_text
from vsalog.writers.trace import TraceWriter


@dataclass(frozen=True, slots=True)
class Result:
    """What came of a log.

    Attributes
    ----------
    files : what → (file in the scratch folder, name in the batch)
    said : fields of its record (`vsalog.batch.records.Record`)
    """

    files: dict[str, tuple[Path, str]]
    said: dict[str, Any]


def check(settings: Settings) -> None:
    """See whether what is asked for can be at all, before any log is opened.

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


def estimate(log: Log, path: Path, settings: Settings, scratch: Path) -> Result:
    """Estimate the joints of a log: a trace, a model and, where asked for, a page.

    Raises
    ------
    VsalogError
        The log is at fault, or a file cannot be written.
    """
    job = prepare([path], EstimateOptions(rig=_rig(settings), **settings.options))
    provenance, name = job.provenance(), encoded(log.name)
    trace, model, page = scratch / PART, scratch / "model.toml", scratch / "estimate.html"
    with ExitStack() as stack:
        writers = [stack.enter_context(TraceWriter(trace, provenance, in_dataset))]
        if settings.report:
            # The page reads columns back from a trace as `estimate` writes it.
            writers.append(stack.enter_context(TraceWriter(scratch / "plain.parquet", provenance)))

        def sink(block: Trace) -> None:
            for writer in writers:
                writer.write(block)

        estimates = job.run(sink)
        writers[0].add_findings(e.findings for e in estimates)
    write_text(model, job.model_file(estimates, provenance).to_toml())
    device, date = _device(job.rig), day(trace)
    files = {"trace": (trace, trace_name(device, date, log.name)), "model": (model, f"models/{name}.model.toml")}
    if settings.report:
        write_estimate_page(page, job, scratch / "plain.parquet", estimates, provenance)
        files["report"] = (page, f"reports/{name}/estimate.html")
    said = {
        "device": device,
        "date": date,
        "joints": tuple(of_estimate(job, e) for e in estimates),
        "warnings": job.warnings,
        "rig_sha256": _sha256(provenance["vsalog.rig"]),
        "input_sha256": next(iter(json.loads(provenance["vsalog.input"]).values()), ""),
    }
    return Result(files, said)


def validate(log: Log, path: Path, settings: Settings, scratch: Path) -> Result:
    """Hold the model against a log: a report and its page.

    Raises
    ------
    VsalogError
        The log or the model is at fault, or a file cannot be written.
    """
    model = _model(settings, scratch)
    options = ValidateOptions(rig=_rig_text(settings), **settings.options)
    drawings = Drawings(frozen(model), options.joints, 1, False)
    report = validation_words.worded(run_validation(model, [path], options, draw=drawings))
    if settings.rig is not None:
        report = msgspec.structs.replace(report, settings=report.settings | {"rig": settings.rig_name})
    outputs = validate_files.Outputs.within(scratch / "report", None)
    validate_files.write_report(report, drawings, outputs)
    said = {
        "device": _device(Rig.from_toml(report.rig, "rig")),
        "joints": tuple(of_validation(report)),
        "rig_sha256": _sha256(report.rig),
        "input_sha256": report.logs[0].sha256,
        "met": all(t.met for t in report.thresholds),
    }
    return Result(_reports(log, document=outputs.document, report=outputs.page), said)


def diagnose(log: Log, path: Path, settings: Settings, scratch: Path) -> Result:
    """Hold the rig's simulation against a log: a diagnosis, its page and, where causes were found, the extended rig.

    Raises
    ------
    VsalogError
        The log or the rig is at fault, or a file cannot be written.
    """
    outcome = run_diagnosis(path, None, DiagnoseOptions(rig=_rig_text(settings), **settings.options))
    diagnosis = diagnosis_sentences.worded(outcome)
    extended = None if outcome.extended is None else outcome.extended.to_toml()
    within = diagnose_files.Outputs.within(scratch / "report")
    outputs = diagnose_files.write_diagnosis(diagnosis, outcome.evidence, extended, within)
    rig = {"rig": outputs.rig} if outputs.rig_is == "written" else {}
    joints = tuple(of_diagnosis(diagnosis))
    own = {joint.joint for joint in joints}
    said = {
        "device": _device(outcome.rig),
        "joints": joints,
        "findings": tuple(msgspec.to_builtins(f) for f in diagnosis.findings if f.joint not in own),
        "warnings": diagnosis.warnings,
        "rig_sha256": _sha256(diagnosis.rig),
        "input_sha256": diagnosis.log_sha256,
        "met": not settings.fail_on_cause or diagnosis.verdict.startswith("consistent"),
    }
    return Result(_reports(log, document=outputs.document, report=outputs.page, **rig), said)


COMMANDS: dict[str, Callable[[Log, Path, Settings, Path], Result]] = {
    "estimate": estimate,
    "validate": validate,
    "diagnose": diagnose,
}


def run_one(log: Log, path: Path, settings: Settings, scratch: Path) -> Result:
    """Do what is asked for to a log, and see that it stayed what it was.

    Parameters
    ----------
    log : of the plan
    path : of it here
    settings : what is asked for
    scratch : an empty folder for what is written

    Raises
    ------
    VsalogError
        The log is at fault, changed meanwhile, or a file cannot be written.
    """
    before = _state(path)
    result = COMMANDS[settings.do](log, path, settings, scratch)
    if _state(path) != before:
        raise ReadError(f"{log.name}: changed while it was worked on; run again with --resume when it is complete")
    return result


def _state(path: Path) -> list[tuple[str, int, int, int]]:
    """Return what changes when a log does; its hash, which is taken only once, would not tell when it was taken."""
    if not path.exists():
        raise ReadError(f"{path}: there is no such file")
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    return [(str(p), s.st_size, s.st_mtime_ns, s.st_ino) for p in files for s in (p.stat(),)]


def _rig(settings: Settings) -> Rig | None:
    return None if settings.rig is None else Rig.from_toml(settings.rig, settings.rig_name)


def _rig_text(settings: Settings) -> str | None:
    """Return the rig as TOML text, which differs from a file's name by its line ends."""
    return None if settings.rig is None else f"\n{settings.rig}"


def _model(settings: Settings, folder: Path) -> Path:
    """Write the model to validate into a folder."""
    assert settings.model is not None
    (folder / "model").mkdir()
    file = folder / "model" / settings.model_name
    file.write_text(settings.model, encoding="utf-8")
    return file


def _reports(log: Log, **files: Path) -> dict[str, tuple[Path, str]]:
    return {what: (file, f"reports/{encoded(log.name)}/{file.name}") for what, file in files.items()}


def _device(rig: Rig) -> str:
    """Return what the data set calls the machine: the rig's name, else its joints'."""
    return device_name(rig.name or "+".join(rig.joints))


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
