"""From estimates all over a box to the job solved in full at the cheapest placement; see `base_search`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, Infeasible
from energy_opt.jobs.file import Job
from energy_opt.jobs.solve_job import JobResult
from energy_opt.motion.move import Settings
from energy_opt.placement.base_search import Search
from energy_opt.placement.placement import Looked, Placement, PlaceRequest, Rough
from energy_opt.poses.sets import TOO_SLOW
from energy_opt.power import PowerModel

TRIES = 2  # times as many seeds are tried if rough cycles fail
APART = 0.15  # share of the box: least distance of seeds
RELAXED = 1.6  # first factor of steps: bent motions bound the optimum from above, and overestimate long steps
ANSWERS = 3  # most placements to solve in full until one is proven


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
    search.check_tool()
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
    cheaper = [at for at in seeds if at.energy < result.energy and not any(at.point is item[2] for item in done)]
    fixed = [step.name for k, step in enumerate(job.steps) if step.wait is None and k not in job.open]
    warnings = [
        f"steps with given joint positions do not move with the {request.fixture or 'base'}: {', '.join(fixed)}"
    ]
    warnings = warnings if fixed else []
    if cheaper and stopped():
        rough = min(cheaper, key=lambda at: at.energy)
        words = ", ".join(f"{x:.4g}" for x in rough.point)
        warnings.append(
            f"stopped before the cheapest place was solved in full: at x, y, z, yaw = {words} a rough cycle, unproven, "
            f"takes {rough.energy:.4g} J; the answer takes {result.energy:.4g} J"
        )
    # estimates with the penalty of a move that is too slow are no energies
    known = ((point, value if value < TOO_SLOW / 2 else np.inf) for point, value in looked)
    tried = tuple(Looked(search.place(point), value, "estimate") for point, value in known)
    return Placement(
        search.place(best), result, search.given, given_result, tried, tuple(search.path),
        (*warnings, *result.warnings), request.fixture, stopped(),
    )  # fmt: skip


def _no_placement_error(search: Search, looked: list[tuple[np.ndarray, float]]) -> Infeasible:
    """The error that no placement works, with the reason at the most promising one, else at the middle of the box.

    Places at which fixed bodies overlap give the reason only if there are no others.
    """
    points = [point for point, _ in looked] or [search.bounds.mean(axis=1)]
    point = next((at for at in points if search.overlap(at) is None), points[0])
    words = ", ".join(f"{x:.4g}" for x in point)
    if overlap := search.overlap(point):
        raise Infeasible(f"no placement in the box was found; at x, y, z, yaw = {words}: {overlap}", limit="clearance")
    try:
        search.posed(point)
        reason, limit = "the job cannot be done at the placements that were tried", "duration"
    except Infeasible as error:
        reason, limit = str(error), error.limit or "pose"
    return Infeasible(f"no placement in the box was found; at x, y, z, yaw = {words}: {reason}", limit=limit)
