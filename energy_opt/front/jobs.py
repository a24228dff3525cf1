"""The job that a request names: a file, or its content."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from energy_opt.files import read_toml
from energy_opt.front.given import cell_of, named_robot, robot_of
from energy_opt.front.moves import documents, payload_document
from energy_opt.jobs.file import Job, Load, job_of
from energy_opt.motion import Settings
from energy_opt.motion.plan.robust import Kind, Rival
from energy_opt.poses.given import poses_of_request
from energy_opt.requests.moves import JobRequest, PlaceRequest, TradeoffRequest
from energy_opt.robot import Robot

Asked = TypeVar("Asked", JobRequest, TradeoffRequest, PlaceRequest)


def content_of(request: JobRequest | TradeoffRequest | PlaceRequest) -> tuple[dict[str, Any], Path]:
    """A job's document, and the file that other files lie beside."""
    if isinstance(request.job, Mapping):
        return dict(request.job), Path(request.folder or ".") / "job.toml"
    path = Path(str(request.job))
    return read_toml(path), path


def job_from(
    request: JobRequest | TradeoffRequest | PlaceRequest, payload: Load | None = None, robot: Robot | None = None
) -> Job:
    """The job, for the robot that the request names, or else its own.

    Args:
        payload: held until a step says another, in place of what the job says. robot: loaded already.
    """
    document, path = content_of(request)
    return job_of(
        document, path, lambda name: robot or robot_of(request, name), allow_outside=request.allow_outside,
        named=poses_of_request(cell_of(request)),
        payload=payload,
    )  # fmt: skip


def resolved_job(request: Asked, robot: Robot, rivals: list[Rival], kind: Kind | None, **known: Any) -> Asked:
    """The request with what its words and files came to: the job as its content."""
    document, path = content_of(request)
    if not isinstance(request, PlaceRequest):
        known["payload"] = payload_document(request.payload)
    return replace(
        request, job=document, folder=str(path.parent.resolve()), robot=named_robot(robot, request.robot),
        model=documents(rivals), robust=kind, **known,
    )  # fmt: skip


def job_settings(request: JobRequest | PlaceRequest) -> Settings:
    """How to solve the moves of a job."""
    given = {name: getattr(request, name, None) for name in ("seed", "compile", "starts", "deadline")}
    return Settings(**{name: value for name, value in given.items() if value is not None})
