"""A description written back as a URDF that every reader understands alike: plain numbers, nothing optional."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

from energy_opt.robot.description import BOUNDS, MOMENTS, MOVING, SIZES, Collision, Description, LinkPart, Pose


def plain_urdf(description: Description, meshes: Mapping[str, Path] | None = None, mark: str = "") -> str:
    """The text of a URDF.

    Args:
        meshes: where the file of each mesh lies, if that is known; None leaves collision bodies out.
        mark: put before the names of links, so that none of them is a joint's.
    """
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(description.path.stem)}>"]
    for link in description.links.values():
        lines += _link(link, meshes, mark)
    for name, joint in description.joints.items():
        lines += [
            f'<joint name={quoteattr(name)} type="{joint.kind}">{_pose(joint.pose)}',
            f"<parent link={quoteattr(mark + joint.parent)}/><child link={quoteattr(mark + joint.child)}/>",
        ]
        if joint.kind in MOVING:
            length = sum(x * x for x in joint.axis) ** 0.5
            bounds = " ".join(f'{bound}="{joint.bounds.get(bound, 0.0)!r}"' for bound in BOUNDS)
            lines.append(f'<axis xyz="{_words(x / length for x in joint.axis)}"/><limit {bounds}/>')
        if joint.mimic is not None and meshes is not None:
            leader, ratio, offset = joint.mimic
            lines.append(f'<mimic joint={quoteattr(leader)} multiplier="{ratio!r}" offset="{offset!r}"/>')
        lines.append("</joint>")
    return "\n".join([*lines, "</robot>"])


def _link(link: LinkPart, meshes: Mapping[str, Path] | None, mark: str) -> Iterator[str]:
    yield f"<link name={quoteattr(mark + link.name)}>"
    if link.inertial is not None:
        moments = zip(MOMENTS, link.inertial.moments, strict=True)
        inertia = " ".join(f'{name}="{value!r}"' for name, value in moments)
        mass = f'<mass value="{link.inertial.mass!r}"/>'
        yield f"<inertial>{_pose(link.inertial.pose)}{mass}<inertia {inertia}/></inertial>"
    for body in [] if meshes is None else link.collisions:
        yield f"<collision>{_pose(body.pose)}<geometry>{_shape(body, meshes or {})}</geometry></collision>"
    yield "</link>"


def _shape(body: Collision, meshes: Mapping[str, Path]) -> str:
    if body.kind == "mesh":
        return f'<mesh filename={quoteattr(str(meshes.get(body.file, body.file)))} scale="{_words(body.size)}"/>'
    if body.kind == "box":
        return f'<box size="{_words(body.size)}"/>'
    sizes = zip(SIZES[body.kind], body.size, strict=True)
    return f"<{body.kind} " + " ".join(f'{name}="{value!r}"' for name, value in sizes) + "/>"


def _pose(pose: Pose) -> str:
    return f'<origin xyz="{_words(pose.xyz)}" rpy="{_words(pose.rpy)}"/>'


def _words(values: Iterator[float] | tuple[float, ...]) -> str:
    return " ".join(map(repr, values))
