"""A cell's arms in an arrangement of their steps, as a scheduling problem, with the saving of each lever.

The levers are added one after the other, at the same cycle time:

as_is   every move in its present duration by the file, else as fast as possible; waits in the first mode of each wait
speeds  also the durations of the moves are chosen
modes   also the modes of the waits are chosen
order   also the order of the steps is chosen, if the order of a group is free
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.schedule import Exclusion, Move, Problem, Ring, Schedule, Wait, solve
from energy_opt.workcell.arm import Arm
from energy_opt.workcell.arrange import arrangements, cheapest, listed
from energy_opt.workcell.curves import problem_of, ring_of
from energy_opt.workcell.file import WorkCell, groups_of

SECONDS = 60.0  # [s] most time for one schedule; the gap that is left is in the result


@dataclass(frozen=True)
class Candidate:
    """An arrangement of the arms' steps, with the saving of each lever for evenly slowed moves.

    Attributes:
        arms: by robot, each with its steps in their order; None for a robot with only curves.
        levers: the schedules of this arrangement.
    """

    arms: tuple[Arm | None, ...]
    levers: Levers


@dataclass(eq=False)
class Stage:
    """A cell's arms, and the times at which they may not meet.

    Attributes:
        arms: by robot; None for a robot with only curves.
        least: [s] least durations of moves of a robot, for the supply.
    """

    cell: WorkCell
    arms: tuple[Arm | None, ...]
    progress: Callable[[str, float], None]
    stopped: Callable[[], bool]
    exclusions: dict[tuple[int, int, int, int], Exclusion] = field(default_factory=dict)
    least: dict[tuple[int, str], float] = field(default_factory=dict)

    @property
    def moving(self) -> bool:
        """True if any robot has an arm, not only curves."""
        return any(arm is not None for arm in self.arms)

    def candidates(self) -> list[Candidate]:
        """The arrangement of the file, and those of least energy with evenly slowed moves.

        These are: arms that may go elsewhere to wait, other orders of the steps, and these orders without going
        elsewhere.

        Raises:
            Infeasible: no schedule keeps cycle time, lags and zones.
        """
        given = self.arms
        self.arms = plain = tuple(None if arm is None else listed(arm) for arm in given)
        for k, arm in enumerate(plain):
            if arm is not None:
                self.progress(f"{arm.name}: evenly slowed", 0.1 * k / len(plain))
                arm.slow()
        found: list[Candidate] = []
        fault: Infeasible | None = None
        free = any(groups_of(robot) for robot in self.cell.robot)

        def add(arms: tuple[Arm | None, ...], levers: Levers | None, schedule: Schedule | None = None) -> None:
            with suppress(Infeasible):
                if free or levers is None:
                    schedule = schedule or solve(self.problem(False, arms=arms), seconds=SECONDS)
                    if levers is not None and arms == plain:  # the solver may have stopped at a gap
                        schedule = min(schedule, levers.best, key=lambda s: s.energy)
                    levers = with_lever(levers, "order", schedule)
                found.append(Candidate(arms, levers))

        levers: Levers | None = None
        try:
            levers = pull(self.problem(False).as_listed)
        except Infeasible as error:
            fault = error
        if levers is not None or not self.moving:
            add(plain, levers)
        waiting = levers
        self.progress("poses to wait in", 0.12)
        if self.moving and (better := self._cheapest(given, False)) is not None and better[0] != plain:
            waiting = with_lever(levers, "modes", better[1])
            add(better[0], waiting)
        self.progress("orders of steps", 0.15)
        if self.moving and free and (better := self._cheapest(given, True)) is not None:
            staying = tuple(
                arm if arm is None or own is None else arm.among(own.table.step)
                for arm, own in zip(better[0], plain, strict=True)
            )
            add(better[0], levers if staying == better[0] else waiting, better[1])
            if staying != better[0]:
                add(staying, levers)
        if not found:
            raise fault or Infeasible("no order of the steps keeps the cycle time", limit="duration")
        return found

    def _cheapest(self, given: Sequence[Arm | None], orders: bool) -> tuple[tuple[Arm | None, ...], Schedule] | None:
        """The arrangement of least energy with its schedule, if there is more than one."""
        choices = [[] if arm is None else arrangements(arm, orders, self.stopped) for arm in given]
        if not orders and all(len(choice) < 2 for choice in choices):
            return None

        def problem(arms: Sequence[Arm | None]) -> Problem:
            out = self.problem(False, arms=arms)
            return out if orders else out.as_listed

        return cheapest(given, choices, problem)

    def problem(
        self,
        optimized: bool,
        hold: Sequence[dict[int, float]] | None = None,
        arms: Sequence[Arm | None] | None = None,
        lossless: bool = False,
        anywhere: bool = False,
        first: bool = False,
    ) -> Problem:
        """The scheduling problem in the present state.

        Args:
            optimized: curves of optimized moves, else of evenly slowed ones.
            hold: of each robot, fixed durations [s] of moves, by the index of their step.
            arms: in place of the stage's own. lossless: the link loses nothing.
            anywhere: without the constraints that keep arms apart and those of the supply.
            first: under the first of several models, not their mean.
        """
        rings: dict[str, Ring] = {}
        for k, (robot, arm) in enumerate(zip(self.cell.robot, self.arms if arms is None else arms, strict=True)):
            held = None if hold is None else hold[k]
            ring = ring_of(self.cell, robot) if arm is None else arm.ring(optimized, held, lossless, first)
            if not anywhere:
                asked = [max(step.least, self.least.get((k, step.name), 0.0)) for step in ring.steps]
                steps = (replace(step, least=least) for step, least in zip(ring.steps, asked, strict=True))
                ring = replace(ring, steps=tuple(steps))
            rings[robot.name] = ring
        return problem_of(self.cell, rings, () if anywhere else tuple(self.exclusions.values()))

    def bound(self, first: bool = False) -> float:
        """A lower bound [J] over all schedules of these curves, wherever the arms are; a supply loses nothing.

        Args:
            first: under the first of several models, not their mean.
        """
        lossless = self.cell.supply is not None
        return solve(self.problem(True, lossless=lossless, anywhere=True, first=first), seconds=SECONDS).bound


@dataclass(frozen=True)
class Levers:
    """Schedules by lever, in order; the last one is the answer.

    Attributes:
        steps: pairs (lever, schedule), each with the levers before it.
        alone: pairs (lever, schedule), each lever by itself on top of "as_is".
        relaxed: True if at full speed the waits had to last longer than their bounds.
    """

    steps: tuple[tuple[str, Schedule], ...]
    alone: tuple[tuple[str, Schedule], ...]
    relaxed: bool

    @property
    def best(self) -> Schedule:
        """The schedule with all levers."""
        return self.steps[-1][1]

    @property
    def stated(self) -> Levers:
        """The levers with energies as results state them."""
        steps, alone = (tuple((name, found.stated) for name, found in pairs) for pairs in (self.steps, self.alone))
        return replace(self, steps=steps, alone=alone)


def with_lever(levers: Levers | None, name: str, schedule: Schedule) -> Levers:
    """The levers with one more, or with another schedule of one."""
    if levers is None:
        return Levers(((name, schedule),), (), False)
    return replace(levers, steps=(*(step for step in levers.steps if step[0] != name), (name, schedule)))


def pull(problem: Problem) -> Levers:
    """Schedule a problem with one lever after the other, except the order of steps.

    The answer takes at most SECONDS, each of the others a quarter of that.

    Raises:
        Infeasible: no schedule keeps cycle time, lags and zones, whatever the durations.
    """
    best, brief = solve(problem, seconds=SECONDS, explain=True), SECONDS / 4
    steps: list[tuple[str, Schedule]] = []
    alone: tuple[tuple[str, Schedule], ...] = ()
    relaxed = False
    for change in (_at_present_duration, _without_longest):
        with suppress(Infeasible):
            fast = _with_steps(_with_steps(problem, _at_present_duration), change)
            steps.append(("as_is", solve(_with_steps(fast, _at_full_readiness), seconds=brief)))
            alone, relaxed = (("modes", solve(fast, seconds=brief)),), change is _without_longest
            break
    before = [] if relaxed else [schedule for _, schedule in steps]  # also possible with the next lever
    with suppress(Infeasible):  # infeasible if a wait's first mode is impossible for so long
        once = solve(_with_steps(problem, _at_full_readiness), seconds=brief)
        before = [min([once, *before], key=lambda schedule: schedule.energy)]
        steps.append(("speeds", before[0]))
    return Levers((*steps, ("modes", min([best, *before], key=lambda schedule: schedule.energy))), alone, relaxed)


def _at_present_duration(step: Move | Wait) -> Move | Wait:
    """The step at its present duration, or at its shortest."""
    if isinstance(step, Wait):
        return step
    taken = step.least if step.as_is is None else min(max(step.as_is, step.least), step.most)
    return replace(step, least=taken, most=taken)


def _at_full_readiness(step: Move | Wait) -> Move | Wait:
    """The step with only its first mode, if it is a wait."""
    return replace(step, modes=step.modes[:1]) if isinstance(step, Wait) else step


def _without_longest(step: Move | Wait) -> Move | Wait:
    """The step without a longest duration if it is a wait."""
    return replace(step, most=np.inf) if isinstance(step, Wait) else step


def _with_steps(problem: Problem, change: Callable[[Move | Wait], Move | Wait]) -> Problem:
    """The problem with every step changed."""
    rings = tuple(Ring(ring.name, tuple(change(step) for step in ring.steps)) for ring in problem.rings)
    return replace(problem, rings=rings)
