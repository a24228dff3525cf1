"""From what was asked for to the cell itself."""

from __future__ import annotations

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene
from energy_opt.cell.scene_files import read_scene
from energy_opt.errors import BadInput
from energy_opt.robot import Robot
from energy_opt.robot.links import pose_of
from energy_opt.robot.tool import tool_of


def own_body(robot: Robot) -> Cell | None:
    """The arm's own body alone, to be drawn where nothing is kept clear of; None where its meshes are not found."""
    try:
        return Cell(robot, CellRequest())
    except BadInput:
        return None


def scene_of(request: CellRequest) -> Scene | None:
    """The requested scene: as its file has it, but for an object that the request moves; None where none is asked for.

    Raises:
        BadInput: the file cannot be read, or there is no such object.
    """
    if request.scene is None:
        return None
    outside, large = request.allow_outside, request.allow_large
    scene = read_scene(request.scene, floor=request.floor, allow_outside=outside, allow_large=large)
    if request.moved is None:
        return scene
    name, place = request.moved
    return scene.with_object_at(name, pose_of(place[:3], place[3:]))


def load_cell(robot: Robot, request: CellRequest) -> Cell | None:
    """A robot's body and cell; None where nothing is asked to be kept clear of.

    Raises:
        BadInput: a file or a mesh cannot be read, or the tool or an object hangs on a link that there is not.
    """
    if not request.checks:
        tool_of(robot.body, request.tool)
        return None
    return Cell(robot, request, scene_of(request))
