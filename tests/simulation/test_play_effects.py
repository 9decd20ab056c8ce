"""Effects of the plants against closed forms and against scipy's integrators, with equations written out again here."""

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp

from vsalog.core.errors import SimulationError
from vsalog.effects.cogging import Cogging
from vsalog.effects.contact import Contact
from vsalog.rig.schema import (
    BoucWen,
    CubicTransmission,
    ElasticJoint,
    Friction,
    LinearTransmission,
    Link,
    Motor,
    Payload,
    SlipElement,
)
from vsalog.simulation.accuracy import COARSE
from vsalog.simulation.inputs import Motion, Servo
from vsalog.simulation.machine import build
from vsalog.simulation.play import play

TIME = np.arange(5001) * 1e-3
K, B, D, M, DQ = 25.0, 0.09, 0.3, 0.06, 0.05
PLAIN = ElasticJoint(
    motor=Motor(inertia=B, damping=D),
    transmission=LinearTransmission(stiffness=K),
    link=Link(inertia=M, damping=DQ),
)


def pull(t):
    return 2.0 * np.sin(2 * np.pi * 0.5 * t) + 0.9 * np.sin(2 * np.pi * 1.9 * t)


def run(motor=None, transmission=None, link=None, torque=pull, time=TIME, **options):
    joint = replace(
        PLAIN,
        motor=replace(PLAIN.motor, **(motor or {})),
        transmission=replace(PLAIN.transmission, **(transmission or {})),
        link=replace(PLAIN.link, **(link or {})),
    )
    return play(build({"j": joint}), {"j": {"motor_torque": torque}}, time, **options)["j"]


def solved(rate, start, time=TIME):
    """Integrate ẋ = rate(t, x), whose kinks are softened by small steps around them."""
    found = solve_ivp(
        rate, (time[0], time[-1]), start, method="DOP853", t_eval=time, rtol=1e-10, atol=1e-12, max_step=2e-3
    )
    assert found.success
    return found.y


def joint_rate(torque=lambda t, u, du, x: K * u, motor=lambda t, th, dth: pull(t) - D * dth, extra=None, m=M,
               link=lambda t, q, dq: -DQ * dq):  # fmt: skip
    """Equations of an elastic joint with other parts; `extra` gives the rates of further states."""

    def rate(t, x):
        q, dq, th, dth = x[:4]
        te = torque(t, q - th, dq - dth, x)
        more = [] if extra is None else extra(q - th, dq - dth, x)
        return [dq, (-te + link(t, q, dq)) / m, dth, (motor(t, th, dth) + te) / B, *more]

    return rate


def assert_near(ours, found, part=1e-6):
    for i, name in enumerate(("link_position", "link_velocity", "motor_position", "motor_velocity")):
        assert np.max(np.abs(ours[name] - found[i])) <= part * np.ptp(found[i]), name


def test_what_is_smooth():
    """Transmission damping, drift, added cubic, cogging, payload, gravity, torque gain and offset, all at once."""
    ours = run(
        motor={"cogging": (Cogging(torque=0.2, order=6.0, phase=0.3),), "torque_gain": 1.1, "torque_offset": 0.15},
        transmission={"damping": 0.4, "drift": 0.05, "added_cubic": 300.0},
        link={"gravity_torque": 1.5, "gravity_angle": 0.2, "payload": Payload(mass=0.3, distance=0.25)},
        start={"j": np.array([0.2, 0.0, 0.2, 0.0])},
    )
    m = M + 0.3 * 0.25**2
    weight = 1.5 + 0.3 * 9.81 * 0.25
    found = solved(
        joint_rate(
            lambda t, u, du, x: (1 + 0.05 * t) * (K * u + 300 * u**3) + 0.4 * du,
            lambda t, th, dth: 1.1 * pull(t) + 0.15 + 0.2 * np.sin(6 * th + 0.3) - D * dth,
            m=m,
            link=lambda t, q, dq: -DQ * dq - weight * np.sin(q - 0.2),
        ),
        [0.2, 0.0, 0.2, 0.0],
    )
    assert_near(ours, found)
    assert np.all(ours["motor_torque"] == pull(TIME))  # what is recorded is what was commanded


def test_asymmetry():
    ours = run(transmission={"asymmetry": 0.3})
    assert_near(ours, solved(joint_rate(lambda t, u, du, x: K * u * (1.3 if u > 0 else 0.7)), [0.0] * 4))


def test_backlash():
    ours = run(transmission={"backlash": 0.02})

    def torque(t, u, du, x):
        return K * np.sign(u) * max(abs(u) - 0.01, 0.0)

    found = solved(joint_rate(torque), [0.0] * 4)
    assert_near(ours, found, 3e-6)
    inside = np.abs(ours["deflection"]) < 0.01
    assert 0.02 < inside.mean() < 0.9
    assert np.all(ours["transmission_torque"][inside] == 0.0)
    assert np.all(ours["stiffness"][inside] == 0.0)


def test_a_bouc_wen_loop():
    loop = BoucWen(torque=0.5, width=0.01, exponent=1.5, shape=0.8)
    ours = run(transmission={"bouc_wen": loop})

    def change(u, du, x):
        z = x[4]
        return [(du - 0.8 * abs(du) * abs(z) ** 0.5 * z + (0.8 - 1) * du * abs(z) ** 1.5) / 0.01]

    found = solved(joint_rate(lambda t, u, du, x: K * u + 0.5 * x[4], extra=change), [0.0] * 5)
    assert_near(ours, found, 3e-6)
    height = ours["transmission_torque"] - ours["flexibility_torque"]
    assert 0.45 < np.max(np.abs(height)) <= 0.5


@pytest.mark.parametrize("width", [1e-5, 1e-7])
def test_a_loop_that_is_next_to_a_step_is_followed(width):
    """Dry friction in a spring: next to K φ its torque is that of the direction in which φ moves, wherever that is clear."""
    loop = BoucWen(torque=0.2, width=width, exponent=1.0, shape=1.0)
    # Vibrations alone would do with fewer steps.
    joint = replace(PLAIN, transmission=replace(PLAIN.transmission, bouc_wen=loop))
    steps, _ = build({"j": joint}).steps(1e-3, accuracy=COARSE)
    ours = run(transmission={"bouc_wen": loop}, steps=steps, start={"j": np.array([0.1, 0.5, 0.1, 0.6])})
    phi, rate = (ours[f"link_{name}"] - ours[f"motor_{name}"] for name in ("position", "velocity"))
    beside = ours["transmission_torque"] - K * phi
    clear = np.abs(rate) > 0.05
    clear[0] = False  # the loop begins at rest
    assert np.count_nonzero(clear) > 1000
    np.testing.assert_allclose(beside[clear], 0.2 * np.sign(rate[clear]), atol=2e-3)


def test_slip_elements_follow_their_play_operator():
    """A slip element's torque is a play operator of the deflection: clip(f + k Δφ, ±limit), step by step."""
    elements = (SlipElement(stiffness=40.0, limit=0.2), SlipElement(stiffness=10.0, limit=0.15))
    ours = run(transmission={"slip": elements})
    f = np.zeros(2)
    expected = []
    for du in np.diff(ours["deflection"], prepend=0.0):
        f = np.clip(f + np.array([40.0, 10.0]) * du, [-0.2, -0.15], [0.2, 0.15])
        expected.append(f.sum())
    height = ours["transmission_torque"] - ours["flexibility_torque"]
    # A turning point between two samples is known to half the rate's change over a sample.
    assert np.max(np.abs(height - expected)) < 2e-3
    assert np.max(height) == pytest.approx(0.35, abs=1e-9)


def test_a_lugre_bristle():
    ours = run(
        motor={"friction": Friction(coulomb=0.3, static=0.5, stribeck_velocity=0.2, presliding_stiffness=80.0,
                                    presliding_damping=0.6)}
    )  # fmt: skip

    def rate(t, x):
        q, dq, th, dth, z = x
        level = 0.3 + 0.2 * np.exp(-((dth / 0.2) ** 2))
        dz = dth - 80.0 * abs(dth) * z / level
        te = K * (q - th)
        return [dq, (-te - DQ * dq) / M, dth, (pull(t) + te - D * dth - 80.0 * z - 0.6 * dz) / B, dz]

    assert_near(ours, solved(rate, [0.0] * 5), 3e-6)


def test_bristles_that_slide_fast_are_dry_friction_where_it_is_known_how_fast():
    """At 100 rad/s bristles follow within 1/24000 s: too stiff for the steps that slower ones need."""
    friction = {"friction": Friction(coulomb=0.05, presliding_stiffness=12.0)}
    short, start = TIME[:501], {"j": np.array([0.0, 100.0, 0.0, 100.0])}
    with pytest.raises(SimulationError):
        run(motor=friction, time=short, start=start)
    ours = run(motor=friction, time=short, start=start, speeds=np.array([100.0, 100.0]))

    def rate(t, x):
        q, dq, th, dth = x
        te = K * (q - th)
        return [dq, (-te - DQ * dq) / M, dth, (pull(t) + te - D * dth - 0.05) / B]

    assert_near(ours, solved(rate, [0.0, 100.0, 0.0, 100.0], short), 1e-4)


def stick_slip(time, coulomb, static, speed):
    """Motor with ideal friction by scipy with its events: an oracle with modes of its own."""
    t, x, s, rows = 0.0, np.zeros(4), 0, []

    def load(t, x):
        return pull(t) + K * (x[0] - x[2])

    def level(v):
        return coulomb + (static - coulomb) * np.exp(-((v / speed) ** 2))

    while t < time[-1]:

        def rate(t, x, s=s):
            a = 0.0 if s == 0 else (load(t, x) - D * x[3] - s * level(x[3])) / B
            return [x[1], (-K * (x[0] - x[2]) - DQ * x[1]) / M, x[3] if s else 0.0, a]

        def event(t, x, s=s):
            return static - abs(load(t, x)) if s == 0 else s * x[3]

        event.terminal, event.direction = True, -1
        inside = time[(time > t) & (time <= time[-1])]
        found = solve_ivp(
            rate, (t, time[-1]), x, "DOP853", t_eval=inside, events=event, rtol=1e-11, atol=1e-13, max_step=5e-3
        )
        rows.append(found.y)
        if found.status == 0:
            break
        t, x = found.t_events[0][0], found.y_events[0][0].copy()
        x[3] = 0.0
        s = int(np.sign(load(t, x))) if s == 0 or abs(load(t, x)) > static else 0
        t = np.nextafter(t, np.inf)
    return np.hstack([np.zeros((4, 1)), *rows])


@pytest.mark.parametrize(("coulomb", "static"), [(0.6, None), (0.5, 0.8)], ids=["coulomb", "stribeck"])
def test_ideal_friction_sticks_and_slips(coulomb, static):
    friction = Friction(coulomb=coulomb, static=static, stribeck_velocity=None if static is None else 0.3)
    ours = run(motor={"friction": friction})
    found = stick_slip(TIME, coulomb, static or coulomb, 0.3)
    assert_near(ours, found, 1e-6)
    stuck = ours["motor_velocity"] == 0.0
    assert 0.005 < stuck.mean() < 0.9
    # Where it sticks it stands still to the last bit.
    assert np.all(np.diff(ours["motor_position"])[stuck[:-1] & stuck[1:]] == 0.0)


def test_a_sliding_link_stops_where_the_closed_form_says():
    """Nothing but Coulomb friction at the link, motor held: an oscillation that loses 4 F/k per turn and then stands."""
    coulomb, k, m = 0.11, 25.0, 0.06
    joint = replace(PLAIN, link=Link(inertia=m, friction=Friction(coulomb=coulomb)))
    ours = play(
        build({"j": joint}), {"j": {"motor_torque": Motion(0.0)}}, TIME, start={"j": np.array([0.1, 0.0, 0.0, 0.0])}
    )["j"]
    half = np.pi * np.sqrt(m / k)
    turns = [0.1 * (-1) ** i - 2 * i * (-1) ** i * coulomb / k for i in range(12)]
    reached = next(i for i, q in enumerate(turns) if abs(q) <= coulomb / k)
    swing = np.floor(TIME / half).astype(int)
    for i in range(reached):
        # Between turning points the motion is a cosine about ±F/k.
        t, side = TIME[swing == i], np.sign(turns[i])
        expected = side * coulomb / k + (turns[i] - side * coulomb / k) * np.cos(np.sqrt(k / m) * (t - i * half))
        assert ours["link_position"][swing == i] == pytest.approx(expected, abs=1e-9)
    assert np.all(ours["link_velocity"][swing > reached] == 0.0)
    assert ours["link_position"][-1] == pytest.approx(turns[reached], abs=1e-9)


def test_load_dependent_friction_rises_with_the_torque():
    """At constant speed the motor's torque is what the transmission takes, viscous friction, and the friction of both."""
    speed, k = 2.0, 40.0
    joint = ElasticJoint(
        motor=Motor(inertia=B, damping=D, friction=Friction(coulomb=0.2, load=0.1)),
        transmission=LinearTransmission(stiffness=k), link=Link(inertia=M, damping=1.5),
    )  # fmt: skip
    torque = (1 + 0.1) * 1.5 * speed + D * speed + 0.2
    start = {"j": np.array([0.0, speed, 1.5 * speed / k, speed])}
    ours = play(build({"j": joint}), {"j": {"motor_torque": torque}}, TIME, start=start)["j"]
    assert ours["motor_velocity"] == pytest.approx(speed, abs=1e-10)


def test_a_late_torque_is_the_same_torque_later():
    late = run(motor={"torque_delay": 0.0123})
    early = run(torque=lambda t: np.where(t < 0.0123, pull(0.0), pull(t - 0.0123)))
    assert late["motor_position"] == pytest.approx(early["motor_position"], abs=1e-6)
    assert np.all(late["motor_torque"] == pull(TIME))


def test_held_samples_act_from_their_sample_on():
    held = np.where(TIME < 0.5, 0.0, 1.0)
    ours = run(torque=held, motor={"torque_delay": 0.25})
    first = int(np.argmax(ours["motor_acceleration"] != 0.0))
    assert TIME[first] == pytest.approx(0.75, abs=1.1e-3)


def test_held_samples_may_be_late_by_less_than_a_step():
    held = np.random.default_rng(4).normal(size=51).repeat(100)[: TIME.size]
    delay = 0.01237
    ours = run(torque=held, motor={"torque_delay": delay})

    def motor(t, th, dth):
        return held[max(int(np.floor((t - delay) / 1e-3 + 1e-9)), 0)] - D * dth

    assert_near(ours, solved(joint_rate(motor=motor), np.zeros(4)), part=1e-5)


def test_a_push_from_outside():
    pushes = (Contact(start=1.0, duration=0.4, torque=0.8),)
    ours = run(link={"contact": pushes})

    def link(t, q, dq):
        return -DQ * dq + (0.8 * np.sin(np.pi * (t - 1.0) / 0.4) ** 2 if 1.0 < t < 1.4 else 0.0)

    assert_near(ours, solved(joint_rate(link=link), [0.0] * 4))
    assert np.all(ours["external_torque"] == 0.0)  # the equations of a diagnosis count both


def test_a_servo_commands_what_its_law_says():
    servo = Servo(lambda t: 0.3 * np.sin(2 * np.pi * t), stiffness=30.0, damping=1.5, limit=2.0)
    ours = run(
        torque=servo, motor={"torque_step": 1e-3, "torque_gain": 0.9, "torque_offset": 0.05, "torque_delay": 0.002}
    )
    rate = 0.6 * np.pi * np.cos(2 * np.pi * TIME)
    law = 30.0 * (0.3 * np.sin(2 * np.pi * TIME) - ours["motor_position"]) + 1.5 * (rate - ours["motor_velocity"])
    assert ours["motor_torque"] == pytest.approx(np.clip(law, -2.0, 2.0), abs=0.6e-3)
    acting = np.concatenate([[ours["motor_torque"][0]] * 2, ours["motor_torque"][:-2]]) * 0.9 + 0.05
    felt = B * ours["motor_acceleration"] + D * ours["motor_velocity"] - ours["transmission_torque"]
    assert felt == pytest.approx(acting, abs=1e-9)


def test_a_prescribed_motor_moves_as_prescribed():
    ours = run(torque=Motion(lambda t: 0.2 * np.sin(3 * t)))
    assert ours["motor_position"] == pytest.approx(0.2 * np.sin(3 * TIME), abs=1e-10)
    assert "motor_torque" not in ours

    def rate(t, x):
        return [x[1], (-K * (x[0] - 0.2 * np.sin(3 * t)) - DQ * x[1]) / M]

    q, _ = solved(rate, [0.0] * 2)
    assert np.max(np.abs(ours["link_position"] - q)) < 1e-6 * np.ptp(q)


@pytest.mark.parametrize("gravity", [0.0, 2.0])
def test_energy_is_conserved_without_damping(gravity):
    joint = ElasticJoint(
        motor=Motor(inertia=B), transmission=CubicTransmission(stiffness=10.0, cubic=800.0, backlash=0.01, asymmetry=0.2),
        link=Link(inertia=M, gravity_torque=gravity),
    )  # fmt: skip
    machine = build({"j": joint})
    steps, _ = machine.steps(1e-3)
    for times, part in ((1, 2e-6), (4, 1e-8)):
        x = play(
            machine, {}, np.arange(10_001) * 1e-3, steps=times * steps, start={"j": np.array([0.4, 0.0, 0.2, 1.0])}
        )["j"]
        u = np.sign(x["deflection"]) * np.maximum(np.abs(x["deflection"]) - 0.005, 0.0)
        elastic = np.where(u > 0, 1.2, 0.8) * (5.0 * u**2 + 200.0 * u**4)
        kinetic = 0.5 * M * x["link_velocity"] ** 2 + 0.5 * B * x["motor_velocity"] ** 2
        energy = elastic + kinetic - gravity * np.cos(x["link_position"])
        assert np.ptp(energy) < part * np.ptp(kinetic)


@pytest.mark.parametrize(
    "motor",
    [{}, {"friction": Friction(coulomb=0.4)}],
    ids=["smooth", "stick and slip"],
)
def test_the_order_of_convergence_is_four(motor):
    """Error at a coarse step over error at half of it: 2⁴, with events too."""
    ends = []
    for steps in (1, 2, 4, 64):
        time = np.arange(201) * 0.02
        x = run(motor=motor, time=time, steps=steps)
        ends.append(np.array([x["link_position"], x["motor_position"]]))
    errors = [np.max(np.abs(e - ends[-1])) for e in ends[:-1]]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.5)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.5)


def test_a_stiff_machine_converges_too():
    """A link on a very stiff, well damped spring: the fast mode is gone at once, the slow motion is of fourth order."""
    ends = []
    for steps in (1, 2, 4, 64):
        time = np.arange(201) * 0.02
        x = run(transmission={"stiffness": 40.0, "damping": 400.0}, time=time, steps=steps)
        ends.append(x["motor_position"])
    errors = [np.max(np.abs(e - ends[-1])) for e in ends[:-1]]
    assert np.log2(errors[0] / errors[1]) > 3.0
    assert np.log2(errors[1] / errors[2]) > 3.0


def test_lacking_inertia_is_reported():
    with pytest.raises(SimulationError, match="joint 'j': motor has no inertia"):
        build({"j": replace(PLAIN, motor=Motor())})
    with pytest.raises(SimulationError, match="joint 'j' has no link"):
        build({"j": replace(PLAIN, link=None)})
    there = "motor_torque, external_torque, link_position"
    with pytest.raises(SimulationError, match=f"has no input 'motor_torque_1'; it has {there}"):
        play(build({"j": PLAIN}), {"j": {"motor_torque_1": 0.0}}, TIME)
