"""What an effect has to keep to: ours do, and what does not is reported in words before anything is computed."""

from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace
from numba.core.errors import TypingError

from vsalog.core.errors import ExtensionError
from vsalog.core.quantities import Angle, Torque
from vsalog.effects import effects
from vsalog.effects.base import Effect, Key, OneNumber
from vsalog.effects.body_torque import BodyTorque
from vsalog.effects.contract import keep_contract
from vsalog.effects.counterpart import Counterpart
from vsalog.effects.reading_error import ReadingError
from vsalog.rig.effect_tables import Body, composed
from vsalog.simulation import play as played


class Detent(BodyTorque, frozen=True):
    torque: Torque = 0.0

    @staticmethod
    def formula(x, v, t, p, at):
        return p[at] * np.sin(6.0 * x)

    def numbers(self, ratio):
        return (self.torque,)

    def slopes(self, ratio):
        return 6.0 * abs(self.torque), 0.0

    def geared(self, ratio):
        return replace(self, torque=self.torque * ratio)


class Wobble(ReadingError, frozen=True):
    UNIT = "rad"
    amplitude: Angle = 0.0

    def error(self, x):
        return self.amplitude * np.sin(x)

    def slope(self, x):
        return self.amplitude * np.cos(x)

    def curvature(self, x):
        return -self.error(x)

    @property
    def largest(self):
        return abs(self.amplitude), abs(self.amplitude)

    def scaled(self, factor):
        return replace(self, amplitude=self.amplitude * factor)


def with_torque(**changed):
    methods = {name: staticmethod(f) if name == "formula" else f for name, f in changed.items()}
    return Effect(keys=(Key("motor", "detent", type("Changed", (Detent,), methods, frozen=True), "detents"),))


def with_error(**changed):
    return Effect(keys=(Key("signal", "wobble", type("Changed", (Wobble,), changed, frozen=True), "a wobble"),))


ROW = dict.fromkeys(("title", "says", "confirm", "reference", "signature", "number", "unit"), "")
WRONG = {
    "no effect": object(),
    "a list of keys": Effect(keys=[]),
    "a counterpart of an unknown part": Effect(counterparts=(Counterpart("wall", ("torque",)),)),
    "a counterpart of a name that is no tuple": Effect(counterparts=(Counterpart("link", "torque"),)),
    "an unknown place": Effect(causes=(OneNumber(name="a", place="wall", key="torque", step=1.0, **ROW),)),
    "an unknown part": Effect(keys=(Key("moter", "detent", Detent, "detents"),)),
    "an error on a motor": Effect(keys=(Key("motor", "wobble", Wobble, "a wobble"),)),
    "a torque on a signal": Effect(keys=(Key("signal", "detent", Detent, "detents"),)),
    "no name": Effect(keys=(Key("motor", "de-tent", Detent, "detents"),)),
    "no formula": Effect(keys=(Key("motor", "detent", BodyTorque, "detents"),)),
    "too few arguments": with_torque(formula=lambda x, v, t, p: x),
    "a branch": with_torque(formula=lambda x, v, t, p, at: p[at] if x > 0.0 else 0.0),
    "a number for an array": with_torque(formula=lambda x, v, t, p, at: p[at]),
    "what the formula has not": with_torque(formula=lambda x, v, t, p, at: p[at + 1] * x),
    "arguments that are changed": with_torque(formula=lambda x, v, t, p, at: np.multiply(x, p[at], out=x)),
    "sums of an array": with_torque(formula=lambda x, v, t, p, at: p[at] * x * np.size(x)),
    "a torque by default": with_torque(formula=lambda x, v, t, p, at: x),
    "numbers that are none": with_torque(numbers=lambda self, ratio: (float("nan"),)),
    "a number for numbers": with_torque(numbers=lambda self, ratio: 1.0),
    "more numbers behind a gear": with_torque(numbers=lambda self, ratio: (0.0,) * int(ratio)),
    "a negative slope": with_torque(slopes=lambda self, ratio: (-1.0, 0.0)),
    "an infinite slope": with_torque(slopes=lambda self, ratio: (float("inf"), 0.0)),
    "nothing geared": with_torque(geared=lambda self, ratio: None),
    "no unit": with_error(UNIT=None),
    "an error by default": with_error(error=lambda self, x: x),
    "a curvature of another shape": with_error(curvature=lambda self, x: np.zeros(3)),
    "one bound": with_error(largest=1.0),
    "nothing scaled": with_error(scaled=lambda self, factor: None),
}


@pytest.mark.parametrize("name", effects())
def test_ours_keep_to_it(name):
    keep_contract(effects()[name])


def test_what_keeps_to_it_is_taken():
    keep_contract(Effect(keys=(Key("motor", "detent", Detent, "detents", many=True),)))
    keep_contract(with_error())


@pytest.mark.filterwarnings("ignore::numpy.exceptions.VisibleDeprecationWarning")
@pytest.mark.parametrize("what", WRONG)
def test_what_does_not_is_refused(what):
    # What its own code raises is reported by who loads it.
    with pytest.raises((ValueError, TypeError, IndexError)):
        keep_contract(WRONG[what])


def test_a_key_that_the_part_has_is_refused(monkeypatch):
    class Shaft(Body, frozen=True):
        damping: Torque = 0.0

    for name in ("damping", "torques"):
        found = {"detent": Effect(keys=(Key("motor", name, Detent, "detents"),))}
        monkeypatch.setattr("vsalog.rig.effect_tables.effects", lambda found=found: found)
        with pytest.raises(ExtensionError, match=f"'{name}'"):
            composed(Shaft, "motor")


def test_a_formula_that_cannot_be_compiled_is_reported_by_its_module(monkeypatch):
    def fails(*_):
        raise TypingError("no way")

    monkeypatch.setattr(played, "integrate", fails)
    with pytest.raises(TypingError):  # ours would be a bug
        played._integrated()
    theirs = SimpleNamespace(__module__="bench", formula=SimpleNamespace(__module__="bench.detent"))
    monkeypatch.setattr(played, "TORQUES", (*played.TORQUES, theirs))
    with pytest.raises(ExtensionError, match=r"bench\.detent"):
        played._integrated()
