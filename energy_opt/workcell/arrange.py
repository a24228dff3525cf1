"""The arrangement of the arms' steps: their order where it is free, and the pose in which an arm waits.

An arrangement is estimated by the schedule of its arm alone, with evenly slowed moves. The sum of these energies is
also a lower bound for the cell. Combinations of arrangements are scheduled in the order of their bounds, until none of
the others can be better. Groups with few orders are enumerated; for larger ones a bounded search keeps the best orders
it finds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import islice, permutations, product

from energy_opt.errors import Infeasible
from energy_opt.schedule import Problem, Schedule, solve
from energy_opt.schedule.problem import Group, in_blocks, possible
from energy_opt.workcell.arm import Arm
from energy_opt.workcell.file import StepTable, groups_of

ORDERS = 720  # most orders of an arm's groups to enumerate: six steps
MET = 300  # most estimates of a bounded search
KEPT = 24  # most arrangements of an arm to combine with others', and most combinations to schedule
AWAY = 4  # orders of an arm, the best first, in which waiting elsewhere is tried
# an arm moves to another pose to wait only if the power there is below this share of that at its best own pose
CHEAPER = 0.98
SECONDS = 5.0  # [s] for the schedule of one arm, and of a combination
CLOSE = 1e-6  # relative: energies that differ by less are equal


@dataclass(frozen=True)
class Arranged:
    """An arm in an arrangement, and the least energy of its own cycle [J]."""

    arm: Arm
    energy: float


def listed(arm: Arm) -> Arm:
    """The arm with its steps in the order of the file, as far as `after` allows it."""
    groups = groups_of(arm.table)
    orders = [possible(group, range(len(group.blocks))) for group in groups]
    steps = [arm.table.step[k] for k in in_blocks(len(arm.table.step), groups, orders)]
    return arm if steps == arm.table.step else arm.arranged(steps)


def arrangements(arm: Arm, orders: bool, stopped: Callable[[], bool]) -> list[Arranged]:
    """Arrangements of an arm's steps, the cheapest first; with `orders` also in other orders than the file's.

    Args:
        stopped: called before every estimate; True ends the search.
    """
    if not orders:
        found = _estimated(lambda: listed(arm))
        return [] if found is None else _cheapest([found, *_with_waits_elsewhere(found.arm)])
    groups = groups_of(arm.table)
    met: dict[tuple[int, ...], Arranged | None] = {}

    def look(choice: tuple[tuple[int, ...], ...]) -> float:
        order = tuple(in_blocks(len(arm.table.step), groups, choice))
        if order not in met and met and stopped():
            return float("inf")
        if order not in met:
            steps = [arm.table.step[k] for k in order]
            met[order] = _estimated(lambda: arm if steps == arm.table.step else arm.arranged(steps))
        found = met[order]
        return float("inf") if found is None else found.energy

    first = tuple(tuple(possible(group, range(len(group.blocks)))) for group in groups)
    look(first)  # in any case, even if the search finds no better order
    every = product(*map(_orders, groups))
    few = list(islice(every, ORDERS + 1))
    if len(few) <= ORDERS:
        for choice in few:
            look(choice)
    else:
        _search(groups, first, look, lambda: len(met) >= MET or stopped())
    best = _cheapest([one for one in met.values() if one is not None])
    away = [other for one in best[:AWAY] for other in _with_waits_elsewhere(one.arm)]
    return _cheapest([*best, *away])


def cheapest(
    arms: Sequence[Arm | None],
    choices: Sequence[Sequence[Arranged]],
    problem_of: Callable[[Sequence[Arm | None]], Problem],
) -> tuple[tuple[Arm | None, ...], Schedule] | None:
    """The combination of arrangements, one of every arm, of least scheduled energy; None if none is possible.

    Args:
        arms: by robot; None for one with only curves.
        choices: arrangements of every arm, by robot, the cheapest first; empty for one with only curves.
        problem_of: the scheduling problem of arms.
    """
    places = [k for k, arm in enumerate(arms) if arm is not None]
    of = [choices[k] for k in places]
    if not all(of):
        return None
    # best first: the sum of the arms' energies alone is a lower bound of the cell's
    best: tuple[tuple[Arm | None, ...], Schedule] | None = None
    others: float | None = None  # [J] least energy of the robots with only curves
    open_, seen, tried = [(sum(c[0].energy for c in of), (0,) * len(of))], {(0,) * len(of)}, 0
    while open_ and tried < KEPT:
        bound, pick = heappop(open_)
        if best is not None and bound + (others or 0.0) >= best[1].energy * (1 - CLOSE):
            break
        tried += 1
        now = list(arms)
        for k, choice, number in zip(places, of, pick, strict=True):
            now[k] = choice[number].arm
        problem = problem_of(now)
        if others is None:
            rings = (
                Problem(problem.cycle_time, (r,)) for r, arm in zip(problem.rings, arms, strict=True) if arm is None
            )
            others = sum(solve(alone, seconds=SECONDS).bound for alone in rings)
        with suppress(Infeasible):
            schedule = solve(problem, seconds=SECONDS)
            if best is None or schedule.energy < best[1].energy:
                best = tuple(now), schedule
        for k in range(len(of)):
            more = (*pick[:k], pick[k] + 1, *pick[k + 1 :])
            if more[k] < len(of[k]) and more not in seen:
                seen.add(more)
                heappush(open_, (sum(c[n].energy for c, n in zip(of, more, strict=True)), more))
    return best


def _estimated(make: Callable[[], Arm]) -> Arranged | None:
    """An arm in an arrangement with the energy of its cycle alone; None if it is not possible."""
    with suppress(Infeasible):
        return _own_cycle(make())
    return None


def _own_cycle(arm: Arm) -> Arranged:
    """An arm with evenly slowed moves, and the energy [J] of its own cheapest schedule."""
    arm.slow()
    return Arranged(arm, solve(Problem(arm.job.cycle_time, (arm.ring(False),)), seconds=SECONDS).bound)


def _cheapest(found: Sequence[Arranged]) -> list[Arranged]:
    return sorted(found, key=lambda one: one.energy)[:KEPT]


def _orders(group: Group) -> Iterator[tuple[int, ...]]:
    """All orders of a group's blocks that `before` allows."""
    for order in permutations(range(len(group.blocks))):
        place = {b: k for k, b in enumerate(order)}
        if all(place[i] < place[j] for i, j in group.before):
            yield order


def _search(
    groups: Sequence[Group],
    first: tuple[tuple[int, ...], ...],
    look: Callable[[tuple[tuple[int, ...], ...]], float],
    spent: Callable[[], bool],
) -> None:
    """Move one block at a time to where it lowers the energy most, until none does or the budget is spent."""
    now, energy = first, look(first)
    while not spent():
        near = list(_neighbouring_orders(groups, now))
        best = min(near, key=lambda n: energy if spent() else look(n), default=now)
        if look(best) >= energy * (1 - CLOSE):
            return
        now, energy = best, look(best)


def _neighbouring_orders(
    groups: Sequence[Group], now: tuple[tuple[int, ...], ...]
) -> Iterator[tuple[tuple[int, ...], ...]]:
    """Orders in which one block has another place, or a sequence of blocks is reversed."""
    for g, group in enumerate(groups):
        order = now[g]
        for i, j in product(range(len(order)), repeat=2):
            rest = [b for b in order if b != order[i]]
            moved = (*rest[:j], order[i], *rest[j:])
            for other in (moved, (*order[:i], *reversed(order[i : j + 1]), *order[j + 1 :]) if i < j else order):
                if other != order and tuple(possible(group, other)) == tuple(other):
                    yield (*now[:g], tuple(other), *now[g + 1 :])


def _with_waits_elsewhere(arm: Arm) -> list[Arranged]:
    """The arm with one step added before a move: to a pose in which waiting takes less power than at its own poses."""
    steps = arm.table.step
    least = min(min(mode.power for mode in arm.modes_at(k)) for k, step in enumerate(arm.job.steps) if step.stop)
    out = []
    for pose in arm.postures:
        for k, step in enumerate(steps):
            if not step.moves or (k and steps[k - 1].moves and not steps[k - 1].stop):
                continue
            further = StepTable(name=f"to wait at {pose}", to=pose, payload=step.payload, mode=step.mode)
            with suppress(Infeasible):
                other = arm.listing([*steps[:k], further, *steps[k:]])
                if min(mode.power for mode in other.modes_at(k)) >= CHEAPER * least:
                    break
                out.append(_own_cycle(other.ready()))
    return out
