"""URDFs that are damaged in one place each: refused in one line that names it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.robot import known_robots, load_robot
from energy_opt.robot.description import read_description

GOOD = """<?xml version="1.0"?>
<robot name="one">
  <link name="base"/>
  <link name="arm">
    <inertial><origin xyz="0 0 0.1" rpy="0 0 0"/><mass value="2.0"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial>
  </link>
  <joint name="turn" type="revolute">
    <origin xyz="0 0 0" rpy="0 0 0"/><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="2" effort="30"/>
  </joint>
</robot>
"""

DAMAGES = [
    ('mass value="2.0"', 'mass value="3,0"', "link 'arm', mass: value='3,0'"),
    ('mass value="2.0"', 'mass value="two"', "link 'arm', mass: value"),
    ('mass value="2.0"', 'mass value="nan"', "link 'arm', mass: value='nan'"),
    ('mass value="2.0"', 'mass value="-2"', "negative"),
    ('<mass value="2.0"/>', "", "link 'arm', mass: value is missing"),
    ('izz="0.01"', 'izz="0.05"', "link 'arm', inertia"),
    ('ixx="0.02"', 'ixx="-0.02"', "negative"),
    ('ixy="0"', 'ixy="zero"', "ixy='zero'"),
    ('axis xyz="0 1 0"', 'axis xyz="0 0 0"', "joint 'turn', axis"),
    ('axis xyz="0 1 0"', 'axis xyz="0 1"', "joint 'turn', axis"),
    ('lower="-1"', 'lower="2"', "lower=2 is above"),
    ('effort="30"', 'effort="-30"', "effort"),
    ('lower="-1"', 'lower="-inf"', "limit: lower='-inf' is not finite; leave it out where there is no limit"),
    ('child link="arm"', 'child link="leg"', "child link 'leg'"),
    ('parent link="base"', 'parent link="arm"', "in a circle"),
    ('type="revolute"', 'type="hinge"', "type='hinge'"),
    ('<link name="base"/>', '<link name="base"/><link name="arm"/>', "twice"),
    ('<link name="base"/>', '<link name="base"/><link name="loose"/>', "without a parent"),
    (
        "</robot>",
        '<joint name="two" type="fixed"><parent link="base"/><child link="arm"/></joint></robot>',
        "two parents",
    ),
    (
        "<robot name",
        '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arg name="a"/></robot><x name',
        "not XML",
    ),
    ("</robot>", "", "not XML"),
    ('<?xml version="1.0"?>', '<!DOCTYPE r [<!ENTITY a "b">]>', "document type"),
]


def test_the_undamaged_one_and_every_known_robot_pass(tmp_path: Path) -> None:
    (tmp_path / "good.urdf").write_text(GOOD)
    read_description(tmp_path / "good.urdf")
    assert load_robot(str(tmp_path / "good.urdf")).n == 1
    for name in known_robots():
        read_description(load_robot(name).urdf)


@pytest.mark.parametrize(("before", "after", "said"), DAMAGES)
def test_a_damage_is_named(before: str, after: str, said: str, tmp_path: Path) -> None:
    assert GOOD.count(before) == 1
    path = tmp_path / "damaged.urdf"
    path.write_text(GOOD.replace(before, after))
    with pytest.raises(BadInput, match=said) as caught:
        load_robot(str(path))
    assert "\n" not in str(caught.value)


def test_xacro_says_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf.xacro"
    for inside in ('<xacro:arg name="a"/>', '<link name="${prefix}base"/>', '<link name="$(arg prefix)base"/>'):
        path.write_text(f'<robot xmlns:xacro="http://ros.org/wiki/xacro">{inside}</robot>')
        with pytest.raises(BadInput, match=r"run xacro first: xacro arm.urdf.xacro > robot.urdf$"):
            load_robot(str(path))
    assert main(["check", str(path), str(path)]) == 2


def test_a_xacro_output_without_links_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "macros.urdf"
    path.write_text('<robot name="macros" xmlns:xacro="http://ros.org/wiki/xacro"><!-- defines a macro --></robot>')
    with pytest.raises(BadInput, match=r"macros.urdf: no <link>; .* the file that uses the robot's macro$"):
        load_robot(str(path))


def test_a_misspelt_place_at_its_default_changes_nothing(tmp_path: Path) -> None:
    """A vendor writes <origins xyz="0 0 0" .../>; any other place under that name is refused."""
    shape = '<collision><{tag} xyz="0 {y} 0.0" rpy="0 0 -0"/><geometry><sphere radius="0.1"/></geometry></collision>'
    files = []
    for k, (tag, y) in enumerate((("origin", "0"), ("origins", "0"), ("origins", "0.1"))):
        files.append(tmp_path / f"{k}.urdf")
        files[-1].write_text(GOOD.replace("</inertial>", "</inertial>" + shape.format(tag=tag, y=y)))
    assert read_description(files[1]).links == read_description(files[0]).links
    with pytest.raises(BadInput, match="<origins> is not read here; expected <origin>"):
        read_description(files[2])


def test_a_piped_urdf_is_refused_as_such(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(BadInput, match="a pipe, which is read only once; write the URDF into a file"):
        load_robot(tmp_path / "pipe")
