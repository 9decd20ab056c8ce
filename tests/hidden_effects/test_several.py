"""That the battery of several logs hides what it says, and scores what it should."""

import numpy as np
import pytest

from .several import BEGAN, STORIES, Score, make, score, table


@pytest.fixture(scope="module")
def softening():
    return make("softens", "elastic", 3)


@pytest.fixture(scope="module")
def zeros():
    return make("zeros", "elastic", 2)


def cause(hidden, log=None, alike=()):
    return {
        "cause": hidden.effect.cause,
        "part": hidden.part,
        "log": log,
        "material": True,
        "indistinguishable_from": list(alike),
    }


def told(case, values, rate, since):
    """A diagnosis that says so of the changing spring."""
    first = case.changing[0]
    trend = {
        "cause": first.effect.cause, "part": first.part, "number": "factor", "logs": [f"log{k}" for k in range(len(values))],
        "values": values, "intervals": [[v - 1e-3, v + 1e-3] for v in values], "since": since, "per_day": rate,
        "per_day_interval": [rate - 1e-6, rate + 1e-6],
    }  # fmt: skip
    return {"verdict": "explained", "causes": [cause(first, "log9")], "trends": [trend]}


def test_a_spring_that_softens_is_as_it_was_and_then_softer_from_log_to_log(softening):
    factors = np.array([h.parameters["factor"] for h in softening.changing])
    assert len(factors) == STORIES["softens"].logs == 10
    assert factors[0] == 1.0
    assert np.all(np.diff(factors) <= 0.0)
    begins = np.flatnonzero(factors < 1.0)[0]
    days = np.array(softening.days)
    # On a line with where it began.
    assert np.ptp(np.diff(factors[begins - 1 :]) / np.diff(days[begins - 1 :])) == pytest.approx(0.0, abs=1e-12)
    assert [round((s[0] - BEGAN) / 86400.0, 6) for s in softening.stamps] == [round(d, 6) for d in softening.days]
    assert len({len(s) for s in softening.stamps}) > 1  # a rate of its own in each log


def test_a_diagnosis_is_scored_by_what_is_hidden(softening):
    values = [h.parameters["factor"] for h in softening.changing]
    began = next(k for k, v in enumerate(values) if v < 1.0)
    rate = (values[-1] - values[began]) / (softening.days[-1] - softening.days[began])
    nothing = {"verdict": "consistent", "causes": [], "trends": []}
    right = told(softening, values, rate, f"log{began}")
    seen = score("x", softening, right, nothing)
    assert (seen.found, seen.onset, seen.rate, seen.false) == (True, 0, True, [])
    assert all(seen.covered)
    off = told(softening, [v - 0.01 for v in values], 2.0 * rate, f"log{began - 1}")
    off["causes"].append(off["causes"][0] | {"cause": "link.contact", "part": "link"})
    seen = score("x", softening, off, right)
    assert (seen.onset, seen.rate, seen.false, seen.single_false) == (-1, False, ["link.contact@link"], [])
    assert not any(seen.covered)
    assert score("x", softening, nothing, nothing).found is False


def test_two_encoders_are_separated_where_the_right_one_is_named_alone(zeros):
    (hidden,) = zeros.changing[:1]
    right = {"verdict": "explained", "causes": [cause(hidden)], "trends": []}
    (other,) = {"motor_position", "link_position"} - {hidden.part}
    class_of_two = {**right, "causes": [cause(hidden, alike=[f"sensor.encoder_offset ({other})"])]}
    wrong = {**right, "causes": [cause(hidden) | {"part": other}]}
    seen = score("x", zeros, right, class_of_two)
    assert (seen.apart, seen.single_apart) == (True, False)
    assert score("x", zeros, wrong, right).apart is False


def test_the_first_log_of_two_set_points_does_not_show_the_links_weight(zeros):
    hangs = float(zeros.bench.nominal.link[0]["hangs_at"])
    weights = [np.ptp(np.sin(log["link_position"] - hangs)) / np.ptp(log["link_position"]) for log in zeros.logs]
    assert weights[0] < 0.1 < 0.5 < weights[1]


def test_a_diagnosis_that_fails_is_counted(softening):
    failed = score("x", softening, "boom", None)
    row = table([failed, Score("y", "softens", "elastic", "explained", seconds=8.0, single_seconds=1.0)]).splitlines()[
        2
    ]
    assert row.split(" | ")[-2:] == ["1/2", "8.0 × |"]
