"""The power model: an arm's effects with their values, and the law that follows from them."""

from energy_opt.power.drive_law import DriveTerms, drive_function, drive_terms
from energy_opt.power.known import load_model, source_method_1, source_method_2
from energy_opt.power.mixture import Mixture
from energy_opt.power.model import PowerModel

__all__ = [
    "DriveTerms", "Mixture", "PowerModel", "drive_function", "drive_terms", "load_model", "source_method_1",
    "source_method_2",
]  # fmt: skip
