"""Tracing the residual of measured power to the effect that the declared model lacks."""

from energy_opt.diagnose.diagnosis import Diagnosis, diagnose
from energy_opt.diagnose.output import write

__all__ = ["Diagnosis", "diagnose", "write"]
