"""Dynamics of a chain of rigid links: M(q) q̈ + C(q, q̇) q̇ + g(q) of De Luca 2007 eq. 1, for the chain of a rig."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsalog.mechanics import _rigid_body
from vsalog.rig.schema import Chain, ChainLink, Payload

Array = NDArray[np.float64]


def bodies(chain: Chain, payloads: dict[str, Payload] | None = None) -> Array:
    """Return the numbers of each link, as the compiled functions read them.

    Parameters
    ----------
    chain : of the rig
    payloads : joint → point mass on its link, on the frame's x-axis, `distance` from the joint's axis

    Returns
    -------
    shape (N, 18)
    """
    return np.array([_body(link, (payloads or {}).get(link.joint)) for link in chain.link])


def inverse_dynamics(
    chain: Chain, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, payloads: dict[str, Payload] | None = None
) -> Array:
    """Return the torques that move the links so [N·m].

    Parameters
    ----------
    chain : of the rig, N links
    q, dq, ddq : shape (…, N) [rad, rad/s, rad/s²], broadcast
    payloads : as for `bodies`

    Returns
    -------
    shape (…, N)
    """
    x, v, a = np.broadcast_arrays(*(np.asarray(values, dtype=np.float64) for values in (q, dq, ddq)))
    x2, v2, a2 = (np.ascontiguousarray(values.reshape(-1, x.shape[-1])) for values in (x, v, a))
    out = np.empty_like(x2)
    links = bodies(chain, payloads)
    numbers = np.concatenate([links.ravel(), chain.gravity])
    _rigid_body.inverse_dynamics_over_time(numbers, links.size, x2, v2, a2, out)
    return out.reshape(x.shape)


def mass_matrix(chain: Chain, q: ArrayLike) -> Array:
    """Return M(q) [kg·m²], shape (N, N), at the position `q`, shape (N,)."""
    weightless = np.asarray(q, dtype=np.float64)
    still = np.zeros_like(weightless)
    gravity = inverse_dynamics(chain, weightless, still, still)
    return np.array([inverse_dynamics(chain, weightless, still, e) - gravity for e in np.eye(weightless.size)]).T


def _body(link: ChainLink, payload: Payload | None) -> Array:
    mass, centre, inertia = link.mass, np.array(link.centre), np.diag(link.inertia)
    if payload is not None and payload.mass > 0.0:
        point = np.array([payload.distance - link.length, 0.0, 0.0])
        whole = mass + payload.mass
        common = (mass * centre + payload.mass * point) / whole
        inertia = inertia + _point_inertia(mass, centre - common) + _point_inertia(payload.mass, point - common)
        mass, centre = whole, common
    frame = (link.length, link.offset, np.cos(link.twist), np.sin(link.twist), link.angle)
    return np.array([*frame, mass, *centre, *inertia.ravel()])


def _point_inertia(mass: float, r: Array) -> Array:
    return np.asarray(mass * (float(r @ r) * np.eye(3) - np.outer(r, r)))
