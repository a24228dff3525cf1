"""Tracing the residual of measured power to the effect that the declared model lacks."""

from energy_opt.diagnosis.diagnosis import Diagnosis, diagnose

__all__ = ["Diagnosis", "diagnose"]
