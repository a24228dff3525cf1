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
from pathlib import Path
from typing import Any

import coal
import numpy as np
from strict_urdf import SHAPES, Reading, Refused, strict

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import EnergyOptError
from energy_opt.robot import load_robot

NUMBER = re.compile(r'(?<=[" ])-?[0-9]+\.[0-9]+(?=[" ])')


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
