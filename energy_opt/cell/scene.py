"""A scene as plain data: objects made of shapes, which pairs may touch, and the floor. NumPy only.

Poses are (4, 4) homogeneous matrices, lengths metres. A point p of a shape is in the base frame of the robot at
base⁻¹ · object.pose · shape.pose · p, with `base` the pose of the robot's base in the scene's frame.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from energy_opt.errors import BadInput, suggest
from energy_opt.files import plain

Kind = Literal["box", "sphere", "cylinder", "cone", "plane", "mesh"]
KINDS: tuple[Kind, ...] = get_args(Kind)
# Names of the sizes [m] that each kind of shape has.
SIZES: Mapping[Kind, tuple[str, ...]] = {
    "box": ("x", "y", "z"),
    "sphere": ("radius",),
    "cylinder": ("radius", "height"),
    "cone": ("radius", "height"),
    "plane": (),
    "mesh": (),
}
WORLD = ("world", "map", "odom", "scene")  # names of the scene's own frame
TOOL = "<tool>"  # means the tool's frame, where a link is named
FLOOR = "floor"  # the name of the object that means `Scene.floor`
FARTHEST = 10_000.0  # [m] largest size or position in a cell: larger ones are in another unit
BEYOND = 30.0  # [reaches of the arm] larger lengths are in another unit; scenes have halls of 40 m
ON_PLANE = 0.05  # [m] an arm whose first joint is nearer to a plane is on it, or passes through it


@dataclass(frozen=True, eq=False)
class Shape:
    """One convex primitive, half-space or mesh.

    Attributes:
        kind: "box" (full edge lengths x, y, z about its centre), "sphere" (radius), "cylinder" and "cone" (radius,
            height along z about the middle of the height; a cone's tip is at +z), "plane" (no size: the half-space
            z <= 0 of its frame is solid), "mesh" (a surface of triangles).
        size: [m], as `SIZES` lists.
        pose: (4, 4) in the frame of its object.
        vertices, triangles: (V, 3) [m] and (T, 3) indices of a mesh; empty for every other kind.
    """

    kind: Kind
    size: tuple[float, ...] = ()
    pose: np.ndarray = field(default_factory=lambda: np.eye(4))
    vertices: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    triangles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))


@dataclass(frozen=True, eq=False)
class SceneObject:
    """A named thing made of shapes that do not move against each other.

    Attributes:
        pose: (4, 4) in the scene's frame, or in the frame `frame`.
        attached_to: the link that carries it, or `TOOL`; None where it is in the cell.
        frame: the link in whose frame `pose` is, or `TOOL`; None for the scene's (see `Scene.among`).
        touch_links: links that may touch it, beside the one that carries it.
    """

    name: str
    shapes: tuple[Shape, ...]
    pose: np.ndarray = field(default_factory=lambda: np.eye(4))
    attached_to: str | None = None
    frame: str | None = None
    touch_links: tuple[str, ...] = ()

    @property
    def place(self) -> np.ndarray:
        """(4, 4) pose of the frame with its name: as in MoveIt, the only shape's pose if it has none of its own."""
        own = len(self.shapes) != 1 or not np.array_equal(self.pose, np.eye(4))
        return self.pose if own else self.shapes[0].pose

    @property
    def still_in(self) -> str | None:
        """The frame that an object which no link carries is in; None for the scene's."""
        return self.frame if self.attached_to is None else None

    def at(self, place: np.ndarray) -> SceneObject:
        """The object with that frame at `place` (4, 4)."""
        if self.place is self.pose:
            return replace(self, pose=place)
        return replace(self, shapes=(replace(self.shapes[0], pose=place),))


Arms = Sequence[tuple[Mapping[str, tuple[int, np.ndarray]], np.ndarray]]  # links (see `link_frames`), and base (4, 4)


def place_of(frame: str, what: str, arms: Arms, objects: Iterable[SceneObject] = ()) -> np.ndarray:
    """(4, 4) pose in the scene's frame of a frame that does not move: the scene's own, a link's, or an object's.

    Raises:
        BadInput: there is no such frame, it moves with an arm, or several have the name; `what` begins the message.
    """
    if frame in WORLD:  # also where a link has this name
        return np.eye(4)
    known = [(name, joint, base @ at) for links, base in arms for name, (joint, at) in links.items()]
    known += [(o.name, -1 if o.frame is None and o.attached_to is None else 0, o.place) for o in objects]
    named = [(joint, at) for name, joint, at in known if name == frame]
    if not named:
        names = list(dict.fromkeys([WORLD[0], *(name for name, joint, _ in known if joint < 0)]))
        raise BadInput(f"{what}: no frame {frame!r}{suggest(frame, names)}; frames are {', '.join(names)}")
    if any(joint >= 0 for joint, _ in named):
        raise BadInput(f"{what}: {frame} moves with the arm, so a pose in its frame is not fixed")
    if not all(np.allclose(at, named[0][1]) for _, at in named):
        raise BadInput(f"{what}: several frames are named {frame!r}; give the pose in the scene's frame, world")
    return named[0][1]


@dataclass(frozen=True)
class AllowedPairs:
    """Which pairs of links and objects may touch, as in MoveIt's allowed collision matrix.

    Attributes:
        entries: pairs (in alphabetical order) that are named, and whether they may touch.
        defaults: names that may touch (True) or must not touch (False) whatever they are not paired with by name.
    """

    entries: Mapping[tuple[str, str], bool] = field(default_factory=dict)
    defaults: Mapping[str, bool] = field(default_factory=dict)

    def allows(self, a: str, b: str) -> bool:
        """Whether a and b may touch: their entry, else both defaults, else the one there is; else they may not."""
        named = self.entries.get((a, b) if a <= b else (b, a))
        if named is not None:
            return named
        given = [self.defaults[name] for name in (a, b) if name in self.defaults]
        return bool(given) and all(given)


@dataclass(frozen=True, eq=False)
class PlacedShape:
    """A shape where it is needed: `pose` (4, 4) in the robot's base frame, or in the frame of the link `frame`."""

    object: str
    shape: Shape
    pose: np.ndarray
    attached_to: str | None = None
    frame: str | None = None
    touch_links: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Scene:
    """The arm's surroundings.

    Attributes:
        objects: every name once.
        floor: everything below this height of the scene's frame is solid [m]; None without a floor.
        source: the file it was read from, for messages.
        warnings: one line for each thing in the file that is not used.
        poses: poses of the tool that the file names, as it has them.
        root: the file's name of the scene's frame, beside `WORLD`; a link of this name comes first.
    """

    objects: tuple[SceneObject, ...] = ()
    allowed: AllowedPairs = field(default_factory=AllowedPairs)
    source: str = ""
    floor: float | None = None
    warnings: tuple[str, ...] = ()
    poses: Mapping[str, object] = field(default_factory=dict)
    root: str = ""

    def to_text(self) -> str:
        """The scene as JSON with the meshes of its files, for worker processes; the same scene gives the same text."""
        entries = [[a, b, may] for (a, b), may in sorted(self.allowed.entries.items())]
        document = {
            "objects": [asdict(thing) for thing in self.objects],
            "allowed": [entries, dict(sorted(self.allowed.defaults.items()))],
            **{name: getattr(self, name) for name in ("floor", "warnings", "poses", "root")},
            "source": Path(self.source).name,
        }
        return json.dumps(plain(document))

    @classmethod
    def from_text(cls, text: str) -> Scene:
        """The scene that `to_text` wrote."""
        document = json.loads(text)
        entries, defaults = document.pop("allowed")
        allowed = AllowedPairs({(a, b): may for a, b, may in entries}, defaults)
        objects, warnings = tuple(map(_object, document.pop("objects"))), tuple(document.pop("warnings"))
        return cls(objects, allowed, warnings=warnings, **document)

    def with_object_at(self, name: str, place: np.ndarray) -> Scene:
        """The scene with an object's frame at `place` (4, 4) of the scene's frame.

        Raises:
            BadInput: no object has that name, or it moves with the arm.
        """
        still = [thing.name for thing in self.objects if thing.attached_to is None]
        if name not in still:
            known = f"{suggest(name, still)}; those are {', '.join(still) or 'none'}"
            raise BadInput(f"{self.source}: no object {name!r} is fixed in the scene{known}")
        moved = (replace(o.at(place), frame=None) if o.name == name else o for o in self.objects)
        return replace(self, objects=tuple(moved))

    def among(self, arms: Arms) -> Scene:
        """The scene with all objects that arms do not carry in its own frame.

        The name of an arm's root link means the scene's frame, as in a planning scene, wherever the base is. So does a
        name that no link or object has, if all objects are in this frame.

        Raises:
            BadInput: an object's frame moves, or several are unknown.
        """
        fixed = {name: (base, at) for links, base in arms for name, (joint, at) in links.items() if joint < 0}
        roots = {name for name, (_, at) in fixed.items() if np.allclose(at, np.eye(4))}
        links = {name for of_arm, _ in arms for name in of_arm}
        still = [thing for thing in self.objects if thing.attached_to is None]
        used = dict.fromkeys(thing.frame for thing in still if thing.frame is not None)
        known = {*WORLD, *links, *(thing.name for thing in still)}
        only = next(iter(used)) if len(used) == 1 and all(thing.frame for thing in still) else ""
        own = self.root or ("" if only in known else only)
        said: list[str] = []
        out: list[SceneObject] = []
        for each in used:
            if each in roots and not np.allclose(fixed[each][0], np.eye(4)):
                said.append(f"{each}: the frame of objects is taken as the scene's, in which --base places this link")
            elif each == own != self.root:
                said.append(f"no link is named {each!r}{suggest(each, links)}: this frame is taken as the scene's")
        for thing in self.objects:
            if (frame := thing.still_in) is not None:
                scene = frame in roots or (frame == own and frame not in links)
                at = place_of(WORLD[0] if scene else frame, f"{self.source}: object {thing.name}", arms, out)
                thing = replace(thing.at(at @ thing.place), frame=None)
            out.append(thing)
        remarks = (f"{self.source}: {text}" for text in said)
        return replace(self, objects=tuple(out), warnings=tuple(dict.fromkeys((*self.warnings, *remarks))))

    def placed(self, base: np.ndarray | None = None, joint: np.ndarray | None = None) -> Iterator[PlacedShape]:
        """Every shape, the floor last.

        A plane is a wall that the arm does not pass: the half-space with its first joint is free, whatever the
        direction of the normal. The base itself may be sunk in the plane.

        Args:
            base: (4, 4) pose of the robot's base in the scene's frame. joint: (3,) [m] the arm's first joint in the
                frame of its base; None for the base itself.
        """
        into = np.eye(4) if base is None else np.linalg.inv(base)
        for thing in self.objects:
            for shape in thing.shapes:
                moved = thing.pose @ shape.pose
                if thing.frame is None:
                    moved = into @ moved
                if shape.kind == "plane" and thing.attached_to is None:
                    moved = facing(moved, np.zeros(3) if joint is None else joint)
                yield PlacedShape(thing.name, shape, moved, thing.attached_to, thing.frame, thing.touch_links)
        if self.floor is not None:
            ground = np.eye(4)
            ground[2, 3] = self.floor
            yield PlacedShape(FLOOR, Shape("plane"), into @ ground)


def _object(thing: dict[str, Any]) -> SceneObject:
    """An object of a scene from its document."""
    shapes = []
    for shape in thing["shapes"]:
        vertices = np.array(shape["vertices"], dtype=float).reshape(-1, 3)
        triangles = np.array(shape["triangles"], dtype=np.int64).reshape(-1, 3)
        shapes.append(Shape(shape["kind"], tuple(shape["size"]), np.array(shape["pose"]), vertices, triangles))
    known = {"shapes": tuple(shapes), "pose": np.array(thing["pose"]), "touch_links": tuple(thing["touch_links"])}
    return SceneObject(**{**thing, **known})


def out_of_scale(scene: Scene, base: np.ndarray | None, reach: float) -> list[str]:
    """Warnings on objects, and a base, that are so far or so large that their unit must be wrong.

    Args:
        base: (4, 4) pose of the robot's base in the scene's frame. reach: of the arm [m].
    """
    found: dict[str, str] = {}
    if base is not None and (far := float(np.linalg.norm(base[:3, 3]))) > BEYOND * reach:
        found[""] = f"the base is {far:g} m from the origin; {far / 1000:g} m if in millimetres"
    for placed in scene.placed(base):
        if placed.frame is not None:
            continue
        place = placed.pose[:3, 3]
        if placed.shape.kind == "plane":
            extent, far = 0.0, abs(float(placed.pose[:3, 2] @ place))
        else:
            corners = placed.shape.vertices if placed.shape.kind == "mesh" else np.array(placed.shape.size)
            extent, far = float(np.abs(corners).max()), float(np.linalg.norm(place))
        for what, length in ((f"is {far:g} m from the base", far), (f"measures {extent:g} m", extent)):
            if length > BEYOND * reach:
                found.setdefault(placed.object, f"object {placed.object} {what}; {length / 1000:g} m if in millimetres")
    tail = f"the arm reaches {reach:.3g} m; lengths of a scene are metres"
    return [f"{scene.source if name else '--base'}: {word}; {tail}" for name, word in found.items()]


def unknown_names(scene: Scene, names: Collection[str]) -> list[str]:
    """Warnings on names in pairs that may touch that are none of `names`, nor of the scene's objects.

    Files of other programs may name what is not there.
    """
    allowed, known = scene.allowed, {*names, *(thing.name for thing in scene.objects)}
    given = [name for pair, may in allowed.entries.items() if may for name in pair]
    given += [name for name, may in allowed.defaults.items() if may]
    given += [name for thing in scene.objects for name in thing.touch_links]
    found: dict[str, list[str]] = {}
    for name in dict.fromkeys(given):
        if name not in known and not name.startswith("<"):  # MoveIt's name of its octomap
            found.setdefault(suggest(name, sorted(known)), []).append(repr(name))
    return [
        f"{scene.source}: what may touch is neither a link nor an object: {', '.join(those)}{hint}"
        for hint, those in found.items()
    ]


def facing(pose: np.ndarray, joint: np.ndarray) -> np.ndarray:
    """The pose of a plane, turned over if its solid held the joint (3,); if this is on it, the upper half is free."""
    height, up = float(pose[:3, 2] @ (joint - pose[:3, 3])), float(pose[2, 2])
    solid = (up if abs(height) <= ON_PLANE < abs(up) else height) < 0
    return pose @ np.diag([1.0, -1.0, -1.0, 1.0]) if solid else pose
