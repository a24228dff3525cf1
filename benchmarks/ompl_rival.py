"""OMPL as it is commonly used: RRTConnect over poses checked one by one, its simplifier, a spline through what is left.

Poses are checked without a margin, lines at the planner's own resolution (1 % of the space), as its users get it.
What lies between the poses is what our proof looks at.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Answer:
    """Waypoints (K, n) of the simplified path and of the same smoothed (None where none was found), and seconds."""

    simplified: np.ndarray | None
    smoothed: np.ndarray | None
    seconds: float


def plan(
    start: np.ndarray,
    goal: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    clear: Callable[[np.ndarray], bool],
    seed: int,
    seconds: float,
) -> Answer:
    """A path from start to goal within bounds (n,) [rad], at most `seconds` of planning."""
    import ompl.base as ob
    import ompl.geometric as og
    import ompl.util as ou

    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(seed + 1)
    n = len(start)
    space, bounds = ob.RealVectorStateSpace(n), ob.RealVectorBounds(n)
    for j in range(n):
        bounds.setLow(j, float(min(lower[j], start[j], goal[j])))
        bounds.setHigh(j, float(max(upper[j], start[j], goal[j])))
    space.setBounds(bounds)

    def pose(state: object) -> np.ndarray:
        return np.array([state[j] for j in range(n)])  # type: ignore[index]

    setup = og.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: clear(pose(state)))
    ends = space.allocState(), space.allocState()
    for state, q in zip(ends, (start, goal), strict=True):
        for j in range(n):
            state[j] = float(q[j])
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
    begin = time.process_time()
    setup.solve(seconds)
    if not setup.haveExactSolutionPath():
        return Answer(None, None, time.process_time() - begin)
    setup.simplifySolution(1.0)
    path = setup.getSolutionPath()
    simplified = np.array([pose(path.getState(k)) for k in range(path.getStateCount())])
    og.PathSimplifier(setup.getSpaceInformation()).smoothBSpline(path)
    smoothed = np.array([pose(path.getState(k)) for k in range(path.getStateCount())])
    return Answer(simplified, smoothed, time.process_time() - begin)
