"""The verb `identify`: overhead and copper loss from static poses, by the two methods of the source paper."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.load import load_cell
from energy_opt.errors import BadInput
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import carried, cell_of, request_of_set, robot_of, robot_of_set
from energy_opt.measured import read_set
from energy_opt.power import PowerModel
from energy_opt.power.drive_law import rigid_inputs
from energy_opt.requests.verbs import IdentifyRequest
from energy_opt.results import Found
from energy_opt.robot import PointMass, Robot
from energy_opt.static_poses.methods import Identification, poses_of
from energy_opt.static_poses.methods import identify as of_poses
from energy_opt.static_poses.suggest import Suggestion, suggest
from energy_opt.tables import read_table, write_table

POSES = "suggested_poses.csv"


@dataclass(frozen=True, repr=False, eq=False)
class Suggested(Found):
    """Static poses that determine the copper loss of the arm `robot` best: `found.poses` (K, n) [rad], `found.load`
    (K,), their |gravity torque|^2 [(N m)^2], and `found.width`, their expected accuracy.
    """

    robot: Robot
    found: Suggestion

    def document(self) -> dict[str, Any]:
        """Robot, joints, poses and their loads, as JSON has them."""
        found = {"poses": self.found.poses.tolist(), "load": self.found.load.tolist()}
        return {"robot": self.robot.name, "joints": list(self.robot.joints), **found}

    def guarded(self, out: Path) -> None:
        """Refuse a folder with other poses."""
        if (path := out / POSES).is_file():
            held, (header, columns) = read_table(path), self.table
            if list(held) != header or any(
                list(held[name]) != list(x) for name, x in zip(header, columns, strict=True)
            ):
                raise BadInput(f"{path} holds other poses; choose another --out, or overwrite it with --force")

    def kept(self, out: Path) -> Suggested:
        """Write suggested_poses.csv into the folder `out`."""
        write_table(out / POSES, *self.table)
        return self

    def text(self, out: Path) -> str:
        """A line for each pose [rad or m], with its |gravity torque|^2 [(N m)^2]."""
        names = [*self.robot.joints, "torque^2"]
        poses = ([f"{x:.4f}" for x in pose] for pose in zip(*self.table[1], strict=True))
        width = 2 + max(9, *map(len, names))
        return "\n".join("".join(word.rjust(width) for word in line) for line in (names, *poses))

    @property
    def table(self) -> tuple[list[str], list[np.ndarray]]:
        """Headers and columns of suggested_poses.csv."""
        header = [*(f"{joint}.position" for joint in self.robot.joints), "gravity_torque_squared"]
        return header, [*self.found.poses.T, self.found.load]

    def __repr__(self) -> str:
        return f"Suggested({self.robot.name!r}, {len(self.found.poses)} poses)"


def run(request: IdentifyRequest, desk: Desk) -> Identification | Suggested:
    """The source paper's two methods from the static poses of a set; or the poses that determine the losses best.

    Raises:
        BadInput: neither a set nor `suggest`, or a fault of the set.
    """
    if request.set is None and request.suggest is None:
        raise BadInput("identify needs a measured set (DIR), or --suggest N with --robot")
    if request.robot is None and request.set is None:
        raise BadInput("identify --suggest needs --robot, or a set whose log.toml names one")
    folder = Path(request.set or "")
    arm, mass = robot_of_set(request, folder) if request.robot is None else robot_of(request), None
    if request.payload is not None:
        values = carried(request.payload, arm).values
        mass = PointMass(float(values["mass"][0]), values["com"])
    if request.suggest is not None:
        return _suggest(request, request.suggest, arm, mass, desk)
    with desk.showing() as show:
        show.stage("reading", 0.0, 1.0)
        measured = read_set(folder, arm, allow_outside=request.allow_outside)
    for remark in measured.remarks:
        desk.say(f"note: {remark}")
    if mass is None and measured.payload is not None:
        mass = measured.payload
        desk.say(f"note: the arm carries {mass.mass:g} kg, as its recorder states")
    asked = request_of_set(request, measured.robot)
    document = desk.take(Identification.answer, asked)
    found = of_poses(measured.robot.name, poses_of(measured, mass, _gravity(request, measured.robot)))
    result = desk.keep(replace(found, request=document))
    desk.say(str(result) + ("" if desk.out is None else f"\nwritten: {desk.out}"))
    return result


def _gravity(request: IdentifyRequest, robot: Robot) -> np.ndarray | None:
    """Gravity (3,) [m/s^2] in the frame of the tilted base; None without --base."""
    if request.base is None:
        return None
    return rigid_inputs(PowerModel(robot.name, ()).standing(*request.base[3:5]), robot.body)[1]


def _suggest(request: IdentifyRequest, count: int, robot: Robot, mass: PointMass | None, desk: Desk) -> Suggested:
    """Static poses that determine a robot's losses best."""
    cell = load_cell(robot, cell_of(request))
    found = suggest(robot, count, request.seed, mass, None if cell is None else cell.free, _gravity(request, robot))
    answer = Suggested(robot, found)
    if desk.out is not None and not desk.force:
        answer.guarded(desk.out)
    desk.keep(answer)
    desk.say(
        f"{(desk.out or Path()) / POSES}: {count} poses, |gravity torque|^2 from {found.load.min():.4g} to "
        f"{found.load.max():.4g} (N m)^2; if the readings scatter by 1 W, the 95 % interval of r_over_kt2 is "
        f"+-{found.width:.3g} W/(N m)^2"
    )
    return answer


identify = verb(IdentifyRequest, run)
