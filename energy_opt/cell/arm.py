"""The arm's own bodies: the collision bodies of its description, on the joints that carry them, and which are near."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from energy_opt.cell import solids
from energy_opt.cell.bodies import Body
from energy_opt.cell.solids import Solid
from energy_opt.errors import BadInput
from energy_opt.robot import Robot
from energy_opt.robot.description import Collision, Description
from energy_opt.robot.held import placed
from energy_opt.robot.meshes import mesh_files

MOST_TRIANGLES = 1_000_000  # of a mesh, as in a scene


def arm_bodies(robot: Robot, package_dirs: Sequence[Path] = (), allow_large: bool = False) -> list[Body]:
    """Every collision body of the description, joints that are locked held where they are.

    Raises:
        BadInput: a mesh is missing, too large, or cannot be read; names the link.
    """
    description, frames = robot.description, robot.body.link_frames()
    files = mesh_files(description, package_dirs, allow_large)
    known: dict[tuple[object, ...], Solid] = {}
    out = []
    for link in description.links.values():
        joint, at = frames[link.name]
        for body in link.collisions:
            key = body.kind, body.size, body.file
            if key not in known:
                try:
                    known[key] = _solid(body, files, allow_large)
                except BadInput as error:
                    remedy = "; --self-collision off plans without the arm's body"
                    raise BadInput(f"{description.path}: link {link.name}: {error}{remedy}") from None
            out.append(Body(link.name, joint, at @ placed(body.pose), known[key]))
    return out


def _solid(body: Collision, files: dict[str, Path], allow_large: bool) -> Solid:
    if body.kind == "mesh":
        return solids.mesh_file(files[body.file], body.size, sys.maxsize if allow_large else MOST_TRIANGLES)
    if body.kind == "box":
        return solids.box(body.size)
    make: dict[str, Callable[..., Solid]] = {
        "sphere": solids.sphere, "cylinder": solids.cylinder, "capsule": solids.capsule,
    }  # fmt: skip
    return make[body.kind](*body.size)


def neighbours(description: Description, still: Collection[str] = ()) -> list[tuple[str, str]]:
    """Pairs of links with bodies that one moving joint connects, and nothing with a body between them.

    Fixed joints, those in `still` and links without bodies pass the connection on; a second moving joint does not.
    """
    near: dict[str, list[tuple[str, bool]]] = {name: [] for name in description.links}
    for name, joint in description.joints.items():
        moves = joint.kind != "fixed" and name not in still
        near[joint.parent].append((joint.child, moves))
        near[joint.child].append((joint.parent, moves))
    real = {name for name, link in description.links.items() if link.collisions}
    out = set()
    for start in sorted(real):
        edge, seen = [(start, 0)], {start}
        while edge:
            link, moving = edge.pop()
            for other, moves in near[link]:
                if other in seen or moving + moves > 1:
                    continue
                seen.add(other)
                if other not in real:
                    edge.append((other, moving + moves))
                elif moving + moves == 1:
                    out.add((min(start, other), max(start, other)))
    return sorted(out)
