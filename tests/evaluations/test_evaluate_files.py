"""The verb `evaluate` on files, from the command line and from Python."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from poses import GOAL, START
from swings import UR_GOAL, UR_START, swing

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.formats import read_trajectory, write
from energy_opt.front.check import check
from energy_opt.front.evaluate import table
from energy_opt.motion.trajectory import Trajectory
from energy_opt.robot import Robot


def test_evaluate_on_the_command_line(panda: Robot, tmp_path: Path, capsys) -> None:
    time = np.linspace(0, 2, 201)
    x = (time / 2)[:, None]
    rows = (START + (GOAL - START) * x**3 * (10 - 15 * x + 6 * x**2), (GOAL - START) * 15 * x**2 * (1 - x) ** 2,
            (GOAL - START) * 15 * x * (1 - x) * (1 - 2 * x))  # fmt: skip
    write(Trajectory(panda.joints, time, *rows), tmp_path / "a.csv")
    words = ["evaluate", str(tmp_path / "a.csv"), "--out", str(tmp_path / "out"), "--payload", "1", "--quiet", "--json"]
    assert main([*words, "--write", "franka"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["robot"] == "panda" and len(found["motions"][0]["models"]) == 2 and found["motions"][0]["valid"]
    assert found["written"][0]["file"] == "trajectory.franka.csv" and found["written"][0]["valid"]
    assert main(["evaluate", str(tmp_path / "b.csv"), "--out", str(tmp_path / "out"), "--quiet"]) == 2


def test_several_known_robots_with_the_same_joints_are_not_guessed_among(
    ur5: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first of six was taken: a ur5e's motion had a ur3's energy."""
    write(swing(ur5.joints, UR_START, UR_GOAL, 2.0), tmp_path / "a.csv")
    for words in (["evaluate", "--out", str(tmp_path / "out")], ["check"]):
        assert main([*words, str(tmp_path / "a.csv")]) == 2
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1 and "give --robot; ur3, ur5, ur10, ur3e, ur5e, ur10e have the same joints" in said[0]
    assert main(["check", str(tmp_path / "a.csv"), "--robot", "ur5"]) == 0


def test_positions_for_a_controllers_steps_are_judged_as_such(panda: Robot, ur5: Robot, tmp_path: Path) -> None:
    """Quintics between them broke limits that the controller's differences keep; a slow start was called a wait."""
    x = np.linspace(0, 1, 401)[:, None]

    def cubic(robot: Robot, start: np.ndarray, d: np.ndarray, T: float) -> Trajectory:
        """It begins and ends with an acceleration."""
        rows = start + d * x**2 * (3 - 2 * x), d * 6 * x * (1 - x) / T, d * 6 * (1 - 2 * x) / T**2
        return Trajectory(robot.joints, x[:, 0] * T, *rows)

    slow = swing(panda.joints, START, GOAL, 3.0)
    for motion, robot, form, rate in (
        (cubic(panda, START, 0.2 * (GOAL - START), 0.5), panda, "franka", 1000),
        (slow, panda, "franka", 1000),
        (cubic(ur5, UR_START, UR_GOAL - UR_START, 0.8001), ur5, "urscript", 500),
    ):
        eo.evaluate(motion, robot, "source-method-2").save(tmp_path, [form], rate)
        (row,) = json.loads((tmp_path / "evaluate.json").read_text())["written"]
        assert row["valid"] and row["rate"] == rate
        again = eo.evaluate(tmp_path / row["file"], robot, "source-method-2")
        (found,) = again.document()["motions"]
        assert found["valid"] and found["waits"] == []
        assert set(found["certificate"]["max_violation"]) == {"position", "velocity", "acceleration", "jerk", "effort"}
        assert check(tmp_path / row["file"], robot=robot).usable


def test_a_motion_that_comes_to_rest_on_a_position_limit_has_baselines(panda: Robot) -> None:
    """The spline through its positions passes the limit by 3e-8 rad where joint 6 stops while joint 1 goes on."""
    time = np.linspace(0, 4, 401)
    q, v, a = np.tile(START, (401, 1)), np.zeros((401, 7)), np.zeros((401, 7))
    for joint, first, length, end, by in ((5, 0.0, 2.0, panda.limits.upper[5], 0.4), (0, 0.0, 4.0, 1.0, 1.0)):
        x = np.clip((time - first) / length, 0, 1)
        q[:, joint] = end - by * (1 - x**3 * (10 - 15 * x + 6 * x**2))
        v[:, joint] = by * 30 * x**2 * (1 - x) ** 2 / length
        a[:, joint] = by * 60 * x * (1 - 3 * x + 2 * x**2) / length**2
    found = eo.evaluate(Trajectory(panda.joints, time, q, v, a), "panda", "source-method-2", self_collision=False)
    (motion,) = found.document()["motions"]
    assert motion["certificate"]["max_violation"]["position"] <= 0
    assert [row["name"] for row in motion["baselines"]] == ["toppra", "scaled"]
    assert all(row["valid"] for row in motion["baselines"])


def test_evaluate_from_python_under_several_models_side_by_side(panda: Robot) -> None:
    """Energies by hand: Pinocchio's torque and the model's law on a fine grid; a recording with noise is smoothed."""
    import pinocchio as pin

    time = np.linspace(0, 2, 401)
    x = (time / 2)[:, None]
    q = START + (GOAL - START) * x**3 * (10 - 15 * x + 6 * x**2)
    v = (GOAL - START) * 30 * x**2 * (1 - x) ** 2 / 2
    a = (GOAL - START) * 60 * x * (1 - x) * (1 - 2 * x) / 4
    t = Trajectory(panda.joints, time, q, v, a)
    found = eo.evaluate([t, t.slowed(4.0)], "panda", ["source-method-2", "careful"])
    text = str(found)
    assert "under source-method-2" in text and "under careful" in text and text.count("all limits kept") == 2
    assert text.count("clearance proven ≥ ") == text.count(" (nearest measured ") == 2
    lines = [line.split() for line in text.splitlines()]
    begin = lines.index(["the", "total", "by", "effect"])
    parts = [float(line[1]) for line in lines[begin + 1 : [line[0] for line in lines].index("toppra")]]
    assert len(parts) >= 3 and abs(sum(parts) - float(lines[begin - 4][1])) < 1e-3 * (len(parts) + 1)
    model = pin.buildModelFromUrdf(str(panda.urdf))
    names = list(model.names)[1:]
    lock = [model.getJointId(n) for n in names if n not in panda.joints]
    q0 = pin.neutral(model)
    for n, value in panda.locked.items():
        q0[model.joints[model.getJointId(n)].idx_q] = value
    arm = pin.buildReducedModel(model, lock, q0)
    data = arm.createData()
    loss = [0.0036 * np.sum(pin.rnea(arm, data, *row) ** 2) for row in zip(q, v, a, strict=True)]
    energy = found.found[0].energies["source-method-2"]
    assert energy.by_effect["copper_loss"] == pytest.approx(np.trapezoid(loss, time), rel=1e-4)
    assert energy.standby == pytest.approx(2 * 88.04)
    assert found.found[1].energies["source-method-2"].standby == pytest.approx(4 * 88.04)
    two = [
        replace(e, motion=replace(e.motion, name=f"{folder}/trajectory.csv"))
        for folder, e in zip(("declared", "diagnosed"), found.found, strict=True)
    ]
    assert table(two).splitlines()[0].split() == ["declared/trajectory.csv", "diagnosed/trajectory.csv"]


def test_standard_moves_have_their_motion_in_a_file_beside_them(tmp_path: Path) -> None:
    """Their timing is the controller's own."""
    joints = ", ".join(f"j{k}" for k in range(6))
    (tmp_path / "moves.script").write_text(f"# {joints}\n  local start = [0,0,0,0,0,0]\n  movej([1,0,0,0,0,0])\n")
    (tmp_path / "moves.yaml").write_text("format: energy-opt/moves/1\nmoves:\n- to: [1.0]\n")
    for name in ("moves.script", "moves.yaml"):
        with pytest.raises(BadInput, match=r"standard moves.*trajectory\.csv beside"):
            eo.evaluate(tmp_path / name, "ur5e")


def test_a_recording_with_noise_is_smoothed(panda: Robot, tmp_path: Path) -> None:
    time = np.linspace(0, 3, 301)
    q = START + (GOAL - START) * (0.5 - 0.5 * np.cos(np.pi * time / 3))[:, None]
    noisy = q + np.random.default_rng(0).normal(0, 2e-4, q.shape)
    header = ",".join(["time", *(f"{joint}.position" for joint in panda.joints)])
    np.savetxt(tmp_path / "run.csv", np.column_stack([time, noisy]), delimiter=",", header=header, comments="")
    found = eo.evaluate(tmp_path / "run.csv", panda, "source-method-2").found[0]
    exact = Trajectory(
        panda.joints, time, q, *(np.gradient(x, time, axis=0) for x in (q, np.gradient(q, time, axis=0)))
    )
    clean = eo.evaluate(exact, panda, "source-method-2").found[0].energies["source-method-2"]
    assert "noisy recording" in found.motion.notes[0]
    assert found.energies["source-method-2"].loss == pytest.approx(clean.loss, rel=0.02)


def test_the_message_of_write_is_the_one_in_the_folder(panda: Robot, tmp_path: Path) -> None:
    """`--write yaml --rate 50` was replaced by the judged samples, with joint names without the prefix."""
    start, goal = (",".join(map(str, q)) for q in (START, START + 0.2))
    words = ["optimize", "--robot", "panda", f"--start={start}", f"--goal={goal}", "--mode", "retime", "--quiet"]
    words += ["--model", "source-method-2", "--compile", "never", "--out", str(tmp_path / "out")]
    assert main([*words, "--write", "yaml", "--rate", "50", "--joint-prefix", "left_"]) == 0
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [(row["file"], row["rate"]) for row in found["written"]] == [
        ("trajectory.csv", None),
        ("trajectory.yaml", 50),
    ]
    again = read_trajectory(tmp_path / "out" / "trajectory.yaml", panda.joints, "left_")
    np.testing.assert_allclose(np.diff(again.time)[:-1], 0.02, rtol=1e-6)
    assert main([*words, "--write", "csv", "--joint-prefix", "left_", "--force"]) == 0
    for file, prefix in (("trajectory.csv", ""), ("trajectory_prefixed.csv", "left_")):
        assert len(read_trajectory(tmp_path / "out" / file, panda.joints, prefix).time) > 100


def test_a_file_that_breaks_a_limit_is_no_secret_in_python(panda: Robot, tmp_path: Path) -> None:
    """The result said exit code 0 and no file, also after `save`; the command line said 4."""
    time = np.linspace(0, 0.3, 31)
    x = (time / 0.3)[:, None]
    shape = x**3 * (10 - 15 * x + 6 * x**2), 100 * x**2 * (1 - x) ** 2, 2000 / 3 * x * (1 - x) * (1 - 2 * x)
    rows = [np.outer(column, GOAL - START) for column in shape]
    fast = Trajectory(panda.joints, time, START + rows[0], rows[1], rows[2])
    with pytest.warns(UserWarning, match=r"trajectory\.yaml: .*THIS FILE BREAKS A LIMIT"):
        found = eo.evaluate(fast, "panda", "source-method-2", self_collision=False, write=["yaml"])
    assert found.exit_code == 4 and found["written"][0]["valid"] is False
    saved = json.loads((found.save(tmp_path / "a") / "evaluate.json").read_text())
    assert saved["written"] == found["written"] and (tmp_path / "a" / "trajectory.yaml").is_file()
    with pytest.warns(UserWarning, match=r"trajectory\.json: .*THIS FILE BREAKS A LIMIT"):
        found.save(tmp_path / "b", write=["json"])
