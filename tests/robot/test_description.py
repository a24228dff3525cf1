"""What is held of a description is what its XML says: bodies, masses, neighbours; the rest is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from damaged_descriptions import run

from energy_opt.cell.cell import Cell
from energy_opt.cell.pairs import neighbours
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.robot import Robot, load_robot
from energy_opt.robot.description import read_description

INERTIA = '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/>'
LIMIT = '<limit lower="-2.5" upper="2.5" velocity="2" effort="200"/>'


def chain(folder: Path, *bodies: str, fixed: tuple[int, ...] = (), name: str = "chain") -> Path:
    """An arm of links 0.3 m apart that turn about y, with these collision elements ("" for a link without)."""
    links, joints = [], []
    for k, body in enumerate(bodies):
        inertial = f'<inertial><mass value="1.5"/>{INERTIA}</inertial>' if k else ""
        links.append(f'<link name="l{k}">{inertial}{body}</link>')
        if k:
            kind = "fixed" if k in fixed else "revolute"
            joints.append(
                f'<joint name="j{k}" type="{kind}"><origin xyz="0.3 0 0"/><parent link="l{k - 1}"/><child link="l{k}"/>'
                f'<axis xyz="0 1 0"/>{"" if kind == "fixed" else LIMIT}</joint>'
            )
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="r">{"".join(links)}{"".join(joints)}</robot>')
    return path


def ball(radius: str = "0.15", xyz: str = "0 0 0") -> str:
    return f'<collision><origin xyz="{xyz}"/><geometry><sphere radius="{radius}"/></geometry></collision>'


def pairs(cell: Cell) -> set[tuple[str, str]]:
    names = [cell.bodies.names(p) for p in range(len(cell.bodies.pairs))]
    return {(min(pair), max(pair)) for pair in names}


def test_damaged_descriptions_are_held_as_they_are_or_refused(tmp_path: Path) -> None:
    answers, wrong = run(150, 7, tmp_path)
    assert not wrong, wrong[0][:2]
    assert answers["held"] > 25 and answers["refused"] > 50


@pytest.mark.parametrize("radius", ["0.15 ", " 0.15", "0.15\n", "1.5e-1", "+.15"])
def test_a_body_that_is_written_otherwise_is_the_same_body(tmp_path: Path, radius: str) -> None:
    """One of these made a library drop the body, and what was left was proven free."""
    cell = Cell(load_robot(chain(tmp_path, ball(), ball(), ball(radius), ball())), CellRequest())
    assert cell.links == 4 and {round(b.solid.hull.radius, 12) for b in cell.bodies.all} == {0.15}
    assert pairs(cell) == {("l0", "l2"), ("l0", "l3"), ("l1", "l3")}


def test_masses_written_otherwise_are_the_same(tmp_path: Path) -> None:
    path = chain(tmp_path, ball(), ball())
    for text, mass in (("8.058 ", 8.058), ("\t8.058", 8.058), ("1e1", 10.0)):
        path.write_text(chain(tmp_path, ball(), ball()).read_text().replace('mass value="1.5"', f'mass value="{text}"'))
        assert load_robot(path).body.tree()[0].mass == mass


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (ball(xyz="0.2, 0, 0"), "l1.*xyz='0.2, 0, 0'"),
        (ball("3_0"), "radius='3_0'"),
        (ball("-0.1"), "radius='-0.1'"),
        (ball().replace("sphere radius", "ellipsoid radius"), "holds <ellipsoid>"),
        (ball().replace("<sphere", "<Sphere"), "holds <Sphere>"),
        (ball().replace('<sphere radius="0.15"/>', '<box size="-0.3 0.1 0.1"/>'), "size='-0.3 0.1 0.1'"),
        (ball().replace('<sphere radius="0.15"/>', ""), "holds nothing"),
        (ball().replace("collision>", "colision>"), "<colision> is not read"),
        (ball(xyz="0 0 0.1").replace("<origin", "<orgin"), "<orgin> is not read"),
        (ball().replace("xyz=", "quat_xyzw="), "'quat_xyzw' is not known"),
        (ball().replace("</geometry>", '<box size="1 1 1"/></geometry>'), "holds <sphere>, <box>"),
        (ball().replace("<origin", '<origin xyz="0 0 1"/><origin'), "<origin> is given 2 times"),
        (
            ball().replace("<geometry>", '<geometry><sphere radius="0.2"/></geometry><geometry>'),
            "<geometry> is given 2",
        ),
        ('<collision><geometry><mesh filename="a.stl" scale="0.001"/></geometry></collision>', "scale='0.001'"),
        ('<collision><geometry><mesh filename="a.stl" scale="1 0 1"/></geometry></collision>', "scale='1 0 1'"),
    ],
)
def test_a_body_that_would_be_lost_is_refused(tmp_path: Path, body: str, says: str) -> None:
    path = chain(tmp_path, ball(), body, ball(), ball())
    with pytest.raises(BadInput, match=says) as caught:
        load_robot(path)
    assert "\n" not in str(caught.value)


def test_a_capsule_is_a_body(tmp_path: Path) -> None:
    """Of 0.4 m between the centres of its caps, along the arm stretched out."""
    capsule = (
        ball()
        .replace('<sphere radius="0.15"/>', '<capsule radius="0.1" length="0.4"/>')
        .replace('<origin xyz="0 0 0"/>', '<origin rpy="0 1.5707963267948966 0"/>')
    )
    cell = Cell(load_robot(chain(tmp_path, ball("0.05"), "", "", capsule)), CellRequest())
    assert pairs(cell) == {("l0", "l3")}
    (_, distance), *_ = cell.distances(np.zeros(3), 5.0)
    assert distance == pytest.approx(0.9 - 0.05 - 0.3, abs=1e-6)


def test_links_without_bodies_connect_no_neighbours(tmp_path: Path) -> None:
    """l1 and l3 are two joints apart: the bare link between them does not make them neighbours."""
    path = chain(tmp_path, "", ball("0.05"), "", ball("0.05"))
    assert neighbours(read_description(path)) == []
    cell = Cell(load_robot(path), CellRequest())
    assert pairs(cell) == {("l1", "l3")}
    folded = cell.distances(np.array([0.0, 0.0, 0.0]), 5.0)
    assert folded[0][1] == pytest.approx(0.5, abs=1e-6)


def test_fixed_and_locked_joints_pass_the_connection_on(tmp_path: Path) -> None:
    path = chain(tmp_path, ball("0.05"), "", ball("0.05"), ball("0.05"), fixed=(1,))
    assert neighbours(read_description(path)) == [("l0", "l2"), ("l2", "l3")]
    path = chain(tmp_path, ball("0.05"), "", ball("0.05"), ball("0.05"))
    assert neighbours(read_description(path)) == [("l2", "l3")]
    assert neighbours(read_description(path), {"j1"}) == [("l0", "l2"), ("l2", "l3")]


def test_unchecked_pairs_are_reported(tmp_path: Path) -> None:
    fat = Cell(load_robot(chain(tmp_path, ball("0.5"), ball("0.5"), ball("0.5"))), CellRequest())
    assert not fat.checks and len(fat.warnings) == 2
    assert "no pair of its links is checked" in fat.warnings[0] and "l0 and l2" in fat.warnings[1]
    bare = Cell(load_robot(chain(tmp_path, "", "", ball())), CellRequest())
    assert not bare.checks and "the arm is not checked against itself" in bare.warnings[0]


def test_a_link_and_a_joint_may_share_a_name(tmp_path: Path) -> None:
    path = chain(tmp_path, ball("0.05"), ball("0.05"), ball("0.05"))
    path.write_text(path.read_text().replace('"j1"', '"l2"').replace('"j2"', '"l1"'))
    robot = load_robot(path)
    assert robot.joints == ("l2", "l1") and set(robot.body.link_frames()) == {"l0", "l1", "l2"}
    assert robot.body.link_frames()["l2"][0] == 1 and pairs(Cell(robot, CellRequest())) == {("l0", "l2")}
    still = load_robot(path, lock={"l1": 0.5})
    assert still.joints == ("l2",) and still.body.link_frames()["l2"][0] == 0


@pytest.mark.parametrize("name", ["j1\ndef x():", "j  1", "j'1", "x" * 129, "j;1"])
def test_names_that_could_break_a_file_are_refused(tmp_path: Path, name: str) -> None:
    path = chain(tmp_path, ball(), ball())
    path.write_text(path.read_text().replace('"j1"', f'"{name}"'.replace("\n", "&#10;")))
    with pytest.raises(BadInput, match=r"letters, digits, _ - \. / and"):
        load_robot(path)


def test_a_chain_of_many_fixed_links_is_loaded(tmp_path: Path) -> None:
    """More links than Python calls can be nested."""
    robot = load_robot(chain(tmp_path, *[""] * 1200, fixed=tuple(range(2, 1200))))
    assert robot.joints == ("j1",) and robot.body.link_frames()["l1199"][0] == 0


@pytest.mark.parametrize("name", ["panda", "ur10", "kinova", "xarm7", "z1", "ur5e"])
def test_the_model_is_the_one_that_pinocchio_reads_from_the_file(name: str) -> None:
    robot = load_robot(name)
    held = pin.buildModelFromUrdf(str(robot.urdf))
    locks = [held.getJointId(joint) for joint in robot.locked]
    held = pin.buildReducedModel(held, locks, pin.neutral(held)) if locks else held
    links = robot.body.tree()
    assert [link.name for link in links] == list(held.names)[1:]
    for k, link in enumerate(links, start=1):
        assert link.parent == held.parents[k] - 1
        np.testing.assert_allclose(link.placement, held.jointPlacements[k].homogeneous, atol=1e-12)
        ours = pin.Inertia(link.mass, link.lever, link.inertia)
        np.testing.assert_allclose(ours.matrix(), held.inertias[k].matrix(), atol=1e-12)
    frames = {f.name: f for f in held.frames if f.type == pin.FrameType.BODY}
    for link, (joint, pose) in robot.body.link_frames().items():
        assert joint == frames[link].parentJoint - 1
        np.testing.assert_allclose(pose, frames[link].placement.homogeneous, atol=1e-12)


@pytest.fixture(scope="module")
def torus() -> tuple[np.ndarray, np.ndarray]:
    """A ring of 320,000 triangles: what its hull holds is much more than itself."""
    m, n = 800, 200
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, m, endpoint=False), np.linspace(0, 2 * np.pi, n, endpoint=False))
    ring = 0.05 + 0.02 * np.cos(v)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), 0.02 * np.sin(v)], axis=-1).reshape(-1, 3)
    k = np.arange(m * n).reshape(n, m)
    a, b, c, d = k, np.roll(k, -1, 1), np.roll(k, -1, 0), np.roll(np.roll(k, -1, 0), -1, 1)
    return points, np.vstack([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, d), (a, d, c))])


def stl(path: Path, points: np.ndarray, triangles: np.ndarray) -> Path:
    rows = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")])
    rows["p"] = points[triangles]
    path.write_bytes(b"\0" * 80 + np.uint32(len(triangles)).tobytes() + rows.tobytes())
    return path


MESH = '<collision><geometry><mesh filename="{}"/></geometry></collision>'


@pytest.mark.slow
def test_a_heavy_mesh_takes_about_the_time_of_its_hull(tmp_path: Path, torus: tuple[np.ndarray, np.ndarray]) -> None:
    """Two links with 320,000 triangles each, compared with one convex hull by SciPy."""
    import time

    from scipy.spatial import ConvexHull

    assert stl(tmp_path / "ring.stl", *torus).stat().st_size == pytest.approx(16e6, rel=0.01)
    robot = load_robot(chain(tmp_path, ball("0.02"), MESH.format("ring.stl"), MESH.format("ring.stl")))
    begin = time.process_time()
    cell = Cell(robot, CellRequest())
    taken, begin = time.process_time() - begin, time.process_time()
    ConvexHull(torus[0])
    assert taken < 12 * (time.process_time() - begin) and pairs(cell) == {("l0", "l2")}


@pytest.mark.parametrize("how", ["bytes", "triangles", "nan", "short"])
def test_meshes_are_bounded_and_whole(
    tmp_path: Path, torus: tuple[np.ndarray, np.ndarray], monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    points, triangles = torus[0].copy(), torus[1][:2000]
    if how == "nan":
        points[triangles[0, 0]] = np.nan
    path = stl(tmp_path / "ring.stl", points, triangles)
    if how == "bytes":
        monkeypatch.setattr("energy_opt.robot.meshes.LARGEST", 99_000)
    elif how == "triangles":
        monkeypatch.setattr("energy_opt.cell.bodies.MOST_TRIANGLES", 1999)
    elif how == "short":
        path.write_bytes(path.read_bytes()[:-60])
    robot = load_robot(chain(tmp_path, ball("0.02"), MESH.format("ring.stl")))
    with pytest.raises(BadInput, match=r"link l1: .*ring.stl: "):
        Cell(robot, CellRequest())
    if how in ("bytes", "triangles"):
        assert Cell(robot, CellRequest(allow_large=True)).links == 2


def test_meshes_of_another_machine_are_found_below_the_package_folder(tmp_path: Path) -> None:
    (tmp_path / "here" / "arm" / "meshes").mkdir(parents=True)
    stl(tmp_path / "here" / "arm" / "meshes" / "a.stl", np.eye(3), np.array([[0, 1, 2]]))
    robot: Robot = load_robot(chain(tmp_path, ball("0.02"), MESH.format("file:///opt/ros/share/arm/meshes/a.stl")))
    with pytest.raises(BadInput, match=r"1 of 1 collision meshes not found.*package_dir"):
        Cell(robot, CellRequest())
    assert Cell(robot, CellRequest(package_dirs=(tmp_path / "here",))).links == 2
