"""What encoders' steps hide while positions rest: sums against their definition, and what rounding does to real fits."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from vsalog.core.signals import JointSignals
from vsalog.estimators import residual_rls
from vsalog.estimators.device import device_of
from vsalog.estimators.resting import Resting, rest_block, rest_covariance
from vsalog.rig import Rig


def stays_of(cells: np.ndarray) -> list[tuple[slice, bool]]:
    """Cut a series of steps into stays; tell of each whether it was only passed through."""
    borders = [0, *(np.flatnonzero(np.diff(cells)) + 1), len(cells)]
    stays = [slice(a, b) for a, b in pairwise(borders)]
    level = [cells[s.start] for s in stays]
    passed = [
        0 < i < len(stays) - 1 and (level[i] - level[i - 1]) * (level[i + 1] - level[i]) > 0.0
        for i in range(len(stays))
    ]
    return list(zip(stays, passed, strict=True))


def by_definition(F, cells, errors, fresh, integral):
    """Σ g gᵀ over stays that are not passed through, g = Σ e F; of an integral Σ e_j G_j, less its mean where its run is over."""
    M = np.zeros((F.shape[1], F.shape[1]))
    runs = [0, *(k for k in np.flatnonzero(fresh) if k), len(F)] if integral else [0, len(F)]
    for begin, end in pairwise(runs):
        part, weights = slice(begin, end), F[begin:end]
        if integral:
            weights = weights[::-1].cumsum(axis=0)[::-1]
            if end != len(F):
                weights = weights - np.arange(len(weights), 0, -1)[:, None] / len(weights) * weights[0]
                weights[:, 0] = 0.0
        for r in range(cells.shape[1]):
            for stay, passed in stays_of(cells[part, r]):
                if not passed:
                    g = (errors[part, r, None] * weights)[stay].sum(axis=0)
                    M += np.outer(g, g)
    return M


@pytest.mark.parametrize("integral", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_sums_follow_their_definition_however_the_rows_are_cut(integral, seed):
    rng = np.random.default_rng(seed)
    count, n, period = 200, 3, 0.01
    F = np.column_stack((np.ones(count), rng.normal(size=(count, n - 1))))
    cells = np.cumsum(rng.integers(-1, 2, size=(count, 2)) * (rng.random((count, 2)) < 0.3), axis=0).astype(float)
    sigma = rng.uniform(1.0, 2.0, count)
    fresh = np.zeros(count, dtype=bool)
    fresh[[0, 90, 150]] = integral
    moves, sizes = np.array([[1.0], [1.0]]), np.array([0.1, 0.3])
    # One transmission, whose stiffness is the last unknown times a slope of one.
    slopes, unknowns = np.zeros((count, 1, n)), np.zeros((count, n))
    slopes[:, 0, -1], unknowns[:, -1] = 1.0, sigma
    directions = rng.normal(size=(count, 2, n))
    state, made = None, []
    for part in (slice(0, 1), slice(1, 70), slice(70, 149), slice(149, count)):
        resting = Resting(cells[part], np.zeros(cells[part].shape, dtype=np.int64), moves, sizes)
        state, out = rest_block(
            state, F[part], np.ones(len(F[part]), dtype=bool), fresh[part], slopes[part], unknowns[part], directions[part],
            resting, period if integral else None, 1.0,
        )  # fmt: skip
        made.append(out)
    errors = sigma[:, None] * sizes * (period if integral else 1.0)
    M = by_definition(F, cells, errors, fresh, integral)
    np.testing.assert_allclose(rest_covariance(state), M, rtol=1e-9, atol=1e-12 * np.abs(M).max())
    expected = np.einsum("mi,ij,mj->m", directions[-1], M, directions[-1])
    np.testing.assert_allclose(np.concatenate(made)[-1], expected, rtol=1e-9)
    halfway = by_definition(F[:120], cells[:120], errors[:120], fresh[:120], integral)
    expected = np.einsum("mi,ij,mj->m", directions[119], halfway, directions[119])
    np.testing.assert_allclose(np.concatenate(made)[119], expected, rtol=1e-9)


@pytest.mark.parametrize("discount", [1.0, 0.99])
def test_what_is_forgotten_weighs_less(discount):
    """Rows before weigh less with each row, their regressors and so the sums over what follows a stay."""
    rng, count, n = np.random.default_rng(7), 60, 2
    F = np.column_stack((np.ones(count), rng.normal(size=count)))
    cells = (np.arange(count) // 20 % 2).astype(float)[:, None]
    slopes, unknowns = np.zeros((count, 1, n)), np.ones((count, n))
    slopes[:, 0, 1] = 1.0
    weights = discount ** np.arange(count)[::-1]
    for integral in (False, True):
        resting = Resting(cells, np.zeros(cells.shape, dtype=np.int64), np.ones((1, 1)), np.array([0.5]))
        state, _ = rest_block(
            None, F, np.ones(count, dtype=bool), np.zeros(count, dtype=bool), slopes, unknowns, np.zeros((count, 1, n)),
            resting, 1.0 if integral else None, discount,
        )  # fmt: skip
        weighted = weights[:, None] * F
        if integral:
            weighted = weighted[::-1].cumsum(axis=0)[::-1]
        g = [0.5 * weighted[stay].sum(axis=0) for stay, _ in stays_of(cells[:, 0])]
        np.testing.assert_allclose(rest_covariance(state), sum(np.outer(x, x) for x in g), rtol=1e-9)


PERIOD, STEP, STIFFNESS, INERTIA, DAMPING = 5e-3, 0.01, 40.0, 0.02, 0.2


def from_rest_to_rest(seed):
    """A linear spring between coarse encoders that moves from rest to rest; written here: nothing of it is the product's."""
    rng, rest, move = np.random.default_rng(seed), 300, 40
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, move + 1) / move)
    theta, q = [np.full(rest, rng.uniform(-0.02, 0.02))], [np.full(rest, rng.uniform(-0.02, 0.02))]
    for k in range(8):
        for x, size in ((theta, 0.03), (q, 0.12)):
            goal = (-1) ** k * size * rng.uniform(0.5, 1.0)
            x.append(x[-1][-1] + (goal - x[-1][-1]) * ramp)
            x.append(np.full(rest, goal))
    theta, q = np.concatenate(theta), np.concatenate(q)
    n, torque = theta.size, STIFFNESS * (q - theta)
    motor = INERTIA * np.gradient(np.gradient(theta, PERIOD), PERIOD) + DAMPING * np.gradient(theta, PERIOD) - torque
    roles = {
        "link_position": STEP * np.round(q / STEP),
        "motor_position": STEP * np.round(theta / STEP),
        "torque_sensor": torque + rng.normal(0.0, 0.01, n),
        "motor_torque": motor + rng.normal(0.0, 0.01, n),
    }
    starts = np.zeros(n, dtype=np.bool_)
    starts[0] = True
    stamps = np.arange(n, dtype=np.int64) * int(PERIOD * 1e9)
    steps = {"link_position": STEP, "motor_position": STEP}
    return JointSignals(
        "sea", PERIOD, stamps, np.arange(n) * PERIOD, roles, starts, np.zeros(n, np.int32), resolution=steps
    )


@pytest.mark.parametrize("method", ["SENSOR", "RESIDUAL"])
def test_a_spring_between_rests_is_known_as_well_as_its_encoders_tell(method):
    """Sixty logs: the stiffness at the deflections it was seen at lies in its band; by left-overs alone half of it does not."""
    scores = []
    for seed in range(60):
        signals = from_rest_to_rest(seed)
        rig = Rig.preset("sea").file.joint["sea"]
        device = device_of("sea", rig, signals.roles)
        tuning = residual_rls.ResidualRlsTuning(modality=method)
        fold = residual_rls.build(device, signals, tuning)
        state, traces = fold.step(fold.start(), signals)
        state, rest = fold.finish(state)
        column = {
            name: np.concatenate([np.asarray(t["1"][name], float) for t in (*traces, *rest)])
            for name in ("stiffness", "stiffness_std", "deflection")
        }
        late = slice(len(signals) // 2, None, 50)
        seen = (np.abs(column["deflection"][late]) > 0.03) & np.isfinite(column["stiffness_std"][late])
        scores.append(((column["stiffness"] - STIFFNESS) / column["stiffness_std"])[late][seen])
    z = np.concatenate(scores)
    assert z.size > 500
    assert np.mean(np.abs(z) < 1.96) > 0.9
    # And it is not hidden behind bands that nothing could leave.
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.1
