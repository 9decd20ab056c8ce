"""Draws the picture in the README: the stiffness of the VSA-II sample log next to the simulator's truth.

pip install matplotlib && python docs/picture.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import vsalog
from vsalog.simulation.experiments import vsa2_experiment

ROOT = Path(__file__).parent.parent
INK, BAND, TRUTH = "#1f5f99", "#9ec4e6", "#222222"


def main() -> None:
    """Estimate, draw, save."""
    (joint,) = vsalog.estimate(ROOT / "sample_logs" / "vsa2_exp1.mcap")
    total, t = joint.trace["total"], joint.trace.time
    truth = vsa2_experiment(1, seed=1).truth["stiffness_total"]
    sigma, std = total["stiffness"], total["stiffness_std"]
    figure, axes = plt.subplots(figsize=(9, 3.4), layout="constrained")
    axes.plot(t, truth, color=TRUTH, lw=1.0, ls="--", label="simulator's truth")
    axes.fill_between(t, sigma - 2 * std, sigma + 2 * std, color=BAND, lw=0, label="± 2 standard deviations")
    axes.plot(t, sigma, color=INK, lw=1.2, label="estimate, from motor signals alone")
    unsupported = ~total["excited"]
    axes.fill_between(
        t,
        0,
        1,
        where=unsupported,
        transform=axes.get_xaxis_transform(),
        color="0.93",
        lw=0,
        label="not supported by the data",
    )
    axes.set(xlabel="time [s]", ylabel="stiffness [N·m/rad]", xlim=(0, 20), ylim=(0.25, 0.75))
    axes.legend(loc="upper right", ncols=2, frameon=False, fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(ROOT / "docs" / "images" / "vsa2_stiffness.png", dpi=110)
    print(
        f"{np.mean(np.abs(sigma - truth)[t > 2] <= 2 * std[t > 2]):.0%} of the truth lies within two standard deviations"
    )


if __name__ == "__main__":
    main()
