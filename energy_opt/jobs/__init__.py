"""Whole jobs: a cycle of moves and waits, whose time is shared for least energy."""

from energy_opt.jobs.file import check_job, load_job
from energy_opt.jobs.legs import Job, Step
from energy_opt.jobs.posed import run_posed
from energy_opt.jobs.run import JobResult, run_job

__all__ = ["Job", "JobResult", "Step", "check_job", "load_job", "run_job", "run_posed"]
