"""A valve: how wide its orifices are, and where its middle is."""

from __future__ import annotations

from vsalog.effects.base import Default, Effect, OneNumber

EFFECT = Effect(
    tolerances=(
        Default(("inflow_area", "outflow_area", "area_scale"), "effective areas from flow curves", share=0.2),
    ),
    causes=(
        OneNumber(
            name="pneumatic.orifice_area", place="valve", key="area_scale", number="scale", unit="1", step=1e-3,
            low=0.02, high=50.0,
            title="The orifices of {part} let more or less air through than in the rig, by one factor in and out",
            says="its muscle's pressure changes faster or more slowly than in the rig, by one factor",
            confirm="Step the valve's voltage with the joint clamped: the pressure ends where it should, but sooner or later.",
            reference="Shin 2021 §II-B2, A₁ and A₂",
            signature="pressure equation: the valve's flow, over V",
        ),
        # The map has corners: a step no longer than the distance between them.
        OneNumber(
            name="pneumatic.valve_offset", place="valve", key="offset", number="offset", unit="V",
            step=lambda s: 1e-4 * s.range, low=lambda s: -s.range, high=lambda s: s.range,
            reach=lambda s: 0.1 * s.range, scale=lambda s: s.range,
            title="The middle of {part} is at another voltage than in the rig",
            says="its muscle's pressure is off as if another voltage had been commanded",
            confirm="Hold the voltage at which the valve should be half open, and see which pressure its muscle ends at.",
            reference="Shin 2021 §II-B2, Fig. 5c: the map κ",
            signature="pressure equation: the flow's change with the voltage, over V",
        ),
    ),
)  # fmt: skip
