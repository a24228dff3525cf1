"""Whole jobs: a cycle of moves and waits, its time spent where it saves most."""

from energy_opt.job.file import Job, Step, check_job, load_job
from energy_opt.job.posed import run_posed
from energy_opt.job.run import JobResult, run_job

__all__ = ["Job", "JobResult", "Step", "check_job", "load_job", "run_job", "run_posed"]
