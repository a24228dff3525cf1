"""Energy against duration for one move.

The minimum is a solve with free duration, the fastest point one of minimum time. Every other point is continued from
its neighbours (see `motion.plan.neighbour`): out from the free optimum to both ends, then down and up the whole front
while that reduces energy. The better result is kept, so that a poor local optimum leaves no bump in the front.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from energy_opt.errors import Infeasible, at_least
from energy_opt.motion import Move, Planner
from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.plan.neighbour import Neighbours, Optimum
from energy_opt.motion.plan.resting import cheaper_end, with_rest
from energy_opt.motion.trajectory import Trajectory
from energy_opt.tradeoffs.fixed_cycle import Cycle, Waiting

COUNT = 20  # default number of points
REACH = 2.5  # the default front ends at this multiple of the fastest duration, or beyond the optimum
LOWER = 1e-6  # relative: if a point is this much below the free optimum, the latter is solved again from there
SAME = 1e-9  # relative difference of durations that count as equal
ROUNDS = 3  # most passes down and up, while they reduce energy
SEARCH = 12  # most solves of the search for the best duration in a cycle


@dataclass(frozen=True, eq=False)
class Point:
    """A duration [s] and its result; `reason` says why there is no trajectory, if there is none.

    `minimised`: mean or largest energy [J] under several models, of the move alone and with the wait after it.
    """

    duration: float
    status: str
    optimum: Optimum | None = None
    reason: str = ""
    waiting: Waiting | None = None
    minimised: tuple[float, float] | None = None

    @property
    def energy(self) -> Energy | None:
        """Energy of the move, if there is a trajectory."""
        return None if self.optimum is None else self.optimum.energy

    @property
    def trajectory(self) -> Trajectory | None:
        """The move's trajectory, if there is one."""
        return None if self.optimum is None else self.optimum.trajectory

    @property
    def total(self) -> float:
        """Energy of the move, J; infinite without a trajectory."""
        return np.inf if self.energy is None else self.energy.total

    @property
    def cycle_total(self) -> float:
        """Energy of the move and of the wait after it, J."""
        return self.total + (self.waiting.total if self.waiting else 0.0)


@dataclass
class Front:
    """The part of a move's front that is known so far; complete unless `interrupted`."""

    points: list[Point] = field(default_factory=list)
    minimum: Point | None = None
    fastest: Point | None = None
    cycle_minimum: Point | None = None
    cycle_fastest: Point | None = None
    solves: int = 0
    interrupted: bool = False

    @property
    def status(self) -> str:
        """Status of the feasible points, "solved" or "not_converged"; "infeasible" without any; or "interrupted"."""
        found = [point.status for point in self.points if point.status != "infeasible"]
        if self.interrupted or not found:
            return "interrupted" if self.interrupted else "infeasible"
        return "solved" if set(found) == {"solved"} else "not_converged"


def trace(
    planner: Planner,
    move: Move,
    *,
    durations: Sequence[float] | None = None,
    longest: float | None = None,
    cycle: Cycle | None = None,
    progress: Callable[[Front, int], None] = lambda front, total: None,
    stopped: Callable[[], bool] = lambda: False,
    steps: Steps | None = None,
) -> Front:
    """The front of a move; Ctrl-C ends it early and keeps the points so far.

    Args:
        planner: minimises energy.
        move: its duration is ignored.
        durations: of the front's points, s; by default chosen from the fastest and the optimum.
        longest: largest default duration, s.
        cycle: also the energy over this cycle.
        progress: called after every solve with the front and the number of solves expected.
        stopped: called after every solve; True ends the front early, like Ctrl-C.
        steps: solves the move at given durations; the planner's own by default.

    Raises:
        Infeasible: no duration works, or none within the cycle.
    """
    free = replace(move, duration=None, max_duration=None)
    tracer = _Tracer(planner, steps or Neighbours(planner.single(free)), free, cycle, progress, stopped)
    try:
        tracer.run(durations, longest)
    except KeyboardInterrupt:
        tracer.front.interrupted = True
    return tracer.front


class Steps(Protocol):
    """Solves a move at several durations, one after the other (see `Neighbours`)."""

    def at(self, duration: float, neighbour: Optimum) -> Optimum | None:
        """The optimum of this duration, from that of a neighbouring one; None if it cannot be had."""


@dataclass(eq=False)
class _Tracer:
    """Traces the front of one move: its first optimum in full, the others from their neighbours.

    Attributes:
        free: the move without a duration. expected: number of solves.
    """

    planner: Planner
    steps: Steps
    free: Move
    cycle: Cycle | None
    progress: Callable[[Front, int], None]
    stopped: Callable[[], bool]
    front: Front = field(default_factory=Front)
    expected: int = COUNT + 2

    def run(self, durations: Sequence[float] | None, longest: float | None) -> None:
        """The fastest move, the least energy, all points between, and the best duration in the cycle, in this order.

        Args:
            durations: [s] of the points; None: chosen here. longest: [s] the largest of them.

        Raises:
            Infeasible: the fastest move does not fit into the cycle, or takes longer than `longest`.
        """
        front = self.front
        front.fastest = self._fastest()
        shortest = front.fastest.duration
        if self.cycle is not None and self.cycle.length < shortest * (1 - SAME):
            raise Infeasible(
                f"the cycle of {self.cycle.length:g} s is shorter than the fastest move, {at_least(shortest)} s",
                limit="duration",
                shortest_duration=shortest,
            )
        warm = [front.fastest.trajectory] if front.fastest.trajectory is not None else []
        front.minimum = self._free(warm)
        if front.minimum.trajectory is not None and front.minimum.duration < shortest:  # another local optimum
            front.fastest, shortest = front.minimum, front.minimum.duration
        grid = self._grid(shortest, front.minimum.duration, longest) if durations is None else np.unique(durations)
        self.expected = len(grid) + 2 + (SEARCH if self.cycle else 0)
        front.points = [Point(float(d), "not_converged", reason="not computed") for d in grid]
        self._sweep()
        self._rest()
        as_fast = [point for point in front.points if _equal(point.duration, shortest)]
        front.fastest = min((front.fastest, *as_fast), key=lambda point: point.total)
        self._keep_minimum()
        if self.cycle is not None:
            front.cycle_minimum = self._best_in_cycle(self.cycle)

    def _fastest(self) -> Point:
        """The fastest move: TOPP-RA's on a fixed path, or a solve of minimum time if the path is free."""
        path_fastest = self.planner.minimum_time(self.free)
        if self.free.mode == "retime":
            return Point(path_fastest, "solved")
        result = self.planner.with_settings(objective="time", starts=1).solve(self.free)
        self._count()
        found: Trajectory = result.trajectory
        solved = result.status == "solved"
        if found.duration > path_fastest:
            timed = self.planner.slowed(self.free, path_fastest)
            if timed is None:
                return Point(path_fastest, "solved")
            found, solved = timed, True
        return self._point(found.duration, Optimum(found, self.planner.score(found), solved))

    def _grid(self, fastest: float, best: float, longest: float | None) -> np.ndarray:
        """Durations (COUNT,) [s] from the fastest move to the end of the cycle, or to beyond the best duration.

        Raises:
            Infeasible: the fastest move takes longer than `longest`.
        """
        last = self.cycle.length if self.cycle else max(REACH * fastest, 1.5 * best)
        if longest is not None:
            if longest < fastest * (1 - SAME):
                raise Infeasible(
                    f"{longest:g} s is shorter than the fastest move, {at_least(fastest)} s",
                    limit="duration",
                    shortest_duration=fastest,
                )
            last = longest
        return np.linspace(fastest, max(last, fastest), COUNT if last > fastest else 1)

    def _count(self) -> None:
        """Count a solve, show the progress, and end the front if the user requested it."""
        self.front.solves += 1
        self.progress(self.front, max(self.expected, self.front.solves))
        if self.stopped():
            raise KeyboardInterrupt

    def _free(self, warm: Sequence[Trajectory], planner: Planner | None = None) -> Point:
        """The least energy at a free duration, by another planner if one is given."""
        result = (planner or self.planner).solve(self.free, warm=warm)
        self._count()
        return self._point(
            result.trajectory.duration, Optimum(result.trajectory, result.energy, result.status == "solved")
        )

    def _step(self, duration: float, neighbour: Optimum, known: Optimum | None = None) -> Point:
        """One step to exactly `duration` s; it does not count as a solve if the result is `known`."""
        try:
            optimum = self.steps.at(duration, neighbour)
        except Infeasible as error:
            point = Point(duration, "infeasible", reason=str(error))
        else:
            point = self._point(duration, optimum)
        if known is None or point.optimum is not known:
            self._count()
        return point

    def _point(self, duration: float, optimum: Optimum | None) -> Point:
        """The point of an optimum, with the wait after it if there is a cycle; None: nothing was found."""
        if optimum is None:
            return Point(duration, "not_converged", reason="no trajectory within limits was found from its neighbours")
        status, waiting = "solved" if optimum.converged else "not_converged", None
        if self.cycle is not None and duration <= self.cycle.length * (1 + SAME):  # else the move outlasts the cycle
            waiting = self.cycle.waiting(duration)
        return Point(duration, status, optimum, waiting=waiting)

    def _sweep(self) -> None:
        """Out from the free optimum to both ends; then down and up again, while that reduces energy."""
        points, best = self.front.points, self.front.minimum
        assert best is not None
        middle = int(np.searchsorted([p.duration for p in points], best.duration))
        up, down = range(len(points)), range(len(points) - 1, -1, -1)
        self._go(best, range(middle, len(points)))
        self._go(best, range(middle - 1, -1, -1))
        if self.free.mode == "retime":  # one program each, which needs no neighbour
            return
        for _ in range(ROUNDS):
            lower = [self._go(points[order[0]], order[1:]) for order in (down, up)]
            if not any(lower):
                return

    def _go(self, neighbour: Point, order: Iterable[int]) -> bool:
        """Improve each point from the one before it; True if any has less energy now."""
        points, lower = self.front.points, False
        for k in order:
            before = points[k].total
            neighbour = self._improve(k, neighbour)
            lower |= points[k].total < before * (1 - LOWER)
        return lower

    def _improve(self, k: int, neighbour: Point) -> Point:
        """Step to point k from a neighbour and keep the better; returns the point from which the next one starts."""
        old, fastest = self.front.points[k], self.front.fastest
        assert fastest is not None
        if old.duration < fastest.duration * (1 - SAME):
            reason = f"shorter than the fastest move, {at_least(fastest.duration)} s"
            self.front.points[k] = Point(old.duration, "infeasible", reason=reason)
            return neighbour
        if old.optimum is None and fastest.optimum is not None and _equal(old.duration, fastest.duration):
            neighbour = fastest
        if neighbour.optimum is not None:
            new = self._step(old.duration, neighbour.optimum, old.optimum)
            ranks = [(point.status != "solved", point.total) for point in (new, old)]  # converged, then energy
            if old.optimum is None or (new.optimum is not None and ranks[0] < ranks[1]):
                self.front.points[k] = new
        kept = self.front.points[k]
        return kept if kept.optimum is not None else neighbour

    def _rest(self) -> None:
        """Where a faster point and rest at one end take less energy than a point, they replace it."""
        planner, best = self.planner, Point(0.0, "")
        held, after = cheaper_end(planner.scorer, self.free)
        for k, point in enumerate(self.front.points):
            gain = point.total - held * point.duration - (best.total - held * best.duration)
            if best.optimum is None or gain < 0:
                best = point if point.status == "solved" else best
            elif gain > LOWER * point.total:
                motion = with_rest(best.optimum.trajectory, point.duration, after)
                if motion is not None and planner.certify(motion, self.free).valid:
                    resting = replace(point, status="solved", optimum=Optimum(motion, planner.score(motion), True))
                    self.front.points[k] = min(point, resting, key=lambda p: p.total)

    def _keep_minimum(self) -> None:
        """If a point of the grid is below the free optimum, solve again with free duration from there."""
        best = min(self.front.points, key=lambda p: p.total, default=Point(np.nan, ""))
        assert self.front.minimum is not None
        if best.trajectory is not None and best.total < self.front.minimum.total * (1 - LOWER):
            again = self._free([best.trajectory], self.planner.with_settings(starts=1))
            self.front.minimum = min((self.front.minimum, again, best), key=lambda p: p.total)

    def _best_in_cycle(self, cycle: Cycle) -> Point:
        """The duration of least energy over the cycle, searched between the best point's neighbours."""
        from scipy.optimize import minimize_scalar

        fastest, ends = self.front.fastest, (self.front.minimum, self.front.fastest)
        known = [p for p in (*self.front.points, *ends) if p and p.waiting and p.trajectory is not None]

        def at(duration: float) -> Point:
            near = min(known, key=lambda p: abs(p.duration - duration), default=None)
            if near is None or near.optimum is None:
                return Point(duration, "not_converged", reason="nothing to start from")
            point = self._step(duration, near.optimum)
            if point.trajectory is not None:
                known.append(point)
            return point

        if fastest is not None:  # the fastest move, for comparison with the best
            at_once = min((at(fastest.duration), fastest), key=lambda p: p.cycle_total)
            self.front.cycle_fastest = at_once if at_once.trajectory is not None else None
        if not any(_equal(p.duration, cycle.length) for p in known):
            end = at(cycle.length)  # slower is often even better: always try the whole cycle
            if not known:
                raise Infeasible(end.reason, limit="duration")
        known.sort(key=lambda p: p.duration)
        k = int(np.argmin([p.cycle_total for p in known]))
        low, high = known[max(k - 1, 0)].duration, known[min(k + 1, len(known) - 1)].duration

        def energy(duration: float) -> float:
            return min(at(float(duration)).cycle_total, 1e300)

        if high > low * (1 + SAME):
            options = {"maxiter": SEARCH - 1, "xatol": 1e-3 * low}
            minimize_scalar(energy, bounds=(low, high), method="bounded", options=options)
        return min(known, key=lambda p: p.cycle_total)


def _equal(a: float, b: float) -> bool:
    return abs(a / b - 1) <= SAME
