"""A robot: its joints, limits and rigid body, and which of their values are assumed.

The rating of an arm's drives measures its size; friction and electrical values that are
not published are scaled by it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.arguments import expect
from energy_opt.errors import BadInput, shown, suggest
from energy_opt.files import path_of, write_text
from energy_opt.robot.catalog import CATALOG, DATA, urdf_of
from energy_opt.robot.checks import believed_efforts, check_masses, doubtful_masses, unused_values
from energy_opt.robot.description import BOUNDS, RATES, Description, read_description, urdf_text
from energy_opt.robot.kinematics import Link, other_ends
from energy_opt.robot.limits import (
    ASSUMED_VELOCITY,
    DOUBTFUL_VELOCITY,
    UNSCALED,
    Factors,
    Limits,
    overlay,
    postures,
    unit_of,
    with_assumptions,
)
from energy_opt.robot.meshes import mesh_files
from energy_opt.robot.mimic import followers, leaders_limits
from energy_opt.robot.rigid_body import RigidBody

POSES = 64  # postures for estimating the efforts of an arm without limits
ROOM = 1.5  # estimated effort over the largest torque to hold and accelerate; strongest joints have 0.9 to 3.3
ROUNDING = 1e-3  # [rad, m] a position may lie outside its limits by this much: it is typed by hand, or rounded
WEAKEST = 0.1  # least rating of a joint over that of the strongest one; a UR5e's wrist has 0.19, a Panda's 0.14


@dataclass(frozen=True, eq=False)
class Rating:
    """Speed and effort that the drives are rated for; always finite.

    Lower limits of a user do not change them: a slowed arm has the same motors.

    Attributes:
        velocity: (n,) [rad/s, m/s]. effort: (n,) [N m, N]. estimated: (n,) efforts that no file states and that are
            estimated from the arm's own weight. fingers: (n,) the joints of a gripper, which do not measure the arm.
    """

    velocity: np.ndarray
    effort: np.ndarray
    estimated: np.ndarray
    fingers: np.ndarray

    @property
    def power(self) -> float:
        """The sum of effort times speed of the arm's joints, W: no arm's drives give more."""
        return float((self.effort * self.velocity)[~self.fingers].sum())

    @property
    def strongest(self) -> float:
        """The largest effort [N m, N] of the arm's joints."""
        return float(self.effort[~self.fingers].max())


def rating_of(own: Limits, known: np.ndarray, held: Limits, body: RigidBody) -> Rating:
    """The rating from the arm's own limits and those in force.

    Args:
        own: as URDF and publications state them, assumptions filled in.
        known: (n,) the joints whose own velocity is stated.
        held: the limits in force; what the arm's own files do not state is taken from here.
    """
    velocity = np.where(known, np.maximum(own.velocity, held.velocity), held.velocity)
    velocity = np.where(velocity < DOUBTFUL_VELOCITY, velocity, ASSUMED_VELOCITY)  # no drive turns a joint so fast
    stated = [np.where(np.isfinite(limits.effort), limits.effort, 0.0) for limits in (own, held)]
    effort = np.maximum(*stated)
    missing = effort <= 0
    if missing.any():
        effort = np.where(missing, _estimated(body, held), effort)
        for slides in (False, True):  # newtons and newton metres are not comparable
            alike = np.array(body.slides) == slides
            if alike.any():
                effort[alike & missing] = np.maximum(effort, WEAKEST * effort[alike].max())[alike & missing]
    return Rating(velocity, effort, missing, np.array(body.fingers))


def _estimated(body: RigidBody, limits: Limits) -> np.ndarray:
    """Effort ratings (n,) [N m, N] for joints without an effort limit.

    ROOM times the largest torque in POSES seeded postures: what holds the joint, plus what accelerates it alone at its
    limit.
    """
    rng = np.random.default_rng(0)
    low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
    high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
    q = rng.uniform(np.minimum(low, high), np.maximum(low, high), (POSES, body.n))
    still = np.zeros_like(q)
    holding = body.torque(q, still, still)
    out = np.empty(body.n)
    for j in range(body.n):
        push = still.copy()
        push[:, j] = limits.acceleration[j]
        moved = body.torque(q, still, push)[:, j] - holding[:, j]
        out[j] = ROOM * (np.abs(holding[:, j]).max() + np.abs(moved).max())
    return out


@dataclass(frozen=True, repr=False, eq=False)
class Robot:
    """An arm that can be planned for.

    Attributes:
        name: its name in the catalogue, or the URDF file's stem.
        limits: after all overlays and assumptions.
        unlocked: the independent joints if only those are locked that are locked by default.
        warnings: one line for each limit or inertia that is missing, zero or a placeholder, with what is assumed.
        description: links, joints and collision bodies as they are in the file.
        rated: what its drives are rated for, which a user's lower limits do not change.
        sources: where each joint's "velocity", "acceleration", "jerk" and "effort" limit comes from: "urdf", "limits"
            (the user's file), "published" or "assumed".
        locked: joints that do not move, with their positions, including followers of such joints.
        given: the arguments `limits` and `lock` of `load_robot` that it was loaded with.
    """

    name: str
    limits: Limits
    body: RigidBody
    description: Description
    rated: Rating
    sources: Mapping[str, tuple[str, ...]]
    locked: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    unlocked: tuple[str, ...] = ()
    given: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {self.n} joints)"

    @property
    def urdf(self) -> Path:
        """The file that the robot was read from."""
        return self.description.path

    def named_in(self, folder: Path) -> str:
        """Name of the robot for a document in `folder`: its name in the catalogue, else a copy of its URDF there.

        The copy names its collision meshes by absolute paths.
        """
        entry = CATALOG.get(self.name)
        if entry is not None and self.urdf == urdf_of(entry):
            return self.name
        try:
            meshes = mesh_files(self.description)
        except BadInput:  # meshes are missing in the copy as in the original
            meshes = {}
        write_text(folder / self.urdf.name, urdf_text(self.description, meshes))
        return self.urdf.name

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that move by themselves, in the order of every vector."""
        return self.body.joints

    @property
    def movable(self) -> tuple[str, ...]:
        """Names of all joints that could move, followers and locked ones included, in the order of the description."""
        return tuple(name for name, joint in self.description.joints.items() if joint.kind != "fixed")

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

    @property
    def reach(self) -> float:
        """Distance [m] from the base that no joint's frame exceeds; travel without an end is left out."""
        lengths = [np.linalg.norm(link.placement[:3, 3]) for link in self.body.tree()]
        travel = np.maximum(np.abs(self.limits.lower), np.abs(self.limits.upper))[list(self.slides)]
        return float(sum(lengths) + travel[np.isfinite(travel)].sum())

    def unit(self, kind: str, joint: str | None = None) -> str:
        """Unit of a joint's "position", "velocity", "acceleration", "jerk" or "effort", or of power and the like."""
        return unit_of(kind, joint in self.joints and self.slides[self.joints.index(joint)])

    @property
    def n(self) -> int:
        """Number of joints that move by themselves."""
        return self.body.n


def load_robot(
    name_or_urdf: str | PathLike[str],
    *,
    limits: str | PathLike[str] | None = None,
    lock: Mapping[str, float] | None = None,
    prefix: str = "",
) -> Robot:
    """Load a robot by its name or by the path of a URDF file.

    `eo.robots()` lists the names. The robot's joints (n of them) are the order of every vector of positions.

    Args:
        name_or_urdf: "panda", for example, or a path.
        limits: a MoveIt joint_limits.yaml that overrides URDF and published limits.
        lock: joints that do not take part, with their positions [rad or m].
        prefix: text before the joints' names in the limits file.

    Raises:
        BadInput: unknown name, unreadable file, unknown joint, a joint locked outside its limits.
    """
    if not isinstance(name_or_urdf, (str, PathLike)):
        raise BadInput(f"--robot {shown(name_or_urdf)}: expected a name, the path of a URDF, or a Robot")
    expect(lock, Mapping | None, "--lock")
    name_or_urdf, limits = str(name_or_urdf), None if limits is None else path_of(limits, "--limits")
    entry = CATALOG.get(name_or_urdf)
    if entry is None:
        path = path_of(name_or_urdf, "--robot")
        if not path.is_file():
            if path.is_fifo():
                raise BadInput(f"{name_or_urdf}: a pipe, which is read only once; write the URDF into a file first")
            hint = suggest(name_or_urdf, CATALOG)
            raise BadInput(
                f"{name_or_urdf!r} is neither a URDF file nor the name of a robot ({', '.join(CATALOG)}){hint}"
            )
        name, published, usual = path.stem, None, {}
    else:
        path, name = urdf_of(entry), name_or_urdf
        published, usual = DATA / "limits" / f"{name}.yaml", dict(entry.lock)
    description = read_description(path)
    _check_lock(description, lock or {})
    body, locked = _body(description, {**usual, **(lock or {})})
    unlocked = _body(description, usual)[0].joints if lock else body.joints
    links = body.tree()
    merged = _stated(description, links)
    doubtful = check_masses(description, locked, links)
    end = links[body.last].name
    if ends := other_ends(links):
        doubtful.append(
            f"branches end at {', '.join((end, *ends))}: payload and default --tool are at {end}; "
            "--lock the joints of this branch to use another"
        )
    elif end != body.joints[-1]:
        gripper = ", ".join(joint for joint, finger in zip(body.joints, body.fingers, strict=True) if finger)
        why = f"before the fingers {gripper}" if gripper else "at the end of the longest chain"
        doubtful.append(f"payload and default --tool are at {end}, {why}")
    steps, factors, scaled = [merged], UNSCALED, []
    for file, before in ((published, ""), (limits, prefix)):
        warned: list[str] = []
        if file is not None and (file is limits or file.is_file()):
            merged, factors, warned = overlay(merged, [link.name for link in links], file, before, locked)
        steps.append(merged)
        scaled += warned
    led = leaders_limits(merged, links)[1]
    reduced = [leaders_limits(step, links)[0] for step in steps]
    known = [_completed(step, reduced[0].effort, body) for step in reduced[1:]]
    full, warnings = known[1]
    own = known[0][0]
    rated = rating_of(own, own.velocity == reduced[1].velocity, full, body)
    sources = _sources([*reduced, full], factors)
    held = full.scaled(factors, np.isinf(reduced[-1].jerk))
    if entry is None:  # what is known of the arms by name takes these values' place
        doubtful += unused_values(description, body.joints, held)
    given = ({} if limits is None else {"limits": str(limits)}) | ({"lock": dict(lock)} if lock else {})
    said = (*scaled, *led, *warnings, *doubtful)
    return Robot(name, held, body, description, rated, sources, locked, said, unlocked, given)


def _stated(description: Description, links: Sequence[Link]) -> Limits:
    """The limits of all joints as the URDF states them (0: not at all); continuous joints have none on position.

    Of acceleration and deceleration the smaller one counts; without them and without jerk, the limits are infinite.
    """
    stated = [[description.joints[link.name].bounds.get(bound, 0.0) for bound in (*BOUNDS, *RATES)] for link in links]
    lower, upper, velocity, effort, *rates = np.array(stated).T
    acceleration, deceleration, jerk = (np.where(rate > 0, rate, np.inf) for rate in rates)
    continuous, free = np.array([link.continuous for link in links]), np.full(len(links), np.inf)
    lower, upper = np.where(continuous, -free, lower), np.where(continuous, free, upper)
    return Limits(lower, upper, velocity, np.minimum(acceleration, deceleration), jerk, effort)


def _sources(steps: Sequence[Limits], factors: Factors) -> dict[str, tuple[str, ...]]:
    """Source of each joint's limits: the last of `steps` (URDF, published, the user's, assumed) that changes them.

    The user's `factors` change those that are not assumed.
    """
    out = {}
    for kind in ("velocity", "acceleration", "jerk", "effort"):
        values = [getattr(step, kind) for step in steps]
        names = np.full(len(values[0]), "urdf", dtype=object)
        for source, (before, after) in zip(("published", "limits", "assumed"), pairwise(values), strict=True):
            names[(before != after) | (source == "limits" and factors.get(kind, 1.0) != 1)] = source
        out[kind] = tuple(names.tolist())
    return out


def _check_lock(description: Description, lock: Mapping[str, float]) -> None:
    """Refuse positions of locked joints [rad or m] outside of the description's limits."""
    for name, value in lock.items():
        joint = description.joints.get(name)
        if joint is None or joint.kind == "continuous":  # unknown names are refused where the body is built
            continue
        low, high = joint.bounds.get("lower", 0.0), joint.bounds.get("upper", 0.0)
        if low < high and not low - ROUNDING <= value <= high + ROUNDING:
            unit = unit_of("position", joint.kind == "prismatic")
            raise BadInput(f"--lock {name}={value:g}: outside its limits [{low:g}, {high:g}] {unit}")


def _body(description: Description, lock: Mapping[str, float]) -> tuple[RigidBody, dict[str, float]]:
    """The rigid body of a description, and all joints of it that stay, with those that follow one of `lock`."""
    locked, following = followers(description, lock)
    return RigidBody.of(description, locked, following), locked


def _completed(limits: Limits, stated: np.ndarray, body: RigidBody) -> tuple[Limits, list[str]]:
    """Limits with assumptions for what is missing or a placeholder; `stated` (n,) are the URDF's efforts."""
    links, q = body.tree(), postures(limits)
    offsets = [float(np.linalg.norm(link.placement[:3, 3])) for link in links]
    reach, behind = sum(offsets), list[float]()
    for link, offset in zip(links, offsets, strict=True):
        behind.append(0.0 if link.parent < 0 else behind[link.parent] + offset)
    length = max(behind)
    mass = sum(link.mass for link in links)
    gravity = body.torque(q, np.zeros_like(q), np.zeros_like(q))
    holding = 9.81 * mass * max(reach, 1.0)
    given, kinds = limits.effort != stated, (body.slides, body.fingers)
    effort, said = believed_efforts(limits.effort, given, gravity, holding, body.joints, *kinds)
    completed, warnings = with_assumptions(limits.replace(effort=effort), body.joints, body.slides)
    travel = float(np.sum(np.ptp(q, axis=0)[np.asarray(body.slides)]))  # of a gantry, which has few offsets
    return completed, [*warnings, *said, *doubtful_masses(limits.effort, gravity, mass, reach + travel, length)]
