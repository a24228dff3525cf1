"""The proof that a motion touches nothing: against geometry worked out by hand, and against an independent judge."""

import json
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from machine import allowed
from poses import START

from energy_opt.cell import solids
from energy_opt.cell.cell import Cell
from energy_opt.cell.curve import MotionCurve
from energy_opt.cell.planes import Near
from energy_opt.cell.proof import one_inside_the_other
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene, SceneObject, Shape
from energy_opt.cell.scene_files import read_scene
from energy_opt.cli.main import main
from energy_opt.motion.initial_paths.room import Room
from energy_opt.motion.path import JointPath, straight, through
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics import native
from energy_opt.robot import Robot, load_robot
from energy_opt.robot.catalog import srdf_beside
from energy_opt.robot.description import urdf_text
from energy_opt.robot.kinematics import Kinematics
from energy_opt.robot.meshes import mesh_files
from energy_opt.tables import read_table, write_table

PROBLEMS = Path(__file__).parents[3] / "shared/data/mbm"

# An arm of one metre about z, with a ball of 0.1 m at its tip and no other body.
BALL = """<robot name="ball">
<link name="base"/>
<link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="1 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" effort="100"/></joint></robot>"""


def along(path: JointPath, duration: float, rows: int) -> Trajectory:
    """The path with the fifth-degree timing that begins and ends at rest."""
    t = np.linspace(0, duration, rows)
    u = t / duration
    s = u**3 * (10 - 15 * u + 6 * u**2)
    v = 30 * u**2 * (1 - u) ** 2 / duration
    a = 60 * u * (1 - u) * (1 - 2 * u) / duration**2
    slope = path(s, 1)
    curved = path(s, 2) * v[:, None] ** 2 + slope * a[:, None]
    return Trajectory(tuple("abcdefg"[: path.n]), t, path(s), slope * v[:, None], curved)


def waypoints(name: str, robot: Robot) -> np.ndarray:
    """Those of a planner's path to one of the problems."""
    table = read_table(PROBLEMS / "paths" / f"{name}.csv")
    return np.column_stack([table[f"{joint}.position"] for joint in robot.joints])


def judged(cell: Cell, t: Trajectory):
    return cell.prove(t.time, t.position, t.velocity, t.acceleration)


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    (path := tmp_path_factory.mktemp("urdf") / "ball.urdf").write_text(BALL)
    return load_robot(str(path))


def post(distance: float, angle: float, radius: float = 0.2) -> Scene:
    """A sphere whose centre is `distance` from the arm's axis, at `angle`."""
    pose = np.eye(4)
    pose[:2, 3] = distance * np.cos(angle), distance * np.sin(angle)
    return Scene((SceneObject("post", (Shape("sphere", (radius,)),), pose),))


@pytest.mark.parametrize("rows", [2, 3, 50])
@pytest.mark.parametrize(
    ("gap", "verdict"), [(0.00208, "proven"), (0.00195, "undecided"), (-1e-4, "colliding"), (0.1, "proven")]
)
def test_a_ball_that_passes_a_ball(ball: Robot, gap: float, verdict: str, rows: int) -> None:
    cell = Cell(ball, CellRequest(), post(1 + 0.1 + 0.2 + gap, 0.7))  # nearest where the arm points at the post
    answer = judged(cell, along(straight([-0.5], [1.5]), 2.0, rows))
    assert answer.verdict == verdict and answer.pairs == 1
    if verdict == "proven":
        assert answer.lower_bound is not None and 0.002 <= answer.lower_bound <= gap
        assert gap - 1e-5 <= answer.min_distance
    else:
        assert answer.pair == ("arm", "post") and answer.min_distance == pytest.approx(gap, abs=1e-3)
        near = along(straight([-0.5], [1.5]), 2.0, 2000)
        k = int(np.argmin(np.abs(near.time - answer.time)))
        assert abs(near.position[k, 0] - 0.7) < 0.1
        assert answer.depth is None or 0 < answer.depth <= 1e-5 - gap


def test_between_two_rows_it_is_the_quintic_that_counts(ball: Robot) -> None:
    """Two rows at rest in free poses, with the ball thrown against the post and back between them."""
    cell = Cell(ball, CellRequest(), post(1.0, 0.9, 0.05))
    time, q = np.array([0.0, 1.0]), np.array([[0.0], [0.0]])
    still = np.zeros((2, 1))
    assert cell.prove(time, q, still, still).verdict == "proven"
    thrown = np.array([[4.0], [-4.0]])  # the quintic's middle is at 2 * 4 * 5 / 32 = 1.25 rad
    answer = cell.prove(time, q, thrown, still)
    assert answer.verdict == "colliding"
    assert MotionCurve(time, q, thrown, still).sample(0.5)[0] == pytest.approx(1.25)


def test_a_nearer_end_requires_half_of_its_distance(ball: Robot) -> None:
    close = np.arccos((1 + 1.2**2 - 0.3002**2) / 2.4)  # 0.2 mm between the balls
    cell = Cell(ball, CellRequest(), post(1.2, 0.0))
    answer = judged(cell, along(straight([close], [1.5]), 2.0, 100))
    assert answer.verdict == "proven" and 0.0001 <= answer.lower_bound <= 0.0002
    assert judged(cell, along(straight([1.0], [1.5]), 2.0, 100)).lower_bound >= 0.002
    assert cell.touching(np.array([close])) is None and cell.touching(np.array([0.1])) is not None


@pytest.mark.parametrize(("apart", "kept"), [(0.012, 0.01), (0.0101, 0.01), (0.008, 0.004)])
def test_an_end_that_is_not_nearer_than_asked_keeps_what_was_asked_for(ball: Robot, apart: float, kept: float) -> None:
    """A pair nearer than twice that at an end kept half of its distance there, and the plan counted as solved."""
    end = np.arccos((1 + 1.2**2 - (0.3 + apart) ** 2) / 2.4)
    cell = Cell(ball, CellRequest(clearance=0.01), post(1.2, 0.0))
    ends = np.array([[end], [1.5]])
    assert cell.wanted(ends).min() == pytest.approx(kept, abs=1e-5)
    room = Room(cell, ends)  # paths between the ends keep as much
    assert all(room.clear(q) for q in ends) and room.unproven(straight(*ends)) is None
    nearer = np.arccos((1 + 1.2**2 - (0.3 + 0.99 * kept) ** 2) / 2.4)
    assert not room.clear(np.array([nearer])) and room.unproven(straight([nearer], [1.5])) is not None


def test_a_mesh_is_not_its_hull_and_has_an_inside(ball: Robot) -> None:
    """A ring of boxes as one mesh: the ball passes through its hole; and a ball inside of a closed shell touches it."""

    def boxes(*placed: tuple[tuple[float, ...], tuple[float, ...]]) -> Shape:
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
        faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                 [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
        vertices = np.vstack([corners * size + at for at, size in placed])
        return Shape(
            "mesh", vertices=vertices, triangles=np.vstack([np.array(faces) + 8 * k for k in range(len(placed))])
        )

    gate = boxes(
        ((1, 0, 0.3), (1, 0.1, 0.2)), ((1, 0, -0.3), (1, 0.1, 0.2)), ((0.6, 0, 0), (0.2, 0.1, 0.4)),
        ((1.4, 0, 0), (0.2, 0.1, 0.4)),
    )  # fmt: skip
    cell = Cell(ball, CellRequest(), Scene((SceneObject("gate", (gate,)),)))
    assert judged(cell, along(straight([-0.5], [0.5]), 2.0, 50)).verdict == "proven"
    shell = Scene((SceneObject("shell", (boxes(((1, 0, 0), (0.9, 0.9, 0.9)), ((1, 1, 0), (0.1, 0.1, 0.1))),)),))
    cell = Cell(ball, CellRequest(), shell)
    inside = judged(cell, along(straight([-0.05], [0.05]), 2.0, 50))
    assert "one inside the other" in str(inside) and "(inside)" in str(cell.touching(np.zeros(1)))  # "0 mm deep"


def test_vertices_that_no_triangle_takes_are_no_part_of_a_mesh() -> None:
    """Two open sheets side by side; a stray vertex of one lies within a closed box behind it. (Files have such.)"""
    fold = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0], [5.0, 5.0, 5.0]])
    two = np.array([[0, 1, 2], [0, 2, 3]])
    hollow = np.array([[x, y, z] for x in (4.0, 6.0) for y in (4.0, 6.0) for z in (4.0, 6.0)] + [[9.0, 9.0, 9.0]])
    hollow[7] = 5.6  # a dent, so that it is not its hull
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
                      [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])  # fmt: skip
    sheet, box, inner = solids.mesh(fold, two), solids.mesh(hollow, faces), solids.mesh(fold + 4.5, two)
    here = solids.placement(np.eye(3), np.zeros(3))
    assert not one_inside_the_other(solids.Ruler(sheet, box), here, here)
    assert one_inside_the_other(solids.Ruler(inner, box), here, here)


def dense(robot: Robot, t: Trajectory, samples: int = 400) -> float:
    """The share of samples in contact by Pinocchio's own loop on meshes, all pairs but those that the SRDF disables."""
    model = pin.buildModelFromUrdf(str(robot.urdf))
    text = urdf_text(robot.description, mesh_files(robot.description))
    geometry = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
    full = pin.neutral(model)
    locked = [model.getJointId(name) for name in robot.locked]
    model, geometry = pin.buildReducedModel(model, geometry, locked, full)
    geometry.addAllCollisionPairs()
    pin.removeCollisionPairs(model, geometry, str(srdf_beside(robot.name, robot.urdf)))
    data, found = model.createData(), geometry.createData()
    times = np.linspace(t.time[0], t.time[-1], samples)
    hits = 0
    for q in t.sample(times)[0]:
        hits += pin.computeCollisions(model, data, geometry, found, robot.body.configuration(q[None])[0], True)
    return hits / samples


@pytest.mark.parametrize(("name", "compiled"), [("panda", True), ("ur5", True), ("ur5", False)])
def test_random_moves_against_a_dense_judge(name: str, compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is proven is nowhere in contact, and what collides is in contact where the proof says."""
    if not compiled:
        monkeypatch.setattr(native, "library", lambda part: None)
    robot = load_robot(name)
    cell = Cell(robot, CellRequest(clearance=0.0005))
    rng = np.random.default_rng(4)
    low, high = np.maximum(robot.limits.lower, -2.6), np.minimum(robot.limits.upper, 2.6)
    verdicts = []
    for _ in range(10):
        points = rng.uniform(low, high, (8, robot.n))
        t = along(through(points), 2.0, 120)
        answer = judged(cell, t)
        share = dense(robot, t)
        verdicts.append(answer.verdict)
        assert (answer.verdict == "proven") == (share == 0), (answer, share)
        if answer.verdict == "colliding":
            q = t.sample(np.array([answer.time + t.time[0]]))[0]
            assert cell.touching(q[0]) is not None
    assert {"proven", "colliding"} <= set(verdicts)


def test_kinematics_are_pinocchios(panda: Robot) -> None:
    q = np.random.default_rng(0).uniform(panda.limits.lower, panda.limits.upper, (3, panda.n))
    poses = Kinematics(panda.body.tree())(q)
    frames = panda.body.link_frames()
    joint, pose = frames["panda_hand"]
    model = pin.buildModelFromUrdf(str(panda.urdf))
    data = model.createData()
    for k, row in enumerate(q):
        pin.framesForwardKinematics(model, data, np.concatenate([row, [0.0, 0.0]]))
        hand = data.oMf[model.getFrameId("panda_hand")].homogeneous
        ours = poses.rotation[k, joint] @ pose[:3, 3] + poses.origin[k, joint]
        assert np.allclose(ours, hand[:3, 3], atol=1e-12)


def test_pairs_without_an_srdf_are_those_that_can_help_it() -> None:
    cell = Cell(load_robot("ur10"), CellRequest())
    assert cell.own is not None and cell.own.source == "adjacency and sampling"
    assert cell.own.disabled["forearm_link", "upper_arm_link"] == "adjacent"
    assert ("base_link", "forearm_link") not in cell.own.disabled
    again = Cell(load_robot("ur10"), CellRequest())
    assert again.own is not None and again.own.disabled == cell.own.disabled


@pytest.mark.skipif(not PROBLEMS.is_dir(), reason="the planning problems are not beside the checkout")
def test_planners_paths_are_proven() -> None:
    problems = json.loads((PROBLEMS / "problems.json").read_text())
    problems = problems if isinstance(problems, list) else problems["problems"]
    robots = {name: load_robot(name) for name in ("panda", "ur5")}
    for problem in problems:
        scene = read_scene(PROBLEMS / "scenes" / f"{problem['id']}.yaml")
        cell = Cell(robots[problem["robot"]], CellRequest(), scene)
        motion = along(through(np.array(problem["waypoints"])), 2.0, 300)
        answer = judged(cell.beside(motion.time, motion.position, motion.velocity, motion.acceleration), motion)
        own = problem["clearance"]["path"]
        assert answer.lower_bound >= (0.002 if own > 0.0021 else 0.45 * own)
        assert answer.verdict == "proven", (problem["id"], answer)
        assert answer.min_distance <= problem["clearance"]["path"] + 5e-4


@pytest.mark.skipif(not PROBLEMS.is_dir(), reason="the planning problems are not beside the checkout")
@pytest.mark.parametrize("name", ["panda_bookshelf_thin_0030", "ur5_table_pick_0033"])
def test_rows_over_planes_have_exact_derivatives_and_are_bounds(name: str) -> None:
    """By central differences; and where planes were found no row is above the distance that was measured there."""
    robot = load_robot(name.split("_")[0])
    cell = Cell(robot, CellRequest(), read_scene(PROBLEMS / "scenes" / f"{name}.yaml"))
    q = along(through(waypoints(name, robot)), 2.0, 12).position
    u = np.linspace(0, 1, len(q))
    rows = Near(cell.bodies).constraints(u, q, np.full((len(u), len(cell.bodies.pairs)), 0.002), 0.1)
    multipliers = np.random.default_rng(0).uniform(-1, 1, len(rows.place))
    gradient, hessian = rows.gradient(q), rows.hessian(q, multipliers)
    for j in range(robot.n):
        step = np.zeros(robot.n)
        step[j] = 1e-5
        slope = (rows.value(q + step) - rows.value(q - step)) / 2e-5
        assert np.allclose(gradient[:, j], slope, atol=1e-7)
        bent = (rows.gradient(q + step) - rows.gradient(q - step)) / 2e-5 * multipliers[:, None]
        sums = np.zeros((len(u), robot.n))
        np.add.at(sums, rows.place, bent)
        assert np.allclose(hessian[:, j], sums, atol=1e-7)
    for k in range(len(u)):
        near = dict(cell.distances(q[k], 0.1))
        here = rows.place == k
        assert here.any() or not near
        assert not near or min(rows.value(q)[here]) * 0.1 <= min(near.values()) + 1e-5
    assert len(set(rows.keys.tolist())) == len(rows.keys)


def test_bodies_of_many_pieces_have_rows_for_the_nearest_of_them() -> None:
    """With rows for all, a round of an xarm7's search had fourteen thousand and took eight seconds."""
    robot = load_robot("xarm7")
    cell = Cell(robot, CellRequest())
    q = np.linspace([1.2, 0.4, 2.0, 0.2, 0.2, 1.4, 0.5], [2.2, 1.6, -0.1, -0.1, 1.5, 2.0, 2.8], 5)
    rows = Near(cell.bodies).constraints(np.linspace(0, 1, 5), q, np.full((5, len(cell.bodies.pairs)), 0.002), 0.1)
    assert np.bincount(rows.place).max() <= 6 * len(cell.bodies.pairs)
    for k in range(5):
        least = min(distance for _, distance in cell.distances(q[k], 0.1))
        assert min(rows.value(q)[rows.place == k]) * 0.1 <= least + 1e-5


def test_check_says_what_a_trajectory_touches(panda: Robot, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    file, scene = tmp_path / "move.csv", tmp_path / "scene.yaml"
    q = np.stack([START, START + 0.05])
    t = along(straight(*q), 2.0, 50)
    kinds = {"position": t.position, "velocity": t.velocity, "acceleration": t.acceleration}
    header = ["time", *(f"{joint}.{kind}" for kind in kinds for joint in panda.joints)]
    write_table(file, header, [t.time, *(column for block in kinds.values() for column in block.T)])
    assert main(["check", str(file), "--robot", "panda"]) == 0
    poses = Kinematics(panda.body.tree())(q)
    x, y, z = poses.origin[0, 4]
    scene.write_text(f"objects:\n- {{name: post, type: sphere, radius: 0.05, position: [{x}, {y}, {z}]}}\n")
    assert main(["check", str(file), "--robot", "panda", "--scene", str(scene)]) == 2
    error = capsys.readouterr().err
    assert "collision: panda_link6–post at " in error
    assert main(["check", str(file), "--robot", "panda", "--floor", "0.2"]) == 2
    assert main(["check", str(file), "--robot", "panda", "--floor", "0.2", "--self-collision", "off"]) == 2
    assert "floor" in capsys.readouterr().err


def test_a_scene_of_a_thousand_objects_costs_in_proportion(panda: Robot) -> None:
    """Small boxes all around, out of reach: time grows with their number, and what is kept of them does."""

    def measured(count: int) -> tuple[float, int]:
        rng, objects = np.random.default_rng(0), []
        for k in range(count):
            pose, angle = np.eye(4), rng.uniform(0, 2 * np.pi)
            pose[:3, 3] = 2 * np.cos(angle), 2 * np.sin(angle), rng.uniform(0, 1.5)
            objects.append(SceneObject(f"box {k}", (Shape("box", (0.05, 0.05, 0.05)),), pose))
        begin = time.process_time()
        cell = Cell(panda, CellRequest(), Scene(tuple(objects)))
        tracemalloc.start()
        found = judged(cell, along(straight(START, START + 0.4), 2.0, 101))
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert found.proven and found.pairs > 15 * count
        return time.process_time() - begin, peak

    few, many = (min(measured(count) for _ in range(2)) for count in (250, 1000))  # the quicker run of two
    assert many[0] < 8 * few[0] and many[1] < 5 * few[1]  # quadratic would be 16 times


def test_poses_among_thousands_of_objects_are_checked_alike_and_quickly(panda: Robot) -> None:
    """Boxes in reach, alone and with thousands far away: a path's room calls the same poses clear, in a short time."""
    rng = np.random.default_rng(0)

    def boxes(count: int, radius: float) -> tuple[SceneObject, ...]:
        out = []
        for k in range(count):
            pose, angle = np.eye(4), rng.uniform(0, 2 * np.pi)
            pose[:3, 3] = radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0, 1)
            out.append(SceneObject(f"{radius} {k}", (Shape("box", (0.1, 0.1, 0.1)),), pose))
        return tuple(out)

    near, ends = boxes(6, 0.7), np.array([START, START])
    few = Room(Cell(panda, CellRequest(), Scene(near)), ends)
    crowded, begin = Cell(panda, CellRequest(), Scene(near + boxes(2500, 3.0))), time.process_time()
    many, poses = Room(crowded, ends), START + rng.normal(0.0, 0.5, (200, 7))
    verdicts = [many.clear(q) for q in poses]
    assert time.process_time() - begin < allowed(5)  # it was 20 s
    assert verdicts == [few.clear(q) for q in poses] and 0 < sum(verdicts) < 200
