"""A tool: a frame that moves with one of an arm's links: the last joint's, a flange, a point on a gripper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.robot.kinematics import no_degrees, pose_of
from energy_opt.robot.rigid_body import RigidBody

FARTHEST = 5.0  # [m] largest offset of a tool's origin: the longest lances have half of it


@dataclass(frozen=True)
class Tool:
    """A frame fixed to a link.

    Attributes:
        name: of the frame it is on.
        joint: index, among all of the tree, of the joint that carries it.
        pose: (4, 4) as nested tuples, in that joint's frame.
    """

    name: str
    joint: int
    pose: tuple[tuple[float, ...], ...]

    def __str__(self) -> str:
        return f"tool frame {self.name}"


def tool_of(body: RigidBody, words: str | None = None) -> Tool:
    """The tool from FRAME[,X,Y,Z[,R,P,Y]]: frame of a joint or link, and origin [m] and rotation [rad] in it.

    The last joint's frame by default.

    Raises:
        BadInput: unknown frame, a frame that does not move, or numbers that are none.
    """
    links = body.tree()
    name, *offset = (links[body.last].name if words is None else words).split(",")
    frames = {**body.link_frames(), **{link.name: (k, np.eye(4)) for k, link in enumerate(links)}}
    if name not in frames:
        raise BadInput(f"--tool {words}: no frame {name!r}; frames are {', '.join(frames)}")
    joint, pose = frames[name]
    if joint < 0:
        raise BadInput(f"--tool {words}: {name} does not move with any joint")
    try:
        place = [float(x) for x in offset]
    except ValueError:
        place = [np.nan]
    if len(place) not in (0, 3, 6) or not np.isfinite(place).all():
        raise BadInput(f"--tool {words}: expected FRAME or FRAME,X,Y,Z[,R,P,Y] with the tool's pose there [m, rad]")
    far = max(map(abs, place[:3]), default=0.0)
    if far > FARTHEST:
        meant = f"are these millimetres? {far / 1000:g} m then"
        raise BadInput(f"--tool {words}: its origin is {far:g} m from {name}; expected metres ({meant})")
    pose = pose.copy()
    if place:
        pose[:3, 3] += pose[:3, :3] @ place[:3]
    if len(place) == 6:
        no_degrees(f"--tool {words}", place[3:])
        pose = pose @ pose_of((0.0, 0.0, 0.0), place[3:])
    return Tool(name, joint, tuple(tuple(float(x) for x in row) for row in pose))
