"""The devices: how each is drawn, driven, balanced and written down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from . import (
    clamped,
    effects,
    equations,
    machines,
    motion,
    outside,
    pneumatic,
    pneumatic_effects,
    rig_file,
    rigid,
    sensor_effects,
)


@dataclass(frozen=True)
class Device:
    """What is done differently from device to device.

    A rigid joint and a spring bench are devices of families of their own.

    Attributes
    ----------
    random_machine : device, random generator → machine without effects
    wanted : machine, duration, period, random generator, poor → what drives it
    happened : machine, what drives it → truth, none where it broke
    left_over : nominal machine, channels, qualities, slice of the log, period → what its equations leave over
    scales_of : machine, truth → scales
    rig_text : machine, roles → rig.toml
    """

    random_machine: Callable[..., Any]
    wanted: Callable[..., motion.Wanted]
    happened: Callable[..., motion.Truth | None]
    left_over: Callable[..., dict[str, equations.LeftOver]]
    scales_of: Callable[..., effects.Scales]
    rig_text: Callable[..., str]


# Their effects are registered when they are imported.
REGISTERED = (effects, sensor_effects, outside, pneumatic_effects)

_MECHANICAL = Device(
    machines.random_machine,
    motion.wanted,
    motion.happened,
    equations.left_over,
    effects.scales_of,
    rig_file.rig_text,
)
_PNEUMATIC = Device(
    pneumatic.random_machine,
    pneumatic.wanted,
    pneumatic.happened,
    pneumatic.left_over,
    pneumatic_effects.scales_of,
    pneumatic.rig_text,
)
DEVICES = dict.fromkeys(machines.DEVICES, _MECHANICAL) | {"pneumatic": _PNEUMATIC}


def _own(module: Any) -> Device:
    return Device(
        module.random_machine, module.wanted, module.happened, module.left_over, module.scales_of, module.rig_text
    )


ALL_DEVICES = DEVICES | {"rigid": _own(rigid), "bench": _own(clamped)}
