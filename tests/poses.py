"""Poses of the Panda, rad: README's move, and one that its path may be bent through; arms without limits of jerk."""

from dataclasses import replace

import numpy as np

from energy_opt.robot import Robot

START = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
GOAL = np.array([1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4])
MIDDLE = (START + GOAL) / 2 + [0.1, -0.3, 0.2, 0.1, 0, 0.2, 0.3]


def without_jerk(robot: Robot) -> Robot:
    """The same robot without limits of jerk."""
    return replace(robot, limits=robot.limits.replace(jerk=np.full(robot.n, np.inf)))
