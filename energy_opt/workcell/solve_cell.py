"""A cell from its file to a plan: schedule, motions, proof between arms, and the saving of each lever.

If a plan exceeds the limits of its supply, its starts are changed first; then moves at the peaks of power are slowed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from energy_opt.cell.request import CellRequest
from energy_opt.errors import Infeasible
from energy_opt.motion.limits.joint import Effort
from energy_opt.motion.move import Settings
from energy_opt.motion.plan.efforts import EFFORT_ROUNDS, smaller
from energy_opt.motion.plan.planner import Shares
from energy_opt.power import PowerModel
from energy_opt.robot import Robot, load_robot
from energy_opt.schedule import Schedule
from energy_opt.schedule.problem import CLOSE, keeps
from energy_opt.workcell.arm import Arm
from energy_opt.workcell.as_job import arms_beside
from energy_opt.workcell.between import Between
from energy_opt.workcell.file import WorkCell
from energy_opt.workcell.plan import Planned, Planning
from energy_opt.workcell.stage import Levers, with_lever
from energy_opt.workcell.supply import FINE, Supplied, Supply


@dataclass(frozen=True, eq=False)
class CellResult:
    """The plan of a cell.

    Attributes:
        cell: the request.
        planned: the answer: schedule, motions, clearance between arms.
        levers: schedules with one lever after the other.
        arms: by robot; None for one with only curves.
        own: power drawn from supplies of the robots' own; supply: from the one in the file. None without a
            known arm.
        bound: J, a lower bound over all schedules of these curves.
        interrupted: stopped early.
        robust: of arms planned under the mean of several models: this mean, total [J], lower_bound [J] of it, and its
            levers. All other energies are under the first model.
        overloads: of arms that exceed a torque limit under another model than the first: name, joint, share used.
        left: gap of the schedule that was planned.
        remarks: notes for the reader.
    """

    cell: WorkCell
    planned: Planned
    levers: Levers
    arms: tuple[Arm | None, ...]
    own: Supplied | None
    supply: Supplied | None
    bound: float
    interrupted: bool = False
    robust: dict[str, Any] | None = None
    overloads: tuple[tuple[str, str, float], ...] = ()
    left: float = 0.0
    remarks: tuple[str, ...] = ()

    @property
    def schedule(self) -> Schedule:
        """Start and duration of every step."""
        return self.planned.schedule

    @property
    def clearance(self) -> tuple[Between, ...]:
        """The clearance of every two arms."""
        return self.planned.clearance

    @property
    def energy(self) -> float:
        """Energy [J] of the whole cycle, from the supply in the file if there is one."""
        return self.schedule.energy

    @property
    def gap(self) -> float:
        """(energy - bound) / energy."""
        return max(0.0, self.energy - self.bound) / max(abs(self.energy), 1e-12)

    @property
    def solved(self) -> bool:
        """True if all arms are proven to keep apart."""
        return not self.interrupted and all(between.verdict == "proven" for between in self.clearance)


def run_workcell(
    cell: WorkCell,
    path: Path,
    *,
    load: Callable[[str], Robot] = load_robot,
    model_of: Callable[[str | None, Robot], PowerModel],
    settings: Settings | None = None,
    request: CellRequest | None = None,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[str, float], None] = lambda text, share: None,
    room: Shares = MappingProxyType({}),
) -> CellResult:
    """Plan a cell for least energy.

    Args:
        path: the job file, the base of other files' paths.
        load: loads a robot from its name or from the path of its URDF.
        model_of: the power model of a robot, from its entry in the file (None: no entry).
        request: body and cell, without the bases, which are in the file.
        stopped: called between solves; True ends the work with the best so far.
        progress: called with the present task and the finished share of the work.
        room: shares of the limits' bounds that moves may use, by the limits' names; all of them by default.

    Raises:
        BadInput: a fault of the file. Infeasible: no schedule keeps cycle time, lags, zones, limits of the supply, and
        arms apart.
    """

    around = request or CellRequest()
    load = cache(load)

    def planned(shares: Mapping[str, np.ndarray]) -> CellResult:
        """The plan in which robots use at most these shares of their torque limits."""
        arms: list[Arm | None] = []
        for table in cell.robot:
            beside = arms_beside(cell, table, path, load, around)
            given = Path(path), load, model_of, settings or Settings(), beside, stopped
            try:
                used = {**room, Effort.name: shares.get(table.name, 1.0) * room.get(Effort.name, 1.0)}
                arms.append(None if table.robot is None else Arm(cell, table, *given, used))
            except Infeasible as error:
                error.args = (f"{table.name}: {str(error).removeprefix(f'{table.name}: ')}",)
                raise
        _check_max_power(cell, arms)
        return _planned(Planning(cell, tuple(arms), progress, stopped))

    first = found = planned({})
    over = _efforts(first)
    shares: dict[str, np.ndarray] = {}
    for _ in range(EFFORT_ROUNDS):
        if not over or found.interrupted:
            break
        for name, (own, others) in over.items():
            shares[name] = smaller(shares.get(name, np.ones_like(own)), others, own)
        try:
            found = planned(shares)
        except Infeasible:
            break
        over = _efforts(found)
    if not over and found.solved:
        return found
    joints = {arm.name: arm.job.robot.joints for arm in first.arms if arm is not None}
    overloads = [
        (name, joints[name][int(use.argmax())], float(use.max())) for name, (_, use) in _efforts(first).items()
    ]
    return replace(first, overloads=tuple(overloads), interrupted=stopped())


def _check_max_power(cell: WorkCell, arms: Sequence[Arm | None]) -> None:
    """Raise Infeasible if the supply's largest power is less than the arms take at rest, each in its cheapest mode."""
    most = None if cell.supply is None else cell.supply.max_power
    if most is None:
        return
    least = 0.0
    for arm in arms:
        if arm is not None:
            modes = (mode.power for k in range(len(arm.job.steps)) for mode in arm.modes_at(k))
            # motors may hold it at less power between these poses, but never at less than this
            least += min(arm.scoring.of(False).model.constant_power(arm.job.robot.n), *modes)
    if most < least:
        raise Infeasible(
            f"supply: max_power = {most:.5g} W is below the {least:.5g} W that the arms take at rest; expected more",
            limit="max_power",
        )


def _efforts(result: CellResult) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """The robots with a motor's torque beyond its limit under another model than the first.

    Of each the largest shares (n,) of the limits: under the first model, and under the others.
    """
    out = {}
    for arm, motion in zip(result.arms, result.planned.motions, strict=True):
        if arm is not None and motion is not None and arm.scoring.mixed:
            used = arm.scoring.efforts([(arm.step_of(part.name), part.trajectory) for part in motion.parts])
            if used[1].max() > 1:
                out[arm.name] = used
    return out


def _planned(planning: Planning) -> CellResult:
    """The plan of a cell, stated under the first of several models."""
    cell, stopped = planning.cell, planning.stopped
    candidates = planning.candidates()
    if planning.moving:
        planned, levers = planning.plan(candidates)
    else:
        levers = candidates[0].levers
        planned = planning.proved(levers.best)
    arms = planning.arms
    left = planned.schedule.gap
    if all(arm is None for arm in arms):
        return CellResult(cell, planned, levers, arms, None, None, planned.schedule.bound, stopped(), left=left)
    mixed, robust = any(arm is not None and arm.scoring.mixed for arm in arms), None
    models = (False, True) if mixed else (False,)  # the mean of several, and the first
    found = own = [_from_supply(planning, planned.schedule, first, False) for first in models]
    every = [with_lever(levers.stated if first else levers, "paths", own[first][0]) for first in models]
    if cell.supply is not None:
        planned = supplied(planning, planned)
        found = [_from_supply(planning, planned.schedule, first, cell.supply.shared) for first in models]
        every = [with_lever(of_one, "supply", found[first][0]) for first, of_one in zip(models, every, strict=True)]
    bounds = [min(planning.bound(first), found[first][0].energy) for first in models]
    if mixed:
        steps = [{"name": name, "energy_total": schedule.energy} for name, schedule in every[0].steps]
        robust = {"kind": "mean", "total": found[0][0].energy, "lower_bound": bounds[0], "levers": steps}
    planned, drawn = replace(planned, schedule=found[-1][0]), found[-1][1]
    return CellResult(
        cell, planned, every[-1], planning.arms, own[-1][1], drawn, bounds[-1], stopped(), robust, left=left
    )


def _from_supply(planning: Planning, schedule: Schedule, first: bool, shared: bool) -> tuple[Schedule, Supplied]:
    """A schedule with what its steps take from the file's supply, if there is one, and the power drawn.

    Args:
        first: under the first of several models, not their mean. shared: from one link, not one for each robot.
    """
    supply = Supply(planning.cell, planning.arms, FINE, first)
    schedule = planning.stated(schedule) if first else schedule
    drawn = supply.drawn(schedule, shared)
    return (schedule if planning.cell.supply is None else supply.by_step(schedule, shared)), drawn


SLOWER = 1.2  # factor of a move's duration in the next plan
SLOWED = 24  # most plans with slower moves


def supplied(planning: Planning, planned: Planned) -> Planned:
    """The plan with starts, and slower moves if needed, that keep the supply's limits.

    Raises:
        Infeasible: none was found; gives the least peak found, its time, and its moves.
    """
    least: tuple[float, Infeasible] | None = None
    for _ in range(SLOWED):
        planned = _with_shifted_starts(planning, planned)
        supply = Supply(planning.cell, planning.arms, FINE)
        drawn = supply.drawn(planned.schedule, supply.table.shared)
        if drawn.valid or planning.stopped():
            return planned
        for arm in planning.arms if least is None else ():
            if arm is not None:  # moves that brake little take less at their peaks, too
                arm.optimize_using_again(0.0)
        moves = supply.heaviest(planned.schedule, drawn)
        if least is None or drawn.price < least[0]:
            least = drawn.price, _supply_error(planned.schedule, moves, drawn)
        if planning.bound() > (drawn.bound or np.inf) * planning.cell.cycle_time:
            break  # its mean is above the limit
        rings = planned.schedule.problem.rings
        slower = (
            planning.slower(r, rings[r].steps[k].name, SLOWER * float(planned.schedule.durations[r][k]))
            for r, k in moves
        )
        found = next((plan for plan in slower if plan is not None), None)
        if found is None:
            break
        planned = found
    assert least is not None
    raise least[1]


def _supply_error(schedule: Schedule, moves: list[tuple[int, int]], drawn: Supplied) -> Infeasible:
    """The error of a supply whose limits no schedule holds; names the moves at the worst instant."""
    rings = schedule.problem.rings
    names = ", ".join(f"{rings[r].name}.{rings[r].steps[k].name}" for r, k in moves) or "all robots wait then"
    if drawn.overflow > 0:
        return Infeasible(
            f"supply: {drawn.lost:.4g} J of braking cannot be stored ({names}): resistor = false; neither other "
            "times nor slower moves avoid it; a larger capacity, or a longer cycle_time, gives room",
            limit="capacity",
        )
    return Infeasible(
        f"supply: the least peak found is {drawn.peak:.5g} W at {drawn.peak_time:.4g} s of the cycle ({names}); "
        f"max_power = {drawn.bound:.5g} W; neither other times nor slower moves keep it; a longer cycle_time may",
        limit="max_power",
        time=drawn.peak_time,
    )


def _with_shifted_starts(planning: Planning, planned: Planned) -> Planned:
    """The plan with starts at which the supply draws less, if the arms keep apart."""
    supply = Supply(planning.cell, planning.arms)
    now = supply.drawn(planned.schedule, supply.table.shared)
    if now.lost == 0 and now.price == now.energy:  # no other times draw less, and the bound is kept
        return planned

    def apart(schedule: Schedule) -> bool:
        return all(between.verdict == "proven" for between in planning.proved(schedule).clearance)

    schedule = supply.in_phase(planned.schedule, apart)
    finer = supply.shifted(schedule)
    schedule = finer if apart(finer) else schedule
    if schedule is planned.schedule:
        return planned
    return replace(planning.proved(from_zero(schedule)), around=planned.around)


def from_zero(schedule: Schedule) -> Schedule:
    """The schedule from the first step of the first robot on, with other robots not earlier if lags allow it."""
    cycle = schedule.problem.cycle_time
    starts = [own - schedule.starts[0][0] for own in schedule.starts]
    for r, own in enumerate(starts):
        later = [*starts[:r], own + cycle, *starts[r + 1 :]]
        if own[0] < 0 and keeps(schedule.problem, later, schedule.durations):
            starts = later
    return replace(schedule, starts=tuple(starts))


def near_zero(schedule: Schedule) -> list[np.ndarray]:
    """The starts [s] of each robot's steps, later by whole cycles: none below 0 where all lags hold so, others near it.

    The first robot's stay, as they begin at 0: a lag may ask for a step of another robot before.
    """
    problem, starts = schedule.problem, schedule.starts
    cycle = problem.cycle_time
    later = [max(0, int(np.ceil((-own.min() - CLOSE) / cycle))) for own in starts]
    for _ in starts:
        for lag in problem.lags:
            if lag.height is None:  # it holds for any number of cycles
                continue
            (a, i), (b, j) = lag.begin, lag.end
            owed = lag.length - CLOSE - float(starts[b][j] - starts[a][i])
            later[b] = max(later[b], later[a] + int(np.ceil(owed / cycle - lag.height)))
    counted = [own + cycle * (cycles - later[0]) for own, cycles in zip(starts, later, strict=True)]
    return [np.where(np.abs(own) <= CLOSE, 0.0, own) for own in counted]
