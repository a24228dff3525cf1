"""A job whose steps end at poses of the tool, solved in full.

It begins with the positions that are likely to be cheapest; where that cycle is not solved, others follow. The usual
choice, at every pose the branch nearest to the arm's previous position, is solved too; the cheaper one is the answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from energy_opt.cell.request import CellRequest
from energy_opt.errors import Infeasible
from energy_opt.jobs.cycle import Choice
from energy_opt.jobs.file import Job
from energy_opt.jobs.posed import Ends, Posed, same
from energy_opt.jobs.solve_job import JobResult, RoughCycles, run_job
from energy_opt.motion.move import Settings
from energy_opt.power import PowerModel


def run_posed(
    job: Job,
    model: PowerModel,
    settings: Settings | None = None,
    *,
    cell: CellRequest | None = None,
    ends: Ends | None = None,
    stopped: Callable[[], bool] = lambda: False,
    progress: Callable[[str, float], None] = lambda text, share: None,
    **more: Any,
) -> JobResult:
    """As `run_job`, for jobs that may have poses: their positions are chosen over the whole cycle.

    Args:
        ends: positions (n,) at the ends of all moving steps, by their index; by default they are chosen, and the cycle
            with the nearest branches is solved, too; the cheaper one is the answer.
        more: further arguments of `run_job`.

    Raises:
        Infeasible: a pose is out of reach, or a cycle cannot be done; says which step and what would work.
    """
    if not job.open:
        return run_job(job, model, settings, cell=cell, stopped=stopped, progress=progress, **more)
    settings, cell = settings or Settings(), cell or CellRequest()
    progress("joint positions of the poses", 0.0)
    posed = Posed(job, model, settings, cell, None if ends is None else {k: q[None] for k, q in ends.items()})
    tried: list[tuple[Ends, JobResult | Infeasible]] = []

    def solved(at: Ends, first: float) -> JobResult | Infeasible:
        """The cycle with these ends, or why it cannot be done; `first`: finished share of the work."""
        for other, known in tried:
            if same(at, other):
                return known
        found: JobResult | Infeasible
        try:
            found = run_job(
                job.at(at), model, settings, cell=cell, stopped=stopped, **more,
                progress=lambda text, share: progress(text, first + share * (0.5 if ends is None else 1.0)),
            )  # fmt: skip
        except Infeasible as error:
            found = error
        tried.append((at, found))
        return found

    for at in posed.likely(RoughCycles(model, settings, job, stopped), True) if ends is None else [ends]:
        answer = solved(at, 0.0)
        if isinstance(answer, JobResult) and (answer.solved or stopped()):
            break
    nearest = solved(posed.greedy(), 0.5) if ends is None else None
    done = [(at, found) for at, found in tried if isinstance(found, JobResult)]
    if not done:
        raise next(found for _, found in tried if isinstance(found, Infeasible))
    at, best = min(done, key=lambda item: (not item[1].solved, item[1].energy))
    branches, chosen = {k: len(posed.sets[k]) for k in posed.poses}, {k: at[k] for k in posed.poses}
    greedy = nearest.energy if isinstance(nearest, JobResult) else None
    choice = Choice(chosen, posed.asked, branches, best.energy, greedy, len(tried), cell.tool)
    return replace(best, choice=choice, warnings=(*best.warnings, *posed.near(at)))
