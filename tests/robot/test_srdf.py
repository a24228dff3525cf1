"""SRDF files, and where the meshes of a URDF lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.errors import BadInput
from energy_opt.front.given import positions
from energy_opt.robot import Robot, known_robots, load_robot
from energy_opt.robot.description import read_description
from energy_opt.robot.meshes import mesh_files
from energy_opt.robot.srdf import read_srdf, semantics

SRDF = """<robot name="r">
  <disable_collisions link1="b" link2="a" reason="Adjacent"/>
  <disable_default_collisions link="c"/>
  <enable_collisions link1="c" link2="a"/>
  <group_state name="home" group="g"><joint name="j2" value="0.5"/><joint name="j1" value="-1"/></group_state>
</robot>"""
URDF = """<robot name="r"><link name="a">
  <visual><geometry><mesh filename="package://never/there.dae"/></geometry></visual>
  <collision><geometry><mesh filename="{}"/></geometry></collision></link></robot>"""


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_pairs_and_poses(tmp_path: Path) -> None:
    srdf = read_srdf(written(tmp_path, "r.srdf", SRDF))
    assert srdf.allows("a", "b") and srdf.allows("b", "a") and srdf.disabled[("a", "b")] == "Adjacent"
    assert srdf.allows("c", "b") and not srdf.allows("c", "a") and not srdf.allows("a", "d")
    assert srdf.pose("home", ["j1", "j2"]).tolist() == [-1.0, 0.5]
    with pytest.raises(BadInput, match="no position for j3"):
        srdf.pose("home", ["j1", "j3"])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<robot", "not XML"),
        ("<urdf/>", "expected <robot>"),
        ('<robot name="r"><link name="a"/></robot>', "a URDF; expected an SRDF"),
        ('<!DOCTYPE r [<!ENTITY a "b">]><robot/>', "document type"),
        ('<robot><disable_collisions link1="a"/></robot>', "without link2"),
        ('<robot><group_state name="x"><joint name="j" value="nan"/></group_state></robot>', "not finite"),
    ],
)
def test_faulty_files_are_one_line(tmp_path: Path, text: str, says: str) -> None:
    path = written(tmp_path, "bad.srdf", text)
    with pytest.raises(BadInput, match=says) as caught:
        read_srdf(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_known_robots_bring_pairs_and_poses(panda: Robot, ur5: Robot) -> None:
    """Counts are those of the files that come with example-robot-data."""
    assert len(semantics(panda).disabled) == 35 and len(semantics(ur5).disabled) == 10
    assert not semantics(load_robot("ur10")).disabled
    assert np.allclose(positions("default", panda, "start"), [0, -0.785398, 0, -2.35619, 0, 1.5707, 0.785398])
    with pytest.raises(BadInput, match=r"goal homme: no pose is named 'homme'.*default"):
        positions("homme", panda, "goal")
    with pytest.raises(BadInput, match="1 positions"):
        positions("0.5", panda, "goal")


def test_the_srdf_of_another_arm_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path, "r.srdf", SRDF)
    with pytest.raises(BadInput, match=r"none of its links \(a, b, c, …\) is a link of panda \(.*panda_link"):
        semantics(load_robot("panda"), file)
    file.write_text('<robot name="r"><disable_collisions link1="panda_link1" link2="a_gripper"/></robot>')
    assert semantics(load_robot("panda"), file).disabled


@pytest.mark.parametrize("name", [n for n in known_robots() if not n.endswith("e")])
def test_meshes_of_known_robots_are_found(name: str) -> None:
    meshes = mesh_files(load_robot(name).description)
    assert meshes and all(path.is_file() for path in meshes.values())


@pytest.mark.parametrize("where", ["pkg/meshes/a.stl", "elsewhere/pkg/meshes/a.stl"])
def test_package_paths_are_found_above_the_file_and_in_given_folders(tmp_path: Path, where: str) -> None:
    mesh = written(tmp_path, where, "solid a\nendsolid a\n")
    urdf = written(tmp_path, "pkg/urdf/r.urdf", URDF.format("package://pkg/meshes/a.stl"))
    if where.startswith("elsewhere"):
        with pytest.raises(BadInput, match=r"1 of 1 collision meshes not found.*\(link a\).*package_dir") as caught:
            mesh_files(read_description(urdf))
        assert "\n" not in str(caught.value)
    said = read_description(urdf)
    found = mesh_files(said, [tmp_path / "elsewhere"] if where.startswith("elsewhere") else [])
    assert found == {"package://pkg/meshes/a.stl": mesh}
    if where.startswith("elsewhere"):  # a folder that is the package itself, and one some levels above it
        assert list(mesh_files(said, [mesh.parents[1]]).values()) == [mesh]
        assert mesh_files(said, [tmp_path]) == found
        mesh.unlink()
        with pytest.raises(BadInput, match=r"not found \(looked in .* and up to 4 folders below\), first"):
            mesh_files(said, [tmp_path])


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.urdf", '<robot name="r"><group name="arm"/></robot>', "an SRDF (it has <group>); expected a URDF"),
        ("a.urdf", '<robot name="r"><disable_collisions/></robot>', "an SRDF (it has <disable_collisions>); expected"),
        ("a.sdf", '<sdf version="1.6"><model name="r"/></sdf>', "begins with <sdf>; expected <robot>"),
    ],
)
def test_another_description_in_place_of_a_urdf_is_named(tmp_path: Path, name: str, content: str, says: str) -> None:
    (tmp_path / name).write_text(content)
    (said,) = eo.check(tmp_path / name).faults[str(tmp_path / name)]
    assert says in said
