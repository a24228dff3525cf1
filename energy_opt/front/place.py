"""The verb `place`: the base pose that makes a job cheapest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from energy_opt.errors import Infeasible
from energy_opt.folders import written_whole
from energy_opt.found import Found
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import cell_of
from energy_opt.front.jobs import job_from, job_settings, resolved_job
from energy_opt.front.rivals import rivals_of
from energy_opt.jobs.models import mean_of
from energy_opt.placement import Placement
from energy_opt.placement import PlaceRequest as Box
from energy_opt.placement import place as placed
from energy_opt.requests.moves import PlaceRequest

ANSWER = "place.json"


@dataclass(frozen=True, repr=False)
class PlaceAnswer(Found):
    """A placement with what it was asked for.

    Attributes:
        placement: the base pose, and the job solved there.
        request: what was asked; `run` repeats it. stamp: version, and the command line where there was one.
        interrupted: stopped early.
        saved: place.json as it was written.
    """

    placement: Placement
    request: PlaceRequest
    stamp: Mapping[str, Any]
    interrupted: bool = False
    saved: Mapping[str, Any] | None = None

    @property
    def exit_code(self) -> int:
        """Of the command line."""
        return 130 if self.interrupted else 0 if self.placement.solved else 4

    def document(self) -> dict[str, Any]:
        """place.json, less its files."""
        return {**self.placement.document(), "request": {**self.request.document(), **self.stamp}}

    def text(self, out: Path) -> str:
        """A line for a terminal, of a placement that was saved into `out`."""
        from energy_opt.placement.output import headline

        return f"{headline(self.saved or self.document())}\nfiles in {out}"

    def kept(self, out: Path) -> PlaceAnswer:
        """Write place.json, map.png, report.html and the job solved at the answer into the folder `out`."""
        from energy_opt.placement.output import write

        with written_whole(out, ANSWER) as aside:
            saved = write(self.placement, {**self.request.document(), **self.stamp}, aside)
        return PlaceAnswer(self.placement, self.request, self.stamp, self.interrupted, saved)

    def __repr__(self) -> str:
        return f"PlaceAnswer({self.placement!r})"


def run(request: PlaceRequest, desk: Desk) -> PlaceAnswer:
    """The pose of the base, or of a fixture, in a box that makes a job cheapest.

    Raises:
        BadInput: a fault of the job or of the box. Infeasible: the job cannot be done from anywhere in the box.
    """
    given, counts = (
        request.base_box,
        {name: getattr(request, name) for name in ("looked_at", "seeds", "steps", "fixture")},
    )
    words = given if isinstance(given, str) else ",".join(repr(float(x)) for x in given)
    box, around = Box.of(words, **counts), cell_of(request)
    job = job_from(request)
    rivals, kind = rivals_of(request, job.robot, desk)
    asked = resolved_job(request, job.robot, rivals, kind)
    document = desk.stamped(asked.document())
    desk.take(ANSWER, document)
    with desk.working() as (stopped, show):
        try:
            found = placed(
                job, mean_of(rivals), box, settings=job_settings(request), cell=around, stopped=stopped, progress=show
            )
        except Infeasible as error:
            desk.failed(ANSWER, error, robot=job.robot.name, request=document)
            raise
        answer = desk.keep(PlaceAnswer(found, asked, desk.stamped({}), stopped()))
    for warning in answer.saved["warnings"] if answer.saved is not None else ():
        desk.say(f"warning: {warning}")
    return answer


place = verb(PlaceRequest, run)
