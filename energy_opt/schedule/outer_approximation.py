"""A schedule of least energy, with a lower bound: outer approximation of convex curves by tangents.

The program with tangents gives a bound; its modes and cycle counts are then fixed, and tangents are added at the chosen
durations until the program without integers agrees with the curves; both repeat until bound and schedule meet (Duran
and Grossmann, Mathematical Programming 36, 1986).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import monotonic

import numpy as np

from energy_opt.errors import Infeasible, at_least
from energy_opt.schedule.milp import Program
from energy_opt.schedule.problem import Exclusion, Lag, Move, Problem, Ring, Wait, in_blocks, possible

SMALL = 1e-9  # relative: a tangent nearer to the curve than this is not added
EARLIEST = 5.0  # [s] time limit for moving starts forward, which changes no energy
ROUNDED = 1e-7  # [s] by which a robot's longest wait may then change, because the sum of durations is rounded
EXPLAINED = 10.0  # [s] time limit for finding the conflicting constraints
UNDECIDED = "solve time"  # `limit` of an `Infeasible` if no schedule was found in time; one may exist
ROUNDS = 100  # most rounds of adding tangents; each at least halves the remaining error


@dataclass(frozen=True)
class Schedule:
    """Start and duration of every step, and the modes of waits.

    Attributes:
        problem: the scheduled problem, with the steps of every ring in their final order.
        starts, durations: (steps,) [s] for every ring; starts count from the first step of the first ring.
        modes: for every ring the name of the mode of each step; "" for a move.
        energies: (steps,) [J] for every ring.
        bound: J, a lower bound over all schedules of these curves.
        seconds: time of solving.
    """

    problem: Problem
    starts: tuple[np.ndarray, ...]
    durations: tuple[np.ndarray, ...]
    modes: tuple[tuple[str, ...], ...]
    energies: tuple[np.ndarray, ...]
    bound: float
    seconds: float

    @property
    def energy(self) -> float:
        """Energy of the whole cycle [J]."""
        return float(sum(e.sum() for e in self.energies))

    @property
    def stated(self) -> Schedule:
        """The schedule with the energies of `Move.stated` and `Mode.stated`, where a step has them."""
        energies = tuple(e.copy() for e in self.energies)
        for out, ring, lengths, modes in zip(energies, self.problem.rings, self.durations, self.modes, strict=True):
            for k, step in enumerate(ring.steps):
                if isinstance(step, Move):
                    out[k] = out[k] if step.stated is None else step.stated(float(lengths[k]))
                    continue
                mode = next(mode for mode in step.modes if mode.name == modes[k])
                if mode.stated is not None:
                    out[k] = replace(mode, power=mode.stated).energy(float(lengths[k]))
        return replace(self, energies=energies)

    @property
    def gap(self) -> float:
        """(energy - bound) / energy."""
        return max(0.0, self.energy - self.bound) / max(abs(self.energy), 1e-12)


def solve(problem: Problem, *, seconds: float = 60.0, gap: float = 1e-6, explain: bool = False) -> Schedule:
    """The schedule of least energy.

    Args:
        seconds: time limit [s]; the remaining gap is in the result.
        gap: relative distance of energy and bound at which to stop.
        explain: if there is no schedule, find the conflicting lags and exclusions, which takes time.

    Raises:
        Infeasible: no schedule keeps the cycle time, the lags and the zones; or none was found in `seconds`: its limit
            is then `UNDECIDED`.
    """
    begin = monotonic()
    program = Program(problem)
    best: Schedule | None = None
    bound = -np.inf
    for _ in range(ROUNDS):
        left = seconds - (monotonic() - begin)
        if best is not None and left <= 0:
            break
        found = program.solve(left, gap / 2)
        if found.x is None:
            if best is not None:
                break
            raise _no_schedule_error(found.impossible, problem, seconds, explain)
        bound = max(bound, found.bound)
        now = _best_with_fixed_integers(program, found.x, begin + seconds)
        if best is None or now.energy < best.energy:
            best = now
        if best.energy - bound <= gap * abs(best.energy):
            break
        if not _refine(program, found.x):
            break
    assert best is not None
    return replace(_earliest(best), bound=min(bound, best.energy), seconds=monotonic() - begin)


def _best_with_fixed_integers(program: Program, x: np.ndarray, deadline: float) -> Schedule:
    """The best schedule with the modes and cycle counts of `x`."""
    lower, upper, integer = program.lower, program.upper, program.integer
    held = [round(v) if i else 0 for v, i in zip(x, integer, strict=True)]
    program.lower = [float(h) if i else lo for h, i, lo in zip(held, integer, lower, strict=True)]
    program.upper = [float(h) if i else up for h, i, up in zip(held, integer, upper, strict=True)]
    try:
        for _ in range(ROUNDS):
            if not _refine(program, x) or monotonic() > deadline:
                break
            found = program.solve(deadline - monotonic(), 0.0)
            if found.x is None:
                break
            x = found.x
    finally:
        program.lower, program.upper = lower, upper
    return _schedule(program, x)


def _refine(program: Program, x: np.ndarray) -> bool:
    """Add a tangent wherever a curve is above the energy in `x`; True if any was added."""
    added = False
    for at, energy in program.energy.items():
        move = program.problem.rings[at[0]].steps[at[1]]
        assert isinstance(move, Move)
        d = float(np.clip(program.duration[at].evaluate(x), move.least, move.most))
        value = move.curve.value(d)
        if value - energy.evaluate(x) > SMALL * max(1.0, abs(value)):
            program.add_tangent(at, d)
            added = True
    return added


def _schedule(program: Program, x: np.ndarray) -> Schedule:
    """The schedule of a solution x of the program; durations are clipped to their bounds."""
    problem = program.problem
    starts, durations, modes, energies, orders = [], [], [], [], list[list[int]]()
    for r, ring in enumerate(problem.rings):
        orders.append(_order(program, x, r))
        length = np.array([program.duration[r, k].evaluate(x) for k in range(len(ring.steps))])
        named, energy = [], np.zeros(len(ring.steps))
        for k, step in enumerate(ring.steps):
            if isinstance(step, Wait):
                chosen = step.modes[int(np.argmax([z.evaluate(x) for z, _ in program.choice[r, k]]))]
                length[k] = np.clip(length[k], max(step.least, chosen.shortest), step.most)
                named.append(chosen.name)
                energy[k] = chosen.energy(length[k])
            else:
                length[k] = np.clip(length[k], step.least, step.most)
                named.append("")
                energy[k] = step.curve.value(float(length[k]))
        # starts follow exactly from the durations; the rounding error goes into a wait
        length, energy = length[orders[r]], energy[orders[r]]
        starts.append(program.start[r, orders[r][0]].evaluate(x) + np.concatenate([[0.0], np.cumsum(length)[:-1]]))
        durations.append(length)
        modes.append(tuple(named[k] for k in orders[r]))
        energies.append(energy)
    if any(ring.groups for ring in problem.rings):
        problem = problem.in_order(orders)
    return Schedule(problem, tuple(starts), tuple(durations), tuple(modes), tuple(energies), -np.inf, 0.0)


def _order(program: Program, x: np.ndarray, r: int) -> list[int]:
    """The order of a ring's steps: blocks by their starts, those without duration first."""
    ring = program.problem.rings[r]

    def when(block: tuple[int, int]) -> tuple[float, float]:
        length = sum(program.duration[r, k].evaluate(x) for k in range(block[0], block[1] + 1))
        return program.start[r, block[0]].evaluate(x) + length / 2, length

    orders = [possible(g, sorted(range(len(g.blocks)), key=lambda b: when(g.blocks[b]))) for g in ring.groups]
    return in_blocks(len(ring.steps), ring.groups, orders)


def _earliest(schedule: Schedule) -> Schedule:
    """The same durations and modes with every robot as early as possible, from 0 on."""
    program = Program(with_fixed_durations(schedule))
    program.cost = [0.0] * len(program.cost)
    for (_, step), start in program.start.items():
        if step == 0:
            program.cost[start.idxs[0]] = 1.0
            program.lower[start.idxs[0]] = 0.0
    found = program.solve(EARLIEST, 0.0)
    if found.x is None:
        return schedule
    first = [program.start[r, 0].evaluate(found.x) for r in range(len(schedule.starts))]
    return replace(schedule, starts=tuple(s - s[0] + f for s, f in zip(schedule.starts, first, strict=True)))


def with_fixed_durations(schedule: Schedule) -> Problem:
    """The problem with the durations and modes of a schedule; only starts are free."""
    rings = []
    for ring, lengths, modes in zip(schedule.problem.rings, schedule.durations, schedule.modes, strict=True):
        steps: list[Move | Wait] = []
        waits = [length for step, length in zip(ring.steps, lengths.tolist(), strict=True) if isinstance(step, Wait)]
        for step, length, mode in zip(ring.steps, lengths.tolist(), modes, strict=True):
            if isinstance(step, Move):
                steps.append(replace(step, least=length, most=length))
                continue
            slack = ROUNDED if length == max(waits) else 0.0
            span = {"least": max(0.0, length - slack), "most": length + slack}
            steps.append(replace(step, **span, modes=tuple(m for m in step.modes if m.name == mode)))
        rings.append(Ring(ring.name, tuple(steps)))
    return replace(schedule.problem, rings=tuple(rings))


def _no_schedule_error(impossible: bool, problem: Problem, seconds: float, explain: bool) -> Infeasible:
    """The error of a problem without a schedule.

    Args:
        impossible: the solver proved it. problem: as given. seconds: [s] that the solver had. explain: find the
            conflicting constraints.
    """
    for ring in problem.rings:
        shortest = [
            max(s.least, min(m.shortest for m in s.modes)) if isinstance(s, Wait) else s.least for s in ring.steps
        ]
        for step, needed in zip(ring.steps, shortest, strict=True):
            if needed > step.most:
                names = ", ".join(mode.name for mode in step.modes) if isinstance(step, Wait) else ""
                return Infeasible(
                    f"{ring.name}.{step.name} takes {step.most:.6g} s at most, its modes ({names}) {needed:.6g} s at "
                    "least",
                    limit="duration",
                )
        least = sum(shortest)
        if least > problem.cycle_time:
            return Infeasible(
                f"{ring.name}: its steps take {at_least(least)} s at least, the cycle has {problem.cycle_time:.6g} s",
                limit="duration",
                shortest_duration=least,
            )
        most = sum(s.most for s in ring.steps)
        if most < problem.cycle_time:
            return Infeasible(
                f"{ring.name}: its steps take {most:.6g} s at most, the cycle has {problem.cycle_time:.6g} s; "
                "give a wait a longer bound",
                limit="duration",
            )
    if impossible:
        conflict = "; ".join(map(problem.describe, _conflict(problem))) if explain else ""
        these = f"; these cannot be kept together: {conflict}" if conflict else ""
        return Infeasible(f"no schedule keeps all lags and zones within the cycle time{these}", limit="duration")
    return Infeasible(f"no schedule was found in {seconds:g} s", limit=UNDECIDED)


def _conflict(problem: Problem) -> list[Lag | Exclusion]:
    """A minimal set of lags and exclusions that no schedule keeps together, as far as time allows."""
    begin, kept = monotonic(), problem
    for one in (*problem.lags, *problem.exclusions):
        lags = tuple(lag for lag in kept.lags if lag is not one)
        fewer = replace(kept, lags=lags, exclusions=tuple(pair for pair in kept.exclusions if pair is not one))
        program = Program(fewer)
        program.cost = [0.0] * len(program.cost)
        if monotonic() - begin < EXPLAINED and program.solve(EXPLAINED / 5, 0.0).impossible:
            kept = fewer
    return [*kept.lags, *kept.exclusions]
