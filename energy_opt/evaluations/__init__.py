"""Any motion as it is: energy under one or several models, limits and clearance, beside plain timings of its path."""

from energy_opt.evaluations.run import Evaluation, evaluate
from energy_opt.evaluations.source import Recorded, load

__all__ = ["Evaluation", "Recorded", "evaluate", "load"]
