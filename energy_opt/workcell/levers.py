"""What each lever saves, one after the other, at the same cycle time.

as_is   every move as fast as it can be, waits at full readiness (the first mode that a wait has)
speeds  durations of the moves chosen
modes   modes of the waits chosen, too
order   the order of steps chosen, too, where a group of them leaves it free
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

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
    """Schedule a problem with one lever after the other, but for the order of steps.

    Args:
        seconds: for the answer [s]; the others take at most a quarter of that each.

    Raises:
        Infeasible: no schedule keeps cycle time, lags and zones, whatever the durations.
    """
    best = solve(problem, seconds=seconds)
    brief = seconds / 4
    fast, ready = _full_speed(problem), _first_mode
    relaxed = False
    try:
        as_is = solve(ready(fast), seconds=brief)
    except Infeasible:
        relaxed, fast = True, _longer_waits(fast)
        try:
            as_is = solve(ready(fast), seconds=brief)
        except Infeasible:
            return Levers((("modes", best),), (), False)
    steps = [("as_is", as_is)]
    with suppress(Infeasible):  # where a wait's first mode is impossible for so long
        steps.append(("speeds", solve(ready(problem), seconds=brief)))
    return Levers((*steps, ("modes", best)), (("modes", solve(fast, seconds=brief)),), relaxed)


def _full_speed(problem: Problem) -> Problem:
    return _each(problem, lambda step: replace(step, most=step.least) if isinstance(step, Move) else step)


def _first_mode(problem: Problem) -> Problem:
    return _each(problem, lambda step: replace(step, modes=step.modes[:1]) if isinstance(step, Wait) else step)


def _longer_waits(problem: Problem) -> Problem:
    return _each(problem, lambda s: replace(s, most=problem.cycle_time) if isinstance(s, Wait) else s)


def _each(problem: Problem, change: Callable[[Move | Wait], Move | Wait]) -> Problem:
    rings = tuple(Ring(ring.name, tuple(change(step) for step in ring.steps)) for ring in problem.rings)
    return replace(problem, rings=rings)
