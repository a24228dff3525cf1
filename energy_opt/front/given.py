"""Conversion of arguments (words, lists, names, files) to the package's objects; shapes are checked.

Words are those of the command line: `"0.1,0.2"`, `"joint=0.1"`, `"1.5,0,0,0.1"`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from energy_opt.cell.request import CellRequest
from energy_opt.effects import Payload
from energy_opt.errors import BadInput, shown
from energy_opt.evaluations.source import is_set, joints_in, robot_named
from energy_opt.files import finite_number, words_of
from energy_opt.measured import read_log
from energy_opt.measured.sets import robot_of as robot_of_log
from energy_opt.names import in_order
from energy_opt.power import PowerModel
from energy_opt.power.drive_law import body_of
from energy_opt.power.known import is_named, load_model, named_model
from energy_opt.power.model import model_from_document
from energy_opt.power.variants import of_joints
from energy_opt.requests.groups import CellGroup, RobotGroup
from energy_opt.requests.verbs import DiagnoseRequest, IdentifyRequest
from energy_opt.robot import Robot, known_robots, load_robot
from energy_opt.robot.srdf import semantics

if TYPE_CHECKING:
    from energy_opt.batches.task import RobotSource
    from energy_opt.requests.groups import AnyModel, AnyRobot

DEFAULT = "source-method-2"
HEAVIEST = 5.0  # largest payload over an arm's own moving mass: no arm carries twice its weight
FARTHEST = 2.0  # [m] a payload's centre may be as far from the last joint, or as the arm reaches
PAYLOAD = "MASS or MASS,CX,CY,CZ"
_NUMBER = re.compile(r"[-+.]*\d")


def robot_of(request: RobotGroup, given: str | None = None) -> Robot:
    """The robot that a request names or has, or else `given`, with the limits and locked joints of the request.

    Raises:
        BadInput: none is given, or limits and locked joints for a robot that is loaded already.
    """
    named = getattr(request, "robot", None)
    named = given if named is None else named
    if named is None:
        raise BadInput("--robot is missing: a name (`energy-opt robots`) or a URDF")
    known: dict[str, Any] = {"limits": request.limits, "lock": request.locked or None}
    if isinstance(named, Robot):
        for name, value in known.items():
            if value is not None:
                raise BadInput(f"--{name} belongs to a robot that is loaded: load_robot(name, {name}=...)")
        return named
    return load_robot(named, **known, prefix=getattr(request, "joint_prefix", ""))


def named_robot(robot: Robot) -> str:
    """Name to load a robot by: that of a known one, else its URDF."""
    return robot.name if robot.name in known_robots() else str(robot.urdf)


def robot_of_files(paths: Sequence[Path], prefix: str = "") -> str:
    """The robot of some files, by name or URDF: the one that they name, or the only known one with their joints.

    Args:
        paths: of motions. prefix: of the joint names in the files.

    Raises:
        BadInput: neither; names the known robots if there are several.
    """
    for path in paths:
        if is_set(path):
            return named_robot(robot_of_log(read_log(path)))
        named = robot_named(path)
        if named is not None and (named in known_robots() or Path(named).is_file()):
            return named
    names = joints_in(paths[0])
    held = {name.removeprefix(prefix) for name in names}
    arms = {name: set(load_robot(name).joints) for name in known_robots()}
    most = max((len(joints) for joints in arms.values() if joints <= held), default=0)
    fitting = [name for name, joints in arms.items() if joints <= held and len(joints) == most]
    if not fitting:
        raise BadInput(f"{paths[0]}: joints {', '.join(names)} are not those of a known robot; give --robot")
    if len(fitting) > 1:
        raise BadInput(f"{paths[0]}: give --robot; {', '.join(fitting)} have the same joints")
    return fitting[0]


def as_loaded(robot: Robot, given: AnyRobot | None) -> dict[str, Any]:
    """Fields of a request that load the robot again: its name, and limits and locked joints of a given `Robot`."""
    if isinstance(given, Robot):
        return {"robot": named_robot(given), **given.given}
    return {"robot": named_robot(robot) if given is None else str(given)}


def model_from(given: AnyModel | None, robot: Robot) -> PowerModel:
    """A model, or the one of a name, a model file or its document; the source paper's Method 2 where None is given.

    Raises:
        BadInput: no such name or file, a model of another number of joints, or links that no body has.
    """
    where = f"{given}: " if isinstance(given, (str, PathLike)) else ""
    if isinstance(given, PowerModel):
        model = given
    elif isinstance(given, Mapping):
        model = model_from_document({key: value for key, value in given.items() if key != "name"}, "model")
    else:
        model = load_model(DEFAULT if given is None else given, robot)
    try:
        model = of_joints(model, robot)
        model.check(robot.n)
        body_of(model, robot.body)
    except BadInput as error:
        raise BadInput(f"{where}{error}") from None
    return model


def of_another_arm(name: str, model: PowerModel, robot: Robot | RobotSource) -> str:
    """A warning, one line, if a model was written for another robot; else empty."""
    return "" if model.is_of(robot.name) else f"{name}: a model of {model.robot}, used for {robot.name}"


def of_another_load(name: str, model: PowerModel, used: PowerModel) -> str:
    """A warning, one line, if a model's payload is replaced by another one; else empty."""
    own, other = model.get(Payload.name), used.get(Payload.name)
    if own is None or own == other:
        return ""
    masses = [0.0 if e is None else float(e.values["mass"][0]) for e in (own, other)]
    return f"{name}: its payload of {masses[0]:g} kg is replaced by that of --payload, {masses[1]:g} kg"


def several(given: AnyModel | Sequence[AnyModel] | None) -> list[AnyModel]:
    """The models of one or several; empty where none is given."""
    if given is None:
        return []
    return [given] if isinstance(given, (str, PathLike, PowerModel, Mapping)) else list(given)


def source_model(robot: AnyRobot = "panda", method: int = 2) -> PowerModel:
    """The power model of Petrichenko et al. 2024 (arXiv 2411.03194), applied to any robot.

    Values are published ones if there are any (`panda`; copper loss of `ur5e`), else scaled from the robot's limits.

    Args:
        robot: loaded, or by name.
        method: 1 (standby alone) or 2 (standby [W] and copper loss [W/(N m)^2]).

    Raises:
        BadInput: another method, or an unknown robot.
    """
    name = f"source-method-{method}"
    if not is_named(name):
        raise BadInput(f"--method {shown(method)}; expected 1 or 2")
    return named_model(name, robot if isinstance(robot, Robot) else str(robot))


def carried(given: Any, robot: Robot) -> Payload:
    """`payload_from`, with a check that the arm may carry it.

    Raises:
        BadInput: as `payload_from`, or far more than the arm itself weighs.
    """
    payload = payload_from(given, max(FARTHEST, robot.reach))
    mass = float(payload.values["mass"][0])
    own = sum(link.mass for link in robot.body.tree())
    if mass > HEAVIEST * own:
        raise BadInput(
            f"--payload: {mass:g} kg is too much: the links of {robot.name} have {own:.3g} kg; expected kg (are these "
            f"grams? then {mass / 1000:g} kg)"
        )
    return payload


def on_arm(model: PowerModel, request: Any, robot: Robot) -> PowerModel:
    """The model with the payload and the tilt of the base that a request states, if it states them.

    Raises:
        BadInput: as `carried`; or the base is tilted, and the model states another tilt.
    """
    payload, base = getattr(request, "payload", None), getattr(request, "base", None)
    model = model if payload is None else model.for_move(carried(payload, robot))
    return model if base is None else model.standing(*base[3:5])


def payload_from(given: Any, farthest: float = np.inf) -> Payload:
    """A payload from its mass [kg], from mass and centre (m, x, y, z) [kg, m] in the last joint's frame, or by name.

    Args:
        farthest: [m] largest plausible distance of the centre from the last joint.

    Raises:
        BadInput: another number of values, invalid values, or a centre that is implausibly far away.
    """
    if isinstance(given, Payload):
        return given
    if isinstance(given, str):
        numbers = np.array([finite_number(word, f"--payload {given}", PAYLOAD) for word in words_of(given)])
        if len(numbers) not in (1, 4):
            raise BadInput(f"--payload {given}: {len(numbers)} numbers; expected {PAYLOAD}")
    else:
        mapping = isinstance(given, Mapping)
        if mapping and not {"mass"} <= given.keys() <= {"mass", "com"}:
            raise BadInput(f"--payload: keys {', '.join(map(str, given))}; expected mass and com")
        values = [*np.ravel(given.get("mass")), *np.ravel(given.get("com", [0, 0, 0]))] if mapping else given
        try:
            numbers = np.atleast_1d(np.asarray(values, dtype=float))
        except (TypeError, ValueError):
            numbers = np.zeros(0)
        if numbers.shape not in ((1,), (4,)):
            raise BadInput(f"--payload {shown(given)}: expected a mass, or mass and centre of mass: (m, x, y, z)")
    far = float(np.abs(numbers[1:]).max(initial=0.0))
    if far > farthest:
        raise BadInput(
            f"--payload: its centre is {far:g} m from the last joint; expected metres (are these millimetres? "
            f"{far / 1000:g} m then)"
        )
    try:
        return Payload(mass=numbers[0], com=numbers[1:] if numbers.size == 4 else np.zeros(3))
    except BadInput as error:
        raise BadInput(f"--payload: {str(error).removeprefix('effect payload: ')}") from None


def payload_document(given: Any) -> dict[str, Any] | None:
    """A payload as an entry of a request's document."""
    return None if given is None else {name: value.tolist() for name, value in payload_from(given).values.items()}


def cell_of(request: CellGroup) -> CellRequest:
    """Body and cell as a request has them.

    Raises:
        BadInput: a value that no cell has, or a payload's size without a payload.
    """
    given: dict[str, Any] = {
        name: value
        for name in CellRequest.__dataclass_fields__
        if name != "payload_at" and (value := getattr(request, name, None)) is not None
    }
    given["package_dirs"] = tuple(Path(folder) for folder in request.package_dir)
    if request.payload_size is not None:
        payload = getattr(request, "payload", None)
        if payload is None:
            raise BadInput("--payload-size belongs to --payload MASS[,CX,CY,CZ]")
        given["payload_at"] = tuple(payload_from(payload).values["com"].tolist())
    return CellRequest(**given)


def positions(given: Any, robot: Robot, name: str, srdf: Path | None = None) -> np.ndarray:
    """Joint positions (n,) [rad] from any sequence in the robot's order, by joint names in any order, or as words.

    A mapping has joint names, and so have the labels of a pandas Series that are not numbers.

    Args:
        given: also `"0.1,0.2"`, `"0.1 0.2"`, `"joint=0.1,…"`, or the name of a pose of the SRDF (`srdf`, or its own).
        name: of the argument, for messages.

    Raises:
        BadInput: another number of values, an unknown or missing joint, not finite.
    """
    if isinstance(given, str):
        word = given.strip()
        if not word or any(c in word for c in ",=") or _NUMBER.match(word):
            return _in_words(given, robot.joints, f"--{name}")
        try:
            return semantics(robot, srdf).pose(word, robot.joints)
        except BadInput as error:
            raise BadInput(f"--{name} {word}: {error}") from None
    try:
        q = np.array(in_order(given, robot.joints, f"--{name}"), dtype=float)
    except (TypeError, ValueError):
        raise BadInput(f"--{name}: {shown(given)} is not {robot.n} numbers [rad]") from None
    if q.shape != (robot.n,):
        hint = "; for several goals give eo.AnyOf([...])" if name == "goal" and q.ndim == 2 else ""
        found = f"{len(q)} numbers" if q.ndim == 1 else f"{shown(given)} is not a list of numbers"
        raise BadInput(f"--{name}: {found}; {robot.name} has {robot.n} joints: {', '.join(robot.joints)}{hint}")
    if not np.isfinite(q).all():
        raise BadInput(f"--{name}: expected finite joint positions [rad]")
    return q


def _in_words(text: str, joints: Sequence[str], flag: str) -> np.ndarray:
    """Joint positions (n,) from `0.1,0.2,…` or `name=value,…` in any order."""
    if ";" in text:
        raise BadInput(f"{flag} {text}: expected commas between the positions, and points in numbers; found ';'")
    if "=" in text:  # names may have spaces, values have none
        text = re.sub(r"(=[^\s,]+)\s+(?=[^\s,])", r"\1,", re.sub(r"\s*=\s*", "=", text.strip()))
        named: dict[str, float] = {}
        for part in text.removesuffix(",").split(","):
            name, _, value = part.partition("=")
            if name.strip() in named:
                raise BadInput(f"{flag}: joint {name.strip()} is given twice")
            known = name.strip() in joints
            named[name.strip()] = finite_number(value, f"{flag} {part}", "name=value") if known else 0.0
        return np.asarray(in_order(named, joints, flag))
    parts = words_of(text)
    if len(parts) != len(joints):
        raise BadInput(f"{flag}: {len(parts)} positions; the robot has {len(joints)} joints: {', '.join(joints)}")
    return np.array([finite_number(part, f"{flag} {text}", "numbers [rad, m]") for part in parts])


Asked = TypeVar("Asked", IdentifyRequest, DiagnoseRequest)


def robot_of_set(request: IdentifyRequest | DiagnoseRequest, folder: Path) -> Robot:
    """The robot that the set of a folder names, with the request's limits and locked joints."""
    limits = None if request.limits is None else Path(request.limits)
    return robot_of_log(read_log(folder, request.allow_outside), limits, request.locked)


def request_of_set(request: Asked, robot: Robot, **known: Any) -> Asked:
    """The request with its words resolved.

    Raises:
        BadInput: the seed is below 0.
    """
    if request.seed < 0:
        raise BadInput(f"--seed {request.seed}: expected 0 or more")
    if request.robot is not None:
        known |= as_loaded(robot, request.robot)
    return replace(request, payload=payload_document(request.payload), **known)
