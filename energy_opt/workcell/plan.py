"""Arms in one cycle: fronts, schedule and proof between the arms, one after the other until all agree.

price        every move slowed evenly, then optimized at a few durations
schedule     durations, modes and starts of least energy on the lower hull of what is known
refine       optimize every move at the duration that it got; again while the cycle's energy changes by 0.1 %
prove        every two arms, for the whole cycle and for lateness; where two touch, the times at which their steps
             may not meet become a constraint, and the schedule is made again with the durations that are known
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.schedule import Exclusion, Problem, Ring, Run, Schedule, solve
from energy_opt.workcell.arm import SOLVED, Arm
from energy_opt.workcell.between import Between, TwoArms, prove_apart
from energy_opt.workcell.curves import problem_of, ring_of
from energy_opt.workcell.file import WorkCell
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
        self.exclusions: dict[tuple[int, int, int, int], Exclusion] = {}
        cells = [None if arm is None else arm.cell for arm in arms]
        self._two = {
            (a, b): TwoArms(one, two)
            for (a, one), (b, two) in combinations(enumerate(cells), 2)
            if one is not None and two is not None
        }

    def price(self) -> None:
        """Slow every move evenly, and optimize it at the first durations."""
        moves = [(arm, move) for arm in self.arms if arm is not None for move in arm.moves]
        for arm in self.arms:
            if arm is not None:
                arm.slow()
        for k, (arm, move) in enumerate(moves):
            self.progress(f"{arm.name}: {move.leg.name}", 0.5 * k / max(len(moves), 1))
            for factor in SOLVED:
                if not self.stopped():
                    arm.optimize(move, min(move.shortest * factor, move.longest))

    def problem(self, optimized: bool, hold: Sequence[dict[int, float] | None] | None = None) -> Problem:
        """The scheduling problem with all that is known now."""
        rings: dict[str, Ring] = {}
        for k, (robot, arm) in enumerate(zip(self.cell.robot, self.arms, strict=True)):
            held = None if hold is None else hold[k]
            rings[robot.name] = ring_of(self.cell, robot) if arm is None else arm.ring(optimized, held)
        return problem_of(self.cell, rings, tuple(self.exclusions.values()))

    def plan(self) -> Planned:
        """The plan of least energy in which no two arms touch.

        Raises:
            Infeasible: no schedule keeps cycle time, lags, zones and the arms apart; names the two steps.
        """
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
