"""A robot's description, read once and strictly: links, masses, collision bodies and joints of a URDF as plain numbers.

All data of an arm come from this module. Libraries get these numbers and never the file, because they accept different
elements and ignore others without a message.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

from energy_opt.errors import BadInput, suggest
from energy_opt.names import check_name
from energy_opt.robot.xml import number_in, only_child, read_robot_xml, refuse_unread, vector_in

Vector = tuple[float, float, float]

MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
TRANSPOSED = ("iyx", "izx", "izy")  # transposed moments, which some files also have; ignored
MOVING = ("revolute", "continuous", "prismatic")
KINDS = (*MOVING, "fixed", "floating", "planar")
SIZES = {"box": (), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}
FARTHEST = 1e4  # [m] largest length or position of an arm
HEAVIEST = 1e6  # [kg, kg m^2] largest mass or moment
LINK, JOINT = ("inertial", "collision", "visual"), ("origin", "parent", "child", "axis", "limit", "mimic")
INERTIAL, COLLISION, SHAPES = ("origin", "mass", "inertia"), ("origin", "geometry"), (*SIZES, "mesh")
BOUNDS = ("lower", "upper", "velocity", "effort")
RATES = ("acceleration", "deceleration", "jerk")  # URDF 1.2 has them, too
UNUSED = (("dynamics", "damping"), ("dynamics", "friction"), ("safety_controller", "soft_lower_limit"),
          ("safety_controller", "soft_upper_limit"))  # fmt: skip
# Reduction and rotor inertia in a <transmission>: tag in lower case and without _, and the value that adds nothing
MOTOR = {"mechanicalreduction": 1.0, "gearratio": 1.0, "motorinertia": 0.0, "rotorinertia": 0.0}
# Tags that are read in one place only: elsewhere they would be ignored
STRUCTURE = frozenset({"link", "joint", *LINK, *INERTIAL, *COLLISION, *SHAPES, *JOINT} - {"visual"})


@dataclass(frozen=True)
class Pose:
    """Pose of a frame in another one: position [m], and roll, pitch, yaw [rad] about fixed axes."""

    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Inertial:
    """Mass [kg], centre of mass with the axes of the moments, and moments (in the order of `MOMENTS`) [kg m^2]."""

    mass: float
    pose: Pose
    moments: tuple[float, ...]


@dataclass(frozen=True)
class Collision:
    """One collision body of a link.

    Attributes:
        kind: "box", "sphere", "cylinder", "capsule" (its length is between the centres of its caps) or "mesh".
        size: edges; radius; radius and length along z [m]; of a mesh its scale along x, y and z.
        file: of a mesh, as the description names it.
    """

    kind: str
    size: tuple[float, ...]
    pose: Pose
    file: str = ""


@dataclass(frozen=True)
class LinkPart:
    """A link: its inertia, if it has one, its collision bodies, and whether it has a visual shape."""

    name: str
    inertial: Inertial | None
    collisions: tuple[Collision, ...]
    visible: bool


@dataclass(frozen=True)
class JointPart:
    """A joint.

    Attributes:
        kind: one of `KINDS`.
        axis: not yet of unit length.
        bounds: the stated ones of lower, upper, velocity, effort, acceleration, deceleration and jerk.
        mimic: joint that leads, multiplier and offset.
        unused: what is stated of damping, friction, soft_lower_limit, soft_upper_limit, of the motor in a
            <transmission> (see `MOTOR`), and of position_min and the like in <ros2_control>, which no plan uses.
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: Pose
    axis: Vector
    bounds: dict[str, float]
    mimic: tuple[str, float, float] | None
    unused: dict[str, float]


@dataclass(frozen=True)
class Description:
    """A robot as its URDF describes it: a tree of links and joints by name, in the order of the file.

    Attributes:
        base: the link without a parent.
    """

    path: Path
    links: dict[str, LinkPart]
    joints: dict[str, JointPart]
    base: str


def read_description(path: Path) -> Description:
    """The description of a robot.

    Raises:
        BadInput: not a tree of links and joints with finite numbers, or an element would be ignored. The message names
            the link or joint, the attribute, and a correct form.
    """
    path = Path(path)
    root = read_robot_xml(path)
    tag = next((tag for tag in ("group", "disable_collisions") if root.find(tag) is not None), None)
    if tag is not None and root.find("link") is None:
        raise BadInput(f"{path}: an SRDF (it has <{tag}>); expected a URDF; an SRDF is given with --srdf")
    refuse_unread(f"{path}", root, ("link", "joint"), None, STRUCTURE - {"mimic"}, within=False)
    links = {name: _link(f"{path}: link {name!r}", name, e) for name, e in _named(path, root, "link")}
    joints = {name: _joint(f"{path}: joint {name!r}", name, e, links) for name, e in _named(path, root, "joint")}
    for name, values in (*_motors(root), *_commanded(root)):
        if name in joints:
            joints[name].unused.update(values)
    for name, joint in joints.items():
        if joint.mimic is not None:
            others = [other for other, its in joints.items() if its.kind != "fixed" and other != name]
            if joint.mimic[0] not in others:
                hint = suggest(joint.mimic[0], others) or f"; they are {', '.join(others) or 'none'}"
                raise BadInput(
                    f"{path}: joint {name!r}, mimic: joint={joint.mimic[0]!r}; expected the name of another joint "
                    f"that moves{hint}"
                )
    return Description(path, links, joints, _base(path, links, joints))


def _named(path: Path, root: Element, tag: str) -> list[tuple[str, Element]]:
    """The elements of a tag with their names, each of which is given once."""
    out: dict[str, Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            raise BadInput(f"{path}: a <{tag}> without a name")
        check_name(name, f"{path}: <{tag}>")
        if name in out:
            raise BadInput(f"{path}: {tag} {name!r} is there twice")
        out[name] = element
    return list(out.items())


def _pose(where: str, element: Element) -> Pose:
    """The pose of an element's <origin>; the identity if there is none."""
    origin, where = only_child(where, element, "origin"), f"{where}, origin"
    if origin is None:
        return Pose()
    refuse_unread(where, origin, (), ("xyz", "rpy"))
    xyz = vector_in(where, origin, "xyz", "0 0 0")
    if max(map(abs, xyz)) > FARTHEST:
        raise BadInput(f"{where}: xyz={origin.get('xyz')!r}; expected metres, at most {FARTHEST:g}")
    return Pose(xyz, vector_in(where, origin, "rpy", "0 0 0"))


def _link(where: str, name: str, link: Element) -> LinkPart:
    """A link: mass and inertia, and collision bodies."""
    refuse_unread(where, link, LINK, None, STRUCTURE - {"origin"})  # links have no origin, but some files give them one
    element, visible = only_child(where, link, "inertial"), link.find("visual") is not None
    inertial = None if element is None else _inertial(f"{where}, inertial", where, element)
    bodies = [_collision(f"{where}, collision", body) for body in link.findall("collision")]
    return LinkPart(name, inertial, tuple(bodies), visible)


def _inertial(at: str, where: str, inertial: Element) -> Inertial:
    """Mass [kg], pose and moments [kg m^2] of a link."""
    refuse_unread(at, inertial, INERTIAL, None, STRUCTURE)
    pose, mass, inertia = _pose(at, inertial), only_child(at, inertial, "mass"), only_child(at, inertial, "inertia")
    for element, tag, attributes in ((mass, "mass", ("value",)), (inertia, "inertia", (*MOMENTS, *TRANSPOSED))):
        if element is not None:
            refuse_unread(f"{where}, {tag}", element, (), attributes)
    value = number_in(f"{where}, mass", mass, "value")
    if value < 0:
        raise BadInput(f"{where}, mass: value={value:g} kg is negative")
    moments = tuple(number_in(f"{where}, inertia", inertia, moment) for moment in MOMENTS)
    if max(value, *map(abs, moments)) > HEAVIEST:
        raise BadInput(f"{where}, inertial: expected a mass and moments of at most {HEAVIEST:g} kg, kg m^2")
    return Inertial(value, pose, moments)


def _collision(where: str, collision: Element) -> Collision:
    """A collision body: its pose, and one primitive with its size [m] or one mesh with its scale."""
    refuse_unread(where, collision, COLLISION, None, STRUCTURE)
    pose, geometry = _pose(where, collision), only_child(where, collision, "geometry")
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1 or shapes[0].tag not in SHAPES:
        found = ", ".join(f"<{str(shape.tag)[:60]}>" for shape in shapes) or "nothing"
        raise BadInput(f"{where}, geometry: holds {found}; expected one of {', '.join(f'<{s}>' for s in SHAPES)}")
    shape, kind = shapes[0], str(shapes[0].tag)
    where = f"{where}, {kind}"
    if kind == "mesh":
        refuse_unread(where, shape, (), ("filename", "scale"))
        file, scale = shape.get("filename", "").strip(), vector_in(where, shape, "scale", "1 1 1")
        if not file or not file.isprintable():
            raise BadInput(f"{where}: filename={file[:60]!r}; expected the name of a file")
        if not all(1e-9 <= abs(x) <= FARTHEST for x in scale):
            raise BadInput(f"{where}: scale={shape.get('scale')!r}; expected three numbers other than 0")
        return Collision(kind, scale, pose, file)
    names = SIZES[kind]
    refuse_unread(where, shape, (), names or ("size",))
    size: tuple[float, ...] = tuple(number_in(where, shape, name) for name in names) or vector_in(where, shape, "size")
    for name, value in zip(names or ("size",) * 3, size, strict=True):
        if not 0 <= value <= FARTHEST:  # files in use have boxes and spheres of size 0: points
            raise BadInput(f"{where}: {name}={shape.get(name)!r}; expected metres, 0 to {FARTHEST:g}")
    return Collision(kind, size, pose)


def _joint(where: str, name: str, joint: Element, links: dict[str, LinkPart]) -> JointPart:
    """A joint: its links, kind, axis, limits and mimic law."""
    kind = joint.get("type", "")
    if kind not in KINDS:
        raise BadInput(f"{where}: type={kind!r}; expected one of {', '.join(KINDS)}")
    refuse_unread(where, joint, JOINT, None, STRUCTURE)
    ends = []
    for end in ("parent", "child"):
        element = only_child(where, joint, end)
        link = "" if element is None else element.get("link", "")
        if link not in links:
            raise BadInput(f"{where}: its {end} link {link!r} is not in the file")
        ends.append(link)
    axis = (1.0, 0.0, 0.0)
    direction = only_child(where, joint, "axis")
    if kind in MOVING and direction is not None:
        refuse_unread(f"{where}, axis", direction, (), ("xyz", "rpy"))
        axis = vector_in(f"{where}, axis", direction, "xyz")
        if not 1e-6 <= sum(x * x for x in axis) ** 0.5 <= FARTHEST:
            raise BadInput(f"{where}, axis: xyz={direction.get('xyz')!r} has no length; expected a direction")
    bounds = _bounds(where, kind, only_child(where, joint, "limit")) if kind in MOVING else {}
    law = only_child(where, joint, "mimic") if kind in MOVING else None
    mimic = None
    if law is not None:
        at = f"{where}, mimic"
        refuse_unread(at, law, (), ("joint", "multiplier", "offset"))
        mimic = law.get("joint", ""), number_in(at, law, "multiplier", 1.0), number_in(at, law, "offset", 0.0)
    unused = {}
    for tag, attribute in UNUSED:
        for element in joint.findall(tag):
            with suppress(BadInput):  # missing, or no number
                unused[attribute] = number_in(where, element, attribute)
    return JointPart(name, kind, ends[0], ends[1], _pose(where, joint), axis, bounds, mimic, unused)


def _motors(root: Element) -> Iterator[tuple[str, dict[str, float]]]:
    """Joint and motor's values (see `MOTOR`) of each <transmission> that states other ones than those of no gear."""
    for transmission in root.findall("transmission"):
        found = {}
        for element in transmission.iter():
            tag = str(element.tag).rpartition("}")[2].rpartition(":")[2].replace("_", "").lower()
            with suppress(ValueError):  # no number
                value = float(element.get("value") or element.text or "") if tag in MOTOR else MOTOR.get(tag)
                if value is not None and value != MOTOR[tag]:
                    found[tag] = value
        for joint in transmission.findall("joint"):
            if found:
                yield joint.get("name", ""), found


def _commanded(root: Element) -> Iterator[tuple[str, dict[str, float]]]:
    """Joint, and position_min, position_max, velocity_min or velocity_max, of each such value in <ros2_control>."""
    for joint in root.iterfind("ros2_control/joint"):
        for interface in joint.iterfind("command_interface"):
            for param in interface.iterfind("param"):
                with suppress(ValueError):  # no number
                    value = float(param.text or "")
                    yield joint.get("name", ""), {f"{interface.get('name')}_{param.get('name')}": value}


def _bounds(where: str, kind: str, limit: Element | None) -> dict[str, float]:
    """The attributes of <limit>: lower, upper, velocity, effort, and acceleration, deceleration and jerk if given.

    Raises:
        BadInput: the element is missing, has an unknown attribute, or contradicts itself.
    """
    if limit is None:
        if kind == "continuous":
            return {}
        raise BadInput(f"{where}: <limit> is missing; expected lower, upper, velocity and effort of a {kind} joint")
    at = f"{where}, limit"
    for key in limit.attrib:
        # the attribute may be a misspelling of one of these
        absent = [name for name in BOUNDS if name not in limit.attrib]
        if key not in (*BOUNDS, *RATES) and absent and (kind != "continuous" or suggest(key, absent)):
            hint = suggest(key, absent) or f"; {', '.join(absent)} missing"
            raise BadInput(f"{at}: attribute {key!r} is not known{hint}")
        if limit.get(key, "").strip().lstrip("+-").lower() in ("inf", "infinity"):
            raise BadInput(f"{at}: {key}={limit.get(key)!r} is not finite; leave it out where there is no limit")
    bounds = {name: number_in(at, limit, name) for name in (*BOUNDS, *RATES) if name in limit.attrib}
    if kind != "continuous" and bounds.get("lower", 0.0) > bounds.get("upper", 0.0):
        raise BadInput(f"{at}: lower={bounds.get('lower', 0.0):g} is above upper={bounds.get('upper', 0.0):g}")
    for name in ("velocity", "effort", *RATES):
        if bounds.get(name, 0.0) < 0:
            raise BadInput(f"{at}: {name}={limit.get(name)} is negative")
    return bounds


def _base(path: Path, links: dict[str, LinkPart], joints: dict[str, JointPart]) -> str:
    """The base: the only link without a parent, from which all other links are reached."""
    if not links:
        raise BadInput(f"{path}: no <link>; where xacro wrote it, give xacro the file that uses the robot's macro")
    parent_of: dict[str, str] = {}
    for name, joint in joints.items():
        if joint.child in parent_of:
            raise BadInput(f"{path}: link {joint.child!r} has two parents; joint {name!r} gives it the second")
        parent_of[joint.child] = joint.parent
    roots = [name for name in links if name not in parent_of]
    if len(roots) != 1:
        found = ", ".join(map(repr, roots[:5])) or "none: its joints go in a circle"
        raise BadInput(f"{path}: expected one link without a parent, the base; found {found}")
    reached = set(roots)
    while more := {child for child, parent in parent_of.items() if parent in reached} - reached:
        reached |= more
    if len(reached) < len(links):
        circle = next(name for name in links if name not in reached)
        raise BadInput(f"{path}: link {circle!r} hangs in a circle of joints, not on the base {roots[0]!r}")
    return roots[0]


def urdf_text(description: Description, meshes: Mapping[str, Path]) -> str:
    """The text of the description's file; `meshes` has the path of each mesh's file, if it is known."""
    root = read_robot_xml(description.path)
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "").strip()
        mesh.set("filename", str(meshes.get(name, name)))
    return tostring(root, encoding="unicode")
