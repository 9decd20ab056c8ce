"""What makes an experiment that is proposed a good one."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Design:
    """What all proposed experiments have in common.

    Attributes
    ----------
    duration : of an experiment [s]: some periods of its slowest wave
    shortest_period : sample time of its scenario, at least [s]: servos are no faster
    slowest, fastest : frequencies [Hz]: what friction and gravity, and what inertias and springs show in
    share : of what was seen that is used [1]: a loop overshoots a little
    second_share, second_frequency : of that, what the second movement (a set-point, two motors against each other) takes [1], and
        its frequency [Hz]: slower than the first, and no part of it
    approach, longest_approach : time in which the middle of the range is approached, at least and at most [s]
    payload : share that a payload adds to inertia and weight [1]: well above their tolerances
    with_second : waves that are tried with and without a second movement [1]
    range_share : of a signal that is its range [1]: its few largest values may be noise
    slack : share beyond what was seen that is still what was seen [1]: encoders count in steps, filters smear peaks
    separate : standard deviations of an average by which two hypotheses are separated [1]: what a cause has to be worth
    worthwhile : factor by which a better experiment separates causes better, or shows a smaller cause [1]
    most_hypotheses : that are compared, or causes that the log would not have shown [1]: an experiment answers no more
    """

    duration: float = 16.0
    shortest_period: float = 5e-4
    slowest: float = 0.1
    fastest: float = 5.0
    share: float = 0.85
    second_share: float = 0.4
    second_frequency: float = 0.07
    approach: float = 1.0
    longest_approach: float = 4.0
    payload: float = 0.3
    with_second: int = 4
    range_share: float = 0.995
    slack: float = 0.02
    separate: float = 0.3
    worthwhile: float = 1.5
    most_hypotheses: int = 4


DESIGN = Design()
