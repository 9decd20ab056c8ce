"""What a link may have unlike the rig: inertia, payload, gravity, friction, a push from outside."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from vsalog.core.significance import FALSE_ALARM
from vsalog.diagnosis.causes.base import (
    Cause,
    Parameter,
    Remainder,
    Setting,
    Site,
    link_equation,
    with_part,
)
from vsalog.diagnosis.causes.motor_friction import with_bristles, with_level
from vsalog.effects.base import Exactness
from vsalog.effects.contact import Contact
from vsalog.effects.gravity import Payload

Array = NDArray[np.float64]

# So many pushes at most are outliers of a residual [1]: more frequent bursts are no pushes.
MOST_PUSHES = 3


class _OfLink(Cause):
    """A cause that sits in the link; `of_both` where it is looked for in a link that is rigidly connected to its motor, too."""

    of_both = True

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one where the link's equation can be formed, or that of a motor rigidly connected to it."""
        equation = link_equation(setting)
        if equation == "link" or (equation is not None and self.of_both):
            yield from self.of_link(setting, setting.joint.link)

    def of_link(self, setting: Setting, link: Any) -> Iterator[Site]:
        """Yield the cause in the link."""
        raise NotImplementedError


class LinkPayload(_OfLink):
    """A mass on the link."""

    name = "link.payload"
    title = "The link carries a mass that the rig does not know"
    says = "the link's equation is off by an inertia and a weight together"
    confirm = "Look at the link, or weigh it; take the mass off and record again."
    reference = "Swevers, Verdonck, De Schutter (2007), Dynamic model identification for industrial robots, §payload"
    signature = "link equation: q̈ and sin q together"

    def of_link(self, setting: Setting, link: Any) -> Iterator[Site]:
        """Yield the cause in the link; without gravity it is an inertia like any other."""
        if not link.gravity_torque:
            return
        there, heavy, weighty = link.payload, link.inertia, abs(link.gravity_torque)
        inertia, weight = (there.inertia, there.weight) if there else (0.0, 0.0)
        inertia, weight = max(inertia, 1e-6 * heavy), max(weight, 1e-6 * weighty)
        # A load is anything up to the link itself.
        parameters = (
            Parameter("inertia", "kg*m^2", inertia, 0.01 * heavy, 1e-6 * heavy, scale=heavy, nominal=heavy),
            Parameter(
                "weight",
                "N*m",
                weight,
                0.01 * weighty,
                1e-6 * weighty,
                key="gravity_torque",
                scale=weighty,
                nominal=weighty,
            ),
        )

        def apply(joint: Any, values: Sequence[float]) -> Any:
            load = _payload(values)
            return with_part(joint, "link", payload=Payload(mass=load["mass"][0], distance=load["distance"][0]))

        yield Site(self.name, "link", parameters, apply, report=_payload, excludes=frozenset({"link.gravity"}))


def _payload(values: Sequence[float]) -> dict[str, tuple[float, str]]:
    inertia, weight = max(float(values[0]), 1e-12), max(float(values[1]), 1e-12)
    load = Payload.of(inertia, weight)
    return {"mass": (load.mass, "kg"), "distance": (load.distance, "m")}


class LinkCoulombFriction(_OfLink):
    """Dry friction at the link's bearing."""

    of_both = False  # it is the motor's
    name = "link.coulomb_friction"
    exact = Exactness.CORNERED
    title = "Dry friction of the link is missing in the rig, or has another level"
    says = "the link's equation is off by a level that has the sign of its velocity"
    confirm = (
        "Clamp the motor, deflect the link a little and let go: with dry friction the ringing fades in a straight line and stops"
        " early."
    )
    reference = "Armstrong-Hélouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), §2"
    signature = "link equation: sgn q̇"

    def of_link(self, setting: Setting, link: Any) -> Iterator[Site]:
        """Yield the cause in the link."""
        torque = setting.torque_size()
        parameter = Parameter(
            "torque", "N*m", link.friction.coulomb, 1e-3 * torque, 0.0, key="friction.coulomb", scale=torque
        )
        yield from with_bristles(Site(self.name, "link", (parameter,), with_level("link")), setting)


class LinkContact(_OfLink):
    """A push from outside, once."""

    name = "link.contact"
    exact = Exactness.WAVY
    title = "Something pushed the link for a moment"
    says = "the link's equation is off for a short time only"
    confirm = "Look at what happened at {start}; record again without touching the link."
    reference = "De Luca and Mattone (2005), Sensorless robot collision detection and hybrid force/motion control"
    signature = "link equation: sin²(π (t − t₀) / T)"

    def of_link(self, setting: Setting, link: Any) -> Iterator[Site]:
        """Yield the cause in the link."""
        torque = setting.torque_size()
        parameters = (
            Parameter("start", "s", 0.0, 0.005, 0.0, setting.duration, 0.1, shape=True),
            Parameter("duration", "s", 0.3, 0.005, 0.03, 3.0, 0.1, shape=True, starts=(0.1, 0.3, 1.0)),
            Parameter("torque", "N*m", 0.0, 1e-3 * torque, key="friction.coulomb", scale=torque),
        )

        def apply(joint: Any, values: Sequence[float]) -> Any:
            start, duration, torque = (float(v) for v in values)
            push = Contact(start=max(start, 0.0), duration=max(duration, 1e-3), torque=torque)
            return with_part(joint, "link", contact=(*joint.link.contact, push))

        yield Site(self.name, "link", parameters, apply, partial(_pushes, parameters[1].starts), transient=True)


def _pushes(durations: Sequence[float], left: Remainder) -> list[tuple[float, ...]]:
    """Look for the strongest bump of each duration [s] in the residual of the link's equation, averaged over it."""
    name = "link" if "link" in left.equations else "motor"
    residual = left.equations.get(name)
    if residual is None:
        return []
    period = float(left.time[1] - left.time[0])
    good = np.isfinite(residual)
    values = np.where(good, residual - np.median(residual[good]), 0.0) if good.any() else np.zeros_like(residual)
    found: list[tuple[float, ...]] = []
    for duration in durations:
        length = max(3, round(duration / period))
        if length >= values.size // 2:
            continue
        bell = np.sin(np.pi * (np.arange(length) + 0.5) / length) ** 2
        fit = np.convolve(values, bell, mode="valid") / float(bell @ bell)
        # An encoder errs for moments, where it advances by whole steps from sample to sample or rests: so does noise there.
        again = [np.convolve(np.nan_to_num(n), bell, mode="valid") / float(bell @ bell) for n in left.noise[name]]
        near = uniform_filter1d(np.mean(np.square(again), axis=0), length, mode="constant")
        # What swings in the two lengths before it, or in the two after it, is no push.
        around, within = (
            (2 * n * length + 1) * uniform_filter1d(fit**2, 2 * n * length + 1, mode="constant") for n in (3, 1)
        )
        aside = (around - within) / (4 * length)
        sizes = fit / np.sqrt(np.maximum(np.median(fit**2) + near + aside, 1e-300))
        # What the log begins with may be a loop that is not where the search has it.
        sizes[:length] = 0.0
        k = int(np.argmax(np.abs(sizes)))
        if stands_out(sizes, length):
            found.append((float(left.time[k]), length * period, float(fit[k])))
    return found


def stands_out(sizes: Array, length: int) -> bool:
    """Return whether the largest bumps of a signal exceed the next by more than those differ from each other.

    Squares of the largest of many stretches have an exponential tail, whatever their scale: the k-th spacing times k is from
    one exponential distribution (Rényi 1953, Acta Math. Hungar. 4), and t times the mean of n others is exceeded with probability
    (1 + t / n)⁻ⁿ. A remainder that bursts again and again has no push.

    Parameters
    ----------
    sizes : shape (N,), of a bump that would begin at each sample
    length : of a bump, in samples
    """
    count = sizes.size // (2 * length)
    if count < 4 * MOST_PUSHES:
        return True  # too short to decide
    peaks = np.sort(np.max(np.abs(sizes[: count * 2 * length]).reshape(count, -1), axis=1) ** 2)[::-1][: count // 2]
    spacings = np.arange(1, peaks.size) * -np.diff(peaks)
    for m in range(MOST_PUSHES):
        others = spacings[m + 1 :]
        if (1.0 + spacings[m] / max(float(np.sum(others)), 1e-300)) ** -float(others.size) < FALSE_ALARM:
            return True
    return False
