"""A cell from its file to a plan: schedule, motions, proof between arms, and what each lever saves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from energy_opt.cell.request import CellRequest
from energy_opt.motion.move import Settings
from energy_opt.power import PowerModel
from energy_opt.robot import Robot, load_robot
from energy_opt.schedule import Schedule
from energy_opt.workcell.arm import Arm
from energy_opt.workcell.between import Between
from energy_opt.workcell.file import WorkCell
from energy_opt.workcell.levers import Levers
from energy_opt.workcell.plan import Planned, Planning
from energy_opt.workcell.supplied import supplied
from energy_opt.workcell.supply import FINE, Supplied, Supply


@dataclass(frozen=True)
class CellResult:
    """The plan of a cell.

    Attributes:
        cell: as it was asked for.
        planned: the answer: schedule, motions, clearance between arms.
        levers: schedules with one lever after the other.
        arms: by robot; None for one that is known by its curves alone.
        own: what the robots draw from supplies of their own; supply: from the one that the file describes.
            None where no arm is known.
        bound: J that no schedule of these curves goes below.
        interrupted: stopped early.
    """

    cell: WorkCell
    planned: Planned
    levers: Levers
    arms: tuple[Arm | None, ...]
    own: Supplied | None
    supply: Supplied | None
    bound: float
    interrupted: bool = False

    @property
    def schedule(self) -> Schedule:
        """When every step begins and how long it takes."""
        return self.planned.schedule

    @property
    def clearance(self) -> tuple[Between, ...]:
        """Every two arms."""
        return self.planned.clearance

    @property
    def energy(self) -> float:
        """J of the whole cycle, from the shared supply where there is one."""
        shared = self.cell.supply is not None and self.supply is not None
        return self.supply.energy if shared and self.supply is not None else self.schedule.energy

    @property
    def gap(self) -> float:
        """(energy - bound) / energy."""
        return max(0.0, self.energy - self.bound) / max(abs(self.energy), 1e-12)

    @property
    def solved(self) -> bool:
        """Are all arms proven to keep apart?"""
        return not self.interrupted and all(between.verdict == "proven" for between in self.clearance)


def run_workcell(
    cell: WorkCell,
    path: Path,
    *,
    load: Callable[[str], Robot] = load_robot,
    model_of: Callable[[str | None, Robot], PowerModel],
    settings: Settings | None = None,
    request: CellRequest | None = None,
    seconds: float = 60.0,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[str, float], None] = lambda text, share: None,
) -> CellResult:
    """Plan a cell for least energy.

    Args:
        path: the job file, beside which other files lie.
        load: makes a robot out of its name or of the path of its URDF.
        model_of: the power model of a robot, from what the file says of it (None: nothing).
        request: body and cell, without the bases, which the file says.
        seconds: for each schedule [s]; a gap that is left then is in the result.
        stopped: asked between solves; True ends the work with the best so far.
        progress: called with what is being done and the share of the work that is done.

    Raises:
        BadInput: a fault of the file. Infeasible: no schedule keeps cycle time, lags, zones, limits of the supply, and
        arms apart.
    """
    arms = tuple(
        None
        if table.robot is None
        else Arm(cell, table, Path(path), load, model_of, settings or Settings(), request or CellRequest(), stopped)
        for table in cell.robot
    )
    planning = Planning(cell, arms, seconds, progress, stopped)
    candidates = planning.candidates()
    if planning.moving:
        planned, levers = planning.plan(candidates)
    else:
        levers = candidates[0].levers
        planned = planning.proved(levers.best)
    arms = planning.arms
    if all(arm is None for arm in arms):
        return CellResult(cell, planned, levers, arms, None, None, planned.schedule.bound, stopped())
    own = Supply(cell, arms, FINE).drawn(planned.schedule, shared=False)
    drawn = own
    if cell.supply is not None:
        planned, drawn = supplied(planning, planned)
    bound = planning.bound(lossless=cell.supply is not None)
    energy = planned.schedule.energy if cell.supply is None else drawn.energy
    return CellResult(cell, planned, levers, planning.arms, own, drawn, min(bound, energy), stopped())
