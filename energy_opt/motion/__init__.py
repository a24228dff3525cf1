"""Motion: paths, timings, trajectories, and their optimization for minimum energy.

A path q(s) has no times, a timing says when it is where, a trajectory is their sampled result. `retime` optimizes the
timing of a given path, `reshape` path and timing together; `limits` states the bounds for both, `judge` proves them for
a trajectory, and `plan` leads from a move to its result.
"""

from energy_opt.motion.move import Move, Settings
from energy_opt.motion.plan.planner import Planner
from energy_opt.motion.result import Baseline, Optimality, Result
from energy_opt.motion.trajectory import Trajectory

__all__ = ["Baseline", "Move", "Optimality", "Planner", "Result", "Settings", "Trajectory"]
