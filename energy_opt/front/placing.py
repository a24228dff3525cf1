"""The verb `place` from Python: the base pose that makes a job cheapest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from energy_opt.cell.request import CellRequest
from energy_opt.front.given import AnyModel, several
from energy_opt.front.rivals import rivals_from
from energy_opt.job import load_job
from energy_opt.job.models import mean_of
from energy_opt.motion import Settings
from energy_opt.place import Placement, PlaceRequest
from energy_opt.place import place as placed
from energy_opt.poses.given import poses_of_request
from energy_opt.robot import load_robot


def place(
    job: str | PathLike[str],
    base_box: str | PlaceRequest,
    model: AnyModel | Sequence[AnyModel] = None,
    *,
    cell: CellRequest | None = None,
    settings: Settings | None = None,
    stopped: Callable[[], bool] = lambda: False,
    **more: Any,
) -> Placement:
    """The base pose in a box that makes a job cheapest; see `energy_opt.place.place`.

    Args:
        job: a job file whose steps end at poses of the tool.
        base_box: "X0,X1,Y0,Y1,Z0,Z1[,yaw]" [m], or a `PlaceRequest`.
        model: as for `optimize`.
        cell: what stands around, and the given base.
        more: further fields of a `PlaceRequest`.
    """
    asked = cell or CellRequest()
    request = PlaceRequest.of(base_box, **more) if isinstance(base_box, str) else base_box
    loaded = load_job(Path(job), load_robot, allow_outside=asked.allow_outside, named=poses_of_request(asked))
    rivals, _ = rivals_from(several(model), None, loaded.robot, None)
    power = mean_of(rivals).standing(*asked.base[3:5])
    return placed(loaded, power, request, settings=settings, cell=asked, stopped=stopped)
