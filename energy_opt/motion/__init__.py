"""Motion: paths, timings, trajectories, and their optimization for minimum energy."""

from energy_opt.motion.move import Move, Settings
from energy_opt.motion.plan.planner import Planner
from energy_opt.motion.result import Baseline, Optimality, Result
from energy_opt.motion.trajectory import Trajectory

__all__ = ["Baseline", "Move", "Optimality", "Planner", "Result", "Settings", "Trajectory"]
