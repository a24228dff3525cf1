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
from energy_opt.cell.standing import Standing, touching_anyhow
from energy_opt.errors import Infeasible
from energy_opt.jobs.file import Job
from energy_opt.jobs.legs import pose_in_base
from energy_opt.jobs.posed import Ends, Posed
from energy_opt.jobs.run_posed import run_posed
from energy_opt.jobs.solve_job import JobResult, RoughCycles
from energy_opt.jobs.work import Cells
from energy_opt.motion.move import Settings
from energy_opt.placement.placement import Looked, PlaceRequest, Rough, check_scenes, fixture_pose, in_scene
from energy_opt.poses.freedom import places
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.sets import contact_error
from energy_opt.power import PowerModel
from energy_opt.robot.kinematics import pose_of
from energy_opt.robot.tool import tool_of

FARTHEST = 0.5  # share of the box: longest step of bent motions
SHORTER = 0.25  # share of a step to try where the whole one leads to contact, or to a higher energy
BESIDE = 0.2  # share of the box: step to a neighbour
WORTH = 1e-3  # share of the losses: a step that promises to save less ends the search
POOL = 48  # positions from which inverse kinematics starts at a placement
MOST_RELAXED = 3.0  # largest factor of steps
EVALUATIONS = 60  # most evaluations of bent motions in a step, per coordinate
BRANCHES = 6  # choices of branches to try at the best seed
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
        if request.fixture is None:
            check_scenes(job, cell)
        self.job = in_scene(job, cell)
        self.given = cell.base if request.fixture is None else fixture_pose(self.job, cell, request.fixture)
        self.bounds = request.bounds(self.given)
        self.span = self.bounds[:, 1] - self.bounds[:, 0]
        self.free = np.flatnonzero(self.span > 0)
        self.rough = RoughCycles(model, settings, self.job, stopped)
        self.path: list[Looked] = []
        self._cells = Cells(self.job, cell)
        cells = {id(at): at for at in map(self._cells.of, self.job.steps) if at is not None}
        self._standing = [Standing(at, request.fixture) for at in cells.values()]
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

    def check_tool(self) -> None:
        """Raise Infeasible if the tool's link touches something at a pose, wherever the base, or the fixture, is."""
        tool, fixture = tool_of(self.job.robot.body, self.cell.tool), self.request.fixture
        for step in (self.job.steps[k] for k in self.job.open):
            cell, pose = self._cells.of(step), pose_in_base(step, self.job.robot, self.cell)
            if cell is None or step.pose is None:
                continue
            poses, off = places(pose)
            poses = poses @ np.linalg.inv(np.array(tool.pose))
            contact = touching_anyhow(cell, tool.joint, poses, fixture, step.pose.frame == fixture)
            if contact is not None and contact.depth > off:
                raise contact_error(f"{pose.name}: no placement is possible", contact, cell)

    def overlap(self, point: np.ndarray) -> str | None:
        """What fixed bodies overlap at a placement (4,), and not as they are given; None if none do."""
        base, (old, new) = self.cell.base_pose, (pose_of(at[:3], at[3:]) for at in (self.given, self.place(point)))
        moved = new @ np.linalg.inv(old)  # in the scene's frame
        return next(filter(None, (at.overlap(np.linalg.solve(base, moved @ base)) for at in self._standing)), None)

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
        """Placements (4,) with their estimates [J], the cheapest first; infinite ones cannot be."""
        out, points = list[tuple[np.ndarray, float]](), self.points()
        for k, point in enumerate(points):
            if self.stopped() and out:
                break
            self.progress(f"estimate {k + 1}/{len(points)}", 0.3 * k / len(points))
            out.append((point, self.estimate(point)))
        return sorted(out, key=lambda item: item[1])

    def estimate(self, point: np.ndarray) -> float:
        """The likely energy [J] of the job at a placement (4,).

        Infinite if a pose is out of reach, or fixed bodies overlap.
        """
        poses = (pose_in_base(self.job.steps[k], self.job.robot, self.at(point)) for k in self.job.open)
        if any(map(self._tool.out_of_reach, poses)) or self.overlap(point):
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
        return posed.estimate()

    def solve(self, point: np.ndarray, kind: str, ends: Ends | None = None) -> JobResult | None:
        """The job at a placement in full; None where it cannot be done.

        Args:
            ends: positions at the ends of steps; by default the best of those that are likely and of the nearest.
        """
        best = None
        with suppress(Infeasible):
            cell = self.at(point)
            best = run_posed(self.job, self.model, self.settings, cell=cell, ends=ends, stopped=self.stopped)
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
        return [*posed.choices(), posed.greedy()]

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
        """The positions (n,) by step at a placement (4,) nearest to given ones.

        None if a pose is out of reach, or fixed bodies overlap.
        """
        if self.overlap(point):
            return None
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
