"""The saving of each lever, one after the other, at the same cycle time.

as_is   every move in its present duration by the file, else as fast as possible; waits at full readiness (the first
        mode of a wait)
speeds  durations of the moves chosen
modes   modes of the waits chosen, too
order   the order of steps chosen, too, if a group of them leaves it free
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.schedule import Move, Problem, Ring, Schedule, Wait, solve


@dataclass(frozen=True)
class Levers:
    """Schedules by lever, in order; the last one is the answer.

    Attributes:
        steps: pairs (lever, schedule), each with the levers before it.
        alone: pairs (lever, schedule), each lever by itself on top of "as_is".
        relaxed: at full speed waits had to last longer than their bounds.
    """

    steps: tuple[tuple[str, Schedule], ...]
    alone: tuple[tuple[str, Schedule], ...]
    relaxed: bool

    @property
    def best(self) -> Schedule:
        """The schedule with all levers."""
        return self.steps[-1][1]


def with_lever(levers: Levers | None, name: str, schedule: Schedule) -> Levers:
    """The levers with one more, or with another schedule of one."""
    if levers is None:
        return Levers(((name, schedule),), (), False)
    return replace(levers, steps=(*(step for step in levers.steps if step[0] != name), (name, schedule)))


def pull(problem: Problem, *, seconds: float) -> Levers:
    """Schedule a problem with one lever after the other, except the order of steps.

    Args:
        seconds: for the answer [s]; the others take at most a quarter of that each.

    Raises:
        Infeasible: no schedule keeps cycle time, lags and zones, whatever the durations.
    """
    best, brief = solve(problem, seconds=seconds, explain=True), seconds / 4
    steps: list[tuple[str, Schedule]] = []
    alone: tuple[tuple[str, Schedule], ...] = ()
    relaxed = False
    for change in (_today, _longer):
        with suppress(Infeasible):
            fast = _each(_each(problem, _today), change)
            steps.append(("as_is", solve(_each(fast, _ready), seconds=brief)))
            alone, relaxed = (("modes", solve(fast, seconds=brief)),), change is _longer
            break
    before = [] if relaxed else [schedule for _, schedule in steps]  # also possible with the next lever
    with suppress(Infeasible):  # infeasible if a wait's first mode is impossible for so long
        before = [min([solve(_each(problem, _ready), seconds=brief), *before], key=_energy)]
        steps.append(("speeds", before[0]))
    return Levers((*steps, ("modes", min([best, *before], key=_energy))), alone, relaxed)


def _today(step: Move | Wait) -> Move | Wait:
    if isinstance(step, Wait):
        return step
    taken = step.least if step.as_is is None else min(max(step.as_is, step.least), step.most)
    return replace(step, least=taken, most=taken)


def _ready(step: Move | Wait) -> Move | Wait:
    return replace(step, modes=step.modes[:1]) if isinstance(step, Wait) else step


def _longer(step: Move | Wait) -> Move | Wait:
    return replace(step, most=np.inf) if isinstance(step, Wait) else step


def _energy(schedule: Schedule) -> float:
    return schedule.energy


def _each(problem: Problem, change: Callable[[Move | Wait], Move | Wait]) -> Problem:
    rings = tuple(Ring(ring.name, tuple(change(step) for step in ring.steps)) for ring in problem.rings)
    return replace(problem, rings=rings)
