"""The verbs that read measured data, from Python: identify and diagnose."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from energy_opt.front.given import AnyModel, AnyPayload, AnyRobot, model_from, payload_from, robot_from
from energy_opt.measured import MeasuredSet, read_log, read_set
from energy_opt.measured.sets import robot_of

if TYPE_CHECKING:
    from energy_opt.diagnose import Diagnosis
    from energy_opt.identify import Identification


def measured_set(folder: str | PathLike[str], robot: AnyRobot | None = None) -> MeasuredSet:
    """The measured set of a folder with a log.toml, of the robot that it names or of the one given."""
    folder = Path(folder)
    return read_set(folder, robot_of(read_log(folder), None) if robot is None else robot_from(robot))


def identify(
    folder: str | PathLike[str], robot: AnyRobot | None = None, payload: AnyPayload | None = None
) -> Identification:
    """The source paper's two methods from the static poses of a measured set."""
    from energy_opt.identify import identify, poses_of
    from energy_opt.robot import PointMass

    measured, mass = measured_set(folder, robot), None
    if payload is not None:
        values = payload_from(payload).values
        mass = PointMass(float(values["mass"][0]), values["com"])
    return identify(measured.robot.name, poses_of(measured, mass))


def diagnose(
    folder: str | PathLike[str],
    model: AnyModel,
    *,
    robot: AnyRobot | None = None,
    payload: AnyPayload | None = None,
    **more: Any,
) -> Diagnosis:
    """What the declared model lacks, from measured data.

    Args:
        folder: the measured set: a folder with a log.toml.
        model: the declared model, or its file or name.
        robot: the arm; the one that log.toml names by default.
        payload: known payload, put into the declared model.
        more: further arguments of `energy_opt.diagnose.diagnose`, such as `seed`.
    """
    from energy_opt.diagnose import diagnose

    measured = measured_set(folder, robot)
    declared = model_from(model, measured.robot)
    if payload is not None:
        declared = declared.replaced(payload_from(payload))
    return diagnose(measured, declared, **more)
