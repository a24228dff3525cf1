"""Evaluation of a given motion: energy under one or more models, limits, clearance, and simple timings of its path."""

from energy_opt.evaluations.run import Evaluation, evaluate
from energy_opt.evaluations.source import Recorded, load

__all__ = ["Evaluation", "Recorded", "evaluate", "load"]
