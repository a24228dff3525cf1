"""The scheduling problem of a cell, from its file and a curve for every move.

The curve is the move's energy over its duration, convex: of an arm the lower hull of solved motions, else a formula
in the file. Lags, zones and `after` become constraints between the steps' starts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

from energy_opt.errors import BadInput
from energy_opt.schedule import Exclusion, Lag, Mode, Move, Polynomial, Problem, Ring, Run, Wait
from energy_opt.workcell.file import MOST, ModeTable, RobotTable, StepTable, WorkCell, groups_of, step_label, step_name

ADDED = "wait after {}"
SHORTEST = 1e-3  # [s] shorter durations are not evaluated, because a curve may have negative powers of the duration


def mode_of(table: ModeTable, power: float | None = None) -> Mode:
    """A mode for the schedule; `power` [W] replaces its own."""
    return Mode(table.name, table.power if power is None else power, table.least, table.enter, table.leave)


def modes_at(cell: WorkCell, robot: RobotTable, step: StepTable) -> tuple[Mode, ...]:
    """The modes that are possible in a wait of a robot with only curves.

    A robot's own mode replaces the cell's of the same name. A mode with postures is possible in the waits that these
    name, and if a wait lists it among its `modes` or gives its power.
    """
    named = {*(step.modes or ()), *step.power, step.name}
    tables = {mode.name: mode for mode in (*cell.mode, *robot.mode)}.values()
    known = {m.name: mode_of(m) for m in tables if m.posture == "any" or named & {m.name, *m.posture}}
    for name, power in step.power.items():
        known[name] = replace(known.get(name, Mode(name, power)), power=power)
    return tuple(known[name] for name in (known if step.modes is None else step.modes))


def ring_of(cell: WorkCell, robot: RobotTable) -> Ring:
    """The ring of a robot with only curves.

    Raises:
        BadInput: a curve that is not convex over its durations.
    """
    steps: list[Move | Wait] = []
    for k, step in enumerate(robot.step):
        name, label = step_name(k, step), f"robot {robot.name}: {step_label(k, step)}"
        least, most = step.span
        if step.wait is not None:
            modes = modes_at(cell, robot, step)
            if not modes:
                raise BadInput(f"{label}: no mode is possible here; `posture` of each names others")
            steps.append(Wait(name, least, most, modes))
            continue
        curve = Polynomial(tuple(step.curve or ()))
        least = max(least, SHORTEST)
        ends = [curve.value(d) for d in (least, max(least, most))]
        if not max(map(abs, ends)) <= MOST:
            raise BadInput(
                f"{label}: its curve gives {ends[0]:g} J at {least:g} s and {ends[1]:g} J at "
                f"{most:g} s; expected {MOST:g} J at most"
            )
        if not curve.is_convex(least, max(least, most)):
            raise BadInput(
                f"{label}: its curve is not convex between {least:g} and {most:g} s; "
                "expected a fit of energy over duration whose slope never decreases"
            )
        steps.append(Move(name, least, max(least, most), curve, step.as_is))
    return Ring(robot.name, tuple(steps), tuple(groups_of(robot)))


def problem_of(cell: WorkCell, rings: Mapping[str, Ring], exclusions: Sequence[Exclusion] = ()) -> Problem:
    """The problem of a cell: rings by robot name, with its lags, `after`, zones, and further `exclusions`."""
    apart = (*_exclusions(cell, rings), *exclusions)
    return Problem(cell.cycle_time, tuple(rings[r.name] for r in cell.robot), tuple(_lags(cell, rings)), apart)


def _lags(cell: WorkCell, rings: Mapping[str, Ring]) -> list[Lag]:
    """The file's lags, and those of `after`, between steps of the rings."""
    places = [step_places(robot, rings[robot.name]) for robot in cell.robot]

    def at(name: str) -> tuple[int, int]:
        r, k = cell.step_at(name)
        return r, places[r][k]

    out = [Lag(at(lag.begin), at(lag.end), lag.length, lag.height) for lag in cell.lag]
    for r, robot in enumerate(cell.robot):
        for k, step in zip(places[r], robot.step, strict=True):
            if step.after is None:
                continue
            before = at(step.after)
            # from the end of one step to the start of the other, a whole number of cycles later; without a lag: after
            # the other has ended, and before it begins again
            least, most = step.lag or (0.0, None)
            within = cell.cycle_time if step.lag is None else None
            out.append(Lag(before, (r, k), least, None, begin_ends=True, most=most, within=within))
    return out


def _exclusions(cell: WorkCell, rings: Mapping[str, Ring]) -> list[Exclusion]:
    """Pairs of runs of consecutive steps in one zone, of different robots, kept apart by the jitter of both."""
    zoned: dict[str, list[Run]] = {}
    for r, robot in enumerate(cell.robot):
        ring = rings[robot.name]
        zones = zones_of(robot, ring)
        cuts = {k for group in ring.groups for first, last in group.blocks for k in (first, (last + 1) % len(zones))}
        for k, zone in enumerate(zones):
            if zone is None or (zones[k - 1] == zone and len(set(zones)) > 1 and k not in cuts):
                continue
            last = k
            while last - k < len(zones) - 1 and zones[(last + 1) % len(zones)] == zone:
                if (last + 1) % len(zones) in cuts:
                    break
                last += 1
            zoned.setdefault(zone, []).append(Run(r, k, last % len(zones)))
    pairs = [pair for runs in zoned.values() for pair in combinations(runs, 2)]
    return [Exclusion(one, two, 2 * cell.jitter) for one, two in pairs if one.ring != two.ring]


def zones_of(robot: RobotTable, ring: Ring) -> list[str | None]:
    """The zone of every step of a ring.

    An added wait stays in the zone of the step before it; an added move to wait elsewhere leaves that zone, unless the
    step after it is in the same.
    """
    own: dict[str, str | None] = {}
    before: str | None = None
    for k, table in reversed(list(enumerate(robot.step))):  # a step that does not stop is one motion with the next
        own[step_name(k, table)] = before = table.zone or (before if table.passes else None)
    out: list[str | None] = []
    zone = own.get(ring.steps[-1].name)
    for k, step in enumerate(ring.steps):
        if step.name in own:
            zone = own[step.name]
        elif isinstance(step, Wait) and step.name.removeprefix(ADDED.format("")) not in own:
            after = next((s.name for s in ring.steps[k + 1 :] if s.name in own), "")
            zone = zone if own.get(after) == zone else None
        out.append(zone)
    return out


def step_places(robot: RobotTable, ring: Ring) -> list[int]:
    """Places of a robot's own steps in its ring, which may contain further waits."""
    names = [step.name for step in ring.steps]
    out: list[int] = []
    for k, step in enumerate(robot.step):
        name = step_name(k, step)
        # a pose that is only passed belongs to the step before
        out.append(names.index(name) if name in names else out[-1])
    return out
