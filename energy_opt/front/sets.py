"""Requests about a measured set: its robot, and what was asked of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from energy_opt.errors import BadInput
from energy_opt.front.given import named_robot
from energy_opt.front.moves import payload_document
from energy_opt.measured import read_log
from energy_opt.measured.sets import robot_of
from energy_opt.requests.verbs import DiagnoseRequest, IdentifyRequest
from energy_opt.robot import Robot

Asked = TypeVar("Asked", IdentifyRequest, DiagnoseRequest)


def robot_of_set(request: IdentifyRequest | DiagnoseRequest, folder: Path) -> Robot:
    """The robot that the set of a folder names, with the request's limits and locked joints."""
    limits = None if request.limits is None else Path(request.limits)
    return robot_of(read_log(folder, request.allow_outside), limits, request.locked)


def request_of_set(request: Asked, robot: Robot, **known: Any) -> Asked:
    """The request with what its words came to.

    Raises:
        BadInput: the seed is below 0.
    """
    if request.seed < 0:
        raise BadInput(f"--seed {request.seed}: expected 0 or more")
    named = None if request.robot is None else named_robot(robot, request.robot)
    return replace(request, robot=named, payload=payload_document(request.payload), **known)
