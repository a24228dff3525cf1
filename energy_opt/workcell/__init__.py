"""Several robots in one periodic cycle: job files of format 2, their schedule, and the saving of each lever."""

from energy_opt.workcell.as_job import check_workcell
from energy_opt.workcell.file import FORMAT, WorkCell, load_workcell

__all__ = ["FORMAT", "WorkCell", "check_workcell", "load_workcell"]
