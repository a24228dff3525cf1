"""The pose of the base, or of a fixture, that makes a job cheapest.

estimate   the job at placements all over the box: the cheapest ring through the branches of its poses
seed       rough cycles at the best estimates, far from each other; at the best of these also by other branches
descend    a cycle's motions, bent to the ends for another base, cost at least as much as that base's optimum, and the
           same at this base (envelope theorem), so a base at which they cost less is better; there they settle again;
           where none costs less, neighbours are tried: bent motions overestimate these where limits bind
solve      the job in full, with its scene, only at the given placement and at the answer
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.optimize import minimize

from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, Infeasible
from energy_opt.jobs.file import Job
from energy_opt.jobs.legs import pose_in_base
from energy_opt.jobs.posed import Ends, Posed, run_posed
from energy_opt.jobs.solve_job import JobResult, RoughCycles
from energy_opt.motion.move import Settings
from energy_opt.placement.placement import Looked, Placement, PlaceRequest, Rough, fixture_pose, in_scene
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.sets import DETOUR
from energy_opt.power import PowerModel

TRIES = 2  # times as many seeds are tried if rough cycles fail
APART = 0.15  # share of the box: least distance of seeds
FARTHEST = 0.5  # share of the box: longest step of bent motions
SHORTER = 0.25  # share of a step to try where the whole one leads to contact, or to a higher energy
BESIDE = 0.2  # share of the box: step to a neighbour
WORTH = 1e-3  # share of the losses: a step that promises to save less ends the search
POOL = 48  # positions from which inverse kinematics starts at a placement
# initial and largest factor of steps: bent motions bound the optimum from above, and overestimate long steps
RELAXED, MOST_RELAXED = 1.6, 3.0
EVALUATIONS = 60  # most evaluations of bent motions in a step, per coordinate
BRANCHES = 6  # choices of branches to try at the best seed
ANSWERS = 3  # most placements to solve in full until one is proven
UNREACHED = 1e9  # [J] assumed cost of a placement from which a pose is out of reach


class Search:
    """One search; see `place`."""

    def __init__(
        self,
        job: Job,
        model: PowerModel,
        request: PlaceRequest,
        settings: Settings,
        cell: CellRequest,
        stopped: Callable[[], bool],
        progress: Callable[[str, float], None],
    ) -> None:
        self.model, self.request, self.settings, self.cell = model, request, settings, cell
        self.stopped, self.progress = stopped, progress
        self.job = in_scene(job, cell)
        self.given = cell.base if request.fixture is None else fixture_pose(self.job, cell, request.fixture)
        self.bounds = request.bounds(self.given)
        self.span = self.bounds[:, 1] - self.bounds[:, 0]
        self.free = np.flatnonzero(self.span > 0)
        self.rough = RoughCycles(model, settings, self.job, stopped)
        self.path: list[Looked] = []
        self._pool: dict[int, np.ndarray] | None = None
        self._tool = ToolKinematics(job.robot, cell.tool)

    def at(self, point: np.ndarray) -> CellRequest:
        """The cell with the base, or the fixture, at x, y, z, yaw (4,)."""
        fixture, place = self.request.fixture, self.place(point)
        return replace(self.cell, base=place) if fixture is None else replace(self.cell, moved=(fixture, place))

    def place(self, point: np.ndarray) -> tuple[float, ...]:
        """x, y, z, roll, pitch, yaw (6,) at x, y, z, yaw (4,)."""
        x, y, z, yaw = (float(value) for value in point)
        return x, y, z, self.given[3], self.given[4], yaw

    def posed(self, point: np.ndarray, pool: dict[int, np.ndarray] | None = None) -> Posed:
        """The choice of joint positions at a placement `point` (4,).

        Args:
            pool: starts (K, n) by step; with them the choice is quick and ignores bodies.
        """
        return Posed(self.job, self.model, self.settings, self.at(point), starts=pool)

    def points(self) -> np.ndarray:
        """Placements (P, 4) all over the box: the given one, its middle, and a low-discrepancy sequence."""
        from scipy.stats import qmc

        count = self.request.looked_at
        share = qmc.Halton(len(self.free) or 1, seed=self.settings.seed).random(count)
        out = np.repeat(self.bounds.mean(axis=1)[None], count + 2, axis=0)
        out[0] = np.clip(self.point(self.given), *self.bounds.T)
        if len(self.free):
            out[2:, self.free] = self.bounds[self.free, 0] + share[:, : len(self.free)] * self.span[self.free]
        return out

    def estimates(self) -> list[tuple[np.ndarray, float]]:
        """Placements (4,) with their estimates [J], the cheapest first; infinite if a pose is out of reach."""
        out, points = list[tuple[np.ndarray, float]](), self.points()
        for k, point in enumerate(points):
            if self.stopped() and out:
                break
            self.progress(f"estimate {k + 1}/{len(points)}", 0.3 * k / len(points))
            out.append((point, self.estimate(point)))
        return sorted(out, key=lambda item: item[1])

    def estimate(self, point: np.ndarray) -> float:
        """The likely energy [J] of the job at a placement (4,); infinite if a pose is out of reach."""
        poses = (pose_in_base(self.job.steps[k], self.job.robot, self.at(point)) for k in self.job.open)
        if any(map(self._tool.out_of_reach, poses)):
            return float(np.inf)
        try:
            posed = self.posed(point, self._pool)
        except Infeasible:
            return float(np.inf)
        pool = {} if self._pool is None else self._pool
        for k, q in posed.sets.items():  # positions found here are starts at the next placement
            known = pool.get(k, q[:0])
            pool[k] = np.vstack([q[:: max(1, len(q) // POOL)], known])[:POOL]
        self._pool = pool
        return posed.estimated(improve=False)[1]

    def solve(self, point: np.ndarray, kind: str, ends: Ends | None = None) -> JobResult | None:
        """The job at a placement in full; None where it cannot be done.

        Args:
            ends: positions at the ends of steps; by default the better of those that are likely and of the nearest.
        """
        done: list[JobResult] = []
        for chosen in self._choices(point) if ends is None else [ends]:
            with suppress(Infeasible):
                done.append(
                    run_posed(
                        self.job, self.model, self.settings, cell=self.at(point), ends=chosen, compare=False,
                        refine=ends is None, stopped=self.stopped,
                    )
                )  # fmt: skip
        best = min(done, key=lambda found: (not found.solved, found.energy), default=None)
        self.path.append(Looked(self.place(point), np.nan if best is None else best.energy, kind))
        return best

    def settled(self, point: np.ndarray, kind: str, near: Rough | None = None, ends: Ends | None = None) -> Rough:
        """The rough cycle at a placement; its energy is infinite if none is found.

        Args:
            near: that of another placement, from whose motions it starts; ends: positions at the ends of steps here.
        """
        best = Rough(point, ends or {}, None, np.inf)
        for chosen in self._choices(point) if ends is None else [ends]:
            posed = self.posed(point, {k: q[None] for k, q in chosen.items()})
            found = Rough(point, *posed.settled(self.rough, chosen, None if near is None else near.plan))
            best = min(best, found, key=lambda at: at.energy)
        self.path.append(Looked(self.place(point), best.energy, kind))
        return best

    def varied(self, here: Rough) -> Rough:
        """The cheapest rough cycle at the same placement, also by other branches."""
        try:
            choices = self.posed(here.point).alternatives(BRANCHES)
        except Infeasible:
            return here
        known = len(self.path)
        found = [here, *(self.settled(here.point, "seed", ends=ends) for ends in choices if not self.stopped())]
        del self.path[known:]  # the placement is known already
        return min(found, key=lambda at: at.energy)

    def _choices(self, point: np.ndarray) -> list[Ends]:
        """Positions at the ends of steps: those that are likely to be cheapest, and the nearest."""
        try:
            posed = self.posed(point)
        except Infeasible:
            return []
        return [posed.estimated()[0], posed.greedy()]

    def better(self, here: Rough) -> tuple[np.ndarray, float]:
        """A placement (4,) near a rough cycle at which its bent motions cost less, and the gain [J]."""
        assert here.plan is not None
        starts, point = {k: q[None] for k, q in here.ends.items()}, here.point
        bent = self.posed(point, starts).bending(here.plan)
        least = np.maximum(self.bounds[:, 0], point - FARTHEST * self.span)[self.free]
        most = np.minimum(self.bounds[:, 1], point + FARTHEST * self.span)[self.free]
        if not len(self.free):
            return point, 0.0
        known: list[tuple[float, np.ndarray]] = []

        def cost(share: np.ndarray) -> float:
            at = point.copy()
            at[self.free] = np.clip(point[self.free] + share * self.span[self.free], least, most)
            ends = self.ends_at(at, here.ends)
            value = UNREACHED if ends is None else bent(ends)
            known.append((value, at))
            return value

        before = cost(np.zeros(len(self.free)))
        within = (np.vstack([least, most]) - point[self.free]) / self.span[self.free]
        minimize(
            cost, np.zeros(len(self.free)), method="L-BFGS-B", bounds=within.T,
            options={"maxfun": EVALUATIONS * (1 + len(self.free)), "eps": 1e-4, "maxiter": 12},
        )  # fmt: skip
        value, at = min(known, key=lambda item: item[0])
        return at, before - value

    def ends_at(self, point: np.ndarray, ends: Ends) -> Ends | None:
        """The positions (n,) by step at a placement (4,) nearest to given ones; None if a pose is out of reach."""
        try:
            there = self.posed(point, {k: q[None] for k, q in ends.items()})
        except Infeasible:
            return None
        return {k: there.sets[k][0] if k in there.poses else q for k, q in ends.items()}

    def step(self, here: Rough, relax: float, most: int) -> tuple[Rough | None, float]:
        """A rough cycle that costs less, None if none is near, and the factor of the next step.

        Args:
            here: to begin at. relax: factor of this step. most: how many placements to try.
        """
        assert here.plan is not None
        at, gain = self.better(here)
        if gain < WORTH * sum(answer.energy.loss for answer in here.plan.answers):
            return None, relax
        for factor in (*((relax,) if relax > 1 else ()), 1.0, SHORTER)[:most]:
            point = np.clip(here.point + factor * (at - here.point), self.bounds[:, 0], self.bounds[:, 1])
            ends = self.ends_at(point, here.ends)
            found = None if ends is None else self.settled(point, "step", here, ends)
            if found is not None and found.energy < here.energy:
                further = float(np.clip(factor * (here.energy - found.energy) / gain, 1.0, MOST_RELAXED))
                return found, further if factor > 1 else 1.0
        return None, relax

    def beside(self, here: Rough, most: int) -> Rough | None:
        """A rough cycle that costs less, a step away along one coordinate; None if there is none among `most`."""
        for k, sign in product(self.free, (-1, 1)):
            point = here.point.copy()
            point[k] = np.clip(point[k] + sign * BESIDE * self.span[k], *self.bounds[k])
            if most == 0 or abs(point[k] - here.point[k]) < BESIDE / 2 * self.span[k]:
                continue
            ends = self.ends_at(point, here.ends)
            if ends is not None:
                most -= 1
                found = self.settled(point, "step", here, ends)
                if found.energy < here.energy:
                    return found
        return None

    @staticmethod
    def point(place: tuple[float, ...]) -> np.ndarray:
        """x, y, z, yaw (4,) of a pose (6,)."""
        return np.array([*place[:3], place[5]])


def place(
    job: Job,
    model: PowerModel,
    request: PlaceRequest,
    *,
    settings: Settings | None = None,
    cell: CellRequest | None = None,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[str, float], None] = lambda text, share: None,
) -> Placement:
    """The pose of the base, or of a fixture, in a box that makes a job cheapest; other poses stay where they are.

    Args:
        job: with poses of the tool, in the frame of the given base, of the scene or of its objects.
        cell: the scene, and the given base.

    Raises:
        BadInput: no step of the job ends at a pose. Infeasible: no placement was found at which the job can be done.
        KeyboardInterrupt: stopped before one was found.
    """
    cell = cell or CellRequest()
    if not job.open:
        raise BadInput(
            f"{job.name}: no step ends at a pose of the tool; joint positions do not change with the base, so every "
            "placement takes the same energy (give `pose = [...]` in place of `to`)"
        )
    search = Search(job, model, request, settings or Settings(), cell, stopped, progress)
    given = search.point(search.given)
    progress("as it is given", 0.0)
    given_result = search.solve(given, "given")
    if given_result is None:
        search.path.clear()
    looked = search.estimates()
    inside = bool(((given >= search.bounds[:, 0] - 1e-12) & (given <= search.bounds[:, 1] + 1e-12)).all())
    done: list[tuple[bool, float, np.ndarray, JobResult]] = []  # (not solved, energy [J], …): a proven one comes first
    if given_result is not None and inside:
        done.append((not given_result.solved, given_result.energy, given, given_result))
    seeds: list[Rough] = []
    for point, value in looked:
        found = sum(at.plan is not None for at in seeds)
        if found >= request.seeds or len(seeds) >= TRIES * request.seeds or not np.isfinite(value) or stopped():
            break
        if any((np.abs(point - at.point)[search.free] < APART * search.span[search.free]).all() for at in seeds):
            continue
        progress(f"seed {found + 1}/{request.seeds}", 0.4 + 0.2 * found / request.seeds)
        seeds.append(search.settled(point, "seed"))
    seeds.sort(key=lambda at: at.energy)
    if seeds and seeds[0].plan is not None:
        seeds.insert(0, search.varied(seeds[0]))
    relax = RELAXED
    last = len(search.path) + request.steps
    while (left := last - len(search.path)) > 0 and seeds and seeds[0].plan is not None and not stopped():
        progress(f"step {request.steps - left + 1}/{request.steps}", 0.7 - 0.1 * left / request.steps)
        lower, relax = search.step(seeds[0], relax, left)
        lower = lower or search.beside(seeds[0], last - len(search.path))
        if lower is None:
            break
        seeds.insert(0, lower)
    for rough in seeds[:ANSWERS]:
        if done and (stopped() or (not done[-1][0] and done[-1][2] is not given)):
            break
        progress("answer", 0.7)
        result = search.solve(rough.point, "answer", rough.ends or None)
        if result is not None:
            done.append((not result.solved, result.energy, rough.point, result))
    if not done and stopped():
        raise KeyboardInterrupt
    if not done:
        raise _no_placement_error(search, looked)
    _, _, best, result = min(done, key=lambda item: item[:2])
    fixed = [step.name for k, step in enumerate(job.steps) if step.wait is None and k not in job.open]
    warnings = [
        f"steps with given joint positions do not move with the {request.fixture or 'base'}: {', '.join(fixed)}"
    ]
    # estimates with the penalty of a move in contact, or too slow, are no energies
    known = ((point, value if value < DETOUR else np.inf) for point, value in looked)
    tried = tuple(Looked(search.place(point), value, "estimate") for point, value in known)
    return Placement(
        search.place(best), result, search.given, given_result, tried, tuple(search.path),
        tuple(warnings if fixed else ()), request.fixture,
    )  # fmt: skip


def _no_placement_error(search: Search, looked: list[tuple[np.ndarray, float]]) -> Infeasible:
    """The error that no placement works, with the reason at the most promising one, else at the middle of the box."""
    point = looked[0][0] if looked else search.bounds.mean(axis=1)
    words = ", ".join(f"{x:.4g}" for x in point)
    try:
        search.posed(point)
        reason, limit = "the job cannot be done at the placements that were tried", "duration"
    except Infeasible as error:
        reason, limit = str(error), error.limit or "pose"
    return Infeasible(f"no placement in the box was found; at x, y, z, yaw = {words}: {reason}", limit=limit)
