"""A plan within the limits of its supply: other starts first, then slower moves at the power's peaks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.schedule import Schedule
from energy_opt.schedule.check import keeps
from energy_opt.workcell.plan import Planned, Planning
from energy_opt.workcell.supply import FINE, Supplied, Supply

SLOWER = 1.2  # factor of a move's duration in the next plan
SLOWED = 24  # most plans with slower moves


def supplied(planning: Planning, planned: Planned) -> tuple[Planned, Supplied]:
    """The plan with starts, and slower moves if needed, that keep the supply's limits; and the power it draws.

    Raises:
        Infeasible: none was found; gives the least peak found, its time, and its moves.
    """
    least: tuple[float, Infeasible] | None = None
    for _ in range(SLOWED):
        planned = _shifted(planning, planned)
        supply = Supply(planning.cell, planning.arms, FINE)
        drawn = supply.drawn(planned.schedule, supply.table.shared)
        if drawn.valid or planning.stopped():
            return planned, drawn
        moves = supply.heaviest(planned.schedule, drawn)
        if least is None or drawn.price < least[0]:
            least = drawn.price, _fault(planned.schedule, moves, drawn)
        if planning.bound(lossless=True) > (drawn.bound or np.inf) * planning.cell.cycle_time:
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


def _fault(schedule: Schedule, moves: list[tuple[int, int]], drawn: Supplied) -> Infeasible:
    rings = schedule.problem.rings
    names = ", ".join(f"{rings[r].name}.{rings[r].steps[k].name}" for r, k in moves) or "all robots wait then"
    if drawn.overflow > 0:
        return Infeasible(
            f"supply: {drawn.lost:.4g} J that the arms brake fit nowhere ({names}): resistor = false; neither other "
            "times nor slower moves avoid it; a larger capacity, or a longer cycle_time, gives room",
            limit="capacity",
        )
    return Infeasible(
        f"supply: the least peak found is {drawn.peak:.5g} W at {drawn.peak_time:.4g} s of the cycle ({names}); "
        f"max_power = {drawn.bound:.5g} W; neither other times nor slower moves keep it; a longer cycle_time may",
        limit="max_power",
        time=drawn.peak_time,
    )


def _shifted(planning: Planning, planned: Planned) -> Planned:
    """The plan with starts at which the supply draws less, if the arms keep apart."""
    supply = Supply(planning.cell, planning.arms)

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
