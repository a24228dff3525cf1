"""A cell from its file to a schedule."""

from __future__ import annotations

from dataclasses import dataclass

from energy_opt.errors import BadInput
from energy_opt.schedule import Schedule
from energy_opt.workcell.curves import problem_of, ring_of
from energy_opt.workcell.file import WorkCell
from energy_opt.workcell.levers import Levers, pull


@dataclass(frozen=True)
class CellResult:
    """The schedule of a cell.

    Attributes:
        cell: as it was asked for.
        levers: schedules with one lever after the other; the last is the answer.
    """

    cell: WorkCell
    levers: Levers

    @property
    def schedule(self) -> Schedule:
        """The answer."""
        return self.levers.best


def run_workcell(cell: WorkCell, *, seconds: float = 60.0) -> CellResult:
    """Schedule a cell for least energy.

    Args:
        seconds: for the schedule with all levers [s]; a gap that is left then is in the result.

    Raises:
        BadInput: a robot's arm is given (`robot`), or a curve is not convex.
        Infeasible: no schedule keeps cycle time, lags and zones.
    """
    arms = [robot.name for robot in cell.robot if robot.robot is not None]
    if arms:
        raise BadInput(
            f"robot {arms[0]}: robot = ... is not supported in files of format 2 yet; give `curve`s, or use format 1"
        )
    rings = {robot.name: ring_of(cell, robot) for robot in cell.robot}
    return CellResult(cell, pull(problem_of(cell, rings), seconds=seconds))
