"""What one iteration of reshaping costs, over the number of nodes and of joints.

    python benchmarks/scaling.py [--out numbers.json] [--figure scaling.png]

Serial chains with 2 to 14 joints, generated as URDF files, make a move with 25 to 400 Gauss nodes (three per knot span,
so control points grow along) and with rows for velocity and acceleration everywhere. Measured is the CPU time that ten
more iterations of IPOPT take, function evaluations and linear algebra together; and that of setting up, which happens
once per solve. The exponent of growth over nodes is the slope of a straight line through the logarithms.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from common import finish, table

from energy_opt.files import write_text
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.reshape.curve import fitted
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.level import Level
from energy_opt.motion.reshape.nodes import NodeFunctions, node_functions
from energy_opt.numerics.bspline import DEGREE, Basis
from energy_opt.numerics.compile import compiled
from energy_opt.power import source_method_2
from energy_opt.reports import plots
from energy_opt.robot import Robot, load_robot

NODES, JOINTS = (25, 50, 100, 200, 400), (2, 4, 7, 10, 14)
PER_SPAN = 3
FIRST, MORE = 2, 10  # iterations of the short run, and how many more of them the long run makes
ALLOWED = 1.1  # of the exponent over nodes: linear, and what timing blurs

LINK = """  <link name="link{k}"><inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
JOINT = """  <joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/>
    <origin xyz="0 0 0.2"/><axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="2" effort="300"/></joint>
"""
AXES = ("0 0 1", "0 1 0", "1 0 0")


@dataclass(frozen=True)
class Cost:
    """CPU time [s] of one iteration and of setting up, for so many joints, nodes and control points."""

    joints: int
    nodes: int
    controls: int
    iteration: float
    setup: float


def chain(joints: int, folder: Path) -> Robot:
    """A serial chain of equal links that get lighter towards the tip."""
    parts = [f'<robot name="chain{joints}">\n  <link name="base"/>\n']
    for k in range(joints):
        parent = f"link{k - 1}" if k else "base"
        parts.append(LINK.format(k=k, mass=f"{2.0 * 0.8**k:.4f}"))
        parts.append(JOINT.format(k=k, parent=parent, axis=AXES[k % 3]))
    path = folder / f"chain{joints}.urdf"
    write_text(path, "".join(parts) + "</robot>\n")
    return load_robot(str(path))


def cost(robot: Robot, functions: NodeFunctions, nodes: int, repeats: int) -> Cost:
    """The least of `repeats` measurements."""
    n, model = robot.n, source_method_2(robot.name)
    controls = round(nodes / PER_SPAN) + DEGREE
    shape = Shape(n, Basis(controls), PER_SPAN)
    level = Level(shape, functions)
    limits = robot.limits.replace(acceleration=np.full(n, 10.0))
    start, rest = np.zeros(n), np.zeros(n)
    goal = np.where(np.arange(n) % 2, -0.8, 0.8)
    ends = Ends(start, goal, rest, rest, np.zeros((0, n)))
    u = np.linspace(0, 1, 4 * controls)
    way = u**3 * (10 - 15 * u + 6 * u**2)
    guess = fitted(shape, u, start + np.outer(way, goal - start), ends, 2.0)
    rows = np.array([(k, site, j) for k in (1, 2) for site in range(controls - k) for j in range(n)])

    def spent(iterations: int) -> float:
        begin = time.process_time()
        options: dict[str, object] = {"max_iter": iterations, "mu_init": 1e-2}
        parameters = model.values(n)
        found = level.solve(
            guess, ends, limits, parameters, (2.0, 2.0), tolerance=1e-14, rows=rows, options=options, rounds=1
        )
        assert found.iterations == iterations
        return time.process_time() - begin

    spent(FIRST)  # what the shape keeps for all solves is made here
    short, long = (min(spent(count) for _ in range(repeats)) for count in (FIRST, FIRST + MORE))
    iteration = max(long - short, 1e-9) / MORE
    return Cost(n, len(shape.basis.gauss(PER_SPAN)[0]), controls, iteration, max(short - FIRST * iteration, 0.0))


def exponent(costs: Sequence[Cost]) -> float:
    """Of the growth over nodes, by least squares."""
    return float(np.polyfit(np.log([x.nodes for x in costs]), np.log([x.iteration for x in costs]), 1)[0])


def draw(costs: Sequence[Cost], path: Path) -> None:
    """Time per iteration over nodes and over joints."""
    figure, axes = plots.new_figure(1, 2, height=4.0)
    joints = sorted({x.joints for x in costs})
    spans = sorted({x.nodes for x in costs})
    over_nodes, over_joints = [], []
    for n in joints:
        line = [x for x in costs if x.joints == n]
        x, y = np.array([c.nodes for c in line]), np.array([1e3 * c.iteration for c in line])
        over_nodes.append(plots.Curve(f"{n} joints, exponent {exponent(line):.2f}", x, y))
    for k in spans:
        line = [x for x in costs if x.nodes == k]
        x, y = np.array([c.joints for c in line]), np.array([1e3 * c.iteration for c in line])
        over_joints.append(plots.Curve(f"{k} nodes", x, y))
    drawn = ((axes[0, 0], "nodes", over_nodes, spans), (axes[0, 1], "joints", over_joints, joints))
    for axis, label, lines, ticks in drawn:
        plots.curves(plots.labelled(axis, label, "time per iteration [ms]"), lines)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xticks(ticks, [str(tick) for tick in ticks])
        axis.minorticks_off()
    plots.save(figure, path)


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where time grows faster than linearly in nodes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nodes", type=int, nargs="+", default=list(NODES), help="numbers of nodes")
    parser.add_argument("--joints", type=int, nargs="+", default=list(JOINTS), help="numbers of joints")
    parser.add_argument("--repeats", "--moves", type=int, default=3, help="measurements, the least counts (3)")
    parser.add_argument("--compile", default="never", help="of the node functions: never (default) or always")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="also draw them (PNG)")
    args = parser.parse_args(words)
    costs: list[Cost] = []
    exponents: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name:
        for n in args.joints:
            robot = chain(n, Path(name))
            nodes = node_functions(source_method_2(robot.name), robot.body, joint_limits(robot.limits))
            functions = NodeFunctions(*compiled(nodes.as_list(), args.compile, batch=True)[0])
            of_robot = [cost(robot, functions, count, args.repeats) for count in args.nodes]
            costs += of_robot
            exponents[f"{n} joints"] = exponent(of_robot)
            print(f"{n} joints: done", file=sys.stderr)
    header = ("joints", "nodes", "controls", "ms per iteration", "us per node", "setup ms")
    lines = [
        [x.joints, x.nodes, x.controls, 1e3 * x.iteration, 1e6 * x.iteration / x.nodes, 1e3 * x.setup] for x in costs
    ]
    print(table(header, lines))
    if args.figure is not None:
        draw(costs, args.figure)
    checks = {f"{name}: time ~ nodes^{value:.2f}": value <= ALLOWED for name, value in exponents.items()}
    document = {"costs": [vars(x) for x in costs], "exponents": exponents, "compile": args.compile}
    return finish(document, checks, args.out)


if __name__ == "__main__":
    sys.exit(main())
