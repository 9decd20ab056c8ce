"""MJCF, the XML of MuJoCo: springs are fixed tendons between the joints of motors and links.

Motors are bodies without mass next to their links: their inertia is the armature of their joints, and turns with no other link,
as in De Luca's reduced model. An inertial coupling of the chain is the armature of a tendon, less what it adds to both joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from vsalog.export.assembly import Assembly, Taken
from vsalog.export.bodies import Array, Mass, gravity_of
from vsalog.export.collect import Parts
from vsalog.export.elements import Element, child, plain_names
from vsalog.export.springs import Piece, pieces
from vsalog.mechanics.rigid_body import mass_matrix


def mjcf(found: Assembly) -> tuple[Element, list[str]]:
    """Return a rig as MJCF, and notes on the model.

    Parameters
    ----------
    found : the rig, taken apart for MJCF
    """
    return _Model(found).build()


class _Model:
    def __init__(self, found: Assembly) -> None:
        self.found = found
        self.names = plain_names(found.joints)
        self.springs = {
            (name, key): pieces(
                spring.transmission,
                spring.arm,
                *(spring.parts.of("spring", number) for number in ("cubic", "asymmetry", "gap")),
            )
            for name, taken in found.joints.items()
            for key, spring in taken.springs.items()
        }
        self.step = _timestep(found, self.springs)
        self.couplings = dict(self._couplings())
        self.notes: list[str] = []
        self.root = Element("mujoco", model=plain_names([found.rig.name or "rig"]).popitem()[1])

    def build(self) -> tuple[Element, list[str]]:
        chain = self.found.rig.file.chain
        # A body without mass of its own, as a motor next to its armature, gets the least that MuJoCo accepts.
        child(self.root, "compiler", angle="radian", boundmass=1e-9, boundinertia=1e-12)
        option = child(self.root, "option", timestep=self.step, integrator="implicitfast", gravity=gravity_of(chain))
        child(option, "flag", contact="disable")
        world = child(self.root, "worldbody")
        tendons, actuators = Element("tendon"), Element("actuator")
        carriers: dict[str | None, Element] = {None: world}
        for name, taken in self.found.joints.items():
            carriers[name] = self._bodies(carriers[taken.body.parent], name, taken)
            self._drives(actuators, name, taken)
            self._springs(tendons, actuators, name, taken)
        for (link, motor), inertia in self.couplings.items():
            tendon = child(tendons, "fixed", name=f"{link}_{motor}_coupling", armature=abs(inertia))
            child(tendon, "joint", joint=link, coef=1.0)
            child(tendon, "joint", joint=motor, coef=np.sign(inertia))
        self.root.extend(group for group in (tendons, actuators) if len(group))
        return self.root, self.notes

    def _couplings(self) -> Iterator[tuple[tuple[str, str], float]]:
        """Yield (joint of a link, joint of a motor) and the inertia that couples them [kg·m²]; of two motors the first."""
        chain = self.found.rig.file.chain
        for coupling in () if chain is None else chain.coupling:
            taken = self.found.joints[coupling.motor]
            motor = "link" if taken.one_body else next(iter(taken.motors))
            if coupling.inertia:
                ends = f"{self.names[coupling.link]}_link", f"{self.names[coupling.motor]}_{motor}"
                yield ends, coupling.inertia

    def _bodies(self, carrier: Element, name: str, taken: Taken) -> Element:
        """Add a joint's bodies; return that of its link."""
        body, own = taken.body, self.names[name]
        place = {"pos": body.position} if np.any(body.position) else {}
        place |= _turned(body.rotation)
        for key, parts in taken.motors.items():
            if not taken.one_body:
                motor = child(carrier, "body", name=f"{own}_{key}", **place)
                self._joint(motor, f"{own}_{key}", body.axis, parts)
                child(motor, "inertial", pos=np.zeros(3), mass=1e-9, diaginertia=np.full(3, 1e-12))
        link = child(carrier, "body", name=f"{own}_link", **place)
        self._joint(link, f"{own}_link", body.axis, taken.link)
        self._inertial(link, body.mass or Mass(1e-9, np.zeros(3), np.eye(3), np.full(3, 1e-12)))
        length = float(np.linalg.norm(body.tip))
        if length > 1e-6:
            # For a viewer alone: the inertia is above, and nothing touches anything.
            child(
                link, "geom", type="capsule", fromto=(*np.zeros(3), *body.tip), size=0.05 * length, mass=0.0, contype="0",
                conaffinity="0",
            )  # fmt: skip
        if body.payload is not None:
            self._inertial(child(link, "body", name=f"{own}_payload"), body.payload)
        return link

    @staticmethod
    def _inertial(body: Element, mass: Mass) -> None:
        inertia = np.maximum(mass.inertia, 1e-12)
        child(body, "inertial", pos=mass.centre, mass=mass.mass, diaginertia=inertia, **_turned(mass.axes))

    def _joint(self, body: Element, name: str, axis: Any, parts: Parts) -> None:
        numbers = {key: parts.of("joint", key) for key in ("armature", "damping", "frictionloss")}
        # The tendon of a coupling adds its armature to both ends, which must not have more.
        numbers["armature"] -= sum(abs(inertia) for ends, inertia in self.couplings.items() if name in ends)
        attributes: dict[str, Any] = {key: value for key, value in numbers.items() if value}
        if numbers["frictionloss"]:
            # As hard as the time step allows; softer friction creeps where it should stick.
            attributes |= {"solreffriction": (2.0 * self.step, 1.0), "solimpfriction": (0.99, 0.999, 0.001)}
        child(body, "joint", name=name, type="hinge", axis=axis, **attributes)

    def _drives(self, actuators: Element, name: str, taken: Taken) -> None:
        own = self.names[name]
        for key, parts in taken.motors.items():
            joint = f"{own}_link" if taken.one_body else f"{own}_{key}"
            gain, bias, delay = (parts.of("actuator", what) for what in ("gain", "bias", "delay"))
            quantity = "torque [N·m], on the joint's side of the gear"
            if taken.driven_by_current(key):
                gain, quantity = gain * parts.of("actuator", "current"), "current [A]"
            attributes: dict[str, Any] = {}
            kp, kd, limit = (parts.of("actuator", what) for what in ("kp", "kd", "limit"))
            if kp:
                quantity = "position [rad], on the joint's side of the gear"
                attributes |= {"gainprm": gain * kp, "biastype": "affine", "biasprm": (bias, -gain * kp, -gain * kd)}
            elif gain != 1.0 or bias:
                attributes |= {"gainprm": gain, "biastype": "affine", "biasprm": bias}
            if limit:
                attributes |= {"forcelimited": "true", "forcerange": (bias - gain * limit, bias + gain * limit)}
            if delay:
                # Linear between samples: an age of exactly a sample gives that sample, whichever way it is rounded.
                samples = int(np.ceil(delay / self.step - 1e-9)) + 2
                attributes |= {"delay": delay, "nsample": str(samples), "interp": "linear"}
            child(
                actuators,
                "general" if "gainprm" in attributes else "motor",
                name=f"{own}_{key}",
                joint=joint,
                **attributes,
            )
            self.notes.append(f"control {own}_{key}: the motor's {quantity}")
            if not taken.one_body:
                self._passive(actuators, f"{own}_{key}", parts, joint=joint)
        self._passive(actuators, f"{own}_link", taken.link, joint=f"{own}_link")

    def _passive(self, actuators: Element, name: str, parts: Parts, **target: str) -> None:
        """Add passive torques: LuGre friction and cogging act on a motor without current."""
        for i, one in enumerate(term for term in parts.terms if term.element == "dcmotor"):
            child(
                actuators, "dcmotor", name=f"{name}_passive_{i}", **target, input="none", motorconst=0.0, resistance=1.0,
                **one.attributes,
            )  # fmt: skip

    def _springs(self, tendons: Element, actuators: Element, name: str, taken: Taken) -> None:
        own = self.names[name]
        for key, spring in taken.springs.items():
            parts, reach = self.springs[name, key]
            if np.isfinite(reach):
                self.notes.append(
                    f"{own}_{key}: {len(parts)} tendons are its spring to a thousandth, for deflections up to {reach:.4g} rad"
                )
            rows = [_attributes(piece) for piece in parts]
            if damping := spring.parts.of("spring", "damping"):
                rows[0]["damping"] = damping
            rows += [dict(term.attributes) for term in spring.parts.terms if term.element == "fixed"]
            for i, row in enumerate(rows):
                tendon = child(tendons, "fixed", name=f"{own}_{key}" if i == 0 else f"{own}_{key}_part_{i}", **row)
                child(tendon, "joint", joint=f"{own}_link", coef=1.0)
                child(tendon, "joint", joint=f"{own}_{spring.motor}", coef=-1.0)
            self._passive(actuators, f"{own}_{key}", spring.parts, tendon=f"{own}_{key}")


def _turned(rotation: Array) -> dict[str, Any]:
    """Return how axes lie, shape (3, 3), where they are turned."""
    return {} if np.allclose(rotation, np.eye(3)) else {"xyaxes": np.ravel(rotation.T[:2])}


def _attributes(piece: Piece) -> dict[str, Any]:
    """Return a piece as attributes; higher coefficients only where there are any."""
    a, b, c = piece.coefficients
    return {"stiffness": (a, b, c) if b or c else a, "springlength": (piece.low, piece.high)}


def _timestep(found: Assembly, springs: Mapping[tuple[str, str], tuple[list[Piece], float]]) -> float:
    """Return a whole part of a millisecond, no longer than a delay or than the fastest mode takes for 0.02 rad."""
    chain = found.rig.file.chain
    yielding: dict[str, float] = {}
    if chain is not None:
        inverse = np.linalg.pinv(mass_matrix(chain, np.zeros(len(chain.link))), hermitian=True)
        yielding = {link.joint: float(inverse[i, i]) for i, link in enumerate(chain.link)}
    rates = [1.0]
    longest = 1e-3
    for name, taken in found.joints.items():
        inertia = taken.link.of("inertial", "inertia")
        link = yielding.get(name, 1.0 / inertia if inertia else 0.0)
        stiff = {key: sum(_steepness(springs[name, key][0])) for key in taken.springs}
        stiff = {key: k + _of_terms(taken.springs[key].parts) for key, k in stiff.items()}
        rates.append(link * (sum(stiff.values()) + _of_terms(taken.link) + abs(taken.link.of("inertial", "weight"))))
        for key, parts in taken.motors.items():
            own = parts.of("joint", "armature")
            loaded = sum(k for s, k in stiff.items() if taken.springs[s].motor == key) + _of_terms(parts)
            rates.append(loaded / own if own else 0.0)
            longest = min(longest, parts.of("actuator", "delay") or longest)
    fastest = float(np.sqrt(max(rates)))
    return 1e-3 / float(np.ceil(1e-3 / min(longest, 0.02 / fastest) - 1e-9))


def _steepness(parts: list[Piece]) -> Iterator[float]:
    """Yield stiffnesses at rest [N·m/rad]."""
    return (abs(piece.coefficients[0]) for piece in parts)


def _of_terms(parts: Parts) -> float:
    """Return the stiffness of further elements [N·m/rad]."""
    total = 0.0
    for one in parts.terms:
        attributes = one.attributes
        total += attributes.get("stiffness", 0.0) if one.element == "fixed" else 0.0
        total += attributes["lugre"][0] if "lugre" in attributes else 0.0
        total += abs(attributes["cogging"][0] * attributes["cogging"][1]) if "cogging" in attributes else 0.0
    return float(total)
