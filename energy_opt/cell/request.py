"""The user's options for the arm's body and its cell; plain and hashable, for worker processes."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from energy_opt.cell.scene import FARTHEST, Arms
from energy_opt.errors import BadInput
from energy_opt.robot import Robot
from energy_opt.robot.kinematics import no_degrees, pose_of

PlannerName = Literal["auto", "none", "ompl"]
PLANNERS: tuple[PlannerName, ...] = get_args(PlannerName)
CLEARANCE = 0.002  # [m] default clearance; a pair that is nearer at an end keeps half of its distance there
WIDEST = 100.0  # [m] largest edge of a payload: larger ones are in another unit


@dataclass(frozen=True)
class CellRequest:
    """Body and cell as the options say.

    Attributes:
        self_collision: whether the arm's own body is kept clear of itself.
        srdf: the file of disabled pairs; None for the one beside a known robot, if any.
        scene: the file of the scene, or a `Scene` that was read from one; None without one.
        base: x, y, z [m], roll, pitch, yaw [rad] of the robot's base in the scene's frame.
        floor: everything below this height of the scene's frame is solid [m].
        clearance: required clearance [m]; None for `CLEARANCE`, or half of an end's clearance if that is less.
        planner: source of the first path if the straight line is not free.
        package_dirs: folders in which `package://` of a URDF is looked for.
        allow_outside, allow_large: files outside of the scene's folder, and larger than usual (meshes of the arm
            too), are read.
        payload_size: edges [m] of the payload's box; None for a point.
        payload_at: the centre of that box [m], in the last joint's frame.
        moved: an object of the scene, and x, y, z [m], roll, pitch, yaw [rad] of its frame in place of the file's.
        tool: FRAME[,X,Y,Z], the frame of the bodies that the tool holds; None for the last joint's frame.
        beside: other arms of the cell: name, robot and base, as `base`; their links that do not move are obstacles.
    """

    self_collision: bool = True
    srdf: Path | None = None
    scene: Path | None = None
    base: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    floor: float | None = None
    clearance: float | None = None
    planner: PlannerName = "auto"
    package_dirs: tuple[Path, ...] = ()
    allow_outside: bool = False
    allow_large: bool = False
    payload_size: tuple[float, ...] | None = None
    payload_at: tuple[float, ...] = (0.0, 0.0, 0.0)
    tool: str | None = None
    moved: tuple[str, tuple[float, ...]] | None = None
    beside: tuple[tuple[str, Robot, tuple[float, ...]], ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        if self.planner not in PLANNERS:
            raise BadInput(f"--planner {self.planner!r}; expected {', '.join(PLANNERS)}")
        base = f"--base {','.join(f'{x:g}' for x in self.base)}"
        if len(self.base) != 6 or not np.isfinite(self.base).all():
            raise BadInput(f"{base}: expected X,Y,Z [m] and R,P,Y [rad]")
        if (far := np.abs(self.base[:3]).max()) > FARTHEST:
            raise BadInput(f"{base}: {far:g} m is too far; expected X,Y,Z in metres, at most {FARTHEST:g}")
        no_degrees(base, self.base[3:])
        if self.floor is not None and not abs(self.floor) <= FARTHEST:
            raise BadInput(f"--floor {self.floor:g}: not a height; expected metres, at most {FARTHEST:g}")
        if self.clearance is not None and not 0 < self.clearance <= 1:
            raise BadInput(f"--clearance {self.clearance:g}; expected metres above 0, at most 1")
        size = self.payload_size
        if size is not None and not (len(size) == 3 and all(0 < edge <= WIDEST for edge in size)):
            edges = ",".join(f"{x:g}" for x in size)
            raise BadInput(f"--payload-size {edges}; expected three edges [m] above 0, at most {WIDEST:g}")

    @property
    def checks(self) -> bool:
        """True if any collision check is requested."""
        return self.self_collision or self.scene is not None or self.floor is not None

    def document(self) -> dict[str, object]:
        """The values that differ from the defaults, for a result's request."""
        usual = CellRequest()
        return {
            f.name: str(value) if isinstance(value, Path) else [str(v) if isinstance(v, Path) else v for v in value]
            if isinstance(value, tuple) else value
            for f in fields(self)
            if (value := getattr(self, f.name)) != getattr(usual, f.name) and f.compare
        }  # fmt: skip

    @property
    def base_pose(self) -> np.ndarray:
        """(4, 4) pose of the robot's base in the scene's frame; its angles as in URDF (about fixed x, y, z)."""
        return pose_of(self.base[:3], self.base[3:])

    def arms(self, robot: Robot) -> Arms:
        """The links and the base of the robot, and of the arms beside it."""
        others = ((arm.body.link_frames(), pose_of(base[:3], base[3:])) for _, arm, base in self.beside)
        return [(robot.body.link_frames(), self.base_pose), *others]
