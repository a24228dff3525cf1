"""The search for a reshaped move: several coarse starts, the best refined, limits mended where they are found broken.

A coarse problem (few control points) is solved from several starts; it is cheap, and it is there that local optima
differ. Starts are the timed straight line and the trajectories that are handed in; and bent lines, each the cheapest of
some random bends, which descend for a few iterations without limits on velocity, acceleration and jerk: what lies
lowest then, before limits wall the valleys off, is solved in full. The best coarse curve is carried to the fine
problem, whose rows bind nearly where the coarse ones did.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.motion.limits.base import Limit, box_of
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.level import Curve, Level, Outcome, fitted, refined
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.bspline import Basis

COARSE, COARSE_PACKING = 12, 0.5
CANDIDATES = 16  # random bends of which the cheapest descends
DESCENT = 5  # iterations of a descent without limits
TRIED = 3  # one of so many descents, the lowest, is solved in full
BEND = 0.5  # standard deviation of a bend's amplitude, as a share of half of a joint's range
FEASIBLE = 1e-4  # a coarse outcome with a larger excess over a bound counts as infeasible
WORTH_REFINING = 0.05  # more control points may still mend an excess up to this share of a bound
ROW_STEP, MIN_ROWS = 0.004, 200  # [s]


@dataclass(frozen=True)
class Task:
    """One reshaping: ends, limits, the model's values, bounds on T and the cost per second that no path changes."""

    ends: Ends
    limits: tuple[Limit, ...]
    parameters: np.ndarray
    durations: tuple[float, float]
    offset: float


class Reshaper:
    """Searches moves of one robot and model structure; levels are built when first needed."""

    def __init__(self, nodes: NodeFunctions, joints: int, controls: int, free_acceleration: bool) -> None:
        self._nodes, self._joints = nodes, joints
        self._fine, self._free = controls, free_acceleration
        self._levels: dict[tuple[int, int], Level] = {}

    def level(self, controls: int, vias: int) -> Level:
        """The level with that many control points and via points."""
        if (controls, vias) not in self._levels:
            basis = Basis(controls, COARSE_PACKING) if controls <= COARSE + vias else Basis(controls)
            shape = Shape(self._joints, basis, 3, self._free, vias)
            self._levels[controls, vias] = Level(shape, self._nodes)
        return self._levels[controls, vias]

    def search(
        self,
        task: Task,
        lines: Sequence[tuple[np.ndarray, np.ndarray, float]],
        starts: int,
        seed: int,
        stopped: Callable[[], bool],
    ) -> tuple[Outcome | None, int]:
        """The best outcome and the iterations spent; None where no start leads to a feasible curve.

        `lines` are (u, q, T): positions q (M, n) at u (M,) of a first guess of duration T, at least one.
        """
        vias = len(task.ends.via)
        coarse = self.level(COARSE + 2 * vias, vias)
        guesses = [self._curve(coarse.shape, line, task) for line in lines]
        iterations, found = 0, []
        descents = self._descents(coarse, guesses[0], task, starts - len(guesses), seed, stopped)
        iterations += sum(outcome.iterations for outcome in descents)
        lowest = sorted(descents, key=lambda outcome: outcome.cost)[: -(-len(descents) // TRIED)]
        rows = all_rows(coarse.shape, task.limits)
        for guess in (*guesses, *(outcome.curve for outcome in lowest)):
            outcome = coarse.solve(
                guess,
                task.ends,
                task.limits,
                task.parameters,
                task.durations,
                tolerance=1e-3,
                rows=rows,
                offset=task.offset,
                options={"mu_init": 1e-2, "max_iter": 60},
                rounds=3,
            )
            iterations += outcome.iterations
            found.append(outcome)
            if stopped():
                break
        order = sorted(found, key=lambda o: (o.broken > FEASIBLE, o.cost if o.broken <= FEASIBLE else o.broken))
        fine = self.level(max(self._fine, COARSE + 2 * vias + 4), vias)
        best: Outcome | None = None
        for outcome in order[:2]:
            if outcome.broken > WORTH_REFINING:
                break
            better = self._refine(fine, outcome.curve, task)
            iterations += better.iterations
            if better.broken <= FEASIBLE and (best is None or better.cost < best.cost):
                best = better
            if best is not None or stopped():
                break
        return best, iterations

    def _descents(
        self,
        level: Level,
        straight: Curve,
        task: Task,
        count: int,
        seed: int,
        stopped: Callable[[], bool],
    ) -> list[Outcome]:
        """A few iterations from each of `count` bent copies of a curve, at its duration, with limits on torque only."""
        limits = tuple(limit.scaled(np.inf) if limit.order else limit for limit in task.limits)
        rng = np.random.default_rng(seed)
        out: list[Outcome] = []
        while len(out) < count and not stopped():
            outcome = level.solve(
                self._bent(level, straight, task, rng),
                task.ends,
                limits,
                task.parameters,
                (straight.duration, straight.duration),
                tolerance=1e-2,
                offset=task.offset,
                options={"mu_init": 1e-2, "max_iter": DESCENT},
                rounds=1,
            )
            out.append(outcome)
        return out

    def _refine(self, fine: Level, curve: Curve, task: Task) -> Outcome:
        guess = refined(curve, fine.shape, task.ends)
        return fine.solve(
            guess,
            task.ends,
            task.limits,
            task.parameters,
            task.durations,
            tolerance=1e-5,
            rows=all_rows(fine.shape, task.limits),
            offset=task.offset,
            options={"mu_init": 1e-2},
        )

    def polish(self, outcome: Outcome, task: Task) -> Outcome:
        """Solve again from an outcome, under limits or values that have changed a little."""
        level = self.level(outcome.curve.shape.basis.controls, outcome.curve.shape.vias)
        return level.solve(
            outcome.curve,
            task.ends,
            task.limits,
            task.parameters,
            task.durations,
            tolerance=1e-6,
            rows=outcome.rows,
            offset=task.offset,
            options={"mu_init": 1e-3},
        )

    def _curve(self, shape: Shape, line: tuple[np.ndarray, np.ndarray, float], task: Task) -> Curve:
        u, q, duration = line
        duration = float(np.clip(duration, *task.durations))
        places = np.linspace(0, 1, len(task.ends.via) + 2)[1:-1]
        for i, via in enumerate(task.ends.via):  # where the guess passes nearest, in order
            k = int(np.argmin(np.abs(q - via).sum(axis=1)))
            places[i] = np.clip(u[k], 0.02, 0.98)
        return fitted(shape, u, q, task.ends, duration, np.sort(places))

    def _bent(self, level: Level, straight: Curve, task: Task, rng: np.random.Generator) -> Curve:
        """The cheapest of many randomly bent copies of a curve; a broken limit makes a copy dearer."""
        shape, limits = level.shape, task.limits
        lower, upper = box_of(limits, shape.joints)
        half = np.clip((upper - lower) / 2, 0, np.pi)
        u = np.linspace(0, 1, shape.basis.controls)
        best, least = straight, np.inf
        for _ in range(CANDIDATES):
            amplitude = rng.normal(size=(2, shape.joints)) * [[1.0], [0.5]] * BEND * half
            bend = np.sin(np.pi * u)[:, None] ** 2 * amplitude[0] + np.sin(2 * np.pi * u)[:, None] ** 3 * amplitude[1]
            points = np.clip(straight.points + bend, lower, upper)
            points[: shape.pinned] = straight.points[: shape.pinned]
            points[-shape.pinned :] = straight.points[-shape.pinned :]
            curve = replace(straight, points=points)
            cost, shares = level.shares(curve, task.parameters, limits)
            excess = max(0.0, max(float(share.max()) for share in shares.values()) - 1)
            score = (cost - task.offset * curve.duration) * (1 + excess)
            if score < least:
                best, least = curve, score
        return best


def all_rows(shape: Shape, limits: Sequence[Limit], orders: Sequence[int] = (1, 2)) -> np.ndarray:
    """Rows of limits on the derivatives of those orders, at every site; (R, 3) limit, site, joint."""
    sites = [(k, site) for k, limit in enumerate(limits) if limit.order in orders
             for site in range(len(shape.sites[limit.order - 1]))]  # fmt: skip
    return np.array([(k, site, j) for k, site in sites for j in range(shape.joints)])


def trajectory_of(curve: Curve, joints: tuple[str, ...]) -> Trajectory:
    """Rows at most 4 ms apart, at least 200, one at every knot: between rows the curve is the quintic itself."""
    breaks = curve.shape.basis.breaks
    count = max(MIN_ROWS, int(np.ceil(curve.duration / ROW_STEP)))
    parts = [max(1, int(np.ceil(width * count))) for width in np.diff(breaks)]
    spans = zip(breaks[:-1], breaks[1:], parts, strict=True)
    u = np.append(np.concatenate([np.linspace(a, b, k, endpoint=False) for a, b, k in spans]), 1.0)
    q, v, a, _ = curve.derivatives(u)
    return Trajectory(joints, u * curve.duration, q, v, a)
