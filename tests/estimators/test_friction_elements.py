"""Loops found by linear fits, of strains that are integrated here."""

import numpy as np
import pytest

from vsalog.estimators.loops import Element, loops_among, refined, with_another

pytestmark = pytest.mark.share(2)

TIME = np.arange(0.0, 10.0, 0.01)
DEFLECTION = 0.04 * np.sin(2.0 * TIME) + 0.02 * np.sin(7.3 * TIME + 1.0)
SLIPS = tuple(0.03 * 0.5 ** np.arange(0.0, 4.5, 0.5))
NOISE = 0.007


KNOWN = {}


def strains(elements):
    """Return those of elements, shape (N, n)."""
    new = [element for element in elements if element not in KNOWN]
    KNOWN.update(zip(new, integrated(new).T, strict=True) if new else ())
    return np.column_stack([KNOWN[element] for element in elements])


def integrated(elements):
    """Integrate dz/du = 1 − |z|ⁿ (σ sign(z du) + 1 − σ) by the midpoint rule; what slips at once is clipped."""
    slip, sharpness, shape = (np.array(own) for own in zip(*elements, strict=True))
    sudden = sharpness < 0.01
    n = 1.0 / np.where(sudden, 1.0, sharpness)
    z, out = np.zeros(slip.size), np.zeros((TIME.size, slip.size))

    def rate(z, sign):
        return 1.0 - np.abs(z) ** n * (shape * np.sign(z) * sign + 1.0 - shape)

    for k, change in enumerate(np.diff(DEFLECTION), 1):
        step = change / slip / 4.0
        for _ in range(4):
            middle = z + 0.5 * step * rate(z, np.sign(change))
            smooth = z + step * rate(middle, np.sign(change))
            z = np.clip(np.where(sudden, z + step, smooth), -1.0, 1.0)
        out[k] = z * slip
    return out


def fit_of(loops, seed=0):
    """Return the fit of a cubic spring with loops, stiffness and element each, whose torque has noise."""
    noise = NOISE * np.random.default_rng(seed).normal(size=TIME.size)
    pulled = strains([element for _, element in loops]) @ [stiffness for stiffness, _ in loops]
    base = np.column_stack((DEFLECTION, DEFLECTION**3, np.ones(TIME.size)))
    torque = base @ [20.0, 2000.0, 0.1] + pulled + noise

    def fit(elements):
        return np.linalg.qr(np.column_stack((base, strains(elements), torque)) / NOISE, mode="r")

    return fit


@pytest.mark.parametrize("element", [Element(0.012, 1.0, 0.5), Element(0.008, 0.5, 0.8), Element(0.02, 1.0 / 3.0, 0.6)])
def test_a_loop_is_found(element):
    (found,) = with_another(fit_of([(15.0, element)]), SLIPS, [])
    assert abs(found.stiffness - 15.0) < 4.0 * found.stiffness_std < 1.0
    truth = np.array([np.log(element.slip), element.sharpness, element.shape])
    assert np.all(np.abs(found.place - truth) < 4.0 * found.std)
    assert np.all(found.std < 0.05)
    assert found.form.least <= found.form.exponent <= found.form.most


def test_one_that_slips_at_once_has_no_more_sharpness_than_the_log_can_tell():
    (found,) = with_another(fit_of([(15.0, Element(0.01))]), SLIPS, [])
    assert found.place[1] < 0.05
    assert found.torque == pytest.approx(0.15, rel=0.02)


def test_without_a_loop_none_is_found():
    assert sum(len(with_another(fit_of([(0.0, Element(0.01))], seed), SLIPS, [])) for seed in range(20)) == 0


def test_a_second_loop_is_found_next_to_the_first():
    fit = fit_of([(15.0, Element(0.004, 0.5, 0.7)), (10.0, Element(0.02, 0.5, 0.7))])
    first = with_another(fit, SLIPS, [])
    both = with_another(fit, SLIPS, first)
    assert len(both) == 2
    assert sorted(np.exp(one.place[0]) for one in both) == pytest.approx([0.004, 0.02], rel=0.1)


def test_the_standard_deviations_are_those_of_many_noises():
    truth = Element(0.01, 0.5, 0.7)
    found = [with_another(fit_of([(15.0, truth)], seed), SLIPS, [])[0] for seed in range(30)]
    off = np.array([(one.place - [np.log(0.01), 0.5, 0.7]) / one.std for one in found])
    # Four standard errors of the spread of thirty.
    assert np.all(np.abs(np.sqrt(np.mean(off**2, axis=0)) - 1.0) < 4.0 / np.sqrt(60.0))


def test_a_loop_that_is_known_stays_where_it_is_and_is_read_from_its_elements():
    fit = fit_of([(15.0, Element(0.01, 0.5, 0.7))])
    (known,) = with_another(fit, SLIPS, [])
    (again,) = refined(fit, SLIPS, [known])
    assert np.all(np.abs(again.place - known.place) < 0.2 * known.std)
    elements = again.simplex.elements
    shares = np.r_[0.0, (again.place - again.simplex.first) / again.simplex.sides]
    shares[0] = 1.0 - shares.sum()
    (read,) = loops_among(elements, 15.0 * shares, np.eye(4))
    np.testing.assert_allclose(read.place, again.place, rtol=1e-9)
    assert loops_among([Element(slip) for slip in SLIPS], np.ones(len(SLIPS)), np.eye(len(SLIPS))) == []
