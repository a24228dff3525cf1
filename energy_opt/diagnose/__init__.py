"""Tracing the residual of measured power to the effect that the declared model lacks."""

from energy_opt.diagnose.diagnosis import Diagnosis, diagnose
from energy_opt.diagnose.output import write, write_joints
from energy_opt.diagnose.unmetered import JointDiagnosis, diagnose_joints

__all__ = ["Diagnosis", "JointDiagnosis", "diagnose", "diagnose_joints", "write", "write_joints"]
