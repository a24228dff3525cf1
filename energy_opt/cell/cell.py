"""The arm's body and its cell. A `Cell` is built once and then used for many checks of poses and motions.

Poses are checked by measuring distances, motions by a proof for every instant (`proof`). A pair of bodies that is
nearer at an end of a move than the clearance asked for keeps half of its distance there; ends that are chosen keep all
of it if any can (`poses.distance`).
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.cell.bodies import Bodies, Body, Scenery, arm_bodies
from energy_opt.cell.curve import MotionCurve
from energy_opt.cell.nearest import nearest
from energy_opt.cell.pairs import POSES, Kept, OwnPairs, kept_apart, kept_of, neighbours, own_pairs
from energy_opt.cell.proof import Proof, Touch, one_inside_the_other, overlap, prove
from energy_opt.cell.request import CLEARANCE, CellRequest
from energy_opt.cell.scene import FLOOR, TOOL, Scene, out_of_scale, unknown_names
from energy_opt.cell.solids import GJK_ERROR, Solid, mesh, primitive
from energy_opt.cell.words import clearance_words, length
from energy_opt.errors import BadInput
from energy_opt.robot import Robot, tool_of
from energy_opt.robot.checks import few
from energy_opt.robot.kinematics import Kinematics, pose_of
from energy_opt.robot.srdf import semantics

PAYLOAD = "payload"
# instants at which a given motion's distances are measured; up to this multiple of the asked clearance
ALONG, NEARLY = 300, 1.2
UNCERTAIN = 1.1 * GJK_ERROR  # [m] an end that is farther than the clearance by less cannot be proven to keep it
TOUCHING = 2.5 * GJK_ERROR  # [m] an end with a smaller distance counts as touching, given the solver's error
REMEMBERED = 8  # most proofs that a cell remembers


@dataclass(frozen=True)
class Clearance:
    """The distance of a motion from all bodies that it must not touch.

    Attributes:
        verdict: "proven", "colliding" or "undecided".
        lower_bound: [m] every pair keeps more than this at every instant; None unless proven.
        min_distance: [m] the smallest measured distance (negative: overlap), of `pair` at `time` [s].
        depth: [m] how deep they overlap, infinite if one is inside the other's surface; None unless colliding.
        pairs: number of pairs that were kept apart.
        disabled_pairs: pairs of links that may touch; source: where these come from.
        touches: where the clearance is broken, the deepest first; coarse.
    """

    verdict: str
    lower_bound: float | None = field(default=None, kw_only=True)
    min_distance: float | None = field(default=None, kw_only=True)
    pair: tuple[str, str] | None = field(default=None, kw_only=True)
    time: float | None = field(default=None, kw_only=True)
    depth: float | None = field(default=None, kw_only=True)
    pairs: int
    disabled_pairs: tuple[tuple[str, str], ...]
    source: str
    touches: tuple[Touch, ...] = field(default=(), repr=False)

    @property
    def proven(self) -> bool:
        """True if it is proven that nothing is touched."""
        return self.verdict == "proven"

    def __str__(self) -> str:
        return clearance_words(self.document())

    def document(self) -> dict[str, object]:
        """As it is in result.json."""
        out = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("touches", "depth")}
        if self.depth is not None:
            out["depth"] = self.depth if np.isfinite(self.depth) else None
        pairs = [list(pair) for pair in self.disabled_pairs]
        return {**out, "pair": None if self.pair is None else list(self.pair), "disabled_pairs": pairs}


@dataclass(frozen=True)
class Contact:
    """Two bodies that are too near at one pose.

    Attributes:
        pair: their names. distance: [m], 0 or less if they touch. depth: [m] how deep they overlap, infinite if one is
            inside the other's surface. own: whether both are the arm's. listed: whether a scene file can say that they
            may touch.
    """

    pair: tuple[str, str]
    distance: float
    depth: float
    own: bool = False
    listed: bool = False

    @property
    def remedy(self) -> str:
        """Advice on a pose that would work."""
        by_design = "; if these links may touch, list them with --srdf FILE, or use --self-collision off"
        in_scene = (
            f"; if these may touch, the scene file lists them: `allow: [[{', '.join(self.pair)}]]`, or `touch_links`"
        )
        return f"choose a pose without contact{by_design if self.own else in_scene if self.listed else ''}"

    def __str__(self) -> str:
        a, b = self.pair
        if self.distance <= TOUCHING:
            return f"{a} touches {b} ({f'{length(self.depth)} deep' if np.isfinite(self.depth) else 'inside'})"
        return f"{a} is {length(self.distance)} from {b}"


class Cell:
    """A robot's body among the bodies around it.

    Args:
        robot: the arm. request: the options. scene: the arm's surroundings; None: only the request's floor.

    Raises:
        BadInput: a mesh cannot be read, or the tool or an object is attached to a link that does not exist, or an
            object is in the frame of one, or has the name of a link with a body.
    """

    def __init__(self, robot: Robot, request: CellRequest, scene: Scene | None = None) -> None:
        self.robot, self.request = robot, request
        arms = request.arms(robot)
        self.scene = None if scene is None else scene.among(arms)
        self.asked = CLEARANCE if request.clearance is None else request.clearance
        self._proofs: dict[bytes, Clearance] = {}  # recent proofs: a search and the judge ask for the same motions
        kinematics = Kinematics(robot.body.tree())
        links = arm_bodies(robot, request.package_dirs, request.allow_large)
        self.own: OwnPairs | None = None
        if request.self_collision and links:
            adjacent = neighbours(robot.description, robot.locked)
            self.own = own_pairs(links, kinematics, adjacent, robot.limits, semantics(robot, request.srdf))
        things = [Kept(body, True) for body in links]
        for name, other, base in request.beside:
            at = np.linalg.inv(request.base_pose) @ pose_of(base[:3], base[3:])
            still = (b for b in arm_bodies(other, request.package_dirs, request.allow_large) if b.joint < 0)
            things += [Kept(Body(f"{name}: {b.name}", -1, at @ b.pose, b.solid), False) for b in still]
        self.obstacles = len(things)  # index of the first body of the scene
        whole = self.scene or Scene(source="--floor")
        for name in {thing.name for thing in whole.objects} & {body.name for body in links}:
            raise BadInput(f"{whole.source}: object {name}: a link has this name; give each object its own name")
        if request.floor is not None:
            whole = replace(whole, floor=request.floor)
        self._whole = whole
        tool = tool_of(robot.body, request.tool)
        frames = {**arms[0][0], TOOL: (tool.joint, np.array(tool.pose))}
        others = {link: joint for links, _ in arms[1:] for link, (joint, _) in links.items()}
        self._names = {*frames, *others, FLOOR, PAYLOAD}  # that a scene's pairs may have
        elsewhere = {link for link, joint in others.items() if joint >= 0 and link not in frames}
        known: dict[int, Solid] = {}
        for placed in whole.placed(request.base_pose, robot.body.tree()[0].placement[:3, 3]):
            if elsewhere & {placed.attached_to, placed.frame}:  # another arm carries it
                continue
            shape = placed.shape
            if id(shape) not in known:
                whole_mesh = shape.vertices, shape.triangles
                known[id(shape)] = mesh(*whole_mesh) if shape.kind == "mesh" else primitive(shape.kind, shape.size)
            things.append(kept_of(placed, known[id(shape)], frames))
        if request.payload_size is not None:
            box = primitive("box", request.payload_size)
            things.append(Kept(Body(PAYLOAD, robot.body.last, pose_of(request.payload_at), box), False))
        self.has_body, self.links = bool(links), len(links)
        pairs = kept_apart(things, self.own, whole.allowed)
        self.own_checks = bool(len(pairs)) and bool((pairs < len(links)).all(axis=1).any())
        self.bodies = Bodies(kinematics, [thing.body for thing in things], pairs)
        # (P,) [m] clearance of pairs that come nearer than `asked` on a given motion, else inf
        self._allowed = np.full(len(self.bodies.pairs), np.inf)

    def __copy__(self) -> Cell:
        """A cell that shares all that this one has built."""
        out = object.__new__(type(self))
        vars(out).update(vars(self))
        return out

    def __getstate__(self) -> dict[str, Any]:
        """The content of a pickled cell: no bodies, as meshes become a hundred megabytes."""
        return {name: getattr(self, name) for name in ("robot", "request", "scene", "_allowed")}

    def __getattr__(self, name: str) -> Any:
        """A part of a pickled cell, which is built again from the files when it is first needed."""
        if name.startswith("__") or "bodies" in vars(self) or "_allowed" not in vars(self):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        allowed = self._allowed
        self.__init__(self.robot, self.request, self.scene)  # type: ignore[misc]
        self._allowed = allowed
        return getattr(self, name)

    @property
    def checks(self) -> bool:
        """Whether there is any pair to keep apart."""
        return len(self.bodies.pairs) > 0

    @property
    def warnings(self) -> list[str]:
        """Warnings about the checks."""
        out = [*self._whole.warnings, *out_of_scale(self._whole, self.request.base_pose, max(0.1, self.robot.reach))]
        out += unknown_names(self._whole, self._names)
        bare = [link.name for link in self.robot.description.links.values() if link.visible and not link.collisions]
        if not self.has_body:
            out.append(f"{self.robot.name}: its URDF has no collision geometry; its body is not checked")
        elif bare:
            out.append(
                f"{self.robot.name}: links with a visual shape but no collision geometry are not checked: {few(bare)}; "
                "give them <collision> shapes"
            )
        if self.has_body and self.own is not None and not self.own_checks:
            out.append(
                f"{self.robot.name}: no pair of its links is checked ({len(self.own.disabled)} may touch by "
                f"{Path(self.own.source).name}); the arm is not checked against itself"
            )
        if self.own is not None and self.own.sampled:
            pairs = ", ".join(f"{a} and {b}" for a, b in self.own.sampled)
            out.append(f"{self.robot.name}: links that touch in each of {POSES} random poses are not checked: {pairs}")
        return out

    def distances(self, q: np.ndarray, reach: float) -> list[tuple[int, float]]:
        """Pairs that are nearer than `reach` [m] at q (n,): number and distance (0 or less: they touch)."""
        return [(p, distance) for _, p, distance in self._nearer(q[None], reach)]

    def _nearer(self, q: np.ndarray, reach: float) -> Iterator[tuple[int, int, float]]:
        """The same at many poses q (K, n), pose by pose: pose, number and distance."""
        for k, p, ruler, at, bt, distance in Scenery(self.bodies, q).hulls(reach):
            if not ruler.convex:
                inside = distance <= 0 and one_inside_the_other(ruler, at, bt)
                distance = 0.0 if inside else ruler.exact(at, bt)
            if distance < reach:
                yield k, p, distance

    def touching(self, q: np.ndarray) -> Contact | None:
        """The pair that overlaps deepest at q (n,); None where nothing touches."""
        found = [self._contact(q, p, d) for p, d in self.distances(q, TOUCHING)]
        return max(found, key=lambda contact: contact.depth, default=None)

    def free(self, q: np.ndarray) -> bool:
        """Whether every pair keeps the required clearance at q (n,)."""
        return not self.short(q).any()

    def short(self, q: np.ndarray) -> np.ndarray:
        """By how much each pair is too near at q (n,) for a motion that ends there to keep the whole clearance.

        (P,) [m]; infinite for a pair that touches.
        """
        needed = np.minimum(self.asked, self._allowed) + UNCERTAIN
        out = np.zeros(len(needed))
        for p, distance in self.distances(q, max(self.asked + UNCERTAIN, TOUCHING)):
            out[p] = np.inf if distance <= TOUCHING else max(needed[p] - distance, 0.0)
        return out

    def beside(self, time: np.ndarray, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> Cell:
        """The cell for a given motion, by its samples: time (N,) [s], position, velocity and acceleration (N, n).

        If no clearance was asked for and the given motion comes nearer than the default without touching, each such
        pair keeps half of the motion's own distance. Otherwise the result is this cell.
        """
        if self.request.clearance is not None or not self.checks:
            return self
        found = self.prove(time, position, velocity, acceleration)
        if found.proven:
            return self
        curve, allowed = MotionCurve(time, position, velocity, acceleration), self._allowed.copy()
        instants = [*np.linspace(time[0], time[-1], ALONG), *(touch.time for touch in found.touches)]
        for _, p, distance in self._nearer(curve.positions(np.array(instants)), NEARLY * self.asked):
            if distance <= TOUCHING:
                return self
            allowed[p] = min(allowed[p], distance / 2)
        out = copy(self)
        out._allowed = allowed
        return out

    def _contact(self, q: np.ndarray, pair: int, distance: float) -> Contact:
        """The contact of a pair at q (n,), with the depth of the overlap; see `touching`."""
        scene = Scenery(self.bodies, q[None])
        a, b = self.bodies.pairs[pair].tolist()
        depth = overlap(self.bodies.ruler(pair), scene.placed(0, a), scene.placed(0, b))
        return Contact(self.bodies.names(pair), distance, depth, max(a, b) < self.links, max(a, b) >= self.obstacles)

    def wanted(self, ends: np.ndarray, clearance: float | None = None) -> np.ndarray:
        """The clearance (P,) [m] that each pair keeps on a move between the poses `ends` (2, n).

        It is the asked one. A pair that is nearer at an end, or cannot be proven not to be, keeps half of its distance
        there.

        Args:
            ends: (2, n) [rad, m]. clearance: [m] instead of the asked one.
        """
        asked = self.asked if clearance is None else clearance
        out = np.minimum(asked, self._allowed)
        for q in ends:
            for p, distance in self.distances(q, asked + UNCERTAIN):
                out[p] = min(out[p], max(distance / 2, 0.0))
        return out

    def prove(
        self,
        time: np.ndarray,
        position: np.ndarray,
        velocity: np.ndarray,
        acceleration: np.ndarray,
        wanted: np.ndarray | None = None,
    ) -> Clearance:
        """Whether a motion touches anything, also between its samples; see `proof`.

        Args:
            time: (N,) [s]. position, velocity, acceleration: (N, n). wanted: (P,) [m] clearance of each pair (None: as
                `wanted` says for the motion's ends).

        Returns:
            The verdict with bounds. Proofs of the last motions are remembered.
        """
        curve = MotionCurve(time, position, velocity, acceleration)
        if wanted is None:
            wanted = self.wanted(position[[0, -1]])
        key = b"".join(x.tobytes() for x in (time, position, velocity, acceleration, wanted))
        if key not in self._proofs:
            if len(self._proofs) >= REMEMBERED:
                self._proofs.clear()
            self._proofs[key] = self._clearance(prove(self.bodies, curve, wanted), curve, float(time[0]))
        return self._proofs[key]

    def measured(self, found: Clearance, curve: MotionCurve) -> Clearance:
        """The clearance of a motion with its least distance, over all pairs and the whole motion, if it is proven."""
        least = nearest(self.bodies, curve, found.time) if found.proven and self.checks else None
        if least is None:
            return found
        pair, time = self.bodies.names(least.pair), least.time - float(curve.time[0])
        return replace(found, min_distance=least.distance, pair=pair, time=time)

    def _clearance(self, proof: Proof, curve: MotionCurve, begin: float) -> Clearance:
        """The result of a proof in the terms of a user; times count from `begin` [s]."""
        worst = proof.touches[0] if proof.touches else proof.least
        depth = None
        if proof.verdict == "colliding" and worst is not None:
            depth = self._contact(curve.sample(worst.time), worst.pair, worst.distance).depth
        return Clearance(
            verdict=proof.verdict,
            lower_bound=None if not np.isfinite(proof.lower_bound) else proof.lower_bound,
            min_distance=None if worst is None else worst.distance,
            pair=None if worst is None else self.bodies.names(worst.pair),
            time=None if worst is None else worst.time - begin,
            depth=depth,
            pairs=len(self.bodies.pairs),
            disabled_pairs=() if self.own is None else tuple(self.own.disabled),
            source="off" if self.own is None else Path(self.own.source).name,
            touches=tuple(proof.touches),
        )
