"""A pneumatic muscle: holes, and how strongly it pulls."""

from __future__ import annotations

from vsalog.effects.base import Default, Effect, OneNumber

EFFECT = Effect(
    tolerances=(
        Default(("force_gain",), "muscles of one make differ in length and diameter", share=0.1),
        Default(("leak_area",), "unknown holes, to 1 % of a valve's area", share=1.0, share_of_scale=0.01),
    ),
    causes=(
        OneNumber(
            name="pneumatic.leak", place="filled muscle", key="leak_area", number="area", unit="m^2",
            step=lambda s: 1e-4 * s.range, low=0.0, high=lambda s: 100.0 * s.range, scale=lambda s: s.range,
            title="Air leaks out of {part}, and in the rig it does not",
            says="its pressure falls faster than in the rig, the more so the higher it is, whatever the valve does",
            confirm="Fill the muscle, shut its valve or pinch the hose, and see how fast the pressure falls; listen, or use "
            "soap water.",
            reference="Shin 2021 eq. 4 and 5, with one more orifice to the outside",
            signature="pressure equation: the flow of an orifice to the outside, over V",
        ),
        OneNumber(
            name="pneumatic.force_gain", place="pulling muscle", key="force_gain", number="gain", unit="1", step=1e-3,
            low=0.05, high=20.0,
            title="{part} pulls more or less strongly than in the rig, by one factor",
            says="the joint's torque is off in proportion to that muscle's pull",
            confirm="Hang a known weight on that muscle alone and see which pressure holds it at a given length.",
            reference="Shin 2021 eq. 6 and 7: v and w are fitted, and rubber ages",
            signature="torque equations: r cos ψ F of that muscle",
        ),
    ),
)  # fmt: skip
