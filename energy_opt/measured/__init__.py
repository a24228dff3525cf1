"""Measured data: folders of runs with a log.toml, read into plain arrays, every fault named with file, row, column."""

from energy_opt.measured.check import check_set, inspect_set
from energy_opt.measured.differentiate import Kinematics, Smoothing, choose_smoothing, coarse, kinematics
from energy_opt.measured.log import LogFile, RunEntry, read_log
from energy_opt.measured.meter import nodes, observe, operator
from energy_opt.measured.run import MeasuredSet, Run
from energy_opt.measured.sets import read_set

__all__ = [
    "Kinematics", "LogFile", "MeasuredSet", "Run", "RunEntry", "Smoothing", "check_set", "choose_smoothing",
    "coarse", "inspect_set", "kinematics", "nodes", "observe", "operator", "read_log", "read_set",
]  # fmt: skip
