"""Joints that follow others: torque, poses, bodies, limits and names, against what shares nothing with them."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from independent import Arm
from mimic_arms import GOAL, ODD, ODD_OWN, PALLETIZER, PALLETIZER_ALL, START, odd_arm

from energy_opt import load_robot
from energy_opt.cell.bodies import Scenery
from energy_opt.cell.cell import Cell
from energy_opt.cell.planes import Near
from energy_opt.cell.proof import least_heights, turns
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import Scene, SceneObject, Shape
from energy_opt.diagnosis.hypothesis.links import deviations_of
from energy_opt.dynamics import torque_function
from energy_opt.dynamics.compact import tool_state
from energy_opt.errors import BadInput
from energy_opt.motion.limits.tube import Tube
from energy_opt.motion.path import through
from energy_opt.motion.trajectory import Trajectory
from energy_opt.reports.motion import Played, player
from energy_opt.robot import PointMass, Robot, tool_of


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mimic")
    (folder / "palletizer.urdf").write_text(PALLETIZER)
    (folder / "odd.urdf").write_text(odd_arm())
    return folder


@pytest.fixture(scope="module")
def palletizer(files: Path) -> Robot:
    return load_robot(files / "palletizer.urdf")


@pytest.fixture(scope="module")
def odd(files: Path) -> Robot:
    return load_robot(files / "odd.urdf")


def odd_all(x: np.ndarray, offset: bool) -> np.ndarray:
    """All joints of `ODD` from (c, d, f), by hand."""
    c, d, f = x.T
    a, b = 0.7 * d + 0.2 * offset, -0.3 * c + 0.05 * offset
    return np.column_stack([a, b, c, d, -2.0 * a - 0.1 * offset, f, 3.0 * f])


def states(n: int, count: int = 60) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q, v, a = np.random.default_rng(4).normal(size=(3, count, n))
    return q, v, a


def test_torque_of_an_odd_tree_is_the_virtual_work_of_all_its_joints(odd: Robot) -> None:
    """By a recursion that shares no code, projected by hand; as numbers, one by one and many, and as symbols."""
    q, v, a = states(3)
    arm = Arm(odd_arm(), [name for name, *_ in ODD])
    arm.carry(0.7, np.array([0.1, -0.2, 0.05]))
    full = arm.torque(odd_all(q, True), odd_all(v, False), odd_all(a, False))
    slopes = np.array([[0, 0.7, 0], [-0.3, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1.4, 0], [0, 0, 1], [0, 0, 3]])
    payload = PointMass(0.7, np.array([0.1, -0.2, 0.05]))
    assert odd.joints == ODD_OWN
    assert np.allclose(odd.body.torque(q, v, a, payload), full @ slopes, rtol=1e-9, atol=1e-9)
    assert np.allclose(odd.body.torque(q[:3], v[:3], a[:3], payload), full[:3] @ slopes, rtol=1e-9, atol=1e-9)
    tau = torque_function(odd.body)
    symbolic = [np.array(tau(*row, odd.body.gravity, 0.7, payload.com)).ravel() for row in zip(q, v, a, strict=True)]
    assert np.allclose(symbolic, full @ slopes, rtol=1e-9, atol=1e-9)


def test_the_palletizer_is_pinocchios_own(palletizer: Robot, files: Path) -> None:
    """Against Pinocchio's model with mimic joints: torque and where links are; power is what energy gains."""
    model = pin.buildModelFromUrdf(str(files / "palletizer.urdf"), mimic=True)
    data, body = model.createData(), palletizer.body
    q, v, a = states(5, 55)
    c = np.column_stack([q[:, :3], np.cos(q[:, 3]), np.sin(q[:, 3]), q[:, 4]])  # j4 has no end
    assert palletizer.joints == ("j1", "j2", "j3", "j4", "tip_a")
    assert tuple(link.name for link in body.tree()) == PALLETIZER_ALL
    assert body.tree()[body.last].name == "j4"  # neither the rod, which comes last in the file, nor a finger
    expected = [pin.rnea(model, data, *row) for row in zip(c, v, a, strict=True)]
    assert np.allclose(body.torque(q, v, a), expected, rtol=1e-10, atol=1e-9)
    h = 1e-6
    gained = (body.energy(q + h * v, v + h * a) - body.energy(q - h * v, v - h * a)) / (2 * h)
    assert np.allclose(gained, np.sum(body.torque(q, v, a) * v, axis=1), rtol=1e-6, atol=1e-5)
    joint, pose = body.link_frames()["head"]
    poses, velocity, _ = body.frame_motion(joint, pose, q, v, a)
    for k in range(len(q)):
        pin.forwardKinematics(model, data, c[k], v[k])
        assert np.allclose(poses[k], data.oMi[model.getJointId("j3_head")].homogeneous, atol=1e-12)
        assert np.allclose(poses[k][:3, 2], [0, 0, 1], atol=1e-12)  # the head stays level
        moved = pin.getVelocity(model, data, model.getJointId("j3_head"), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        assert np.allclose(velocity[k], moved.linear, atol=1e-12)


@pytest.mark.parametrize("name", ["palletizer", "odd"])
def test_regressors(name: str, request: pytest.FixtureRequest) -> None:
    robot: Robot = request.getfixturevalue(name)
    body, n = robot.body, robot.n
    links = body.tree()
    about = [x.inertia + x.mass * (x.lever @ x.lever * np.eye(3) - np.outer(x.lever, x.lever)) for x in links]
    six = [i[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]] for i in about]
    phi = np.concatenate([[x.mass, *(x.mass * x.lever), *i] for x, i in zip(links, six, strict=True)])
    rows = states(n, 5)
    regressor = body.link_regressor(*rows)
    assert regressor.shape == (5, n, 10 * len(links)) and np.allclose(regressor @ phi, body.torque(*rows), atol=1e-8)
    # deviations are those of links with a joint of their own; a heavier one by the regressor and by another body
    basis, own = deviations_of(body), body.own_links()
    assert basis.shape == (10 * len(links), 10 * n) and [link.name for link in own] == list(robot.joints)
    mass = np.array([link.mass for link in own]) * np.linspace(1.1, 1.3, n)
    amounts = np.zeros(10 * n)
    amounts[::10] = np.linspace(0.1, 0.3, n)
    heavier = np.array([x.inertia * (1 + s) for x, s in zip(own, amounts[::10], strict=True)])
    other = body.with_links(mass, np.array([x.lever for x in own]), heavier)
    assert np.allclose(regressor @ (phi + basis @ amounts), other.torque(*rows), atol=1e-8)


@pytest.mark.parametrize("name", ["palletizer", "odd"])
def test_tools_and_tubes_follow(name: str, request: pytest.FixtureRequest) -> None:
    """A tool as symbols against Pinocchio's numbers, and a tube's rows against differences of their values."""
    robot: Robot = request.getfixturevalue(name)
    follower = next(link.name for link in reversed(robot.body.tree()) if link.follows is not None)
    tool = tool_of(robot.body, f"{follower},0.02,0.1,-0.03")
    q, v, a = states(robot.n, 4)
    poses, velocity, acceleration = robot.body.frame_motion(tool.joint, np.array(tool.pose), q, v, a)
    x = [ca.SX.sym(word, robot.n) for word in "qva"]
    state = tool_state(robot.body.tree(), tool, *x)
    function = ca.Function("tool", x, [state.position, state.rotation, state.velocity, state.acceleration])
    for k in range(len(q)):
        place, turn, speed, change = (np.array(y) for y in function(q[k], v[k], a[k]))
        assert np.allclose(place.ravel(), poses[k, :3, 3]) and np.allclose(turn, poses[k, :3, :3])
        assert np.allclose(turn @ speed.ravel(), velocity[k]) and np.allclose(turn @ change.ravel(), acceleration[k])
    path = through(np.stack([q[0], q[0] + 0.3, q[1] * 0.3 + q[0]]))
    rows = Tube.of(robot, path, "0.05m", tool).places(lambda u: path(u))
    at, weight = (
        path(rows.u) + 0.01 * np.random.default_rng(1).normal(size=(len(rows.u), robot.n)),
        np.ones(len(rows.u)),
    )
    gradient, hessian = rows.gradient(at).copy(), rows.hessian(at, weight)
    for j in range(robot.n):
        step = 1e-6 * np.eye(robot.n)[j]
        slope = (rows.value(at + step).copy() - rows.value(at - step).copy()) / 2e-6
        assert np.allclose(gradient[:, j], slope, atol=2e-5 * np.abs(gradient).max())
        bent = (rows.gradient(at + step).copy() - rows.gradient(at - step).copy()) / 2e-6
        assert np.allclose(hessian[:, j], bent, atol=1e-4 * np.abs(hessian).max())


@pytest.fixture(scope="module")
def cell(palletizer: Robot) -> Cell:
    """The palletizer among a box, a ball and the floor."""
    places = ((0.75, 0.35, 0.45), Shape("box", (0.2, 0.1, 0.5))), ((0.5, 0.0, 0.45), Shape("sphere", (0.08,)))
    things = []
    for k, (place, shape) in enumerate(places):
        pose = np.eye(4)
        pose[:3, 3] = place
        things.append(SceneObject(f"thing {k}", (shape,), pose))
    return Cell(palletizer, CellRequest(floor=-0.05), Scene(tuple(things)))


def test_bodies_are_never_nearer_than_bounds_say(cell: Cell) -> None:
    """Within an interval of the joints that move by themselves: no distance is below what travel or heights leave."""
    b, rng, total, turned = cell.bodies, np.random.default_rng(1), 0, 0
    followers = [k for k, link in enumerate(cell.robot.body.tree()) if link.follows is not None]
    for size in (0.005, 0.02, 0.06):
        q = START + rng.uniform(0, 1, 5) * (GOAL - START)
        far = size * rng.uniform(0.2, 1.0, (1, 5)) * [1, 1, 1, 1, 0.1]
        near = dict(cell.distances(q, 1.0))
        pair = np.array([p for p, d in near.items() if d > 0])
        k, scene = np.zeros(len(pair), dtype=int), Scenery(b, q[None])
        _, box_a, box_b = scene.apart(k, pair)
        reach = b.kinematics.coupling.reach(far)
        travel, normals = scene.travel(k, pair, (box_a, box_b), reach[k]), []
        for p in pair.tolist():
            b.ruler(p).near(*(scene.placed(0, side) for side in b.pairs[p].tolist()))
            normals.append(b.ruler(p).near.normal)
        flat = np.flatnonzero(b.planar[pair])
        rest = (travel * turns(b, pair, reach[k]))[flat]
        high = least_heights(scene, k[flat], pair[flat], np.array(normals)[flat], far[k[flat]], rest)
        low = np.array([near[p] for p in pair.tolist()]) - travel
        turned += int(np.sum(b.moves[:, pair][:, :, followers].any(axis=(0, 2))))
        around = q + far * np.sign(rng.normal(size=(60, 5))) * rng.choice([1.0, 0.6], (60, 1))
        found = Scenery(b, around)
        for at in range(len(around)):
            here = np.array(
                [b.ruler(p).near(*(found.placed(at, s) for s in b.pairs[p].tolist())) for p in pair.tolist()]
            )
            assert (here >= low - 1e-5).all() and (here[flat] >= high - 1e-5).all()
        total += len(pair)
    assert total > 60 and turned > 40


def test_rows_over_planes_have_the_derivatives_of_their_values(cell: Cell) -> None:
    u = np.linspace(0, 1, 8)
    q = START + u[:, None] * (GOAL - START)
    rows = Near(cell.bodies).constraints(u, q, np.full((len(u), len(cell.bodies.pairs)), 0.002), 0.2)
    weight = np.random.default_rng(0).uniform(-1, 1, len(rows.place))
    gradient, hessian = rows.gradient(q).copy(), rows.hessian(q, weight)
    assert len(rows.place) > 20 and gradient.shape == (len(rows.place), 5)
    for j in range(5):
        step = 1e-5 * np.eye(5)[j]
        slope = (rows.value(q + step).copy() - rows.value(q - step).copy()) / 2e-5
        assert np.allclose(gradient[:, j], slope, atol=1e-6)
        bent = (rows.gradient(q + step).copy() - rows.gradient(q - step).copy()) / 2e-5 * weight[:, None]
        sums = np.zeros((len(u), 5))
        np.add.at(sums, rows.place, bent)
        assert np.allclose(hessian[:, j], sums, atol=1e-6)


def test_the_page_plays_all_joints(cell: Cell) -> None:
    time, still = np.linspace(0, 1, 5), np.zeros((5, 5))
    t = Trajectory(cell.robot.joints, time, START + time[:, None] * (GOAL - START), still, still)
    shown = player(cell.robot, [Played("result", t)], cell)
    assert shown is not None and len(shown["tree"]) == 9
    first, last = shown["motions"][0]["position"][0], shown["motions"][0]["position"][-1]
    assert first == [0.0] * 9 and last == [1.2, 0.5, -0.5, 0.4, -0.4, 1.0, 0.03, -0.03, 0.5]
    placed = cell.bodies.kinematics(GOAL[None]).origin[0, list(PALLETIZER_ALL).index("j4")]
    assert np.allclose(shown["motions"][0]["tools"][0][-1], placed, atol=1e-4)


def test_followers_limits_are_kept_by_their_leaders(files: Path, tmp_path: Path) -> None:
    robot = load_robot(files / "odd.urdf")
    # a = 0.7 d + 0.2 and e = -1.4 d - 0.5 (no end) within [-9, 9]; |1.4 v_d| <= 9; g = 3 f
    assert robot.limits.lower == pytest.approx([-9, -9.2 / 0.7, -3])
    assert robot.limits.upper == pytest.approx([9, 8.8 / 0.7, 3])
    assert robot.limits.velocity == pytest.approx([9, 9 / 1.4, 3]) and robot.limits.effort.tolist() == [900] * 3
    assert "d: velocity limit 6.42857 rad/s, so that e (-1.4 times it) keeps its own" in robot.warnings
    limits = tmp_path / "joint_limits.yaml"
    limits.write_text(
        "joint_limits:\n  j2: {max_velocity: 1.5}\n  j3_head: {has_acceleration_limits: true, max_acceleration: 4.0}\n"
        "  tip_b: {min_position: -0.02, max_position: 0.0}\n"
    )
    held = load_robot(files / "palletizer.urdf", limits=limits)
    assert held.limits.velocity[1] == 1.5 and held.limits.acceleration[2] == 4.0 and held.limits.upper[4] == 0.02
    limits.write_text("joint_limits:\n  tip_b: {min_position: 0.01, max_position: 0.02}\n")
    with pytest.raises(BadInput, match=r"tip_a: no position in its limits \[0, 0.05\] leaves tip_b, which follows it"):
        load_robot(files / "palletizer.urdf", limits=limits)


def test_what_follows_a_still_joint_is_still_and_what_follows_nothing_is_refused(files: Path, tmp_path: Path) -> None:
    still = load_robot(files / "palletizer.urdf", lock={"tip_a": 0.02, "j2": 0.3})
    assert still.joints == ("j1", "j3", "j4")
    assert still.locked == {"tip_a": 0.02, "tip_b": -0.02, "j2": 0.3, "j2_plate": -0.3, "j2_rod": 0.3}
    held = load_robot(files / "palletizer.urdf", lock={"j2_rod": 0.1})  # by its own name: it does not follow
    assert held.joints == ("j1", "j2", "j3", "j4", "tip_a") and held.locked == {"j2_rod": 0.1}
    path = tmp_path / "arm.urdf"
    for old, new, words in (
        (
            'joint="j3"',
            'joint="j5"',
            "joint 'j3_head', mimic: joint='j5'; expected the name of another joint that moves",
        ),
        ('joint="j3"', 'joint="j3_head"', "expected the name of another joint that moves"),
        ('multiplier="-1"/>', 'multiplier="half"/>', "multiplier='half' is not a finite number"),
    ):
        path.write_text(PALLETIZER.replace(old, new, 1))
        with pytest.raises(BadInput, match=words):
            load_robot(path)
    circle = odd_arm().replace(
        '<joint name="d" type="continuous"><parent', '<joint name="d" type="continuous"><mimic joint="e"/><parent'
    )
    path.write_text(circle)
    with pytest.raises(BadInput, match="joint 'a', mimic: a follows d follows e follows a: a circle"):
        load_robot(path)
    path.write_text(PALLETIZER.replace('joint="j3" multiplier="-1"', 'joint="j3" multiplier="0" offset="0.1"'))
    assert load_robot(path).locked == {"j3_head": 0.1}
