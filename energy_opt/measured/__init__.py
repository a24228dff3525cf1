"""Measured data: folders of runs with a log.toml, read into plain arrays, every fault named with file, row, column."""

from energy_opt.measured.differentiate import Kinematics, Smoothing, choose_smoothing, coarse, kinematics
from energy_opt.measured.log import LogFile, RunEntry, read_log
from energy_opt.measured.run import MeasuredSet, Run, nodes, operator
from energy_opt.measured.sets import inspect_set, read_set

__all__ = [
    "Kinematics", "LogFile", "MeasuredSet", "Run", "RunEntry", "Smoothing", "choose_smoothing",
    "coarse", "inspect_set", "kinematics", "nodes", "operator", "read_log", "read_set",
]  # fmt: skip
