"""Named columns as ROS topics: the content of each message, before any encoding."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vsalog.core.errors import WriteError
from vsalog.core.recording import Channel, Recording, Stamps, Values
from vsalog.readers.reach import Nanoseconds

JOINT_STATE = "sensor_msgs/msg/JointState"
FLOAT64 = "std_msgs/msg/Float64"
JOINT_FIELDS = ("position", "velocity", "effort")

_JOINT_CHANNEL = re.compile(r"^(?P<topic>.+)\.(?P<field>position|velocity|effort)\[(?P<name>[^\[\]]+)\]$")


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic: a stamp per message and the columns its messages are made of.

    Attributes
    ----------
    name : topic, starting with a slash
    type : ``sensor_msgs/msg/JointState`` or ``std_msgs/msg/Float64``
    stamps : shape (n,), int64 ns, strictly increasing; the header's stamp and the log time. A Float64 has no header, so
        its time is the log time alone
    columns : (field, element) → shape (n,). Fields of a JointState are ``position``, ``velocity``, ``effort``, elements
        the joints' names; a Float64 has ``data`` and no element
    """

    name: str
    type: str
    stamps: Stamps
    columns: Mapping[tuple[str, str], Values]

    def __post_init__(self) -> None:
        if self.stamps.size and (
            int(self.stamps[0]) < 0 or int(self.stamps[-1]) // Nanoseconds.SECOND > np.iinfo(np.int32).max
        ):
            raise WriteError(f"topic {self.name}: its stamps are outside of what ROS can hold (0 to 2³¹ s)")
        if any(values.shape != self.stamps.shape for values in self.columns.values()):
            raise WriteError(f"topic {self.name}: its columns differ in length")

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of the joints, in order of appearance."""
        return tuple(dict.fromkeys(element for _, element in self.columns))


def topics_of(recording: Recording) -> list[Topic]:
    """Sort a recording's channels into topics.

    ``/topic.position[a]``, ``.velocity[a]``, ``.effort[a]`` become one JointState per stamp. Every other channel becomes
    a Float64 topic: ``/topic.data`` the topic of that name, others the topic that `topic_name` makes of them.

    Raises
    ------
    WriteError
        Two channels would become the same topic, or the channels of one topic have different stamps.
    """
    groups: dict[str, list[tuple[tuple[str, str], Channel]]] = {}
    for name, channel in recording.channels.items():
        match = _JOINT_CHANNEL.match(name)
        topic = topic_name(match["topic"] if match else name.removesuffix(".data"))
        key = (match["field"], match["name"]) if match else ("data", "")
        groups.setdefault(topic, []).append((key, channel))
    return [_topic(name, members) for name, members in groups.items()]


def scalar_topic(name: str, stamps: Stamps, values: Values) -> Topic:
    """Return a Float64 topic of one column."""
    return Topic(name, FLOAT64, stamps, {("data", ""): np.asarray(values, dtype=np.float64)})


def topic_name(name: str) -> str:
    """Return a valid topic name: dots and brackets become slashes, characters that ROS does not allow an underscore.

    >>> topic_name("DESR_N.x00.torque"), topic_name("motor position"), topic_name("/raw.data[3]")
    ('/DESR_N/x00/torque', '/motor_position', '/raw/data/_3')
    """
    parts = [re.sub(r"[^A-Za-z0-9_]", "_", p) for p in re.split(r"[./\[\]]+", name) if p]
    # The parts of a topic's name must not start with a digit.
    return "/" + "/".join(f"_{p}" if p[0].isdigit() else p for p in parts)


def read_back_name(name: str) -> str:
    """Return the name of a channel after it was written as a message.

    >>> read_back_name("/joint_states.effort[a]"), read_back_name("motor torque"), read_back_name("/raw.value.x")
    ('/joint_states.effort[a]', '/motor_torque.data', '/raw/value/x.data')
    """
    match = _JOINT_CHANNEL.match(name)
    if match:
        return f"{topic_name(match['topic'])}.{match['field']}[{match['name']}]"
    return f"{topic_name(name.removesuffix('.data'))}.data"


def _topic(name: str, members: list[tuple[tuple[str, str], Channel]]) -> Topic:
    keys, first = [key for key, _ in members], members[0][1]
    if len(set(keys)) < len(keys) or (("data", "") in keys and len(keys) > 1):
        raise WriteError(f"channels {first.name} and {members[-1][1].name} would become one topic, {name}")
    for _, channel in members[1:]:
        if channel.stamps is not first.stamps and not np.array_equal(channel.stamps, first.stamps):
            raise WriteError(f"channel {channel.name}: its stamps differ from those of {first.name}")
    kind = FLOAT64 if keys[0] == ("data", "") else JOINT_STATE
    return Topic(name, kind, first.stamps, {key: channel.values for key, channel in members})
