"""A sensor read in a control loop is undone as one that is read from a log."""

import numpy as np
import pytest

from vsalog.estimation.live import LiveEstimate
from vsalog.rig import Rig


class Fold:
    """Keeps what an estimator would be given."""

    def step(self, state, block):
        self.block = block
        return state, []


def test_an_encoder_off_its_axis_is_undone_in_a_loop():
    text = Rig.preset("sea").to_toml()
    encoder = (
        '{ channel = "q", gain = 1.1, offset = 0.02, drift = 0.3, eccentricity = { amplitude = 0.01, phase = 0.4 } }'
    )
    rig = Rig.from_toml(text + "\n").with_setting("joint.sea.signals.link_position", encoder)
    live = LiveEstimate(rig.file, "sea", "impedance", {})
    live.fold, live.state, live.period = Fold(), None, 1e-3
    roles = live.reads["sea"]
    assert "link_position" in roles
    x, k = 0.7, 500
    said = dict.fromkeys(roles, 0.0) | {"link_position": 1.1 * x + 0.02 + 0.3 * 0.5 + 0.01 * np.sin(x + 0.4)}
    live.take(k, {"sea": said})
    assert live.fold.block.roles["link_position"][0] == pytest.approx(x, abs=1e-12)
