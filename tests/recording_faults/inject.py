"""Faults put into recordings, as drivers, converters and scripts make them. It knows nothing of how they are found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.recording import Recording

Array = NDArray[np.float64]
Roles = Mapping[str, Mapping[str, str]]


class Injected(NamedTuple):
    """A fault put into a log.

    Attributes
    ----------
    kind : of fault
    joint, role : that it was put into
    recording : the log with it
    """

    kind: str
    joint: str
    role: str
    recording: Recording


def injected(recording: Recording, roles: Roles, rng: np.random.Generator) -> Iterator[Injected]:
    """Yield a log with each kind of fault in each channel that may have it.

    Parameters
    ----------
    recording : a sound log
    roles : joint → role → channel
    rng : draws factors, delays and times
    """
    for joint, channels in roles.items():
        for role, name in channels.items():
            if role.startswith(("setpoint", "secondary", "accelerometer", "external", "commanded")):
                continue
            x = np.asarray(recording.channels[name].values, dtype=np.float64)
            if not np.isfinite(x).all() or np.ptp(x) == 0.0:
                continue
            torque = "torque" in role
            for kind, values in _torque(x, _link(recording, channels), rng) if torque else _position(x, rng):
                yield Injected(kind, joint, role, with_values(recording, name, values))
            for kind, values in _any(x, rng):
                yield Injected(kind, joint, role, with_values(recording, name, values))
            yield Injected("two clocks", joint, role, on_other_clock(recording, name, 1.0 + rng.uniform(1.5e-3, 3e-3)))
        yield from _computed(recording, joint, channels, rng)
        for a, b in combinations(sorted(channels), 2):
            if a.removesuffix("_1") == b.removesuffix("_2"):
                yield Injected("exchanged", joint, f"{a} {b}", exchanged(recording, channels[a], channels[b]))
    for one, other in combinations(roles, 2):
        for role in sorted(set(roles[one]) & set(roles[other])):
            if role.startswith(("link_position", "motor_position", "motor_torque", "torque_sensor")):
                both = exchanged(recording, roles[one][role], roles[other][role])
                yield Injected("exchanged", f"{one} {other}", role, both)


def _link(recording: Recording, channels: Mapping[str, str]) -> Array | None:
    name = channels.get("link_position")
    return None if name is None else np.asarray(recording.channels[name].values, dtype=np.float64)


def _torque(x: Array, q: Array | None, rng: np.random.Generator) -> Iterator[tuple[str, Array]]:
    yield "unsigned torque", np.abs(x)
    yield "current called torque", x / rng.uniform(0.02, 0.3)
    yield "other side of the gear", x / rng.integers(20, 160)
    yield "wrong unit", 1000.0 * x
    if q is not None:
        yield "gravity taken out", x - rng.uniform(0.4, 0.8) * np.ptp(x) * np.sin(q)


def _position(x: Array, rng: np.random.Generator) -> Iterator[tuple[str, Array]]:
    yield "wrong unit", np.degrees(x)
    yield "other side of the gear", x * rng.integers(20, 160)
    yield "encoder counts", np.round(x * 4096 / (2.0 * np.pi))
    if np.ptp(x) < 6.0:
        yield "wrapped", np.mod(x - np.median(x), 2.0 * np.pi)


def _any(x: Array, rng: np.random.Generator) -> Iterator[tuple[str, Array]]:
    yield "wrong sign", -x
    late = int(rng.integers(20, 61) * x.size // 20_000) or 1  # 20 to 60 ms of logs of 20 s
    yield "late", np.concatenate((np.full(late, x[0]), x[:-late]))
    n = int(rng.integers(5, 12))
    # A coarse encoder that turns slowly stays as long at a value anyway.
    if float(np.mean(np.abs(np.diff(x[::n])) >= 2.0 * _step(x))) > 0.95:
        yield "held", np.repeat(x[::n], n)[: x.size]
    at = np.arange(x.size)
    yield "interpolated", np.interp(at, at[::n], x[::n])
    low, high = np.quantile(x, (0.15, 0.85))
    yield "clipped", np.clip(x, low, high)
    stuck, length = x.copy(), int(0.035 * x.size)
    begin = _busiest(x, length)
    stuck[begin : begin + length] = x[begin]
    yield "stuck", stuck


def _step(x: Array) -> float:
    """Return the least difference of values that a signal takes."""
    steps = np.diff(np.unique(x))
    return float(steps[steps > 1e-9 * np.ptp(x)].min())


def _busiest(x: Array, length: int) -> int:
    """Return where, away from the ends, a signal moves farthest in so many samples."""
    smooth = np.convolve(x, np.ones(15) / 15.0, mode="same")
    begins = np.arange(2 * length, x.size - 3 * length, max(1, length // 4))
    return int(begins[np.argmax(np.abs(smooth[begins + length] - smooth[begins]))])


def _computed(
    recording: Recording, joint: str, channels: Mapping[str, str], rng: np.random.Generator
) -> Iterator[Injected]:
    for suffix in ("", "_1", "_2"):
        sensor, motor = channels.get(f"torque_sensor{suffix}"), channels.get(f"motor_position{suffix}")
        if sensor is not None and motor is not None and "link_position" in channels:
            phi = recording.channels[channels["link_position"]].values - recording.channels[motor].values
            yield Injected(
                "computed", joint, f"torque_sensor{suffix}", with_values(recording, sensor, rng.uniform(5, 50) * phi)
            )


def with_values(recording: Recording, name: str, values: Array) -> Recording:
    """Return a recording with other values of one channel."""
    channel = replace(recording.channels[name], values=np.ascontiguousarray(values))
    return replace(recording, channels={**recording.channels, name: channel})


def on_other_clock(recording: Recording, name: str, rate: float) -> Recording:
    """Return a recording of which one channel is a topic of its own, stamped by a clock that runs at that rate."""
    channel = recording.channels[name]
    begin = channel.stamps[0]
    stamps = begin + np.round((channel.stamps - begin) * rate).astype(np.int64)
    stream = f"{channel.stream}_{name.rpartition('.')[2]}"
    streams = {**recording.streams, stream: replace(recording.streams[channel.stream], name=stream)}
    moved = replace(channel, stamps=stamps, stream=stream)
    return replace(recording, channels={**recording.channels, name: moved}, streams=streams)


def exchanged(recording: Recording, a: str, b: str) -> Recording:
    """Return a recording of which two channels have each other's values."""
    x, y = recording.channels[a].values, recording.channels[b].values
    return with_values(with_values(recording, a, y), b, x)
