"""The structures of a scenario file: the inputs of each joint of a rig, and the duration."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, field

from vsalog.core.quantities import (
    Angle,
    Base,
    Damping,
    Duration,
    Fraction,
    Ratio,
    RoleSpread,
    RoleValue,
    Stiffness,
    TimeSpan,
    TorqueLimit,
)

Frequency = Annotated[float, Meta(description="frequency [Hz]", gt=0.0, extra={"unit": "1/s", "units": ("1/s",)})]
AngularFrequency = Annotated[
    float, Meta(description="angular frequency [rad/s]", gt=0.0, extra={"unit": "rad/s", "units": ("rad/s",)})
]
Voltage = Annotated[float, Meta(description="voltage [V]", extra={"unit": "V", "units": ("V",)})]


class Constant(Base, frozen=True, tag="constant", tag_field="type"):
    """`value` at all times."""

    value: RoleValue


class Sine(Base, frozen=True, tag="sine", tag_field="type"):
    """offset + amplitude · sin(2π frequency t + phase)."""

    amplitude: RoleValue
    frequency: Frequency
    phase: Angle = 0.0
    offset: RoleValue = 0.0


class Square(Base, frozen=True, tag="square", tag_field="type"):
    """+amplitude over the share `duty` of each period, −amplitude over the rest; sharp edges."""

    amplitude: RoleValue
    frequency: Frequency
    phase: Angle = 0.0
    duty: Fraction = 0.5


class SoftSquare(Base, frozen=True, tag="soft_square", tag_field="type"):
    """amplitude · tanh(sin(2π frequency t) / softness): with 0.1, an edge takes some 3 % of the period."""

    amplitude: RoleValue
    frequency: Frequency
    softness: Annotated[float, Meta(description="a number without unit", gt=0.0)] = 0.1


class Sawtooth(Base, frozen=True, tag="sawtooth", tag_field="type"):
    """A ramp from −amplitude to +amplitude over each period, through zero at t = 0; downwards with a negative amplitude."""

    amplitude: RoleValue
    frequency: Frequency
    phase: Angle = 0.0


class Steps(Base, frozen=True, tag="steps", tag_field="type"):
    """values[i] from times[i] on, zero before the first; each change takes `rise`, sharp when zero."""

    times: tuple[TimeSpan, ...]
    values: tuple[RoleValue, ...]
    rise: TimeSpan = 0.0


class Chirp(Base, frozen=True, tag="chirp", tag_field="type"):
    """A sine whose frequency runs from `start_frequency` to `end_frequency` over `duration`, and stays there.

    Attributes
    ----------
    amplitude, phase : of the sine
    start_frequency, end_frequency : [Hz]
    duration : that of the scenario when absent [s]
    sweep : ``logarithmic``: by equal factors in equal times; or ``linear``
    """

    amplitude: RoleValue
    start_frequency: Frequency
    end_frequency: Frequency
    duration: Duration | None = None
    phase: Angle = 0.0
    sweep: Literal["logarithmic", "linear"] = "logarithmic"


class Multisine(Base, frozen=True, tag="multisine", tag_field="type"):
    """Cosines of equal strength at the multiples of `spacing` from `lowest_frequency` to `highest_frequency`.

    Attributes
    ----------
    rms : of the sum
    spacing : between the frequencies; its inverse is the period [Hz]
    lowest_frequency : `spacing` when absent [Hz]
    highest_frequency : [Hz]
    phases : ``schroeder``, which keeps the peaks low, or ``random``
    seed : of random phases
    """

    rms: RoleSpread
    spacing: Frequency
    highest_frequency: Frequency
    lowest_frequency: Frequency | None = None
    phases: Literal["schroeder", "random"] = "schroeder"
    seed: Annotated[int, Meta(description="a whole number", ge=0)] = 0


class Trapezoid(Base, frozen=True, tag="trapezoid", tag_field="type"):
    """A ramp up, a plateau and a ramp down, from `start` on; again after each `period` where one is given.

    Attributes
    ----------
    amplitude : of the plateau
    rise, hold, fall : how long each takes; the fall as long as the rise when absent [s]
    start : when it begins [s]
    period : after which it begins again [s]
    """

    amplitude: RoleValue
    rise: Duration
    hold: TimeSpan
    fall: Duration | None = None
    start: TimeSpan = 0.0
    period: Duration | None = None


class RestToRest(Base, frozen=True, tag="rest_to_rest", tag_field="type"):
    """Zero until `start`, then along a polynomial of degree 9 to `amplitude`, which it reaches after `rise`: from rest to rest.

    Its first four derivatives are continuous, so that a joint with an elastic transmission can follow it.

    Attributes
    ----------
    amplitude : where it goes
    rise : how long it takes [s]
    start : when it begins [s]
    """

    amplitude: RoleValue
    rise: Duration
    start: TimeSpan = 0.0


class Csv(Base, frozen=True, tag="csv", tag_field="type"):
    """A column of a file: a CSV table, or any other log that vsalog reads. Its time counts from the log's first stamp.

    Attributes
    ----------
    file : path, from the scenario's folder
    column : name of the column or channel
    unit : of the column; the file's when absent, SI when neither states one
    interpolation : ``linear``, or ``held``: each value holds until the next. Before and after, the ends hold
    rate : samples per second of a table without a time column [Hz]
    """

    file: str
    column: str
    unit: str | None = None
    interpolation: Literal["linear", "held"] = "linear"
    rate: Frequency | None = None


Part = Constant | Sine | Square | SoftSquare | Sawtooth | Steps | Chirp | Multisine | Trapezoid | RestToRest | Csv
Parts = tuple[Part, ...]


class ServoDrive(Base, frozen=True):
    """A position loop on a motor: τ = K_p (θ_d − θ) + K_d (θ̇_d − θ̇), cut at ±limit.

    Attributes
    ----------
    stiffness : K_p [N·m/rad]
    damping : K_d [N·m·s/rad]
    limit : largest torque; none when absent [N·m]
    reference : θ_d, the sum of parts, [[….reference]]
    """

    stiffness: Stiffness
    damping: Damping = 0.0
    limit: TorqueLimit | None = None
    reference: Parts = ()


class StateFeedbackDrive(Base, frozen=True):
    """A state controller of an elastic joint: τ = K_P (x_d − ξ) + τ_d (De Luca 2007 eq. 13), see `control.StateFeedback`.

    Attributes
    ----------
    frequency, damping : of the slowest eigenvalues of the controlled joint [rad/s]
    feedback : where the state ξ comes from
    limit : largest torque; none when absent [N·m]
    tune : of the observer, NAME = "VALUE"
    reference : q_d, the planned position of the link, the sum of parts, [[….reference]]
    """

    frequency: AngularFrequency
    damping: Ratio = 1.0
    feedback: Literal["acceleration-observer", "motor", "truth"] = "acceleration-observer"
    limit: TorqueLimit | None = None
    tune: dict[str, str] = field(default_factory=dict)
    reference: Parts = ()


class PiControlDrive(Base, frozen=True):
    """A proportional and integral controller of a joint's two valves (Shin 2021 §IV-C), see `control.PiControl`.

    Attributes
    ----------
    of : what is controlled
    feedback : where it comes from
    proportional, integral : gains, of SI: V/rad and V/(rad·s), or of N·m
    bias : voltage of both valves without an error [V]
    tune : of the estimator, NAME = "VALUE"
    reference : the sum of parts, [[….reference]]
    """

    proportional: float
    integral: float
    bias: Voltage
    of: Literal["link_position", "torque_sensor"] = "link_position"
    feedback: Literal["pam-ukf", "pam-model", "sensor"] = "pam-ukf"
    tune: dict[str, str] = field(default_factory=dict)
    reference: Parts = ()


class StiffnessControlDrive(Base, frozen=True):
    """A controller of the position and the stiffness of an antagonistic or serial joint, see `control.StiffnessControl`.

    Attributes
    ----------
    frequency : of the motors' position loops [rad/s]
    bandwidth : of the integral that corrects the stiffness, well below that [rad/s]
    feedback : where the stiffness comes from: an estimator's name, ``truth`` or ``none``
    limit : largest torque of a motor; none when absent [N·m]
    tune : of the estimator, NAME = "VALUE"
    position : of the link, the sum of parts, [[….position]]
    stiffness : of the device, the sum of parts, [[….stiffness]]
    """

    frequency: AngularFrequency
    bandwidth: AngularFrequency
    feedback: str = "residual-rls"
    limit: TorqueLimit | None = None
    tune: dict[str, str] = field(default_factory=dict)
    position: Parts = ()
    stiffness: Parts = ()


class Drives(Base, frozen=True):
    """The inputs of one joint; several parts of a role are summed, a role that is not named is zero.

    A motor gets a torque, a servo or a prescribed position, on the joint's side of the gear, or its drive is commanded a
    position, a velocity, or both. A controller receives what the
    joint's sensor readings, and drives its motor or its valves.
    """

    commanded_position: Parts = ()
    commanded_velocity: Parts = ()
    motor_torque: Parts = ()
    motor_torque_1: Parts = ()
    motor_torque_2: Parts = ()
    secondary_torque: Parts = ()
    external_torque: Parts = ()
    valve_1: Parts = ()
    valve_2: Parts = ()
    motor_servo: ServoDrive | None = None
    motor_servo_1: ServoDrive | None = None
    motor_servo_2: ServoDrive | None = None
    secondary_servo: ServoDrive | None = None
    motor_position: Parts = ()
    motor_position_1: Parts = ()
    motor_position_2: Parts = ()
    secondary_position: Parts = ()
    state_feedback: StateFeedbackDrive | None = None
    pi_control: PiControlDrive | None = None
    stiffness_control: StiffnessControlDrive | None = None


class ScenarioFile(Base, frozen=True):
    """A whole scenario file.

    Attributes
    ----------
    name : also part of the log's name
    description : one line, which `vsalog simulate --list` prints
    duration : [s]
    period : sample time [s]
    joint : inputs of the joints, by their names in the rig
    """

    name: str = ""
    description: str = ""
    duration: Duration = 20.0
    period: Duration = 1e-3
    joint: dict[str, Drives] = field(default_factory=dict)
