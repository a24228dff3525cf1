"""A result is evaluated in the cell that its request states, with its robot; a changed motion is remarked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plane_arm import arm
from swings import swing

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.formats import write
from energy_opt.motion.trajectory import Trajectory

SCENE = "objects:\n  - {name: shelf, type: box, size: [0.1, 0.1, 0.1], position: [0.6, 0, 2.2]}\n"


@pytest.fixture
def result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a move that was planned in the folder above it."""
    monkeypatch.chdir(tmp_path)
    arm(tmp_path, 2)
    (tmp_path / "scene.yaml").write_text(SCENE)
    words = ["optimize", "--robot", "arm.urdf", "--start=0.3,-0.6", "--goal=-0.7,0.5", "--duration", "2"]
    cell = ["--base", "0,0,1,0,0,0", "--floor", "0.5", "--scene", "scene.yaml", "--tool", "tip"]
    more = ["--self-collision", "off", "--mode", "retime", "--model", "source-method-2", "--quiet", "--out", "out"]
    assert main([*words, *cell, *more]) == 0
    return tmp_path / "out"


def evaluated(
    result: Path, capsys: pytest.CaptureFixture[str], *words: str, more: tuple[str, ...] = ()
) -> tuple[Any, str]:
    """The content of evaluate.json, and what is said."""
    out = result.parent / "seen"
    asked = [*map(str, (result, *more)), "--self-collision", "off", "--model", "source-method-2", "--force", *words]
    assert main(["evaluate", *asked, "--out", str(out)]) == 0
    return json.loads((out / "evaluate.json").read_text()), capsys.readouterr().err


def test_the_cell_and_the_robot_are_those_of_the_result(
    result: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its URDF was not found, and it was judged without the scene, the floor, the base and the tool."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    own = json.loads((result / "result.json").read_text())["certificate"]["clearance"]
    for path in (result, result / "result.json", result / "trajectory.csv"):
        document, said = evaluated(path, capsys)
        found = document["motions"][0]["certificate"]["clearance"]
        assert found["pairs"] == own["pairs"] and found["min_distance"] == pytest.approx(own["min_distance"])
        for words in ("--base 0,0,1,0,0,0", "--floor 0.5", f"--scene {tmp_path / 'scene.yaml'}", "--tool tip"):
            assert f"note: {words}, as the result states" in said
    document, said = evaluated(result, capsys, "--base", "0,0,1.1,0,0,0")
    assert document["request"]["base"][2] == 1.1 and "--base 0,0,1,0,0,0, as" not in said


def test_what_cannot_be_taken_is_said(result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (result.parent / "scene.yaml").unlink()
    document, said = evaluated(result, capsys)
    assert "its scene scene.yaml was not found" in said and "scene" not in document["request"]
    other = result.parent / "mine.csv"
    other.write_bytes((result / "trajectory.csv").read_bytes())
    document, said = evaluated(result, capsys, "--robot", str(result.parent / "arm.urdf"), more=(str(other),))
    assert "as the result states" not in said and "planned with --base 0,0,1,0,0,0" in said


def test_a_changed_motion_of_a_result_is_remarked(result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It was evaluated as that of the result, without a word."""
    _, said = evaluated(result, capsys)
    assert "SHA-256" not in said
    table = result / "trajectory.csv"
    table.write_text(table.read_text() + "\n")
    for path in (result, result / "result.json"):
        document, said = evaluated(path, capsys)
        assert f"warning: {table}: not the file that was written with result.json" in said
        assert "SHA-256" in document["motions"][0]["notes"][0]


def test_links_without_a_body_are_named_in_every_answer(tmp_path: Path) -> None:
    """Only `optimize` warned that not all of the arm is checked."""
    path = arm(tmp_path, 2)
    seen = '<link name="tip"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>'
    path.write_text(path.read_text().replace('<link name="tip"/>', seen))
    move = {"start": [0.3, -0.6], "goal": [-0.7, 0.5], "model": "source-method-2", "mode": "retime"}
    planned = eo.optimize(path, **move, duration=2.0)
    front = eo.tradeoff(path, **move, durations=[2.0])
    judged = eo.evaluate(planned.trajectory, robot=path)["motions"][0]
    for said in (planned.warnings, front["warnings"], judged["notes"]):
        assert sum("a visual shape but no collision geometry are not checked: tip;" in line for line in said) == 1


def test_timings_of_a_path_touch_what_it_touches(result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They counted as valid within their limits."""
    (result.parent / "other.yaml").write_text(SCENE.replace("2.2", "1.8"))
    for words, free in (((), True), (("--scene", "other.yaml"), False)):
        document, _ = evaluated(result, capsys, *words)
        motion = document["motions"][0]
        assert motion["valid"] is free and [row["valid"] for row in motion["baselines"]] == [free, free]


LIMITS = "joint_limits:\n  j0: {max_velocity: 0.8, max_acceleration: 2.0}\n"


def test_a_robot_loaded_with_limits_and_locked_joints_is_loaded_so_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its request had its name alone: the repeated plan exceeded the limits without a word."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "limits.yaml").write_text(LIMITS)
    robot = eo.load_robot(arm(tmp_path, 3), limits="limits.yaml", lock={"j2": 0.25})
    plan = eo.optimize(robot, "source-method-2", start=[0.3, -0.6], goal=[-0.7, 0.5], mode="retime")
    plan.save("out")
    again = eo.repeat("out/result.json")
    assert again.trajectory.joints == robot.joints == ("j0", "j1")
    assert again.trajectory.duration == pytest.approx(plan.trajectory.duration, rel=1e-6)
    assert np.abs(again.trajectory.velocity[:, 0]).max() <= 0.8 + 1e-6


def test_limits_and_locked_joints_are_those_of_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was judged by other limits without a word, and refused where a joint was locked."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "limits.yaml").write_text(LIMITS.replace("2.0", "40.0"))
    known = {"limits": "limits.yaml", "lock": {"j2": 0.25}, "max_power": 300, "mode": "retime"}
    eo.optimize(arm(tmp_path, 3), "source-method-2", start=[0.3, -0.6], goal=[-0.7, 0.5], **known).save("out")
    document, said = evaluated(tmp_path / "out", capsys)
    assert document["joints"] == ["j0", "j1"] and document["motions"][0]["valid"]
    for words in ("--limits limits.yaml, as", "--lock j2=0.25, as", "its conditions are not judged: --max-power"):
        assert words in said
    (tmp_path / "limits.yaml").unlink()
    assert "its limits limits.yaml were not found" in evaluated(tmp_path / "out", capsys)[1]


HERE, AWAY = np.array([0.3, -0.6]), np.array([-0.7, 0.5])  # the outer link reaches (0.6, 0, 0.8) in AWAY alone


def of_job(folder: Path, job: dict[str, Any], table: str, **document: Any) -> Path:
    """A motion from HERE to AWAY and back, 2 s each, as a table in the folder of a job."""
    arm(folder, 2)
    out = folder / "job"
    out.mkdir()
    there, back = swing(("j0", "j1"), HERE, AWAY, 2.0, 201), swing(("j0", "j1"), AWAY, HERE, 2.0, 201)
    rows = (np.vstack([getattr(there, x), getattr(back, x)[1:]]) for x in ("position", "velocity", "acceleration"))
    write(Trajectory(there.joints, np.append(there.time, 2.0 + back.time[1:]), *rows), out / table)
    request = {"verb": "job", "robot": "arm.urdf", "job": job, "folder": str(folder)}
    (out / "job.json").write_text(json.dumps({**document, "request": request}))
    return out / table


def clearance(found: Any) -> dict[str, Any] | None:
    row: dict[str, Any] = found["motions"][0]["certificate"]["clearance"]
    return row


def test_a_robot_of_several_stands_where_the_job_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its scene was taken without its base. Where the robot is not known, contact is not judged."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENE.replace("2.2", "1.8"))
    robots = [{"name": name, "robot": "arm.urdf", "base": [0, 0, z, 0, 0, 0]} for name, z in (("a", 1), ("b", 5))]
    job = {"robot": robots, "scene": "scene.yaml"}
    table = of_job(tmp_path, job, "cycle_b.csv", robots=[{"name": "a"}, {"name": "b"}])
    for name, verdict in (("cycle_b.csv", "proven"), ("cycle_a.csv", "colliding")):
        table = table.rename(table.parent / name)
        found, _ = evaluated(table, capsys)
        held = clearance(found)
        assert held is not None and held["verdict"] == verdict
        assert found["request"]["robot"].endswith("arm.urdf")
    table = table.rename(table.parent / "cycle_c.csv")
    found, said = evaluated(table, capsys, "--robot", "arm.urdf")
    assert clearance(found) is None and "does not say which robot moves" in said


@pytest.mark.parametrize(("scenes", "verdict"), [(("full", "empty"), "colliding"), (("empty", None), "proven")])
def test_each_step_of_a_job_is_judged_in_its_own_scene(
    scenes: tuple[str, str | None], verdict: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """They were judged in none, and called clear."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full.yaml").write_text(SCENE.replace("2.2", "0.8"))
    (tmp_path / "empty.yaml").write_text(SCENE.replace("2.2", "9.2"))
    steps = [{"name": str(k)} | ({"scene": f"{name}.yaml"} if name else {}) for k, name in enumerate(scenes)]
    held = [{"name": str(k), "start": 2.0 * k, "duration": 2.0, "payload": 0.0} for k in range(2)]
    table = of_job(tmp_path, {"robot": "arm.urdf", "step": steps, "scene": "full.yaml"}, "cycle.csv", steps=held)
    found, _ = evaluated(table, capsys)
    judged = clearance(found)
    assert judged is not None and judged["verdict"] == verdict
    (tmp_path / "empty.yaml").unlink()
    found, said = evaluated(table, capsys)
    assert clearance(found) is None and "empty.yaml was not found" in said
