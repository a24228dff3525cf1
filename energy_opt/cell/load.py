"""Loading of a cell from a request, and the inspection of a robot at rest, which `check` uses."""

from __future__ import annotations

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene
from energy_opt.cell.scene_files import read_scene
from energy_opt.errors import BadInput
from energy_opt.power.assumptions import default_assumptions, grouped
from energy_opt.power.known import name_hints
from energy_opt.robot import Robot, tool_of
from energy_opt.robot.kinematics import pose_of
from energy_opt.robot.limits import postures


def own_body(robot: Robot) -> Cell | None:
    """The arm's own body alone, for drawing without collision checks; None if its meshes are not found."""
    try:
        return Cell(robot, CellRequest())
    except BadInput:
        return None


def scene_of(request: CellRequest, robot: Robot | None = None) -> Scene | None:
    """The requested scene from its file, with the object that the request moves; None without a scene.

    Args:
        request: names the file. robot: in whose links' frames objects may be given; None: these stay as in the file.

    Raises:
        BadInput: the file cannot be read, or there is no such object, or no such frame.
    """
    if request.scene is None:
        return None
    outside, large = request.allow_outside, request.allow_large
    scene: Scene = read_scene(request.scene, floor=request.floor, allow_outside=outside, allow_large=large)
    if request.moved is not None:
        name, place = request.moved
        scene = scene.with_object_at(name, pose_of(place[:3], place[3:]))
    return scene if robot is None else scene.among(request.arms(robot))


def load_cell(robot: Robot, request: CellRequest) -> Cell | None:
    """A robot's body and cell; None if no collision check is requested.

    Raises:
        BadInput: a file or a mesh cannot be read, the tool or an object is attached to an unknown link, or an object
            is in the frame of one.
    """
    if not request.checks:
        tool_of(robot.body, request.tool)
        return None
    return Cell(robot, request, scene_of(request))


def inspected(robot: Robot, request: CellRequest) -> list[str]:
    """Remarks on bodies and masses, on the torque that holds the arm at a free posture, and on assumed values.

    Args:
        request: the options of body and cell; what they ask for is loaded and checked.

    Raises:
        BadInput: its meshes do not load, or none of many postures is free, or held within the effort limits; says
            which joint lacks how much.
    """
    cell = load_cell(robot, request)
    candidates = postures(robot.limits)
    torque = robot.body.torque(candidates, 0 * candidates, 0 * candidates)
    share = np.abs(torque) / robot.limits.effort
    held = np.flatnonzero((share <= 1).all(axis=1))
    if not len(held):
        k = int(np.argmin(share.max(axis=1)))
        j = int(np.argmax(share[k]))
        unit = robot.unit("effort", robot.joints[j])
        raise BadInput(
            f"{robot.urdf}: no posture of {len(candidates)} is held under gravity; in the lightest {robot.joints[j]} "
            f"needs {abs(torque[k, j]):.3g} {unit} of {robot.limits.effort[j]:g}: its masses or its "
            "effort limits are wrong; --limits with max_effort gives the real ones"
        )
    free = next((k for k in held.tolist() if cell is None or cell.touching(candidates[k]) is None), None)
    if free is None:
        assert cell is not None
        contact = cell.touching(candidates[held[0]])
        assert contact is not None
        raise BadInput(
            f"{robot.urdf}: the arm touches itself in all of {len(held)} postures: {contact}; {contact.remedy}"
        )
    grounds = grouped(row for row in default_assumptions(robot) if row.source in ("assumed", "published"))
    assumed = (f"{source}: {what} {value} ({note})" for what, value, source, note in grounds)
    held_at = _held(robot, candidates[free], torque[free])
    said = (*robot.warnings, *(cell.warnings if cell else ()), *name_hints(robot))
    return [_bodies(robot, cell), held_at, *said, *assumed]


def _bodies(robot: Robot, cell: Cell | None) -> str:
    """One line on joints, mass and collision bodies."""
    mass = sum(link.mass for link in robot.body.tree())
    kept = (
        "its body is not checked (--self-collision off)"
        if cell is None
        else f"{cell.links} collision bodies, {len(cell.bodies.pairs)} pairs kept apart"
    )
    locked = f", {len(robot.locked)} locked" if robot.locked else ""
    return f"{robot.n} joints{locked}; {mass:.4g} kg move; {kept}"


def _held(robot: Robot, posture: np.ndarray, torque: np.ndarray) -> str:
    """One line on the torque that holds the posture."""
    share = np.abs(torque) / robot.limits.effort
    j = int(np.argmax(share)) if share.any() else int(np.argmax(np.abs(torque)))
    unit, limit = robot.unit("effort", robot.joints[j]), robot.limits.effort[j]
    at, bound = ",".join(f"{x:.3g}" for x in posture), "it has no limit"
    if not torque.any():
        return f"gravity loads no joint at {at}"
    if np.isfinite(limit):
        bound = f"{100 * share[j]:.2g} % of its limit"
    return f"held under gravity at {at}: {robot.joints[j]} is loaded most, by {abs(torque[j]):.3g} {unit} ({bound})"
