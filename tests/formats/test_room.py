"""Plans for files at a rate leave room for the samples: the move keeps its duration, and what is written holds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from independent import curve
from poses import GOAL, START

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.formats.controller_files import Written
from energy_opt.front.optimize import with_files
from energy_opt.motion import Result
from energy_opt.robot import Robot

QUICK = ["--starts", "1", "--controls", "16", "--compile", "never", "--model", "source-method-2", "--force"]


def held(robot: Robot, document: dict, allowed: float = 1e-6) -> float:
    """The duration of a JointTrajectory whose quintics hold the limits."""
    points = document["points"]

    def seconds(stamp: dict) -> float:
        return stamp["sec"] + 1e-9 * stamp["nanosec"]

    order = [document["joint_names"].index(joint) for joint in robot.joints]
    t = np.array([seconds(point["time_from_start"]) for point in points])
    rows = [
        np.array([point[name] for point in points])[:, order] for name in ("positions", "velocities", "accelerations")
    ]
    _, (_, v, a, jerk) = curve(t, *rows, 24)
    for values, bound in ((v, robot.limits.velocity), (a, robot.limits.acceleration), (jerk, robot.limits.jerk)):
        assert (np.abs(values) / bound).max() < 1 + allowed
    return float(t[-1])


@pytest.mark.parametrize("more", [["--mode", "reshape", "--duration", "0.82"], ["--as", "moves", "--duration", "0.95"]])
def test_a_given_duration_is_kept_at_a_rate(more: list[str], panda: Robot, tmp_path: Path, capsys) -> None:
    start, goal = (",".join(map(str, q)) for q in (START, GOAL))
    words = ["optimize", "--robot", "panda", f"--start={start}", f"--goal={goal}", *more, *QUICK]
    assert main([*words, "--write", "json", "--rate", "125", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().err
    assert "125 Hz" in said and "slowed" not in said and "planned with a margin for the written samples" in said
    assert held(panda, json.loads((tmp_path / "trajectory.json").read_text())) == pytest.approx(
        float(more[-1]), abs=1e-9
    )
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["status"] == "solved" and "J" in result["message"]
    slowed = {row["name"]: row for row in result["baselines"]}["scaled"]
    assert slowed["duration"] == pytest.approx(result["duration"], rel=1e-9)
    assert max(x for x in result["certificate"]["max_violation"].values()) <= 1e-6
    for row in result["written"]:
        assert row["valid"]


JOB = """
format = "energy-opt/job/1"
robot = "panda"
cycle_time = {cycle}
home = {home}
[[step]]
to = {goal}
mode = "retime"
{wait}
[[step]]
to = "home"
mode = "retime"
payload = 0.5
"""


@pytest.mark.slow
def test_a_cycle_of_retimed_moves_holds_in_every_file(panda: Robot, tmp_path: Path, capsys) -> None:
    """Their accelerations begin and end at a bound: in cycle.csv and at a rate they do not jump."""
    file = tmp_path / "job.toml"
    goal = [round(float(x), 4) for x in START + 0.5 * (GOAL - START)]
    file.write_text(JOB.format(cycle=2.5, home=START.tolist(), goal=goal, wait="[[step]]\nwait = 0.3"))
    words = ["job", str(file), "--compile", "never", "--model", "source-method-2", "--out", str(tmp_path / "out")]
    words += ["--cycles-per-year", "500000"]
    assert main([*words, "--write", "yaml", "--rate", "100"]) == 0
    found = json.loads((tmp_path / "out" / "job.json").read_text())
    assert [(row["file"], row["rate"], row["valid"]) for row in found["written"]] == [
        ("cycle.csv", None, True), ("trajectory.yaml", 100.0, True),
    ]  # fmt: skip
    document = yaml.safe_load((tmp_path / "out" / "trajectory.yaml").read_text())
    assert held(panda, document) == pytest.approx(2.5, abs=1e-8)
    rows = np.genfromtxt(tmp_path / "out" / "cycle.csv", delimiter=",", names=True)
    t, jerk = rows["time"], panda.limits.jerk[0]
    change = np.abs(np.diff(rows["panda_joint1acceleration"])) / np.diff(t)
    assert t[-1] == pytest.approx(2.5, abs=1e-8) and change.max() <= jerk * (1 + 1e-6)
    assert "energy saved in a year" in (tmp_path / "out" / "report.html").read_text()
    (motion,) = eo.evaluate(tmp_path / "out", panda, "source-method-2").found  # it stands milliseconds beside its steps
    assert [row.name for row in motion.baselines] == ["toppra", "scaled"] and motion.remark == ""


def test_a_cycle_that_does_not_hold_ends_with_4(tmp_path: Path, capsys) -> None:
    """A stop on a straight way, without a wait: at the fastest timing the acceleration has no time to change sign."""
    file = tmp_path / "job.toml"
    goal = [round(float(x), 4) for x in START + 0.5 * (GOAL - START)]
    on = f"[[step]]\nto = {[round(float(x), 4) for x in GOAL]}\nmode = 'retime'"
    file.write_text(JOB.format(cycle=0.1, home=START.tolist(), goal=goal, wait=on))
    words = ["job", str(file), "--compile", "never", "--model", "source-method-2"]
    assert main([*words, "--out", str(tmp_path / "a"), "--json"]) == 3
    shortest = json.loads(capsys.readouterr().out)["shortest_duration"]
    file.write_text(JOB.format(cycle=shortest, home=START.tolist(), goal=goal, wait=on))
    code = main([*words, "--out", str(tmp_path / "b"), "--quiet"])
    found = json.loads((tmp_path / "b" / "job.json").read_text())
    (row,) = found["written"]
    assert code == 4 and not row["valid"] and any("BREAKS A LIMIT" in said for said in found["warnings"])


def test_files_that_have_another_rate_or_break_a_limit_are_warnings(panda: Robot, tmp_path: Path) -> None:
    """That no rate keeps a file's limits was printed, and in no JSON."""
    ends = {"start": START.tolist(), "goal": GOAL.tolist(), "duration": 2.0, "mode": "retime"}
    result = eo.optimize(
        panda, "source-method-2", **ends, self_collision=False, compile="never", write=["yaml", "json"], rate=20
    )
    why = "with quintics between samples at 20 Hz the jerk of panda_joint1 would come to 9000"
    files = [
        Written("trajectory.yaml", "yaml", None, True, {}, f"as judged; {why}"),
        Written("trajectory.json", "json", 20.0, True, {}, "20 Hz"),
        Written("trajectory.franka.csv", "franka", 1000.0, True, {}, "1000 Hz: --rate 20 is not used"),
    ]

    def write(_: Result, folder: Path) -> list[Written]:
        for row in files:
            (folder / row.file).touch()
        return files

    with_files(result, write).save(tmp_path)
    found = json.loads((tmp_path / "result.json").read_text())["warnings"]
    assert [said for said in found if "trajectory" in said] == [
        f"trajectory.yaml: as judged; {why}",
        "trajectory.franka.csv: 1000 Hz: --rate 20 is not used",
    ]
