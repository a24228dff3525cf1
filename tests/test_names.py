"""Names are checked where they come in."""

from pathlib import Path

import pytest

from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.names import check_name, commented


@pytest.mark.parametrize("name", ["panda_joint1", "left/arm-1.2", "j" * 128, "Gelenk_ä"])
def test_names_of_the_field_are_taken(name: str) -> None:
    assert check_name(name, "robot.urdf: joint") == name


@pytest.mark.parametrize("name", ["", "a\nb", "a b", "a\r", 'a"b', "a;b", "a\u2028b", "j" * 129, "a\n"])
def test_other_names_are_refused_in_one_line(name: str) -> None:
    with pytest.raises(
        BadInput, match=r"robot.urdf: joint: name .*expected 1 to 128 letters, digits and _ - \. /"
    ) as e:
        check_name(name, "robot.urdf: joint")
    assert "\n" not in str(e.value)


def test_a_name_in_a_comment_ends_no_line() -> None:
    assert commented('a\nhalt\r\x0b"\u2028b') == "a_halt____b"


BAD = "j1\\nend\\nmovej([0])"  # as JSON, YAML and TOML write a line break
FILES = {
    "limits.yaml": f'joint_limits: {{panda_joint1: {{max_velocity: 1.0}}, "{BAD}": {{max_velocity: 1.0}}}}\n',
    "scene.yaml": f'objects: [{{name: "{BAD}", type: box, size: [1, 1, 1], position: [2, 0, 0]}}]\n',
    "message.json": f'{{"joint_names": ["{BAD}"], "points": [{{"positions": [0.0], "time_from_start": 1}}]}}',
    "model.toml": f'format = "energy-opt/model/1"\nrobot = "{BAD}"\n',
    "robot.srdf": '<robot name="r"><disable_collisions link1="j1&#10;end" link2="b"/></robot>',
    "robot.urdf": '<robot name="r"><link name="a&#10;b"/></robot>',
    "table.csv": 'time,"j1);end.position"\n0,0\n1,0\n',
}


@pytest.mark.parametrize("file", FILES)
def test_every_reader_refuses_names_that_could_break_a_writer(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / file).write_text(FILES[file])
    assert main(["check", str(tmp_path / file), "--robot", "panda", "--quiet"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and ("letters, digits" in said or "expected a name in quotes" in said)
