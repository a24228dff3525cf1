"""Names are checked where they come in."""

import pytest

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
