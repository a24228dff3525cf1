"""Arguments as people have them (lists, names, files) made into what the package works with; shapes are checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path

import numpy as np

from energy_opt.effects import Payload
from energy_opt.errors import BadInput, near
from energy_opt.motion.path import Curve, JointPath, of_trajectory, through
from energy_opt.motion.standing import check_moves_on
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.power.locked import of_joints
from energy_opt.power.named import is_named, model_of, named_model
from energy_opt.robot import Robot, load_robot

AnyRobot = Robot | str | PathLike[str]
AnyModel = PowerModel | str | PathLike[str] | None
Vector = Sequence[float] | np.ndarray
Positions = Vector | Mapping[str, float]
AnyPayload = float | Sequence[float] | Payload
AnyPath = JointPath | Trajectory | Curve | Sequence[Vector] | np.ndarray | str | PathLike[str]

DEFAULT = "source-method-2"
SAMPLED = 401  # points at which a path that is any function is taken


def robot_from(given: AnyRobot, limits: str | PathLike[str] | None = None) -> Robot:
    """A robot, or the one of a name or of a URDF file."""
    if isinstance(given, Robot):
        if limits is not None:
            raise BadInput("--limits belongs to a robot that is loaded: load_robot(name, limits=...)")
        return given
    return load_robot(str(given), limits=None if limits is None else Path(limits))


def model_from(given: AnyModel, robot: Robot) -> PowerModel:
    """A model, or the one of a name or of a model file; the source paper's Method 2 where None is given.

    Raises:
        BadInput: no such name or file, or a model of another number of joints.
    """
    model = given if isinstance(given, PowerModel) else model_of(DEFAULT if given is None else given, robot)
    model = of_joints(model, robot)
    model.check(robot.n)
    return model


def several(given: AnyModel | Sequence[AnyModel]) -> list[AnyModel]:
    """The models of one or several; empty where none is given."""
    if given is None:
        return []
    return [given] if isinstance(given, (str, PathLike, PowerModel)) else list(given)


def source_model(robot: AnyRobot = "panda", method: int = 2) -> PowerModel:
    """The power model of Petrichenko et al. 2024 (arXiv 2411.03194) by its Method 1 or 2, taken over for any robot."""
    name = f"source-method-{method}"
    if not is_named(name):
        raise BadInput(f"--method {method}; expected 1 or 2")
    return named_model(name, robot if isinstance(robot, Robot) else str(robot))


def payload_from(given: AnyPayload) -> Payload:
    """A payload from its mass [kg], or from mass and centre of mass (m, x, y, z) [kg, m] in the last joint's frame."""
    if isinstance(given, Payload):
        return given
    numbers = np.atleast_1d(np.asarray(given, dtype=float))
    if numbers.shape not in ((1,), (4,)):
        raise BadInput(f"--payload {given!r}: expected a mass, or mass and centre of mass: (m, x, y, z)")
    return Payload(mass=numbers[0], com=numbers[1:] if numbers.size == 4 else np.zeros(3))


def positions(given: Positions, robot: Robot, name: str) -> np.ndarray:
    """Joint positions (n,) [rad] from any sequence in the robot's order, or by joint names in any order.

    Raises:
        BadInput: another number of values, an unknown or missing joint, not finite.
    """
    if isinstance(given, Mapping):
        for joint in given:
            if joint not in robot.joints:
                raise BadInput(
                    f"--{name}: unknown joint {joint!r}{near(joint, robot.joints)}; joints: {', '.join(robot.joints)}"
                )
        missing = [joint for joint in robot.joints if joint not in given]
        if missing:
            raise BadInput(f"--{name}: no value for {', '.join(missing)}")
        given = [given[joint] for joint in robot.joints]
    try:
        q = np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise BadInput(f"--{name}: {given!r} is not {robot.n} numbers [rad]") from None
    if q.shape != (robot.n,):
        raise BadInput(f"--{name}: shape {q.shape}; {robot.name} has {robot.n} joints: {', '.join(robot.joints)}")
    if not np.isfinite(q).all():
        raise BadInput(f"--{name}: expected finite joint positions [rad]")
    return q


def path_from(given: AnyPath, robot: Robot) -> JointPath:
    """A path from waypoints (K, n) [rad], a trajectory, a file of either, or any function q(s) on [0, 1].

    Raises:
        BadInput: of another number of joints, or not finite.
    """
    if isinstance(given, (str, PathLike)):
        from energy_opt.formats import read

        given = read(Path(given)).of(robot.joints, "").path()
    if isinstance(given, Trajectory):
        check_moves_on(given, "--path")
        given = of_trajectory(given)
    if isinstance(given, JointPath):
        path = given
    else:
        points = np.asarray(given(np.linspace(0.0, 1.0, SAMPLED)) if callable(given) else given, dtype=float)
        if points.ndim != 2 or len(points) < 2 or points.shape[1] != robot.n or not np.isfinite(points).all():
            raise BadInput(f"--path: shape {points.shape}; expected waypoints (K, {robot.n}), K at least 2, all finite")
        path = through(points)
    if path.n != robot.n:
        raise BadInput(f"--path: {path.n} joints; {robot.name} has {robot.n}")
    return path
