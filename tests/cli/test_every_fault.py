"""`check` names every fault of a file, a line each, with its place."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from energy_opt.cli.main import main

JOINTS = [f"joint{k}" for k in range(1, 7)]
HEADER = ",".join(["time", *(f"{joint}.position" for joint in JOINTS)])


def faults(file: Path, text: str, capsys: pytest.CaptureFixture[str]) -> list[str]:
    file.write_text(text)
    assert main(["check", str(file), "--robot", "z1", "--json"]) == 2
    (found,) = json.loads(capsys.readouterr().out)["files"]
    return [fault.removeprefix(f"{file}: ") for fault in found["faults"]]


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (
            [HEADER, "0,0,1,-1,0,0,0", "1,nan,1,-1,0,x,0", "2,0,1,,0,0,0"],
            ["row 3, column joint1.position: 'nan' is not finite", "row 3, column joint5.position: 'x' is not a number",
             "row 4, column joint3.position: '' is not a number"],
        ),
        (
            [HEADER, *(f"{t},{t / 100},1,-1,0,0,0" for t in (0, 1, 0.5, 2, 1.5))],
            ["row 4, column time: 0.5 does not come after 1", "row 6, column time: 1.5 does not come after 2"],
        ),
        ([HEADER, "0,1", "1,2"], ["row 2: 2 cells, the header has 7", "row 3: 2 cells, the header has 7"]),
        (["time,a.position,b.position,c.position,b.effort", "0,1,1,1,1"],
         [f"row 1: column {name}.effort is missing, though b.effort is there" for name in "ac"]),
    ],
    ids=["cells", "times", "widths", "columns"],
)  # fmt: skip
def test_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str], lines: list[str], says: list[str]) -> None:
    assert faults(tmp_path / "t.csv", "\n".join(lines), capsys) == says


def test_a_table_without_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{t},0,1,-1,0,0,{'off' if t else 0}" for t in range(1000)]
    found = faults(tmp_path / "t.csv", "\n".join([HEADER, *rows]), capsys)
    assert len(found) < 50 and found[0] == "row 3, column joint6.position: 'off' is not a number"
    assert found[-1] == f"and {999 - len(found) + 1} more faults"


def test_a_message(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = [{"positions": [0, 1, -1, 0, 0, k], "time_from_start": k} for k in (0, "b", "c", 3)]
    message = json.dumps({"joint_names": JOINTS, "points": points})
    names = ("time_from_start", "positions")
    assert faults(tmp_path / "t.json", message, capsys) == [
        f"points[{k}].{name}: '{value}' is not a number" for name in names for k, value in ((1, "b"), (2, "c"))
    ]


def test_joint_limits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = {name: f"  {name}: {{max_velocity: {value}}}" for name, value in (("joint1", "fast"), ("joint2", -1))}
    found = faults(tmp_path / "limits.yaml", "\n".join(["joint_limits:", *rows.values()]), capsys)
    assert [fault.split(";")[0] for fault in found] == [
        "joint_limits.joint1: max_velocity = 'fast'", "joint_limits.joint2: max_velocity = -1",
    ]  # fmt: skip
    rows |= {"joint3": "  jont3: {max_velocity: 1}", "joint4": "  jont4: {max_velocity: 1}"}
    found = faults(tmp_path / "limits.yaml", "\n".join(["joint_limits:", *rows.values()]), capsys)
    assert [fault.split("mean ")[1] for fault in found] == ["'joint3'?", "'joint4'?"]
