"""The kinematics of a chain against closed forms, textbook formulas and differences of positions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.mechanics.kinematics import (
    chain_motion,
    point_acceleration,
    point_position,
    rotation_of,
    specific_force,
)
from vsalog.rig.chain import Accelerometer, Chain, ChainLink

T = np.arange(2001) * 1e-3
# One link that swings in a vertical plane: x points down along the link at q = 0, z is the axis, y to the side.
PENDULUM = Chain(gravity=(9.81, 0.0, 0.0), link=(ChainLink(joint="a", length=0.7),))
# The arm of De Luca 2007 §II and any textbook: two links in one plane.
TWO = Chain(gravity=(0.0, -9.81, 0.0), link=(ChainLink(joint="a", length=0.5), ChainLink(joint="b", length=0.3)))
# Nothing in it is parallel to anything.
SPATIAL = Chain(
    link=(
        ChainLink(joint="a", length=0.1, offset=0.4, twist=1.2, angle=0.3),
        ChainLink(joint="b", length=0.5, offset=-0.1, twist=-0.7),
        ChainLink(joint="c", length=0.2, offset=0.05, twist=0.4, angle=-1.0),
    )
)
POINT = (0.05, -0.12, 0.08)


def smooth(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and acceleration of joints that all move differently."""
    k = np.arange(1, count + 1)
    phase, rate, size = 0.7 * k, 1.3 * k, 1.0 / k
    at = np.multiply.outer(T, rate) + phase
    return size * np.sin(at), size * rate * np.cos(at), -size * rate**2 * np.sin(at)


def test_a_pendulum_feels_tangential_and_centripetal_acceleration() -> None:
    q, dq, ddq = smooth(1)
    (link,) = chain_motion(PENDULUM, q, dq, ddq)
    reading = specific_force(link, Accelerometer(), PENDULUM.gravity)
    x, v, a = q[:, 0], dq[:, 0], ddq[:, 0]
    np.testing.assert_allclose(reading[:, 0], -0.7 * v**2 - 9.81 * np.cos(x), atol=1e-12)
    np.testing.assert_allclose(reading[:, 1], 0.7 * a + 9.81 * np.sin(x), atol=1e-12)
    np.testing.assert_allclose(reading[:, 2], 0.0, atol=1e-12)


def test_a_free_pendulum_feels_nothing_along_its_path() -> None:
    """Falling on a circle: where q̈ = −(g/l) sin q, an accelerometer at the mass cannot tell that it moves sideways."""
    q = np.linspace(-3.0, 3.0, 50)[:, None]
    (link,) = chain_motion(PENDULUM, q, np.zeros_like(q), -9.81 / 0.7 * np.sin(q))
    assert np.abs(specific_force(link, Accelerometer(), PENDULUM.gravity)[:, 1]).max() < 1e-12


@pytest.mark.parametrize("orientation", [(0.0, 0.0, 0.0), (0.4, -0.9, 2.0)])
def test_at_rest_it_reads_g_upwards_wherever_it_sits(orientation: tuple[float, ...]) -> None:
    q, _, _ = smooth(3)
    still = np.zeros_like(q)
    tip = chain_motion(SPATIAL, q, still, still)[-1]
    mounting = Accelerometer(position=POINT, orientation=orientation)
    axes = tip.rotation @ rotation_of(orientation)
    # The sensor's axes in the base's frame: their third components are what they have of "up".
    expected = 9.81 * axes[:, 2, :]
    np.testing.assert_allclose(specific_force(tip, mounting, SPATIAL.gravity), expected, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(expected, axis=1), 9.81)


def test_two_links_in_a_plane_as_in_the_textbooks() -> None:
    q, dq, ddq = smooth(2)
    tip = chain_motion(TWO, q, dq, ddq)[1]
    (a, b), (da, db), (dda, ddb) = q.T, dq.T, ddq.T
    s, ds, dds = a + b, da + db, dda + ddb
    x = 0.5 * np.cos(a) + 0.3 * np.cos(s)
    y = 0.5 * np.sin(a) + 0.3 * np.sin(s)
    zero = np.zeros_like(x)
    np.testing.assert_allclose(tip.position, np.stack([x, y, zero], axis=1), atol=1e-12)
    speed = [-0.5 * da * np.sin(a) - 0.3 * ds * np.sin(s), 0.5 * da * np.cos(a) + 0.3 * ds * np.cos(s), zero]
    np.testing.assert_allclose(tip.velocity, np.stack(speed, axis=1), atol=1e-12)
    ax = -0.5 * (dda * np.sin(a) + da**2 * np.cos(a)) - 0.3 * (dds * np.sin(s) + ds**2 * np.cos(s))
    ay = 0.5 * (dda * np.cos(a) - da**2 * np.sin(a)) + 0.3 * (dds * np.cos(s) - ds**2 * np.sin(s))
    np.testing.assert_allclose(tip.acceleration, np.stack([ax, ay, zero], axis=1), atol=1e-12)
    np.testing.assert_allclose(tip.angular_velocity, np.stack([zero, zero, ds], axis=1), atol=1e-12)


def homogeneous(link: ChainLink, q: float) -> np.ndarray:
    """R_z(q + angle) T_z(offset) T_x(length) R_x(twist), multiplied out of its four factors."""

    def turn(angle: float, i: int, j: int) -> np.ndarray:
        m = np.eye(4)
        m[i, i] = m[j, j] = np.cos(angle)
        m[i, j], m[j, i] = -np.sin(angle), np.sin(angle)
        return m

    def shift(distance: float, axis: int) -> np.ndarray:
        m = np.eye(4)
        m[axis, 3] = distance
        return m

    return turn(q + link.angle, 0, 1) @ shift(link.offset, 2) @ shift(link.length, 0) @ turn(link.twist, 1, 2)


@given(st.lists(st.floats(-7.0, 7.0), min_size=3, max_size=3))
def test_poses_are_products_of_denavit_hartenberg_s_matrices(q: list[float]) -> None:
    motions = chain_motion(SPATIAL, q, np.zeros(3), np.zeros(3))
    pose = np.eye(4)
    for link, angle, motion in zip(SPATIAL.link, q, motions, strict=True):
        pose = pose @ homogeneous(link, angle)
        np.testing.assert_allclose(motion.rotation, pose[:3, :3], atol=1e-12)
        np.testing.assert_allclose(motion.position, pose[:3, 3], atol=1e-12)
        point = pose @ np.array([*POINT, 1.0])
        np.testing.assert_allclose(point_position(motion, POINT), point[:3], atol=1e-12)


def test_accelerations_are_differences_of_positions() -> None:
    q, dq, ddq = smooth(3)
    for motion in chain_motion(SPATIAL, q, dq, ddq):
        where = point_position(motion, POINT)
        second = (where[2:] - 2.0 * where[1:-1] + where[:-2]) / 1e-6
        np.testing.assert_allclose(point_acceleration(motion, POINT)[1:-1], second, atol=5e-4)


def test_angular_velocity_and_acceleration_are_differences_of_rotations() -> None:
    q, dq, ddq = smooth(3)
    for motion in chain_motion(SPATIAL, q, dq, ddq):
        r = motion.rotation
        skew = (r[2:] - r[:-2]) / 2e-3 @ np.swapaxes(r[1:-1], 1, 2)
        omega = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        np.testing.assert_allclose(motion.angular_velocity[1:-1], omega, atol=2e-4)
        alpha = (motion.angular_velocity[2:] - motion.angular_velocity[:-2]) / 2e-3
        np.testing.assert_allclose(motion.angular_acceleration[1:-1], alpha, atol=2e-4)


def test_roll_pitch_and_yaw_turn_about_the_fixed_axes_in_turn() -> None:
    # x to −z by a pitch of 90°, then −z stays under yaw; y goes to −x under yaw of 90°.
    turned = rotation_of((0.0, np.pi / 2, np.pi / 2))
    np.testing.assert_allclose(turned @ [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(turned @ [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(rotation_of((np.pi / 2, 0.0, 0.0)) @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-12)


def test_leading_dimensions_are_kept() -> None:
    q = np.zeros((4, 5, 2))
    tip = chain_motion(TWO, q, np.ones(2), 0.0)[1]
    assert tip.position.shape == tip.acceleration.shape == (4, 5, 3)
    assert tip.rotation.shape == (4, 5, 3, 3)
    assert specific_force(tip, Accelerometer(), TWO.gravity).shape == (4, 5, 3)
