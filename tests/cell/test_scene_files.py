"""Scenes from files: every form says the same, and what is wrong is named with file and object."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from energy_opt.cell.cell import Cell
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene import TOOL, Scene
from energy_opt.cell.scene_files import check_scene, read_scene
from energy_opt.cli.main import example, main
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion.plan.first_path import check_free
from energy_opt.robot import load_robot

EXAMPLE = example("scene")

MBM = Path(__file__).parents[3] / "shared" / "data" / "mbm" / "scenes"
TURN = [0.0, 0.0, 0.7071067811865476, 0.7071067811865476]  # a quarter about z


def written(folder: Path, name: str, content: str | dict[str, Any]) -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def message(*objects: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"world": {"collision_objects": list(objects)}, **more}


def box(name: str = "crate", **changes: Any) -> dict[str, Any]:
    pose = {"position": [0, 1, 0], "orientation": [0, 0, 0, 1]}
    entry = {"id": name, "primitives": [{"type": "box", "dimensions": [1, 2, 3]}], "primitive_poses": [pose]}
    return {**entry, **changes}


def poses(scene: Scene) -> np.ndarray:
    return np.array([shape.pose for shape in scene.placed()])


@pytest.mark.skipif(not MBM.is_dir(), reason="the problems' data are not beside the checkout")
@pytest.mark.parametrize(
    ("name", "others"), [("panda_box_0030", [".scene", "_old.scene"]), ("ur5_box_0033", [".scene"])]
)
def test_messages_and_both_versions_of_text_say_the_same(name: str, others: list[str]) -> None:
    scene = read_scene(MBM / f"{name}.yaml")
    for other in others:
        text = read_scene(MBM / f"{name}{other}")
        assert [o.name for o in text.objects] == [o.name for o in scene.objects]
        assert [s.shape.size for s in text.placed()] == [s.shape.size for s in scene.placed()]
        assert np.allclose(poses(text), poses(scene), atol=1e-12)


def test_an_object_s_pose_goes_before_its_shapes_and_cylinders_come_height_first(tmp_path: Path) -> None:
    entry = box(
        pose={"position": {"x": 1, "y": 0, "z": 0}, "orientation": dict(zip("xyzw", TURN, strict=True))},
        primitives=[{"type": 3, "dimensions": [0.5, 0.1]}, {"type": "cone", "dimensions": [0.4, 0.2]}],
        primitive_poses=[{"position": [0, 1, 0], "orientation": [0, 0, 0, 1.001]}] * 2,
        planes=[{"coef": [0, 0, -2, 1]}],
    )
    scene = read_scene(written(tmp_path, "a.json", message(entry)))
    cylinder, cone, plane = scene.placed()
    assert cylinder.shape.size == (0.1, 0.5) and cone.shape.size == (0.2, 0.4) and not scene.warnings
    assert np.allclose(cylinder.pose[:3, 3], [0, 0, 0])  # one along x, then one along y turned to -x
    assert np.isclose(plane.pose[2, 3], 0.5) and np.isclose(plane.pose[2, 2], -1)  # -2 z + 1 = 0: the base is below it


def test_text_has_its_radius_first_meshes_planes_and_names_with_spaces(tmp_path: Path) -> None:
    text = """a scene
* a can
0 0 1
0 0 0 1
2
cylinder
0.03 0.14
1 2 3
0 0 0 1
0.5 0.5 0.5 1
mesh
3 1
0 0 0
1 0 0
0 1 0
0 1 2
0 0 0
0 0 0 1
0 0 0 0
1
tip of it
0 0 0
0 0 0 1
* floor
0 0 0
0 0 0 1
1
plane
0 0 1 0.5
0 0 0
0 0 0 1
0 0 0 0
0
.
"""
    scene = read_scene(written(tmp_path, "a.scene", text))
    can, floor = scene.objects
    assert (
        can.name == "a can" and can.shapes[0].size == (0.03, 0.14) and can.shapes[1].triangles.tolist() == [[0, 1, 2]]
    )
    assert np.allclose(poses(scene)[0, :3, 3], [1, 2, 4])
    assert np.allclose(floor.shapes[0].pose[:3, 3], [0, 0, -0.5])
    for broken, says in [
        (text.replace("0.03 0.14", "0.03 nan"), r"object a can \(row 7\): nan"),
        (text.replace("0.03", "0"), r"a can \(row 7\): radius"),
        (text.replace("0 1 2\n", "0 1 7\n"), "names another"),
        (text.replace("* floor", "* a can"), "is given twice"),
        (text.replace("plane", "torus"), "object floor .*torus"),
        (text[:-2], "ends here"),
        (text.replace("3 1\n", "999999999 1\n"), "but the file has fewer rows"),
    ]:
        with pytest.raises(BadInput, match=says):
            read_scene(written(tmp_path, "b.scene", broken))


def test_allowed_pairs_attached_objects_and_frames(tmp_path: Path) -> None:
    matrix = {
        "entry_names": ["b", "a"],
        "entry_values": [{"enabled": [False, True]}, {"enabled": [True, False]}],
        "default_entry_names": ["c"],
        "default_entry_values": [True],
    }
    held = {"link_name": "hand", "object": box("held", header={"frame_id": "wrist"}), "touch_links": ["finger"]}
    turned = {
        "header": {"frame_id": "base"},
        "child_frame_id": "cell",
        "transform": {"translation": [0, 0, 2], "rotation": TURN},
    }
    document = message(
        box(header={"frame_id": "cell"}),
        allowed_collision_matrix=matrix,
        robot_state={"attached_collision_objects": [held]},
        fixed_frame_transforms=[turned],
    )
    scene = read_scene(written(tmp_path, "a.json", {"scene": document}))
    assert scene.allowed.allows("a", "b") and scene.allowed.allows("c", "x") and not scene.allowed.allows("a", "x")
    crate, carried = scene.objects
    assert np.allclose((crate.pose @ crate.shapes[0].pose)[:3, 3], [-1, 0, 2])
    assert (carried.attached_to, carried.frame, carried.touch_links) == ("hand", "wrist", ("finger",))


@pytest.mark.parametrize("frame", ["panda_link0", "panda_link5"])
def test_a_held_object_s_pose_is_in_a_frame_that_moves_with_it(tmp_path: Path, frame: str) -> None:
    """Given in another frame, it stayed there as an obstacle, and did not move with the hand."""
    panda = load_robot("panda")

    def cell_with(frame: str) -> Cell | None:
        held = {"link_name": "panda_hand", "object": box("held", header={"frame_id": frame})}
        document = message(robot_state={"attached_collision_objects": [held]})
        return load_cell(panda, CellRequest(scene=written(tmp_path, "a.json", document)))

    assert cell_with("panda_link8") is not None  # the hand is fixed to it
    with pytest.raises(BadInput, match=f"held: panda_hand carries it, but its pose is in the frame of {frame}"):
        cell_with(frame)


def test_operations_are_done_in_order(tmp_path: Path) -> None:
    moved = {"position": [5, 0, 0], "orientation": [0, 0, 0, 1]}
    document = message(
        box("a"), box("b"), {"id": "a", "operation": 1}, box("b", operation="\x02", pose=moved),
        {"id": "b", "operation": 3, "pose": {"position": [0, 0, 1], "orientation": TURN}},
    )  # fmt: skip
    (b,) = read_scene(written(tmp_path, "a.json", document)).objects
    assert b.name == "b" and np.allclose([s.pose[:3, 3] for s in b.shapes], [[0, 1, 0], [5, 1, 0]])
    assert np.allclose(b.pose[:3, 3], [0, 0, 1])


def test_short_yaml_and_its_meshes(tmp_path: Path) -> None:
    (tmp_path / "part.obj").write_text("v 0 0 0\nv 100 0 0\nv 0 100 0\nf 1 2 3\n")
    text = """
objects:
  - {name: part, type: mesh, file: part.obj, scale: 0.001, position: [0, 0, 1e-3]}
  - {name: post, type: cylinder, radius: 0.1, height: 2, quaternion: [0, 0, 1, 1]}
  - {name: tip, type: sphere, size: 0.1, attach: true}
  - {name: cup, type: cone, size: [0.1, 0.2], attach: hand, touch_links: [finger]}
allow: [[part, post]]
"""
    scene = read_scene(written(tmp_path, "a.yaml", text), floor=-0.1)
    part, post, tip, cup = scene.objects
    assert part.shapes[0].vertices.max() == pytest.approx(0.1) and part.pose[2, 3] == 1e-3
    assert post.shapes[0].size == (0.1, 2.0) and np.allclose(post.pose[:2, :2], [[0, -1], [1, 0]])
    assert tip.attached_to == tip.frame == TOOL and cup.attached_to == "hand" and cup.touch_links == ("finger",)
    assert scene.allowed.allows("post", "part") and [s.object for s in scene.placed()][-1] == "floor"
    assert len(scene.warnings) == 1 and "length 1.41" in scene.warnings[0]


def short(**changes: Any) -> dict[str, Any]:
    return {"objects": [{"name": "crate", "type": "box", "size": [1, 1, 1], **changes}]}


@pytest.mark.parametrize(
    ("document", "says"),
    [
        (short(size=[1, 0, 1]), "object crate: y of its box is 0"),
        (short(size=[1, 1]), "box with 2 sizes"),
        (short(size=[1, 1, float("nan")]), "object crate: size is nan"),
        (short(size=[1, 1, 10**400]), "object crate: size is 1000.*expected a finite number"),
        (short(position=[0, 0, float("inf")]), "object crate: z of its position is inf"),
        (short(quaternion=[0, 0, 0, 0]), "object crate: its quaternion is zero"),
        (short(type="torus"), "object crate: type is 'torus'; expected box"),
        (short(type="mesh", file="none.stl"), "object crate: none.stl: no such file"),
        (short(type="mesh", file="../x.stl"), "object crate: .*outside .*allow_outside"),
        (short(type="mesh", file="x.dae"), "object crate: .*stl or .obj"),
        (short(colour="red"), "object crate: unknown key 'colour'"),
        (short(sise=1), "did you mean 'size'"),
        (short(name=""), "object 1: name is ''"),
        ({"objects": short()["objects"] * 2}, "object crate: is given twice"),
        ({"objects": [[[]] * 9]}, "object 1: it is .*expected a table"),
        (message(box(primitives=[{"type": 5, "dimensions": [1]}])), "object crate: a primitive of type 5"),
        (message(box(primitives=[{"type": "box", "dimensions": [1, 2]}])), "box with 2 dimensions"),
        (message(box(primitive_poses=[])["id"]), "object 1: it is 'crate'"),
        (message(box(), box()), "object crate: is given twice"),
        (message(box(primitives=[], primitive_poses=[])), "object crate: has no shape"),
        (message(box(operation=7)), "object crate: operation is 7"),
        (message(box(meshes=[{"vertices": [], "triangles": []}])), "object crate: a mesh without triangles"),
        (message(allowed_collision_matrix={"entry_names": ["a"]}), "allowed_collision_matrix: 0 entry_values"),
        ({"world": {"octomap": {"octomap": {"data": [1]}}}}, "octomap is not read"),
        ([1], "expected a PlanningScene"),
    ],
)
def test_a_fault_is_one_line_with_file_and_object(tmp_path: Path, document: Any, says: str) -> None:
    path = written(tmp_path, "a.json", document)
    with pytest.raises(BadInput, match=says) as caught:
        read_scene(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_check_names_every_fault_and_outside_and_large_are_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "scene"
    folder.mkdir()
    corners = "".join(f"vertex {x} {y} 0\n" for x, y in [(0, 0), (1, 0), (0, 1)])
    facet = f"facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n"
    (tmp_path / "part.stl").write_text(f"solid a\n{facet}endsolid a\n")
    (folder / "cut.stl").write_bytes(b"\x00" * 80 + (10**9).to_bytes(4, "little") + b"\x00" * 50)
    mesh = {"name": "part", "type": "mesh", "file": "../part.stl"}
    path = written(folder, "a.yaml", {"objects": [mesh, {**mesh, "name": "cut", "file": "cut.stl"}]})
    assert main(["check", str(path)]) == 2
    assert [word in line for word, line in zip(["part", "cut"], capsys.readouterr().err.splitlines(), strict=True)]
    path = written(folder, "a.yaml", {"objects": [mesh]})
    assert main(["check", str(path), "--allow-outside"]) == 0
    assert capsys.readouterr().out.endswith("usable\n")
    monkeypatch.setattr("energy_opt.cell.scene_files.parts.MOST_TRIANGLES", 0)
    assert "allow_large" in check_scene(path, allow_outside=True)[0]
    assert not check_scene(path, allow_outside=True, allow_large=True)


def test_check_knows_the_forms_that_scene_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(written(tmp_path, "a.yaml", {"scene": message(box())}))]) == 0
    for text in ("[{name: crate}]", "{}", "", "world"):
        assert main(["check", str(written(tmp_path, "a.yaml", text))]) == 2
        fault = capsys.readouterr().err
        assert all(word in fault for word in ("with world or objects", "joint_names and points", "with joint_limits"))


def test_the_example_works(tmp_path: Path) -> None:
    assert len(read_scene(written(tmp_path, "a.yaml", EXAMPLE)).objects) == 4
    uncommented = EXAMPLE.replace("#  - ", "  - ").replace("\n#    ", "\n    ").replace("# allow", "allow")
    faults = check_scene(written(tmp_path, "a.yaml", uncommented))
    assert len(faults) == 1 and "fixture.stl: no such file" in faults[0]


def test_a_thousand_objects_are_read_in_linear_time(tmp_path: Path) -> None:
    def seconds(count: int) -> float:
        path = written(tmp_path, "a.yaml", {"objects": [short(name=f"o{k}")["objects"][0] for k in range(count)]})
        times = []
        for _ in range(3):  # the least of three: a collection of garbage is no part of reading
            before = time.process_time()
            assert len(read_scene(path).objects) == count
            times.append(time.process_time() - before)
        return min(times)

    seconds(10)
    assert seconds(4000) < 12 * seconds(1000)  # quadratic would be 16 times


def test_a_name_in_a_pair_that_is_no_body_is_remarked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It was accepted without a word, and the contact that it was to allow was refused."""
    table = {"name": "table", "type": "box", "size": [0.8, 1.2, 0.04], "position": [0.75, 0, 0.1]}
    part = {
        "name": "part",
        "type": "box",
        "size": [0.06, 0.06, 0.3],
        "attach": "panda_hand",
        "touch_links": ["panda_hnd"],
    }
    pairs = [["part", "tabel"], ["panda_link0", "table"], ["part", "floor"], ["grip", "wall"]]
    path = written(tmp_path, "scene.yaml", {"objects": [table, part], "allow": pairs})
    assert main(["check", str(path), "--robot", "panda"]) == 0
    said = "what may touch is neither a link nor an object"
    notes = capsys.readouterr().err
    for words in ("'tabel'; did you mean 'table'?", "'grip', 'wall'", "'panda_hnd'; did you mean 'panda_hand'?"):
        assert f"{said}: {words}" in notes
    cell = load_cell(load_robot("panda"), CellRequest(scene=path))
    with pytest.raises(Infeasible, match=r"part touches table .*mean 'table'.*`allow: \[\[part, table\]\]`"):
        check_free(cell, np.array([0, 0.9, 0, -1.6, 0, 2.5, 0.785]), "start")
    pairs[0][1] = "table"
    path = written(tmp_path, "scene.yaml", {"objects": [table, {**part, "touch_links": []}], "allow": pairs[:3]})
    assert main(["check", str(path), "--robot", "panda"]) == 0 and said not in capsys.readouterr().err
    path = written(tmp_path, "scene.yaml", {"objects": [{**part, "attach": "panda_hnd"}]})
    assert main(["check", str(path), "--robot", "panda"]) == 2
    assert "no link; did you mean 'panda_hand'?" in capsys.readouterr().err
