"""Start and goal of a move, if they are not single positions; and the errors of chosen positions at their poses."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt.cell.load import scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.poses.given import in_base
from energy_opt.poses.pose import Freedom, Pose, pose_error
from energy_opt.robot import Robot
from energy_opt.robot.tool import tool_of


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
        scene = scene_of(asked) if any(pose.frame for pose in given) else None

        return self.changed(lambda pose: in_base(pose, robot, scene, asked.base_pose))

    def changed(self, change: Callable[[Pose], Any]) -> Ends:
        """The same ends with every pose changed; positions stay."""

        def new(each: Any) -> Any:
            return change(each) if isinstance(each, Pose) else each

        return Ends(new(self.start), tuple(map(new, self.goals)), tuple(map(new, self.via)))

    @property
    def poses(self) -> dict[str, Pose]:
        """The poses against which the ends of a trajectory are judged."""
        out = {} if self.start is None else {"start": self.start}
        if len(self.goals) == 1 and isinstance(self.goals[0], Pose):
            out["goal"] = self.goals[0]
        return out | {f"via {k}": pose for k, pose in enumerate(self.via, start=1)}


def pose_document(
    robot: Robot, tool_words: str | None, poses: Mapping[str, Pose], positions: Mapping[str, np.ndarray]
) -> dict[str, Any]:
    """Errors of positions (n,) from their poses, recomputed with Pinocchio: distance [m] and angle [rad]."""
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
