"""`vsalog.estimate`: the stiffness of a log's joints in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vsalog.core.recording import Recording
from vsalog.estimation.job import Options, prepare
from vsalog.estimation.joint import JointEstimate
from vsalog.rig import Rig


def estimate(
    logs: str | Path | Recording | Sequence[str | Path | Recording],
    rig: Rig | str | Path | None = None,
    *,
    joints: Sequence[str] = (),
    estimator: str = "auto",
    tune: Mapping[str, Any] | None = None,
    set: Mapping[str, Any] | None = None,
    rate: float | None = None,
    time: str = "auto",
    start: str | None = None,
    end: str | None = None,
) -> list[JointEstimate]:
    """Estimate the stiffness of the joints of a log, as ``vsalog estimate`` does, without writing files.

    Parameters
    ----------
    logs : a log's path or a recording, or several that make one model
    rig : a rig, its file or a preset's name; that in the log, or next to it, when absent
    joints : names of the joints wanted; all when empty
    estimator : ``residual-rls``, ``qr-rls``, ``batch-ls``, ``direct``, ``algebraic``, ``impedance``,
        ``impedance-coupled``, ``grioli-bicchi``, ``grioli-parametric``, ``acceleration-observer``, ``pam-ukf``,
        ``pam-smoother``, ``pam-model``, one of a third party's, or ``auto``
    tune : what to tune, e.g. ``{"forgetting": 0.98}``; docs/explanation/estimators/ lists it, a page per method
    set : changes to the rig, e.g. ``{"joint.elbow.motor.damping": "1 N*mm*s/rad"}``; ``setpoint`` fixes the set-point
    rate : samples per second of a table without a time column [Hz]
    time : which clock to trust: auto, header, log or publish
    start, end : the part of each log that is used: seconds from its beginning, ``"2 min"``, an ISO 8601 date or a time since the
        epoch

    Returns
    -------
    one `JointEstimate` per joint, with its `trace`, `model`, `summary` and `warnings`

    Raises
    ------
    VsalogError
        What the input is to blame for; the message says what, where and what to do.
    """
    if isinstance(logs, str | Path | Recording):
        logs = [logs]
    options = Options(
        rig,
        tuple(joints),
        estimator,
        {k: str(v) for k, v in (tune or {}).items()},
        {k: str(v) for k, v in (set or {}).items()},
        rate,
        time,
        start,
        end,
    )
    return prepare([log if isinstance(log, Recording) else Path(log) for log in logs], options).run()
