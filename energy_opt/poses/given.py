"""Poses in files and options: numbers, in an object's frame, by name, with freedom, or as MoveIt's PoseStamped.

"0.4,0,0.3,3.14,0,0"            six or seven numbers [m, rad], or a list of them, in the robot's base frame
"box_1: 0,0,0.12,3.14,0,0"      in the frame of an object of the scene; "world: ..." in the scene's own
"part"                          a name of `[poses]` or of the scene file's `poses`
"part.yaml"                     a geometry_msgs/PoseStamped; its frame_id names the base, the world or an object
{pose = ..., free = ["rz"], tolerance = "1mm,1deg"}
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.load import scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import WORLD, Scene, place_of
from energy_opt.errors import BadInput, suggest
from energy_opt.files import inside, read_yaml_documents
from energy_opt.poses.pose import FORM, Freedom, Pose, pose_error, pose_from
from energy_opt.robot import Robot, tool_of

KEYS = ("pose", "free", "tolerance", "frame")
SUFFIXES = (".yaml", ".yml", ".json")


class Given:
    """Reads poses.

    Args:
        folder: base folder of files; None for the working directory, and files anywhere.
        named: values of names: a `Pose`, or joint positions (n,).
    """

    def __init__(
        self, folder: Path | None = None, named: Mapping[str, Pose | np.ndarray] | None = None, outside: bool = False
    ) -> None:
        self._folder, self._named, self._outside = folder, dict(named or {}), outside

    def pose(
        self,
        value: object,
        name: str,
        free: Sequence[str] = (),
        tolerance: str | tuple[float, float] | None = None,
    ) -> Pose:
        """A pose from any form; `free` and `tolerance` replace those that it contains.

        Raises:
            BadInput: no pose, an unknown name, or a file without one.
        """
        frame = ""
        if isinstance(value, Mapping):
            unknown = next((key for key in value if key not in KEYS), None)
            if unknown is not None or "pose" not in value:
                known = ", ".join(KEYS)
                raise BadInput(
                    f"{name}: unknown key {unknown!r}; a pose has {known}" if unknown else f"{name}: no pose"
                )
            free = free or _words(value.get("free", ()), f"{name}: free")
            tolerance = tolerance or value.get("tolerance")
            frame, value = str(value.get("frame", "")), value["pose"]
        free = _words(free, f"{name}: free")
        if tolerance is not None and not isinstance(tolerance, (str, tuple)):
            raise BadInput(f'{name}: the tolerance is {tolerance!r}; expected such as "1mm,1deg"')
        if isinstance(value, str) and "," not in value:
            found = self._named.get(value)
            if isinstance(found, Pose):
                more = pose_from(np.eye(4), free, tolerance, name)
                found = replace(found, name=f"{name} ({value})", free=more.free or found.free)
                return found if tolerance is None else replace(found, tolerance=more.tolerance)
            if found is None and Path(value).suffix.lower() in SUFFIXES:
                return self._from_pose_stamped(value, name, free, tolerance)
            names = [key for key, pose in self._named.items() if isinstance(pose, Pose)]
            raise BadInput(f"{name}: no pose {value!r}{suggest(value, names)}; expected a name of poses, or {FORM}")
        if not isinstance(value, str):
            return pose_from(_numbers(value, name), free, tolerance, name, frame)
        before, colon, numbers = value.rpartition(":")
        frame = before.strip() if colon else frame
        return pose_from(numbers.strip(), free, tolerance, name, frame)

    def _from_pose_stamped(
        self, file: str, name: str, free: Sequence[str], tolerance: str | tuple[float, float] | None
    ) -> Pose:
        """A pose from a file of geometry_msgs/PoseStamped.

        Raises:
            BadInput: the file is no such message.
        """
        path = Path(file) if self._folder is None else inside(self._folder, file, self._outside)
        documents = read_yaml_documents(path)
        if len(documents) > 1:
            raise BadInput(f"{name}: {path} holds {len(documents)} documents; expected one PoseStamped")
        found: Any = documents[0] if documents else None
        header = found.get("header", {}) if isinstance(found, Mapping) else {}
        try:
            body = found.get("pose", found)
            place = [body["position"][k] for k in "xyz"]
            turn = [body["orientation"][k] for k in "xyzw"]
            frame = str(header.get("frame_id") or "").removeprefix("/")
        except (AttributeError, KeyError, TypeError):
            raise BadInput(f"{name}: {path}: expected a PoseStamped with pose: position and orientation") from None
        return pose_from(_numbers([*place, *turn], f"{name}: {path}"), free, tolerance, name, frame)


def _words(value: Any, name: str) -> tuple[str, ...]:
    words = (value,) if isinstance(value, str) else tuple(value) if isinstance(value, (list, tuple)) else None
    if words is None or not all(isinstance(word, str) for word in words):
        raise BadInput(f'{name} = {value!r}; expected axes such as ["rz"]')
    return words


def _numbers(value: object, name: str) -> np.ndarray:
    """Only numbers: text and truth values are rejected."""
    if isinstance(value, np.ndarray):
        return value
    given = list(value) if isinstance(value, (list, tuple)) else [value]
    numbers = [x for each in given for x in (each if isinstance(each, (list, tuple, np.ndarray)) else [each])]
    if not all(isinstance(x, Real) and not isinstance(x, bool) for x in numbers):
        raise BadInput(f"{name} = {value!r:.60}; expected {FORM}")
    try:
        return np.array(given, dtype=float)
    except ValueError:  # lists of different lengths
        raise BadInput(f"{name} = {value!r:.60}; expected {FORM}") from None


def poses_of_scene(scene: Scene | None) -> dict[str, Pose]:
    """The poses that a scene file names, in the scene's frame unless they name another.

    Raises:
        BadInput: one of them is not a pose.
    """
    if scene is None:
        return {}
    reader, out = Given(), {}
    for name, value in scene.poses.items():
        pose = reader.pose(value, f"{scene.source}: poses: {name}")
        out[name] = pose if pose.frame else replace(pose, frame=WORLD[0])
    return out


def poses_of_request(request: CellRequest) -> dict[str, Pose]:
    """The poses named in the requested scene's file."""
    return poses_of_scene(scene_of(request))


def in_base(pose: Pose, robot: Robot, scene: Scene | None, base: np.ndarray) -> Pose:
    """A pose in the frame of the robot's base.

    Args:
        scene: the scene of the objects, in its own frame (`Scene.among`); None without one.
        base: (4, 4) pose of the robot's base in the scene's frame.

    Raises:
        BadInput: its frame is unknown, or moves with the arm.
    """
    if not pose.frame:
        return pose
    objects = () if scene is None else scene.objects
    place = place_of(pose.frame, pose.name, [(robot.body.link_frames(), base)], objects)
    return replace(pose, matrix=np.linalg.solve(base, place @ pose.matrix), frame="")


def ends_from_text(text: str) -> Ends:
    """The ends from the text of `Ends.to_text`."""

    def read(end: Any) -> Any:
        if end is None or isinstance(end, list):
            return None if end is None else np.array(end, dtype=float)
        pose = end["pose"]
        free = tuple(Freedom(axis, low, high) for axis, low, high in pose["free"])
        return Pose(np.array(pose["matrix"]), free, tuple(pose["tolerance"]), end["name"])

    found = json.loads(text)
    return Ends(read(found["start"]), tuple(map(read, found["goals"])), tuple(map(read, found["via"])))


@dataclass(frozen=True)
class Ends:
    """A start pose, if any, and alternative goals: poses of the tool or joint positions (n,).

    Attributes:
        via: poses that the tool passes on its way, in order.
    """

    start: Pose | None
    goals: tuple[Pose | np.ndarray, ...]
    via: tuple[Pose, ...] = ()

    def to_text(self) -> str:
        """As JSON; poses must be in the base frame."""

        def said(end: Pose | np.ndarray | None) -> object:
            if end is None:
                return None
            return {"pose": end.document(), "name": end.name} if isinstance(end, Pose) else end.tolist()

        return json.dumps({"start": said(self.start), "goals": [*map(said, self.goals)], "via": [*map(said, self.via)]})

    def in_base(self, robot: Robot, asked: CellRequest) -> Ends:
        """The same ends with every pose in the frame of the robot's base, whichever frame of the scene it was given
        in.
        """
        given = [each for each in (self.start, *self.goals, *self.via) if isinstance(each, Pose)]
        scene = scene_of(asked, robot) if any(pose.frame for pose in given) else None
        return self.changed(lambda pose: in_base(pose, robot, scene, asked.base_pose))

    def changed(self, change: Callable[[Pose], Any]) -> Ends:
        """The same ends with every pose changed; positions stay."""

        def new(each: Any) -> Any:
            return change(each) if isinstance(each, Pose) else each

        return Ends(new(self.start), tuple(map(new, self.goals)), tuple(map(new, self.via)))

    @property
    def poses(self) -> dict[str, Pose]:
        """The poses at which a trajectory begins and that it passes."""
        out = {} if self.start is None else {"start": self.start}
        return out | {f"via {k}": pose for k, pose in enumerate(self.via, start=1)}


def pose_document(
    robot: Robot, tool_words: str | None, poses: Mapping[str, Pose], positions: Mapping[str, np.ndarray]
) -> dict[str, Any]:
    """Errors of positions from their poses, recomputed with Pinocchio: distance [m], angle [rad], and if both are
    within the tolerance (`valid`).

    Args:
        tool_words: the tool, as in the settings. poses, positions: by the name of an end or via point, (n,) [rad, m].
    """
    tool = tool_of(robot.body, tool_words)
    out: dict[str, Any] = {}
    for end, pose in poses.items():
        q = positions[end][None]
        still = np.zeros_like(q)
        at, _, _ = robot.body.frame_motion(tool.joint, np.array(tool.pose), q, still, still)
        shift, turn = np.split(pose_error(pose, at[:, :3, :3], at[:, :3, 3])[0], 2)
        distance, angle = float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
        inside = distance <= pose.tolerance[0] and angle <= pose.tolerance[1]
        out[end] = {"distance": distance, "angle": angle, "valid": inside}
    return out
