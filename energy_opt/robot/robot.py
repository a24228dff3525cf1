"""A robot: its joints, limits and rigid body, and what had to be assumed about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

import numpy as np

from energy_opt.errors import BadInput, near
from energy_opt.files import inside, read_text, write_text
from energy_opt.robot.catalog import CATALOG, published_limits, urdf_of
from energy_opt.robot.limits import Limits, with_assumptions
from energy_opt.robot.limits_file import overlay
from energy_opt.robot.links import Link
from energy_opt.robot.meshes import collision_urdf
from energy_opt.robot.mimic import followers, leaders_limits
from energy_opt.robot.rigid_body import RigidBody
from energy_opt.robot.units import unit_of


@dataclass(frozen=True, repr=False)
class Robot:
    """An arm that can be planned for.

    Attributes:
        name: its name in the catalogue, or the URDF file's stem.
        limits: after all overlays and assumptions.
        unlocked: the joints that would move by themselves if none were locked that is not locked by default.
        warnings: one line for each limit or inertia that is missing, zero or a placeholder, with what is assumed.
        urdf: the file it was read from.
        locked: joints that stay where they are, with their positions; those that follow one of them too.
    """

    name: str
    limits: Limits
    body: RigidBody
    urdf: Path
    locked: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    unlocked: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {self.n} joints)"

    def named_in(self, folder: Path) -> str:
        """What a document in `folder` names it by: its name in the catalogue, else a copy of its URDF there.

        The copy names its collision meshes by absolute paths.
        """
        entry = CATALOG.get(self.name)
        if entry is not None and self.urdf == urdf_of(entry):
            return self.name
        try:
            text = collision_urdf(self.urdf).text
        except BadInput:  # meshes are missing: here as there
            text = read_text(self.urdf)
        write_text(folder / self.urdf.name, text)
        return self.urdf.name

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that move by themselves, in the order of every vector."""
        return self.body.joints

    @property
    def followers(self) -> dict[str, tuple[str, float, float]]:
        """Joints that follow others: the one that leads, ratio, and offset [rad, m] of each."""
        links = self.body.tree()
        laws = {link.name: link.follows for link in links if link.follows is not None}
        return {name: (links[law.leader].name, law.ratio, law.offset) for name, law in laws.items()}

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint's position: "rad", or "m" where it slides."""
        return tuple(unit_of("position", slides) for slides in self.slides)

    @property
    def slides(self) -> tuple[bool, ...]:
        """The joints that slide, whose units are m and N."""
        return self.body.slides

    def unit(self, kind: str, joint: str | None = None) -> str:
        """Unit of a joint's "position", "velocity", "acceleration", "jerk" or "effort", or of power and the like."""
        return unit_of(kind, joint in self.joints and self.slides[self.joints.index(joint)])

    @property
    def n(self) -> int:
        """Number of joints that move by themselves."""
        return self.body.n


def robot_named(name: str, folder: Path, allow_outside: bool = False) -> str:
    """What a document in `folder` means by a robot's name: one of the catalogue, or the path of a URDF.

    Raises:
        BadInput: a URDF outside of the folder, which has to be allowed.
    """
    if not name or name in CATALOG:
        return name
    path = inside(folder, name, allow_outside)
    return name if allow_outside and not path.is_file() else str(path)


def load_robot(
    name_or_urdf: str | PathLike[str],
    *,
    limits: str | PathLike[str] | None = None,
    lock: Mapping[str, float] | None = None,
    prefix: str = "",
) -> Robot:
    """A robot by name (`known_robots()`) or by the path of a URDF file.

    Args:
        limits: a MoveIt joint_limits.yaml that overrides URDF and published limits.
        lock: joints that do not take part, with their positions [rad or m].
        prefix: what stands before the joints' names in the limits file.

    Raises:
        BadInput: unknown name, unreadable file, unknown joint.
    """
    name_or_urdf, limits = str(name_or_urdf), None if limits is None else Path(limits)
    entry = CATALOG.get(name_or_urdf)
    if entry is None:
        path = Path(name_or_urdf)
        if not path.is_file():
            hint = near(name_or_urdf, CATALOG)
            raise BadInput(f"{name_or_urdf!r} is neither a URDF file nor a robot by name{hint}: {', '.join(CATALOG)}")
        name, published, usual = path.stem, None, {}
    else:
        path, name = urdf_of(entry), name_or_urdf
        published, usual = published_limits(name), dict(entry.lock)
    body, locked = _body(path, {**usual, **(lock or {})})
    unlocked = _body(path, usual)[0].joints if lock else body.joints
    links, stated = body.tree(), body.urdf_limits()
    free = np.full(len(links), np.inf)
    merged = Limits(stated.lower, stated.upper, stated.velocity, free, free.copy(), stated.effort)
    scaled: list[str] = []
    for file, before in ((published, ""), (limits, prefix)):
        if file is not None:
            merged, said = overlay(merged, [link.name for link in links], file, before, locked)
            scaled += said
    merged, led = leaders_limits(merged, links)
    merged, warnings = with_assumptions(merged, body.joints, _holding(links), body.slides)
    return Robot(name, merged, body, path, locked, (*scaled, *led, *warnings, *_doubtful_inertias(links)), unlocked)


def _body(path: Path, lock: Mapping[str, float]) -> tuple[RigidBody, dict[str, float]]:
    """The rigid body of a URDF, and all joints of it that stay, with those that follow one of `lock`."""
    locked, following = followers(path, lock) if path.is_file() else (dict(lock), {})
    return RigidBody.from_urdf(path, locked, following), locked


def _holding(links: Sequence[Link]) -> float:
    """Weight of the moving links times their summed reach (1 m at least), N m."""
    reach = sum(float(np.linalg.norm(link.placement[:3, 3])) for link in links)
    return 9.81 * sum(link.mass for link in links) * max(reach, 1.0)


def _doubtful_inertias(links: Sequence[Link]) -> list[str]:
    """A warning for every link whose mass or inertia cannot be that of a real part; the values are used as they are."""
    out = []
    for k, link in enumerate(links):
        if link.mass <= 1e-6:
            if not any(child.parent == k for child in links):
                out.append(f"{link.name}: its link has no mass; assumed: massless")
            continue
        moments = np.linalg.eigvalsh(link.inertia)
        size = max(0.125, float(np.linalg.norm(link.lever)), _reach(links, k, 2))
        gyration = float(np.sqrt(max(moments[-1], 0.0) / link.mass))
        if moments[0] < -1e-9 or moments[0] + moments[1] < moments[2] * (1 - 1e-3) - 1e-9:
            out.append(f"{link.name}: its link's inertia is not that of any body; used as it is")
        elif gyration > 2 * size:
            out.append(
                f"{link.name}: radius of gyration {gyration:.2g} m of a link {size:.2g} m long is implausible "
                "(a placeholder inertia?); used as it is"
            )
        elif moments[-1] <= 0:
            out.append(f"{link.name}: its link has mass but no inertia; assumed: a point mass")
    return out


def _reach(links: Sequence[Link], k: int, depth: int) -> float:
    """Summed offsets of the next `depth` joints after link k, m: how far the link may extend."""
    children = [c for c, other in enumerate(links) if other.parent == k]
    if depth == 0 or not children:
        return 0.0
    return max(float(np.linalg.norm(links[c].placement[:3, 3])) + _reach(links, c, depth - 1) for c in children)
