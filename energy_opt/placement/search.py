"""The pose of the base, or of a fixture, that makes a job cheapest.

estimate   the job at placements all over the box: the cheapest ring through the branches of its poses
solve      the job at the best estimates, far from each other, with its scene
descend    the solved motions, bent to the ends that another base asks for, cost no less than that base's optimum and at
           this base as much (envelope theorem), so a base at which they cost less is better; solved again, and so on
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from energy_opt.cell.load import scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, Infeasible
from energy_opt.jobs.file import Job
from energy_opt.jobs.posed import Ends, Posed, run_posed
from energy_opt.jobs.run import JobResult
from energy_opt.motion.move import Settings
from energy_opt.placement.placement import Looked, Placement
from energy_opt.placement.request import PlaceRequest
from energy_opt.poses.given import WORLD
from energy_opt.power import PowerModel

APART = 0.15  # of the box: distance of seeds
FARTHEST = 0.2  # of the box: the farthest a step goes
WORTH = 1e-3  # of the losses: a step that promises less ends the search
POOL = 48  # positions from which inverse kinematics starts at a placement
RELAXED, MOST_RELAXED = 1.6, 3.0  # steps go on by so much: bent motions bound the optimum from above, and bend more
EVALUATIONS = 60  # of bent motions in a step
UNREACHED = 1e9  # J that a placement is taken to cost from which a pose is out of reach


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
        self.job = _in_scene(job, cell)
        self.given = cell.base if request.fixture is None else _fixture_pose(self.job, cell, request.fixture)
        self.bounds = request.bounds(self.given)
        self.span = self.bounds[:, 1] - self.bounds[:, 0]
        self.free = np.flatnonzero(self.span > 0)
        self.solved: dict[tuple[float, ...], tuple[Ends, JobResult]] = {}
        self.path: list[Looked] = []
        self._pool: dict[int, np.ndarray] | None = None

    def at(self, point: np.ndarray) -> CellRequest:
        """The cell with the base, or the fixture, at x, y, z, yaw (4,)."""
        fixture, place = self.request.fixture, self.place(point)
        return replace(self.cell, base=place) if fixture is None else replace(self.cell, moved=(fixture, place))

    def place(self, point: np.ndarray) -> tuple[float, ...]:
        """x, y, z, roll, pitch, yaw (6,) at x, y, z, yaw (4,)."""
        x, y, z, yaw = (float(value) for value in point)
        return x, y, z, self.given[3], self.given[4], yaw

    def posed(self, point: np.ndarray, pool: dict[int, np.ndarray] | None = None) -> Posed:
        """The choice of positions at a placement; with a pool of starts quickly, and blind to what is around."""
        cell = self.at(point)
        return Posed(self.job, self.model, self.settings, cell, starts=pool)

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
        """Placements and estimates [J], those within reach; the cheapest first."""
        out: list[tuple[np.ndarray, float]] = []
        points = self.points()
        for k, point in enumerate(points):
            if self.stopped() and out:
                break
            self.progress(f"estimate {k + 1}/{len(points)}", 0.3 * k / len(points))
            out.append((point, self.estimate(point)))
        return sorted(out, key=lambda item: item[1])

    def estimate(self, point: np.ndarray) -> float:
        """What the job is likely to take at a placement [J]; infinite where a pose is out of reach."""
        try:
            posed = self.posed(point, self._pool)
        except Infeasible:
            return float(np.inf)
        pool = {} if self._pool is None else self._pool
        for k, q in posed.sets.items():  # what was found here helps at the next placement
            known = pool.get(k, q[:0])
            pool[k] = np.vstack([q[:: max(1, len(q) // POOL)], known])[:POOL]
        self._pool = pool
        return posed.estimated(improve=False)[1]

    def solve(self, point: np.ndarray, kind: str, ends: Ends | None = None) -> JobResult | None:
        """The job at a placement; None where it cannot be done.

        Args:
            ends: positions at the ends of steps; by default those that are chosen there.
        """
        for chosen in self._choices(point) if ends is None else [ends]:
            try:
                found = run_posed(
                    self.job, self.model, self.settings, cell=self.at(point), ends=chosen, compare=False, refine=False,
                    stopped=self.stopped,
                )  # fmt: skip
            except Infeasible:
                continue
            self.path.append(Looked(self.place(point), found.energy, kind))
            self.solved[self.place(point)] = chosen, found
            return found
        self.path.append(Looked(self.place(point), np.nan, kind))
        return None

    def _choices(self, point: np.ndarray) -> list[Ends]:
        """Positions at the ends of steps: those that are likely to be cheapest, and the nearest where these fail."""
        try:
            posed = self.posed(point)
        except Infeasible:
            return []
        return [posed.estimated()[0], posed.greedy()]

    def better(self, point: np.ndarray) -> tuple[np.ndarray, Ends, float]:
        """A placement near a solved one at which the bent motions cost less, positions there, and the gain [J]."""
        ends, result = self.solved[self.place(point)]
        here = self.posed(point, {k: q[None] for k, q in ends.items()})
        bent = here.bending(result)
        least = np.maximum(self.bounds[:, 0], point - FARTHEST * self.span)
        most = np.minimum(self.bounds[:, 1], point + FARTHEST * self.span)
        known: list[tuple[float, np.ndarray, Ends]] = []

        def cost(share: np.ndarray) -> float:
            at = point.copy()
            at[self.free] = np.clip(point[self.free] + share * self.span[self.free], least[self.free], most[self.free])
            try:
                there = self.posed(at, {k: q[None] for k, q in ends.items()})
            except Infeasible:
                return UNREACHED
            moved = {k: there.sets[k][0] if k in there.poses else q for k, q in ends.items()}
            value = bent(moved)
            known.append((value, at, moved))
            return value

        before = cost(np.zeros(len(self.free)))
        if len(self.free):
            sides = np.vstack([(least - point)[self.free], (most - point)[self.free]]) / self.span[self.free]
            minimize(
                cost, np.zeros(len(self.free)), method="L-BFGS-B", bounds=sides.T,
                options={"maxfun": EVALUATIONS * (1 + len(self.free)), "eps": 1e-4, "maxiter": 12},
            )  # fmt: skip
        value, at, moved = min(known, key=lambda item: item[0])
        there = self.posed(at, {k: q[None] for k, q in moved.items()})
        moved, more = there.bent(result, moved)
        return at, moved, before - value + more

    def beyond(self, point: np.ndarray, at: np.ndarray, ends: Ends, relax: float) -> tuple[np.ndarray, str, Ends]:
        """A step to a placement `at`, gone on by a factor, within the box; what `solve` takes."""
        further = np.clip(point + relax * (at - point), self.bounds[:, 0], self.bounds[:, 1])
        try:
            there = self.posed(further, {k: q[None] for k, q in ends.items()})
        except Infeasible:
            return at, "step", ends
        return further, "step", {k: there.sets[k][0] if k in there.poses else q for k, q in ends.items()}

    @staticmethod
    def point(place: tuple[float, ...]) -> np.ndarray:
        """x, y, z, yaw (4,) of a pose (6,)."""
        return np.array([*place[:3], place[5]])


def _in_scene(job: Job, cell: CellRequest) -> Job:
    """The job with its poses where they stand in the scene while the base is where it was given."""
    steps = list(job.steps)
    for k in job.open:
        pose = steps[k].pose
        assert pose is not None
        if not pose.frame:
            steps[k] = replace(steps[k], pose=replace(pose, matrix=cell.base_pose @ pose.matrix, frame=WORLD[0]))
    return replace(job, steps=tuple(steps))


def _fixture_pose(job: Job, cell: CellRequest, fixture: str) -> tuple[float, ...]:
    """Where a fixture is: x, y, z [m], roll, pitch, yaw [rad] (6,) of its frame in the scene's.

    Raises:
        BadInput: no pose of the job is in its frame, or a scene has no such object.
    """
    steps = [step for step in job.steps if step.pose is not None and step.pose.frame == fixture]
    if not steps:
        raise BadInput(f"{job.name}: no step ends at a pose in the frame of {fixture!r}, so its place changes nothing; "
                       f'give `pose = "{fixture}: X,Y,Z,R,P,Y"`')  # fmt: skip
    scene = scene_of(replace(cell, scene=steps[0].scene or cell.scene))
    if scene is None:
        raise BadInput(f"{job.name}: no scene has the object {fixture!r}; give --scene")
    known = {thing.name: thing for thing in scene.objects}
    if fixture not in known:
        scene.with_object_at(fixture, np.eye(4))
    at = known[fixture].place
    return *map(float, at[:3, 3]), *map(float, Rotation.from_matrix(at[:3, :3]).as_euler("xyz"))


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
        cell: what is around, and the given base.

    Raises:
        BadInput: no step of the job ends at a pose. Infeasible: no placement was found at which the job can be done.
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
    reached = [(point, value) for point, value in looked if np.isfinite(value)]
    seeds: list[np.ndarray] = []
    inside = bool(((given >= search.bounds[:, 0] - 1e-12) & (given <= search.bounds[:, 1] + 1e-12)).all())
    done: list[tuple[bool, float, np.ndarray]] = []  # not solved, energy [J], placement: a proven one comes first
    if given_result is not None and inside:
        done.append((not given_result.solved, given_result.energy, given))
    for point, _ in reached:
        if len(seeds) >= request.seeds or (stopped() and done):
            break
        near = [*seeds, *(at for *_, at in done)]
        if any((np.abs(point - other)[search.free] < APART * search.span[search.free]).all() for other in near):
            continue
        progress(f"seed {len(seeds) + 1}/{request.seeds}", 0.3 + 0.4 * len(seeds) / max(request.seeds, 1))
        found = search.solve(point, "seed")
        if found is not None:
            seeds.append(point)
            done.append((not found.solved, found.energy, point))
    if not done:
        raise _nowhere(search, looked)
    best = min(done, key=lambda item: item[:2])
    relax = RELAXED
    for k in range(request.steps):
        if stopped():
            break
        progress(f"step {k + 1}/{request.steps}", 0.7 + 0.3 * k / request.steps)
        at, ends, gain = search.better(best[2])
        losses = sum(answer.energy.loss for answer in search.solved[search.place(best[2])][1].plan.answers)
        if gain < WORTH * losses:
            break
        found = search.solve(*search.beyond(best[2], at, ends, relax))
        if found is None or not found.solved or (False, found.energy) >= best[:2]:
            if relax == 1.0:
                break
            relax = 1.0  # the bound itself is kept
            continue
        relax = float(np.clip(relax * (best[1] - found.energy) / gain, 1.0, MOST_RELAXED)) if relax > 1 else 1.0
        best = False, found.energy, search.point(search.path[-1].place)
    answer = search.place(best[2])
    fixed = [step.name for k, step in enumerate(job.steps) if step.wait is None and k not in job.open]
    warnings = [f"joint positions do not change with the {request.fixture or 'base'}: {', '.join(fixed)}"]
    tried = tuple(Looked(search.place(point), value, "estimate") for point, value in looked)
    return Placement(
        answer, search.solved[answer][1], search.given, given_result, tried, tuple(search.path),
        tuple(warnings if fixed else ()), request.fixture,
    )  # fmt: skip


def _nowhere(search: Search, looked: list[tuple[np.ndarray, float]]) -> Infeasible:
    """Why no placement will do: what is in the way at the one that is most promising, else at the middle of the box."""
    point = looked[0][0] if looked else search.bounds.mean(axis=1)
    words = ", ".join(f"{x:.4g}" for x in point)
    try:
        search.posed(point)
        reason, limit = "the job cannot be done at the placements that were tried", "duration"
    except Infeasible as error:
        reason, limit = str(error), error.limit or "pose"
    return Infeasible(f"no placement in the box was found; at x, y, z, yaw = {words}: {reason}", limit=limit)
