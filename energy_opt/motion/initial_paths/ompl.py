"""Paths from OMPL's RRTConnect: the only module that imports ompl, which the extra `plan` installs."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np


def installed() -> bool:
    """True if OMPL is installed."""
    return importlib.util.find_spec("ompl") is not None


def rrt_connect(
    start: np.ndarray,
    goal: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    clear: Callable[[np.ndarray], bool],
    line: Callable[[np.ndarray, np.ndarray], bool],
    enough: Callable[[], bool],
    seed: int,
    side: float,
) -> np.ndarray | None:
    """A bent line (K, n) from start to goal whose edges are free; None if `enough` came first.

    The same arguments give the same line: OMPL's generator is seeded before its first use, and `enough` should count
    poses, not seconds.

    Args:
        lower, upper: (n,) [rad] bounds of the poses that are drawn; start and goal lie within.
        clear: whether a pose is free; line: whether the straight line between two free poses is.
        enough: when to give up.
        seed: 0 or above.
        side: longest edge of the tree, by the joints' Euclidean norm [rad].
    """
    import ompl.base as ob
    import ompl.geometric as og
    import ompl.util as ou

    class Lines(ob.MotionValidator):
        def checkMotion(self, a: Any, b: Any, *rest: Any) -> bool:  # OMPL's own spelling
            to = pose(b)  # of the tree from the start, nothing else checks this pose
            return clear(to) and line(pose(a), to)

    n = len(start)

    def pose(state: Any) -> np.ndarray:
        return np.array([state[j] for j in range(n)])

    ou.setLogLevel(ou.LOG_NONE)  # otherwise OMPL prints to stdout
    ou.RNG.setSeed(seed + 1)  # OMPL does not accept 0
    space, bounds = ob.RealVectorStateSpace(n), ob.RealVectorBounds(n)
    for j in range(n):
        bounds.setLow(j, float(lower[j]))
        bounds.setHigh(j, float(upper[j]))
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: clear(pose(state)))
    validator = Lines(information)
    information.setMotionValidator(validator)
    information.setup()
    problem = ob.ProblemDefinition(information)
    ends = space.allocState(), space.allocState()
    for state, q in zip(ends, (start, goal), strict=True):
        for j in range(n):
            state[j] = float(q[j])
    problem.setStartAndGoalStates(*ends)
    planner = og.RRTConnect(information)
    planner.setRange(side)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(ob.PlannerTerminationCondition(enough))
    if not problem.hasExactSolution():
        return None
    path = problem.getSolutionPath()
    return np.array([pose(path.getState(k)) for k in range(path.getStateCount())])
