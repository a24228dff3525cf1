"""Schedules of cells: start and duration of every step of every robot, and the modes in which robots wait.

A step's energy over its duration is a convex curve, waits choose between modes, robots share a periodic cycle. This is
a mixed-integer program; `solve.py` returns a schedule and a lower bound on the energy of all schedules.
"""

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
from energy_opt.schedule.solve import UNDECIDED, Schedule, solve

__all__ = [
    "UNDECIDED", "Curve", "Exclusion", "Group", "Hull", "Lag", "Mode", "Move", "Polynomial", "Problem", "Ring", "Run",
    "Schedule", "Wait", "solve",
]  # fmt: skip
