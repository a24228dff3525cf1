"""Names are checked where they come in."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from energy_opt.errors import BadInput
from energy_opt.formats import FORMATS, read
from energy_opt.motion.trajectory import Trajectory
from energy_opt.names import check_name, commented
from energy_opt.tables import read_table


@pytest.mark.parametrize("name", ["panda_joint1", "left/arm-1.2", "j" * 128, "Gelenk_ä", "Revolute 2"])
def test_names_of_the_field_are_taken(name: str) -> None:
    assert check_name(name, "robot.urdf: joint") == name


@pytest.mark.parametrize(
    "name", ["", "a\nb", "a  b", " a", "a ", "a\tb", "a\r", 'a"b', "a;b", "a\u2028b", "j" * 129, "a\n"]
)
def test_other_names_are_refused_in_one_line(name: str) -> None:
    with pytest.raises(
        BadInput, match=r"robot.urdf: joint: name .*expected 1 to 128 letters, digits, _ - \. / and single inner spaces"
    ) as e:
        check_name(name, "robot.urdf: joint")
    assert "\n" not in str(e.value)


def test_a_name_in_a_comment_ends_no_line() -> None:
    assert commented('a\nhalt\r\x0b"\u2028b') == "a_halt____b"


HOSTILE = ['j1\n  popup("x")\nhalt', "j2: [1]\n- a", "j3,power", 'j4"', "j5\u2028halt", "</script><b>"]


def test_no_writer_is_broken_by_a_name(tmp_path: Path) -> None:
    """Names that no file of ours lets in, handed in from Python: quoted, or without what would end a line."""
    time = np.array([0.0, 0.5, 1.0])
    q = np.linspace(0, 1, 18).reshape(3, 6)
    still = np.zeros_like(q)
    motion = Trajectory(tuple(HOSTILE), time, q, still, still)
    for name, form in FORMATS.items():
        form.write(motion, tmp_path / f"{name}{form.suffix}")
    for name in ("yaml", "json", "follow-joint-trajectory", "mcap"):
        again = read(tmp_path / f"{name}{FORMATS[name].suffix}")
        assert list(again.joints) == HOSTILE
        np.testing.assert_array_equal(again.position, q)
    assert yaml.safe_load((tmp_path / "yaml.yaml").read_text())["joint_names"] == HOSTILE
    assert json.loads((tmp_path / "json.json").read_text())["joint_names"] == HOSTILE
    table = read_table(tmp_path / "csv.csv")
    assert len(table) == 19 and "power" not in table and (table["time"] == time).all()
    text = (tmp_path / "urscript.script").read_text()
    lines = text.splitlines()
    assert [line for line in lines if "j1" in line] == lines[:1] and lines[1].startswith("# 1.0")
    assert [line.strip() for line in lines[1:] if "halt" in line] == ["halt"]  # the program's own
