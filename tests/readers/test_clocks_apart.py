"""Topics with header stamps and topics without any, in one joint."""

from __future__ import annotations

import pytest
from random_messages import STORES
from write_logs import MS, START, McapLog, joint_state

from vsalog.binding.joint import bind
from vsalog.core.errors import BindingError
from vsalog.readers import read
from vsalog.rig import Rig

RIG = """
[joint.j]
kind = "elastic"
[joint.j.signals]
motor_position = "/joint_states.position[motor]"
motor_torque = "/joint_states.effort[motor]"
torque_sensor = { channel = "/torque.data", unit = "N*m" }
"""
ROLES = ("motor_position", "motor_torque", "torque_sensor")


def log_of(path, late):
    log, number = McapLog(), STORES[False].types["std_msgs/msg/Float64"]
    for i in range(200):
        log.add(
            "/joint_states", joint_state(START + i * MS, ["motor"], [i], [], [i]), START + i * MS + round(late * 1e9)
        )
        log.add("/torque", number(float(i)), START + i * MS)
    return log.save(path)


def apart_of(path, time="auto", roles=ROLES):
    ((name, joint),) = Rig.from_toml(RIG).joints.items()
    findings = bind([read(path, time=time)], name, joint, roles).findings
    assert bind([read(path, time=time, room=0)], name, joint, roles).findings == findings
    return [finding for finding in findings if finding.code == "recording.clocks_apart"]


@pytest.mark.parametrize("late", [0, 0.0004, -0.0004, 0.0009])
def test_clocks_that_agree_are_no_matter(tmp_path, late):
    assert apart_of(log_of(tmp_path / "log", late)) == []


def test_clocks_that_are_over_a_millisecond_apart_are_reported(tmp_path):
    (found,) = apart_of(log_of(tmp_path / "log", 0.0011))
    assert (found.value, found.limit) == (pytest.approx(0.0011), 1e-3)


@pytest.mark.parametrize("late", [0.004, -0.09])
def test_clocks_that_are_a_little_apart_are_found(tmp_path, late):
    path = log_of(tmp_path / "log", late)
    (apart,) = apart_of(path)
    assert apart.evidence == {"stamped": "/joint_states", "other": "/torque", "clock": "log"}
    assert apart.value == pytest.approx(abs(late))
    assert apart_of(path, "log") == apart_of(path, roles=ROLES[:2]) == []


def test_clocks_that_are_far_apart_are_refused_unless_asked_for(tmp_path):
    path = log_of(tmp_path / "log", 0.15)
    with pytest.raises(BindingError, match=r"0\.15 s apart; --time log puts all on one clock, --time header uses"):
        apart_of(path)
    ((name, joint),) = Rig.from_toml(RIG).joints.items()
    with pytest.raises(BindingError, match="apart"):
        bind([read(path, room=0)], name, joint, ROLES)
    assert len(apart_of(path, "header")) == 1
    assert apart_of(path, "log") == []
