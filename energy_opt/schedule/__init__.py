"""Schedules of cells: start and duration of every step of every robot, and the modes in which robots wait.

A step's energy over its duration is a convex curve, waits choose between modes, robots share a periodic cycle. This is
a mixed-integer program; `outer_approximation` returns a schedule and a lower bound on the energy of all schedules.
"""

from energy_opt.schedule.outer_approximation import UNDECIDED, Schedule, solve
from energy_opt.schedule.problem import (
    Curve,
    Exclusion,
    Group,
    Hull,
    Lag,
    Mode,
    Move,
    Polynomial,
    Problem,
    Ring,
    Run,
    Wait,
)

__all__ = [
    "UNDECIDED", "Curve", "Exclusion", "Group", "Hull", "Lag", "Mode", "Move", "Polynomial", "Problem", "Ring", "Run",
    "Schedule", "Wait", "solve",
]  # fmt: skip
