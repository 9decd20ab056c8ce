"""`vsalog.plan`: which causes a rig's sensors can separate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from vsalog.api.results import Listed, columns, names, texts, warned
from vsalog.core.finding import Finding
from vsalog.core.units import positive_quantity
from vsalog.diagnosis import plan_document as structure
from vsalog.diagnosis.plan import Options, Outcome, sensors_in_si
from vsalog.diagnosis.plan import plan as run
from vsalog.diagnosis.suggest_range import Limits
from vsalog.figures.dot_plots import seen_chart
from vsalog.report.document import Document
from vsalog.report.experiment import scenario_text
from vsalog.report.plan import MOTION_OF, plan_document, planned
from vsalog.report.plot import Drawn
from vsalog.rig import Rig


class Plan(Listed):
    """Which causes of a simulation's error the sensors of a rig separate, and the sensor and the motion that separate more."""

    def __init__(self, found: structure.Plan, outcome: Outcome) -> None:
        self._found, self._outcome = found, outcome

    @property
    def data(self) -> structure.Plan:
        """What ``vsalog plan --json`` prints."""
        return self._found

    @property
    def proposed(self) -> str | None:
        """The proposed motion, a scenario as TOML; None where none is proposed."""
        return None if self._outcome.proposed is None else scenario_text(self._outcome.proposed, *MOTION_OF)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """None: nothing is measured yet."""
        return ()

    def _document(self) -> Document:
        return plan_document(self._found)

    def _figures(self) -> Iterator[Drawn]:
        for joint in self._found.joints:
            if joint.causes:
                yield Drawn(seen_chart(joint.causes), joint.joint)

    _columns = columns(joint=str, cause=str, part=str, seen=float, confused_with=list)

    def _rows(self) -> Iterator[Mapping[str, object]]:
        for joint in self._found.joints:
            for cause in joint.causes:
                others = [
                    f"{rival.cause} ({rival.part})" if rival.part else rival.cause for rival in cause.confused_with
                ]
                yield {
                    "joint": joint.joint,
                    "cause": cause.cause,
                    "part": cause.part,
                    "seen": cause.seen,
                    "confused_with": others,
                }


def plan(
    rig: Rig | str | Path,
    *,
    joints: str | Sequence[str] = (),
    scenario: str | Path | None = None,
    sensors: Sequence[str] | Mapping[str, str] = (),
    max_torque: float | str | None = None,
    max_speed: float | str | None = None,
    max_angle: float | str | None = None,
    set: Mapping[str, object] | None = None,
) -> Plan:
    """Predict which causes of a simulation's error a rig's sensors can separate, as ``vsalog plan`` does, without writing files.

    Parameters
    ----------
    rig : a rig, its file or a preset's name
    joints : names of the joints wanted; all when empty
    scenario : the motion to judge, a scenario's name or file; as for `simulate` when absent
    sensors : roles that could be measured in addition, the cheapest first, or role → noise, one standard deviation with its unit;
        all that the joint's type knows when empty
    max_torque, max_speed, max_angle : limits of the proposed motion [N·m, rad/s, rad], or with a unit
    set : changes to the rig

    Raises
    ------
    VsalogError
        What the input is to blame for; the message says what, where and what to do.
    """
    limits = Limits(
        _limit(max_torque, "N*m", "a torque above zero"),
        _limit(max_speed, "rad/s", "a speed above zero"),
        _limit(max_angle, "rad", "an angle above zero"),
    )
    noises = dict(sensors) if isinstance(sensors, Mapping) else dict.fromkeys(names(sensors), "")
    judged = None if scenario is None else str(scenario)
    outcome = run(rig, Options(names(joints), texts(set), judged, limits, sensors_in_si(noises)))
    return warned(Plan(planned(outcome), outcome))


def _limit(value: float | str | None, unit: str, kind: str) -> float | None:
    return None if value is None else positive_quantity(value, unit, kind)
