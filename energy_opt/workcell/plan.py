"""Arms in one cycle: fronts, schedule and proof between the arms, one after the other until all agree.

arrange      every move slowed evenly; orders of steps and poses to wait in by what they then take
price        every move optimized at a few durations
schedule     durations, modes and starts of least energy on the lower hull of what is known
refine       optimize every move at the duration that it got; again while the cycle's energy changes by 0.1 %
prove        every two arms, for the whole cycle and for lateness; where two touch, the times at which their steps
             may not meet become a constraint, and the schedule is made again with the durations that are known
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.schedule import Exclusion, Problem, Ring, Run, Schedule, solve
from energy_opt.workcell.arm import SOLVED, Arm
from energy_opt.workcell.arrange import arrangements, cheapest, listed
from energy_opt.workcell.between import Between, TwoArms, prove_apart
from energy_opt.workcell.curves import problem_of, ring_of
from energy_opt.workcell.file import WorkCell, groups_of
from energy_opt.workcell.levers import Levers, pull, with_lever
from energy_opt.workcell.meeting import meeting
from energy_opt.workcell.motion import PeriodicMotion

SETTLED = 1e-3  # relative change of the cycle's energy that ends refining
REFINED = 6  # schedules whose durations are optimized
SHIFTED = 30  # schedules that are tried until no two arms touch


@dataclass(frozen=True)
class Planned:
    """A cell's plan.

    Attributes:
        schedule: with durations at which every move is known; exclusions: times that keep arms apart, found on the way.
        clearance: every two arms.
        motions: of every arm over its cycle; None for a robot that is known by its curves alone.
    """

    schedule: Schedule
    exclusions: tuple[Exclusion, ...]
    clearance: tuple[Between, ...]
    motions: tuple[PeriodicMotion | None, ...]


class Planning:
    """The work on a cell with arms.

    Args:
        arms: by robot; None for a robot that is known by its curves alone.
    """

    def __init__(
        self,
        cell: WorkCell,
        arms: Sequence[Arm | None],
        seconds: float,
        progress: Callable[[str, float], None],
        stopped: Callable[[], bool],
    ) -> None:
        self.cell, self.arms, self.seconds = cell, tuple(arms), seconds
        self.progress, self.stopped = progress, stopped
        self._plain = self.arms  # in the order of the file, as far as `after` allows it
        self.exclusions: dict[tuple[int, int, int, int], Exclusion] = {}
        cells = [None if arm is None else arm.cell for arm in arms]
        self._two = {
            (a, b): TwoArms(one, two)
            for (a, one), (b, two) in combinations(enumerate(cells), 2)
            if one is not None and two is not None
        }

    @property
    def moving(self) -> bool:
        """Is any arm known, not by its curves alone?"""
        return any(arm is not None for arm in self.arms)

    def arranged(self) -> Levers:
        """What each lever saves with evenly slowed moves; the arms take the arrangement of steps that costs least.

        Raises:
            Infeasible: no schedule keeps cycle time, lags and zones.
        """
        given = self.arms
        self.arms = tuple(None if arm is None else listed(arm) for arm in given)
        self._plain = self.arms
        for k, arm in enumerate(self.arms):
            if arm is not None:
                self.progress(f"{arm.name}: evenly slowed", 0.1 * k / len(self.arms))
                arm.slow()
        found: Levers | None = None
        fault: Infeasible | None = None
        try:
            found = pull(self.problem(False).as_listed, seconds=self.seconds)
        except Infeasible as error:
            fault = error
        self.progress("poses to wait in", 0.12)
        better = self._cheapest(given, False)
        if better is not None:
            found = with_lever(found, "modes", better)
        if any(groups_of(robot) for robot in self.cell.robot):
            self.progress("orders of steps", 0.15)
            better = self._cheapest(given, True)
            if better is not None:
                found = with_lever(found, "order", better)
        if found is None:
            raise fault or Infeasible("no order of the steps keeps the cycle time", limit="duration")
        return found

    def _cheapest(self, given: Sequence[Arm | None], orders: bool) -> Schedule | None:
        """The schedule of the best arrangement, where there is more than one; the arms take it."""
        choices = [[] if arm is None else arrangements(arm, orders) for arm in given]
        if not orders and all(len(choice) < 2 for choice in choices):
            return None

        def problem(arms: Sequence[Arm | None]) -> Problem:
            out = self.problem(False, arms=arms)
            return out if orders else out.as_listed

        if not self.moving:
            with suppress(Infeasible):
                return solve(problem(given), seconds=self.seconds)
        found = cheapest(given, choices, problem)
        if found is None:
            return None
        self.arms = found[0]
        return found[1]

    def _price(self) -> None:
        """Optimize every move at the first durations."""
        moves = [(arm, move) for arm in self.arms if arm is not None for move in arm.moves]
        for k, (arm, move) in enumerate(moves):
            self.progress(f"{arm.name}: {move.leg.name}", 0.2 + 0.3 * k / max(len(moves), 1))
            for factor in SOLVED:
                if not self.stopped():
                    arm.optimize(move, min(move.shortest * factor, move.longest))

    def problem(
        self,
        optimized: bool,
        hold: Sequence[dict[int, float] | None] | None = None,
        arms: Sequence[Arm | None] | None = None,
    ) -> Problem:
        """The scheduling problem with all that is known now."""
        rings: dict[str, Ring] = {}
        for k, (robot, arm) in enumerate(zip(self.cell.robot, self.arms if arms is None else arms, strict=True)):
            held = None if hold is None else hold[k]
            rings[robot.name] = ring_of(self.cell, robot) if arm is None else arm.ring(optimized, held)
        return problem_of(self.cell, rings, tuple(self.exclusions.values()))

    def plan(self) -> Planned:
        """The plan of least energy in which no two arms touch.

        Where the cheapest arrangement has none, the one of the file is tried.

        Raises:
            Infeasible: no schedule keeps cycle time, lags, zones and the arms apart; names the two steps.
        """
        if self.arms == self._plain:
            return self._planned()
        with suppress(Infeasible):
            return self._planned()
        self.arms, self.exclusions = self._plain, {}
        return self._planned()

    def _planned(self) -> Planned:
        self._price()
        schedule = self._refined()
        for _ in range(SHIFTED):
            found = self.proved(schedule)
            touching = [between for between in found.clearance if between.verdict != "proven"]
            if not touching or self.stopped():
                return found
            self.progress("times that keep the arms apart", 0.9)
            before = dict(self.exclusions)
            for between in touching:
                self._keep_apart(between, found)
            if self.exclusions == before:
                return found
            try:
                schedule = self._scheduled(self._durations(schedule))
            except Infeasible:
                try:
                    schedule = self._refined()
                except Infeasible as error:
                    raise _collision(self.cell, found, touching[0], error) from None
        return found

    def _scheduled(self, hold: Sequence[dict[int, float] | None] | None = None) -> Schedule:
        return solve(self.problem(True, hold), seconds=self.seconds, gap=1e-5)

    def _refined(self) -> Schedule:
        """A schedule whose moves are all optimized at the durations that they have."""
        schedule, before = self._scheduled(), np.inf
        for k in range(REFINED):
            self.progress("schedule", 0.5 + 0.4 * k / REFINED)
            self._optimize(schedule)
            schedule = self._scheduled()
            if abs(schedule.energy - before) < SETTLED * abs(schedule.energy):
                break
            before = schedule.energy
        self._optimize(schedule)
        return self._scheduled(self._durations(schedule))

    def _optimize(self, schedule: Schedule) -> None:
        """Optimize every move at the duration that it has in a schedule."""
        for arm, durations in zip(self.arms, self._durations(schedule), strict=True):
            if arm is None or durations is None:
                continue
            for move in arm.moves:
                if not self.stopped():
                    arm.optimize(move, durations[move.place])

    def _durations(self, schedule: Schedule) -> list[dict[int, float] | None]:
        """Durations of the arms' moves, by step."""
        out: list[dict[int, float] | None] = []
        for arm, ring, lengths in zip(self.arms, schedule.problem.rings, schedule.durations, strict=True):
            if arm is None:
                out.append(None)
                continue
            by_name = dict(zip((step.name for step in ring.steps), lengths.tolist(), strict=True))
            out.append({m.place: by_name[ring_name(arm, m.place)] for m in arm.moves})
        return out

    def proved(self, schedule: Schedule) -> Planned:
        """A schedule with its motions and the proof between every two arms."""
        motions = tuple(
            None if arm is None else PeriodicMotion(arm.parts(ring, starts, lengths), self.cell.cycle_time)
            for arm, ring, starts, lengths in zip(
                self.arms, schedule.problem.rings, schedule.starts, schedule.durations, strict=True
            )
        )
        clearance = []
        for (a, b), arms in self._two.items():
            self.progress(f"proof: {self.cell.robot[a].name} and {self.cell.robot[b].name}", 0.9)
            one, two = motions[a], motions[b]
            assert one is not None
            assert two is not None
            clearance.append(prove_apart(arms, (a, b), one, two, self.cell.jitter))
        return Planned(schedule, tuple(self.exclusions.values()), tuple(clearance), motions)

    def _keep_apart(self, between: Between, found: Planned) -> None:
        """Add the times at which the two steps that touch may not meet."""
        a, b = between.robots
        one, two = found.motions[a], found.motions[b]
        assert one is not None
        assert two is not None
        time = between.time or 0.0
        rings = found.schedule.problem.rings
        parts = one.part_at(time), two.part_at(time + between.late)
        i, j = ([s.name for s in rings[r].steps].index(part.name) for r, part in zip((a, b), parts, strict=True))
        runs = meeting(self._two[a, b], *parts)
        key = (a, i, b, j)
        known = self.exclusions.get(key)
        first, second = (Run(r, k, k, part) for r, k, part in zip((a, b), (i, j), runs, strict=True))
        if known is not None:
            first, second = _wider(known.first, first), _wider(known.second, second)
            if (first, second) == (known.first, known.second):  # it did not suffice: the steps never meet at all
                first, second = Run(a, i, i), Run(b, j, j)
        self.exclusions[key] = Exclusion(first, second, 2 * self.cell.jitter)


def ring_name(arm: Arm, place: int) -> str:
    """The name in a ring of the arm's step at an index of its table."""
    table = arm.table.step[place]
    return table.name or f"step {place + 1}"


def _wider(one: Run, two: Run) -> Run:
    if one.part is None or two.part is None:
        return Run(one.ring, one.first, one.last)
    part = min(one.part[0], two.part[0]), max(one.part[1], two.part[1])
    return Run(one.ring, one.first, one.last, part)


def _collision(cell: WorkCell, found: Planned, between: Between, error: Infeasible) -> Infeasible:
    a, b = between.robots
    time = between.time or 0.0
    one, two = found.motions[a], found.motions[b]
    assert one is not None
    assert two is not None
    steps = one.part_at(time).name, two.part_at(time + between.late).name
    bodies = "" if between.pair is None else f" ({between.pair[0]} and {between.pair[1]})"
    return Infeasible(
        f"{cell.robot[a].name}, step {steps[0]}, and {cell.robot[b].name}, step {steps[1]}, touch at {time:.4g} s"
        f"{bodies}, and no schedule keeps them apart: {error}; a longer cycle_time gives the schedule room",
        limit="clearance",
        time=time,
    )
