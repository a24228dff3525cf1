"""Goals as poses of the tool: branches, freedom, what is said where none is reached, and the goal that is chosen."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from energy_opt.cell.load import load_cell, scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.errors import BadInput, Infeasible
from energy_opt.front.given import source_model
from energy_opt.front.rivals import rivals_from
from energy_opt.jobs import check_job, load_job
from energy_opt.motion import Move, Planner, Settings, Trajectory
from energy_opt.motion.judge.energy import Scorer
from energy_opt.placement import PlaceRequest, place
from energy_opt.placement.search import Search
from energy_opt.poses.choose import Chooser
from energy_opt.poses.estimate import curves, straight
from energy_opt.poses.freedom import Bent, improved
from energy_opt.poses.given import Given, in_base, poses_of_request
from energy_opt.poses.inverse import ToolKinematics, jacobian_of, reach, solve
from energy_opt.poses.pose import Freedom, Pose, missed, pose_from
from energy_opt.poses.sets import Ring, layer
from energy_opt.robot import load_robot


@pytest.fixture(scope="module")
def ur() -> ToolKinematics:
    return ToolKinematics(load_robot("ur5e"))


def pose_at(tool: ToolKinematics, q: np.ndarray, **more: object) -> Pose:
    rotation, origin = tool(q[None])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation[0], origin[0]
    return Pose(matrix, **more)


def by_pinocchio(robot: object, q: np.ndarray) -> np.ndarray:
    """The last joint's frame (4, 4), from a model that Pinocchio reads from the URDF itself."""
    model = pin.buildModelFromUrdf(str(robot.urdf))
    full = pin.neutral(model)
    for name, value in zip(robot.joints, q, strict=True):
        full[model.joints[model.getJointId(name)].idx_q] = value
    data = model.createData()
    pin.forwardKinematics(model, data, full)
    return data.oMi[model.getJointId(robot.joints[-1])].homogeneous


def ur_branches(tool: ToolKinematics, pose: Pose) -> int:
    """How many branches there are, by exhaustion: a grid of starts over all joints, each brought to the pose."""
    from scipy.optimize import least_squares

    found: list[np.ndarray] = []
    for start in product((-2.5, -0.8, 0.8, 2.5), (-2.2, -0.7), (-1.5, 1.5), (-1.0, 1.0), (-1.5, 1.5), (0.5,)):
        result = least_squares(lambda q: tool.missed(pose, q[None]).both[0], np.array(start), xtol=1e-14)
        if np.abs(result.fun).max() < 1e-8:
            q = (result.x + np.pi) % (2 * np.pi) - np.pi
            if all(np.abs((q - other + np.pi) % (2 * np.pi) - np.pi).max() > 1e-3 for other in found):
                found.append(q)
    return len(found)


def test_all_branches_of_a_ur_are_found(ur: ToolKinematics) -> None:
    q = np.array([0.4, -1.2, 1.4, -1.1, -1.3, 0.3])
    pose = pose_at(ur, q)
    found = reach(ur, pose, near=q).positions
    for row in found:
        assert np.abs(by_pinocchio(ur.robot, row) - by_pinocchio(ur.robot, q)).max() < 1e-7
    wrapped = {tuple(np.round((row + np.pi) % (2 * np.pi) - np.pi, 3)) for row in found}
    assert len(wrapped) == 8 == ur_branches(ur, pose)
    assert np.abs(found - q).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("name", ["panda", "ur5e", "xarm7", "z1"])
def test_a_pose_that_was_reached_is_found_again(name: str) -> None:
    tool = ToolKinematics(load_robot(name))
    limits = tool.robot.limits
    q = np.random.default_rng(3).uniform(np.maximum(limits.lower, -2), np.minimum(limits.upper, 2))
    found = reach(tool, pose_at(tool, q), starts=200).positions
    assert len(found)
    assert (found >= limits.lower).all() and (found <= limits.upper).all()
    for row in found[:3]:
        assert np.abs(by_pinocchio(tool.robot, row) - by_pinocchio(tool.robot, q)).max() < 1e-7


def test_freedom_counts_within_its_range_and_not_beyond() -> None:
    turn = pin.exp3(np.array([0.0, 0.0, 0.5]))
    shifted, origin = turn[None], np.array([[0.0, 0.002, 0.0]])
    free = Pose(np.eye(4), (Freedom.of("rz"), Freedom.of("y:-5:5")))
    assert np.abs(missed(free, shifted, origin).both).max() < 1e-12
    narrow = Pose(np.eye(4), (Freedom.of("rz:-10:10"), Freedom.of("y:-1:1")))
    off = missed(narrow, shifted, origin).both[0]
    assert off[1] == pytest.approx(0.001)
    assert off[5] == pytest.approx(0.5 - np.radians(10))
    two = Pose(np.eye(4), (Freedom.of("rx"), Freedom.of("ry")))
    tilted = (pin.exp3(np.array([0.3, 0, 0])) @ pin.exp3(np.array([0, -0.7, 0])))[None]
    assert np.abs(missed(two, tilted, np.zeros((1, 3))).both).max() < 1e-12
    assert np.abs(missed(two, tilted @ turn, np.zeros((1, 3))).both).max() == pytest.approx(0.5)


def test_words_of_poses() -> None:
    pose = pose_from("0.1,0.2,0.3,0,0,0.7071068,0.7071068", ["rz:-30:30"], "1mm,2deg")
    assert np.allclose(pose.matrix[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-6)
    assert pose.tolerance == pytest.approx((1e-3, np.radians(2)))
    assert np.allclose(pose_from([0.1, 0.2, 0.3, 0, 0, np.pi / 2]).matrix, pose.matrix, atol=1e-6)
    for words in ("1,2,3", "0,0,0,1,1,1,1", "400,0,300,0,0,0", "a,0,0,0,0,0"):
        with pytest.raises(BadInput):
            pose_from(words)
    with pytest.raises(BadInput, match="expected one of x, y, z"):
        Freedom.of("yaw")


START = ["--robot", "ur5e", "--start", "0,-1.57,1.57,-1.57,-1.57,0", "--model", "source-method-2", "--quiet"]


def test_a_pose_out_of_reach_says_how_near_one_can_come(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = [*START, "--goal-pose", "2,0,0.3,0,0,0", "--out", str(tmp_path)]
    assert main(["optimize", *options]) == 3
    said = capsys.readouterr().err
    assert "no joint positions reach it" in said
    assert "mm and" in said
    assert main(["optimize", *START, "--goal", "0,0,0,0,0,0", "--free", "rz", "--out", str(tmp_path)]) == 2
    assert "--free belongs to --goal-pose" in capsys.readouterr().err


@pytest.mark.slow
def test_the_chosen_goal_costs_no_more_than_the_nearest(tmp_path: Path) -> None:
    options = [*START, "--goal-pose", "0.4,0.3,0.3,3.14159265,0,0", "--free", "rz", "--duration", "2", "--starts", "3"]
    assert main(["optimize", *options, "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "result.json").read_text())
    energies = [c["energy"] for c in found["candidates"] if c["energy"] is not None]
    assert found["energy"]["total"] == pytest.approx(min(energies))
    assert found["energy"]["total"] <= found["nearest"]["energy"] + 1e-6
    assert found["poses"]["goal"]["valid"]
    last = np.loadtxt(tmp_path / "trajectory.csv", delimiter=",", skiprows=1)[-1]
    q = last[1:7]
    at = by_pinocchio(load_robot("ur5e"), q)
    assert np.linalg.norm(at[:3, 3] - [0.4, 0.3, 0.3]) < 2e-6
    assert np.arccos(np.clip(-at[2, 2], -1, 1)) < 1e-5  # the tool points down, turned as it likes


@pytest.mark.slow
def test_of_several_goals_the_cheapest_is_taken(tmp_path: Path) -> None:
    near, far = "0.1,-1.5,1.5,-1.5,-1.5,0.1", "2.9,-1.5,1.5,-1.5,-1.5,0.1"  # equally high
    options = [*START, "--goal", far, "--goal", near, "--duration", "2", "--starts", "2", "--out", str(tmp_path)]
    assert main(["optimize", *options]) == 0
    found = json.loads((tmp_path / "result.json").read_text())
    assert np.allclose(found["candidates"][0]["goal"], [float(x) for x in near.split(",")])


JOB = """
format = "energy-opt/job/1"
robot = "ur5e"
cycle_time = 6.0
home = [0, -1.57, 1.57, -1.57, -1.57, 0]
[poses]
part = { pose = [0.45, 0.2, 0.1, 3.14159265, 0, 0], free = ["rz:-30:30"] }
[[step]]
to = "part"
[[step]]
name = "place"
pose = "world: -0.2, 0.5, 0.2, 3.14159265, 0, 0"
pose_tolerance = "1mm,1deg"
[[step]]
to = "home"
"""


def test_poses_in_a_job_stay_open_until_they_are_chosen(tmp_path: Path, ur: ToolKinematics) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    job = load_job(path, lambda name: ur.robot)
    assert job.open == (0, 1)
    assert job.steps[0].pose.free[0].high == pytest.approx(np.radians(30))
    assert job.steps[1].pose.frame == "world"
    assert job.steps[1].pose.tolerance == pytest.approx((1e-3, np.radians(1)))
    ends = {0: np.ones(6), 1: np.zeros(6)}
    closed = job.at(ends)
    assert not closed.open
    assert np.array_equal(closed.steps[1].start, ends[0]) and np.array_equal(closed.steps[2].start, ends[1])
    assert np.array_equal(closed.steps[0].start, job.steps[2].goal)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('to = "part"', 'to = "home"\nfree = ["rz"]', "is joint positions; free belongs to a pose"),
        ('to = "part"', 'to = "part"\npose = "part"', "either `to` or `pose`"),
        ('free = ["rz:-30:30"]', 'free = ["yaw"]', "expected one of x, y, z"),
        ("[0.45, 0.2, 0.1, 3.14159265, 0, 0]", "[0.45, 0.2]", "2 numbers; expected X,Y,Z"),
        ('"1mm,1deg"', "3", "such as"),
        ('to = "home"', 'pose = "part"', "does not return to where the cycle begins"),
    ],
)
def test_faults_of_poses_in_a_job(tmp_path: Path, ur: ToolKinematics, old: str, new: str, says: str) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB.replace(old, new))
    assert any(says in line for line in check_job(path, lambda name: ur.robot))


def test_a_pose_in_the_frame_of_an_object_and_from_a_message(tmp_path: Path, ur: ToolKinematics) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "objects: [{name: box_1, type: box, size: [0.1, 0.1, 0.1], position: [0.5, 0.1, 0.2],"
        " quaternion: [0, 0, 0.70710678, 0.70710678]}]\nposes: {pick: {pose: 'box_1: 0.1,0,0,0,0,0', free: [rz]}}\n"
    )
    (tmp_path / "at.yaml").write_text(
        "header: {frame_id: box_1}\npose: {position: {x: 0.1, y: 0, z: 0}, orientation: {x: 0, y: 0, z: 0, w: 1}}\n"
    )
    request = CellRequest(scene=scene, base=(0.5, 0, 0, 0, 0, np.pi / 2))
    given = Given(tmp_path, poses_of_request(request))
    for word in ("pick", "at.yaml", "box_1: 0.1,0,0,0,0,0"):
        pose = in_base(given.pose(word, "goal"), ur.robot, scene_of(request), request.base_pose)
        # the object is turned by 90 deg as the base is; 0.1 m along its x is 0.1 m along the scene's y
        assert np.allclose(pose.matrix[:3, 3], [0.2, 0.0, 0.2], atol=1e-6)
        assert np.allclose(pose.matrix[:3, :3], np.eye(3), atol=1e-6)
    assert given.pose("pick", "goal").free[0].axis == "rz"
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(scene.read_text().replace("free: [rz]", "free: [turn]"))
    assert main(["check", str(scene), "--quiet"]) == 0
    assert main(["check", str(wrong), "--quiet"]) == 2
    with pytest.raises(BadInput, match="no frame 'box_2'; did you mean 'box_1'"):
        in_base(given.pose("box_2: 0,0,0,0,0,0", "goal"), ur.robot, scene_of(request), request.base_pose)


def test_a_tolerance_is_used_up_to_its_bound_and_not_beyond(ur: ToolKinematics) -> None:
    q = np.array([0.4, -1.2, 1.4, -1.1, -1.3, 0.3])
    pose = pose_at(ur, q, tolerance=(5e-3, np.radians(2)))
    wanted = np.array([0.9, 0.5, -0.3, 0.2, 0.1, -0.4])
    better = improved(ur, pose, q, lambda rows: rows @ wanted, None)
    off = by_pinocchio(ur.robot, better) @ np.linalg.inv(by_pinocchio(ur.robot, q))
    at = np.linalg.norm(by_pinocchio(ur.robot, better)[:3, 3] - by_pinocchio(ur.robot, q)[:3, 3])
    assert 0.999 * 5e-3 < at <= 5e-3
    angle = np.linalg.norm(pin.log3(off[:3, :3]))
    assert 0.999 * np.radians(2) < angle <= np.radians(2)


def test_along_a_free_axis_the_cheapest_positions_are_found(ur: ToolKinematics) -> None:
    q = np.array([0.4, -1.2, 1.4, -1.1, -np.pi / 2, 0.3])
    pose = pose_at(ur, q, free=(Freedom("rz", -0.5, 0.2),))
    better = improved(ur, pose, q, lambda rows: (rows[:, 5] - 3.0) ** 2, None)
    assert abs(better[5] - q[5]) == pytest.approx(0.5, abs=1e-6) or abs(better[5] - q[5]) == pytest.approx(
        0.2, abs=1e-6
    )
    free = pose_at(ur, q, free=(Freedom("rz"),))
    assert improved(ur, free, q, lambda rows: (rows[:, 5] - 1.1) ** 2, None)[5] == pytest.approx(1.1, abs=1e-3)


def test_the_ring_is_the_cheapest_of_all(ur: ToolKinematics) -> None:
    """Against all combinations, at the price of waiting."""
    scorer = [Scorer(ur.robot, rivals_from(["source-method-2"], None, ur.robot, None)[0][0].model)]
    rng = np.random.default_rng(1)
    layers = [layer(scorer, rng.uniform(-1, 1, (count, 6)), wait) for count, wait in ((3, 0.5), (2, 0.0), (3, 1.0))]
    ring = Ring(layers, [scorer] * 3, [(0.0, np.inf)] * 3)
    chosen, energy = ring.cheapest(1e3, 0.0)

    def cost(picked: tuple[int, ...]) -> float:
        q = [each.positions[k] for each, k in zip(layers, picked, strict=True)]
        moves = sum(curves(scorer, q[k][None], q[(k + 1) % 3][None]).cheapest()[0][0] for k in range(3))
        return moves + sum(each.wait * each.standing[k] for each, k in zip(layers, picked, strict=True))

    costs = {picked: cost(picked) for picked in product(range(3), range(2), range(3))}
    assert tuple(chosen) == min(costs, key=lambda picked: costs[picked])
    assert energy == pytest.approx(min(costs.values()))


def test_place_says_that_joint_goals_do_not_change_with_the_base(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "job.toml"
    words = JOB.partition("[[step]]")[0] + '[[step]]\nto = [0.1, -1.5, 1.5, -1.5, -1.5, 0.1]\n[[step]]\nto = "home"\n'
    path.write_text(words)
    assert main(["place", str(path), "--base-box=0,1,0,1,0,0", "--out", str(tmp_path / "out")]) == 2
    assert "joint positions do not change with the base" in capsys.readouterr().err
    assert main(["place", str(path), "--base-box=0,1,0,1,0", "--out", str(tmp_path / "out")]) == 2
    assert "expected X0,X1" in capsys.readouterr().err


@pytest.mark.parametrize("free", [(), ("rz",), ("ry:-40:60", "x:-100:50")])
def test_the_derivative_of_what_is_missed_is_that_of_differences(ur: ToolKinematics, free: tuple[str, ...]) -> None:
    rng = np.random.default_rng(5)
    pose = pose_at(ur, rng.uniform(-1, 1, 6), free=tuple(map(Freedom.of, free)))
    q = rng.uniform(-1.5, 1.5, (20, 6))
    steps = 1e-6 * np.eye(6)
    apart = [(ur.missed(pose, q + d).both - ur.missed(pose, q - d).both) / 2e-6 for d in steps]
    exact = jacobian_of(ur, pose, q, ur.missed(pose, q).both)
    assert np.abs(exact - np.stack(apart, axis=2)).max() < 1e-7


def test_a_panda_is_found_at_every_angle_of_its_redundancy() -> None:
    """Fixing joint 7 on a fine grid leaves isolated branches: each angle that a grid search reaches is near a find."""
    tool = ToolKinematics(load_robot("panda"))
    limits = tool.robot.limits
    pose = pose_at(tool, np.array([0.3, 0.2, -0.4, -1.8, 0.3, 2.0, 0.5]))
    found = reach(tool, pose, near=limits.near_zero).positions[:, 6]
    rng = np.random.default_rng(2)
    for angle in np.linspace(limits.lower[6] + 0.05, limits.upper[6] - 0.05, 24):
        starts = rng.uniform(limits.lower, limits.upper, (40, 7))
        starts[:, 6] = angle
        q, error = solve(tool, pose, starts)
        held = q[(error < 1e-9) & (np.abs(q[:, 6] - angle) < 0.05)]
        if len(held):
            assert np.abs(found - held[0, 6]).min() < 0.35


def test_a_bent_motion_costs_what_it_did_and_changes_as_the_straight_moves_do(ur: ToolKinematics) -> None:
    """Of a straight quintic, bent to another end, the straight quintic to that end is left."""
    scorers = [Scorer(ur.robot, rivals_from(["source-method-2"], None, ur.robot, None)[0][0].model)]
    start, goal, other = np.zeros(6), np.full(6, 0.5), np.full(6, 0.5) + 0.1 * np.eye(6)[2]
    x = np.linspace(0, 1, 200)[:, None]
    way, time = goal - start, 2.0 * x[:, 0]
    rows = Trajectory(
        ur.robot.joints, time, start + way * (x**3 * (10 - 15 * x + 6 * x**2)),
        way * (30 * x**2 * (1 - x) ** 2) / 2.0, way * (60 * x * (1 - x) * (1 - 2 * x)) / 4.0,
    )  # fmt: skip
    bent = Bent(scorers, rows, fixed=True)
    assert bent(None, goal[None])[0] == pytest.approx(scorers[0].energy(rows).total, rel=1e-4)
    expected = straight(scorers, start[None], other[None], np.array([2.0]))[0]
    assert bent(None, other[None])[0] == pytest.approx(expected, rel=1e-3)
    assert bent(start[None], other[None])[0] == bent(None, other[None])[0]


def test_a_proven_placement_comes_before_a_cheaper_one_that_is_none(
    tmp_path: Path, ur: ToolKinematics, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    points = [np.zeros(4), np.array([0.2, 0.0, 0.0, 0.0])]

    def solve(search: Search, point: np.ndarray, kind: str, ends: object = None) -> SimpleNamespace:
        proven = point[0] == 0.0
        found = SimpleNamespace(solved=proven, energy=5.0 if proven else 1.0)
        search.solved[search.place(point)] = {}, found
        return found

    monkeypatch.setattr(Search, "solve", solve)
    monkeypatch.setattr(Search, "estimates", lambda search: [(points[1], 1.0), (points[0], 5.0)])
    job = load_job(path, lambda name: ur.robot)
    found = place(job, source_model(ur.robot), PlaceRequest((-0.2, 0.2, 0.0, 0.0, 0.0, 0.0), seeds=2, steps=0))
    assert found.solved and found.place[0] == 0.0 and found.result.energy == 5.0


def test_a_sketch_is_near_the_answer_and_goals_without_one_are_solved_in_full(ur: ToolKinematics) -> None:
    robot, model = ur.robot, source_model(ur.robot)
    planner, start = Planner(robot, model, Settings(starts=1)), np.array([0.0, -1.5, 1.5, -1.6, -1.5, 0.0])
    goals = [start + 0.8, start - 0.7]
    move = Move(start, goals[0], "reshape", 1.2)
    answer, sketch = planner.solve(move), planner.sketch(move)
    assert sketch.duration == pytest.approx(1.2) and sketch.position[-1] == pytest.approx(goals[0])
    assert planner.score(sketch).total == pytest.approx(answer.energy.total, abs=0.05 * answer.energy.loss)
    with pytest.raises(Infeasible, match="no motion within the limits"):
        planner.sketch(replace(move, duration=0.1))

    def none(move: Move, warm: object) -> Trajectory:
        raise Infeasible("no sketch")

    chosen = Chooser(ur, [Scorer(robot, model)], None, planner.solve, none, planner.settle).choose(move, goals)
    assert chosen.result.status == "solved" and chosen.screened == 2
    assert chosen.candidates[0].energy == pytest.approx(chosen.result.energy.total)


@pytest.mark.parametrize("kind", ["yaml", "json"])  # as lines of ours, and as MoveIt's message with an object's pose
def test_a_fixture_is_placed_with_its_shape_and_the_poses_in_its_frame(
    tmp_path: Path, ur: ToolKinematics, kind: str
) -> None:
    scene, path = tmp_path / f"scene.{kind}", tmp_path / "job.toml"
    if kind == "yaml":
        scene.write_text("objects: [{name: tray, type: box, size: [0.2, 0.2, 0.02], position: [0.4, 0.1, 0.1]}]\n")
    else:
        turn = {"x": 0, "y": 0, "z": 0, "w": 1}
        at = [{"position": {"x": x, "y": y, "z": z}, "orientation": turn} for x, y, z in ((0.4, 0.1, 0.1), (0, 0, 0))]
        tray = {"id": "tray", "pose": at[0], "primitives": [{"type": 1, "dimensions": [0.2, 0.2, 0.02]}],
                "primitive_poses": at[1:]}  # fmt: skip
        scene.write_text(json.dumps({"world": {"collision_objects": [tray]}}))
    path.write_text(JOB.replace('"world: -0.2, 0.5, 0.2,', '"tray: 0, 0, 0.2,'))
    job, request = load_job(path, lambda name: ur.robot), CellRequest(scene=scene)
    box = PlaceRequest((0.2, 0.4, 0.0, 0.5, 0.1, 0.2), (0.0, 1.0), fixture="tray")
    search = Search(
        job, source_model(ur.robot), box, Settings(), request, stopped=lambda: False, progress=lambda t, s: None
    )
    assert search.given == pytest.approx((0.4, 0.1, 0.1, 0, 0, 0))
    cell = search.at(np.array([0.3, 0.4, 0.2, 0.5]))
    q = search.posed(np.array([0.3, 0.4, 0.2, 0.5])).sets[1][0]
    assert by_pinocchio(ur.robot, q)[:3, 3] == pytest.approx([0.3, 0.4, 0.4], abs=1e-6)
    box_ = next(scene_of(cell).placed())  # its shape has moved, too
    assert box_.pose[:3, 3] == pytest.approx([0.3, 0.4, 0.2])
    assert box_.pose[:2, :2] == pytest.approx(np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]]))
    assert load_cell(ur.robot, cell).touching(q) is None
    for name, says in (("desk", "no step ends at a pose in the frame of 'desk'"), ("box", "no object 'box' is fixed")):
        path.write_text(path.read_text().replace("tray: 0, 0, 0.2", "box: 0, 0, 0.2") if name == "box" else JOB)
        other = PlaceRequest(box.box, fixture=name)
        with pytest.raises(BadInput, match=says):
            place(load_job(path, lambda name: ur.robot), source_model(ur.robot), other, cell=request)
        path.write_text(JOB.replace('"world: -0.2, 0.5, 0.2,', '"tray: 0, 0, 0.2,'))


@pytest.mark.slow
def test_a_job_of_poses_costs_no_more_than_with_the_nearest_and_placed_no_more_than_there(tmp_path: Path) -> None:
    path = tmp_path / "job.toml"
    steps = JOB.partition("[[step]]")[2].rpartition("[[step]]")[0].replace("world: ", "")
    path.write_text(JOB.partition("home =")[0] + "[poses]\n" + JOB.partition("[poses]\n")[2].partition("[[step]]")[0]
                    + "[[step]]" + steps)  # fmt: skip
    out = tmp_path / "out"
    words = ["--model", "source-method-2", "--starts", "1", "--quiet", "--out", str(out)]
    assert main(["job", str(path), *words]) == 0
    found = json.loads((out / "job.json").read_text())
    assert found["energy_total"] <= found["choice"]["greedy_nearest"] + 1e-9
    for row, wanted in zip(found["poses"], ([0.45, 0.2, 0.1], [-0.2, 0.5, 0.2]), strict=True):
        last = np.loadtxt(out / f"step_{row['step']:02d}.csv", delimiter=",", skiprows=1)[-1, 1:7]
        off = np.linalg.norm(by_pinocchio(load_robot("ur5e"), last)[:3, 3] - wanted)
        assert off <= (1e-3 if row["step"] == 2 else 1e-6)
    words[-1] = str(tmp_path / "placed")
    counts = ["--looked-at", "10", "--seeds", "1", "--steps", "1"]
    assert main(["place", str(path), "--base-box=-0.1,0.1,-0.1,0.1,0,0", *counts, *words]) == 0
    placed = json.loads((tmp_path / "placed" / "place.json").read_text())
    assert placed["energy_total"] <= placed["given"]["energy_total"]
    job = json.loads((tmp_path / "placed" / "job" / "job.json").read_text())
    assert job["energy_total"] == pytest.approx(placed["energy_total"])
    for row, wanted in zip(placed["goals"], ([0.45, 0.2, 0.1], [-0.2, 0.5, 0.2]), strict=True):
        at = by_pinocchio(load_robot("ur5e"), np.array(row["goal"]))[:3, 3] + placed["base"][:3]
        assert np.linalg.norm(at - wanted) <= (1e-3 if row["step"] == 2 else 1e-6)
