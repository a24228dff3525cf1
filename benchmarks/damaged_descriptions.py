"""Damaged robot descriptions: each is refused, or held exactly as a strict reading of its XML says.

    python benchmarks/damaged_descriptions.py [--count 2000] [--seed 0]

Random arms get one to three damages: numbers with spaces, units, commas, underscores, missing and doubled tags, unknown
shapes, dummy links, and so on. What the package then holds (masses by joint, number, kind, size and place of the
collision bodies) is compared with a reading of its own: minidom, decimal numbers, SciPy's rotations. What a strict
reading takes must be taken, what it refuses must be refused.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any
from xml.dom import minidom
from xml.parsers.expat import ExpatError

import coal
import numpy as np
from scipy.spatial.transform import Rotation

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import EnergyOptError
from energy_opt.robot import load_robot

DECIMAL = re.compile(r"[ \t\r\n]*([+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?)[ \t\r\n]*")
NUMBER = re.compile(r'(?<=[" ])-?[0-9]+\.[0-9]+(?=[" ])')
SHAPES = {"box": ["size"], "sphere": ["radius"], "cylinder": ["radius", "length"], "capsule": ["radius", "length"]}
MOMENTS = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]


class Refused(Exception):
    """A strict reading does not take the file."""


@dataclass(frozen=True)
class Reading:
    """Mass [kg] of what each moving joint carries; kind, sizes and place at zero of each collision body, sorted."""

    mass: dict[str, float]
    bodies: list[tuple[Any, ...]]


def strict(text: str) -> Reading:
    """What the XML of a URDF says; Refused where any of it can be read in two ways."""
    try:
        root = minidom.parseString(text.encode()).documentElement
    except (ExpatError, ValueError):
        raise Refused("XML") from None
    if root.tagName != "robot":
        raise Refused(root.tagName)
    links, joints = {}, {}
    for node in _children(root, ["link", "joint"]):
        name = node.getAttribute("name")
        table = links if node.tagName == "link" else joints
        if name in table or not re.fullmatch(r"[A-Za-z0-9_./-]{1,128}", name):
            raise Refused(name)
        table[name] = _link(node) if node.tagName == "link" else _joint(node)
    by_child = {}
    for name, (kind, parent, child, place) in joints.items():
        if parent not in links or child not in links or child in by_child:
            raise Refused(name)
        by_child[child] = name, kind, parent, place
    if len([name for name in links if name not in by_child]) != 1:
        raise Refused("base")
    mass = {name: 0.0 for name, joint in joints.items() if joint[0] != "fixed"}
    bodies = []
    for name, (own, shapes) in links.items():
        place, on, at, seen = np.eye(4), "", name, set()
        while at in by_child:
            joint, kind, parent, step = by_child[at]
            if at in seen:
                raise Refused("circle")
            seen.add(at)
            on = on or (joint if kind != "fixed" else "")
            place, at = step @ place, parent
        if on:
            mass[on] += own
        for kind, sizes, pose in shapes:
            bodies.append((kind, *np.round(sizes, 9), *np.round((place @ pose)[:3].ravel() + 0.0, 6)))
    return Reading(mass, sorted(bodies))


def _children(node: Any, known: Sequence[str], single: bool = False) -> list[Any]:
    """The element's children; Refused where a tag is none of the known ones, or there twice and not alike."""
    out = [child for child in node.childNodes if child.nodeType == child.ELEMENT_NODE]
    for child in out:
        if child.tagName not in known:
            raise Refused(child.tagName)
    if not single:
        return out
    kept: dict[str, Any] = {}
    for child in out:
        before = kept.setdefault(child.tagName, child)
        if before.toxml().split() != child.toxml().split():
            raise Refused(child.tagName)
    return list(kept.values())


def _numbers(node: Any, attribute: str, count: int, default: str | None = None) -> list[float]:
    text = node.getAttribute(attribute) if node is not None and node.hasAttribute(attribute) else default
    words = [] if text is None else re.split(r"[ \t\r\n]+", text.strip(" \t\r\n"))
    if len(words) != count or not all(DECIMAL.fullmatch(word) for word in words):
        raise Refused(f"{attribute}={text}")
    values = [float(Decimal(word)) for word in words]
    if not np.isfinite(values).all():
        raise Refused(f"{attribute}={text}")
    return values


def _only(node: Any, attributes: Sequence[str]) -> None:
    for name in dict(node.attributes.items()):
        if name not in attributes:
            raise Refused(name)


def _place(parts: dict[str, Any]) -> np.ndarray:
    origin = parts.get("origin")
    if origin is not None:
        _only(origin, ["xyz", "rpy"])
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", _numbers(origin, "rpy", 3, "0 0 0")).as_matrix()
    out[:3, 3] = _numbers(origin, "xyz", 3, "0 0 0")
    return out


def _parts(node: Any, known: Sequence[str]) -> dict[str, Any]:
    return {child.tagName: child for child in _children(node, known, single=True)}


def _link(node: Any) -> tuple[float, list[tuple[str, list[float], np.ndarray]]]:
    mass, shapes, inertials = 0.0, [], []
    for child in _children(node, ["inertial", "collision", "visual"]):
        if child.tagName == "inertial":
            inertials.append(child)
            parts = _parts(child, ["origin", "mass", "inertia"])
            _place(parts)
            if set(parts) < {"mass", "inertia"}:
                raise Refused("inertial")
            for tag, attributes in (("mass", ["value"]), ("inertia", MOMENTS)):
                _only(parts[tag], attributes)
                values = [_numbers(parts[tag], attribute, 1)[0] for attribute in attributes]
                mass = values[0] if tag == "mass" else mass
            if mass < 0:
                raise Refused("mass")
        elif child.tagName == "collision":
            parts = _parts(child, ["origin", "geometry"])
            inside = _children(parts["geometry"], list(SHAPES)) if "geometry" in parts else []
            if len(inside) != 1:
                raise Refused("geometry")
            attributes = SHAPES[inside[0].tagName]
            _only(inside[0], attributes)
            many = 3 if inside[0].tagName == "box" else 1
            sizes = [x for attribute in attributes for x in _numbers(inside[0], attribute, many)]
            if min(sizes) < 0:
                raise Refused("size")
            shapes.append((inside[0].tagName, sizes, _place(parts)))
    if len({" ".join(i.toxml().split()) for i in inertials}) > 1:
        raise Refused("inertial")
    return mass, shapes


def _joint(node: Any) -> tuple[str, str, str, np.ndarray]:
    parts = _parts(node, ["origin", "parent", "child", "axis", "limit"])
    kind = node.getAttribute("type")
    if kind not in ("revolute", "fixed") or not {"parent", "child"} <= set(parts):
        raise Refused(kind)
    if kind == "revolute":
        if "axis" in parts:
            _only(parts["axis"], ["xyz"])
            if not any(_numbers(parts["axis"], "xyz", 3)):
                raise Refused("axis")
        if "limit" not in parts:
            raise Refused("limit")
        _only(parts["limit"], ["lower", "upper", "velocity", "effort"])
        lower, upper, velocity, effort = (
            _numbers(parts["limit"], name, 1, "0")[0] for name in ("lower", "upper", "velocity", "effort")
        )
        if lower > upper or velocity < 0 or effort < 0:
            raise Refused("limit")
    return kind, parts["parent"].getAttribute("link"), parts["child"].getAttribute("link"), _place(parts)


def held(path: Path) -> Reading:
    """What the package holds of a file: masses by Pinocchio, bodies by coal."""
    robot = load_robot(path)
    cell = Cell(robot, CellRequest(self_collision=False, floor=-50.0))
    poses = cell.bodies.kinematics(np.zeros((1, robot.n)))
    bodies = []
    for body in cell.bodies.all[: cell.links]:
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = poses.rotation[0, body.joint], poses.origin[0, body.joint]
        place = np.round((frame @ body.pose)[:3].ravel() + 0.0, 6)
        bodies.append((*_coal(body.solid.hull.geometry), *place))
    return Reading({link.name: link.mass for link in robot.body.tree()}, sorted(bodies))


def _coal(shape: Any) -> tuple[Any, ...]:
    if isinstance(shape, coal.Box):
        return ("box", *np.round(2 * np.asarray(shape.halfSide), 9))
    if isinstance(shape, coal.Sphere):
        return "sphere", round(shape.radius, 9)
    kind = "capsule" if isinstance(shape, coal.Capsule) else "cylinder"
    return kind, round(shape.radius, 9), round(2 * shape.halfLength, 9)


def arm(rng: random.Random) -> str:
    """A random arm of two to five links, every number with a point."""

    def three(low: float, high: float) -> str:
        return " ".join(f"{rng.uniform(low, high):.4f}" for _ in range(3))

    def shape() -> str:
        kind = rng.choice(list(SHAPES))
        sizes = [three(0.01, 0.2) if name == "size" else f"{rng.uniform(0.01, 0.2):.4f}" for name in SHAPES[kind]]
        return f"<{kind} " + " ".join(f'{n}="{v}"' for n, v in zip(SHAPES[kind], sizes, strict=True)) + "/>"

    lines = ['<robot name="arm">']
    count = rng.randint(3, 6)
    for k in range(count):
        lines.append(f'<link name="l{k}">')
        if k:
            m = rng.uniform(0.5, 5)
            lines.append(
                f'<inertial><origin xyz="{three(-0.1, 0.1)}" rpy="{three(-3, 3)}"/><mass value="{m:.4f}"/>'
                f'<inertia ixx="{m * 0.01:.6f}" ixy="0.0" ixz="0.0" iyy="{m * 0.012:.6f}" iyz="0.0" '
                f'izz="{m * 0.011:.6f}"/></inertial>'
            )
        for _ in range(rng.choice([0, 1, 1, 1, 2])):
            lines.append(
                f'<collision><origin xyz="{three(-0.2, 0.2)}" rpy="{three(-3, 3)}"/><geometry>{shape()}</geometry>'
                "</collision>"
            )
        lines.append("</link>")
    for k in range(1, count):
        kind = "fixed" if k > 1 and rng.random() < 0.2 else "revolute"
        lines.append(
            f'<joint name="j{k}" type="{kind}"><origin xyz="{three(-0.4, 0.4)}" rpy="{three(-3, 3)}"/>'
            f'<parent link="l{k - 1}"/><child link="l{k}"/>'
        )
        if kind == "revolute":
            lines.append(f'<axis xyz="{three(0.2, 1)}"/><limit lower="-1.0" upper="1.5" velocity="2.0" effort="90.0"/>')
        lines.append("</joint>")
    return "\n".join([*lines, "</robot>"])


def _at(rng: random.Random, pattern: str, text: str, change: Callable[[str], str]) -> str:
    found = list(re.finditer(pattern, text, re.DOTALL))
    if not found:
        return text
    spot = rng.choice(found)
    return text[: spot.start()] + change(spot[0]) + text[spot.end() :]


TAG = r"<(?:mass|inertia|origin|axis|limit|parent|child|box|sphere|cylinder|capsule)\b[^>]*/>"
WHOLE = r"<collision>.*?</collision>|<inertial>.*?</inertial>"
ANY = r"(?<=<)(?:mass|inertia|inertial|collision|geometry|box|sphere|cylinder|capsule|origin|axis|limit|joint|link)\b"
ATTRIBUTE = r"\b(?:value|xyz|rpy|radius|length|size|lower|ixx|izz|effort)(?==)"
SUFFIXES = [" ", "\t", "\n", "&#32;", "e0", "E+00", "&#48;", "000000000000001", "e-400", "e400", "m", " kg", ",", "f",
            "\u00a0", " 1.0", ".0", "e", "_0"]  # fmt: skip
PREFIXES = [" ", "\n", "+", "-", "--", "1_", "0x", "\uff11", "0", "."]
SPELT: list[Callable[[str], str]] = [
    *[lambda x, s=s: x + s for s in SUFFIXES], *[lambda x, p=p: p + x for p in PREFIXES],
    *[lambda x, w=w: w for w in ("nan", "inf", "", "-.", "1e")],  # type: ignore[misc]
    lambda x: x.rstrip("0"), lambda x: x.replace(".", ","), lambda x: x.replace(".", "_"), lambda x: "${" + x + "}",
]  # fmt: skip


def damage(rng: random.Random, text: str) -> str:
    """The text with one damage."""
    kind = rng.randrange(12)
    if kind <= 4:
        return _at(rng, NUMBER.pattern, text, rng.choice(SPELT))
    if kind == 5:
        return _at(rng, f"{TAG}|{WHOLE}", text, lambda x: "")
    if kind == 6:
        return _at(rng, f"{TAG}|{WHOLE}", text, lambda x: x + "\n" + x)
    if kind == 7:
        return _at(rng, f"{TAG}|{WHOLE}", text, lambda x: x + _at(rng, NUMBER.pattern, x, lambda n: n + "5"))
    if kind == 8:
        other = rng.choice(["ellipsoid", "torus", "Sphere", "x", "ns:box", "sphere_", "colision", "MASS", "link"])
        return _at(rng, ANY, text, lambda x: rng.choice([other, x.upper(), x + "s", x[:-1]]))
    if kind == 9:
        return _at(rng, ATTRIBUTE, text, lambda x: rng.choice([x.upper(), x + "s", x[:-1], "quat_xyzw"]))
    if kind == 10:  # a dummy link
        k = rng.randint(100, 999)
        how = rng.choice(
            ['type="fixed">', 'type="revolute"><limit lower="-1.0" upper="1.0" velocity="1.0" effort="9.0"/>']
        )
        extra = f'<link name="d{k}"/><joint name="e{k}" {how}<parent link="l0"/><child link="d{k}"/></joint>'
        return text.replace('<joint name="j1"', extra + '<joint name="j1"', 1).replace(
            '<parent link="l0"/><child link="l1"/>', f'<parent link="d{k}"/><child link="l1"/>', 1
        )
    return _at(rng, TAG, text, lambda x: rng.choice([f"<!-- {x[1:-2]} -->{x}", f"{x}<!-- -->", f"<![CDATA[ ]]>{x}"]))


def judged(text: str, path: Path) -> str:
    """ "held", "refused", or what is wrong."""
    path.write_text(text, encoding="utf-8")
    try:
        said: Reading | None = strict(text)
    except Refused:
        said = None
    try:
        found = held(path)
    except EnergyOptError as error:
        if said is None or sum(said.mass.values()) <= 1e-6 or "no body" in str(error) or "negative" in str(error):
            return "refused"
        return f"refused what a strict reading takes: {error}"
    if said is None:
        return "taken, though a strict reading refuses it"
    if found.mass.keys() != said.mass.keys():
        return "other joints"
    if any(abs(found.mass[name] - said.mass[name]) > 1e-9 for name in said.mass):
        return f"masses {found.mass}, the file says {said.mass}"
    return "held" if found.bodies == said.bodies else f"bodies {found.bodies}, the file says {said.bodies}"


def run(count: int, seed: int, folder: Path) -> tuple[Counter[str], list[tuple[int, str, str]]]:
    """How many of `count` were held and refused, and each that is wrong: its number, what, and the text."""
    answers: Counter[str] = Counter()
    wrong = []
    for k in range(count):
        rng = random.Random(f"{seed}-{k}")
        text = arm(rng)
        for _ in range(rng.randint(1, 3)):
            text = damage(rng, text)
        answer = judged(text, folder / "damaged.urdf")
        answers[answer if answer in ("held", "refused") else "wrong"] += 1
        if answer not in ("held", "refused"):
            wrong.append((k, answer, text))
    return answers, wrong


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 1 where anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        answers, wrong = run(args.count, args.seed, Path(folder))
    print(f"{args.count} damaged descriptions: " + ", ".join(f"{n} {what}" for what, n in sorted(answers.items())))
    for k, answer, _ in wrong[:20]:
        print(f"  {k}: {answer[:300]}")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
