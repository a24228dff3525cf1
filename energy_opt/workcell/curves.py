"""The scheduling problem of a cell, from its file and a curve for every move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

from energy_opt.errors import BadInput
from energy_opt.schedule import Exclusion, Lag, Mode, Move, Polynomial, Problem, Ring, Wait
from energy_opt.workcell.file import ModeTable, RobotTable, StepTable, WorkCell, step_name

SHORTEST = 1e-3  # [s] a curve with negative powers of the duration is not evaluated below


def mode_of(table: ModeTable, power: float | None = None) -> Mode:
    """A mode as the schedule uses it; `power` [W] in place of its own."""
    return Mode(table.name, table.power if power is None else power, table.least, table.enter, table.leave)


def modes_at(cell: WorkCell, robot: RobotTable, step: StepTable) -> tuple[Mode, ...]:
    """The modes that are possible in a wait; a robot's own mode takes the place of the cell's of the same name."""
    known = {mode.name: mode_of(mode) for mode in (*cell.mode, *robot.mode)}
    for name, power in step.power.items():
        known[name] = replace(known.get(name, Mode(name, power)), power=power)
    return tuple(known[name] for name in (known if step.modes is None else step.modes))


def ring_of(cell: WorkCell, robot: RobotTable) -> Ring:
    """The ring of a robot that is known by its curves alone.

    Raises:
        BadInput: a curve that is not convex over its durations.
    """
    steps: list[Move | Wait] = []
    for k, step in enumerate(robot.step):
        name = step_name(k, step)
        least, most = step.span
        if step.wait is not None:
            steps.append(Wait(name, least, most, modes_at(cell, robot, step)))
            continue
        curve = Polynomial(tuple(step.curve or ()))
        least = max(least, SHORTEST)
        if not curve.is_convex(least, max(least, most)):
            raise BadInput(
                f"robot {robot.name}: step {name}: its curve is not convex between {least:g} and {most:g} s; "
                "expected a fit of energy over duration whose slope never decreases"
            )
        steps.append(Move(name, least, max(least, most), curve))
    return Ring(robot.name, tuple(steps))


def problem_of(cell: WorkCell, rings: Mapping[str, Ring]) -> Problem:
    """The problem of a cell: rings by robot name, with its lags, `after` and zones."""
    return Problem(
        cell.cycle_time, tuple(rings[robot.name] for robot in cell.robot), tuple(_lags(cell)), tuple(_exclusions(cell))
    )


def _lags(cell: WorkCell) -> list[Lag]:
    out = [Lag(cell.step_at(lag.begin), cell.step_at(lag.end), lag.length, lag.height) for lag in cell.lag]
    for r, robot in enumerate(cell.robot):
        for k, step in enumerate(robot.step):
            if step.after is None:
                continue
            before = cell.step_at(step.after)
            if (
                step.lag is not None
            ):  # from the end of the one to the start of the other, a whole number of cycles later
                out.append(Lag(before, (r, k), step.lag[0], None, begin_ends=True, most=step.lag[1]))
                continue
            # Without a lag: after the other has ended, and before it begins again.
            out.append(Lag(before, (r, k), 0.0, None, begin_ends=True, within=cell.cycle_time))
    return out


def _exclusions(cell: WorkCell) -> list[Exclusion]:
    """Runs of consecutive steps in one zone, of different robots, two by two. Both keep the jitter apart."""
    runs: dict[str, list[tuple[int, int, int]]] = {}
    for r, robot in enumerate(cell.robot):
        zones = [step.zone for step in robot.step]
        count = len(zones)
        for k, zone in enumerate(zones):
            if zone is None or (zones[k - 1] == zone and len(set(zones)) > 1):
                continue
            last = k
            while last - k < count - 1 and zones[(last + 1) % count] == zone:
                last += 1
            runs.setdefault(zone, []).append((r, k, last % count))
    pairs = [pair for zone in runs.values() for pair in combinations(zone, 2)]
    return [Exclusion(one, two, 2 * cell.jitter) for one, two in pairs if one[0] != two[0]]
