"""A tube about a path: nearest points, derivatives of rows, and solved moves by a dense sampling of both curves."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from poses import GOAL, MIDDLE, START
from scipy.interpolate import CubicSpline

from energy_opt.cli.main import main
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion import Move, Planner, Settings
from energy_opt.motion.limits.tube import Tube
from energy_opt.motion.nearest import NearestOf
from energy_opt.motion.path import through
from energy_opt.power import PowerModel
from energy_opt.robot import Robot, tool_of

POINTS = np.stack([START, (START + MIDDLE) / 2 + 0.1, MIDDLE, GOAL])
QUICK = {"starts": 1, "controls": 20, "compile": "never"}


def spline(points: np.ndarray, count: int) -> np.ndarray:
    """Positions along the natural spline through points, by chord length."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return CubicSpline(s, points, bc_type="natural")(np.linspace(0, s[-1], count))


def test_nearest_points_are_the_nearest() -> None:
    near, dense = NearestOf(through(POINTS)), spline(POINTS, 40001)
    q = spline(POINTS, 30) + np.random.default_rng(1).normal(size=(30, 7)) * 0.3
    foot = near(q)
    least = np.array([np.linalg.norm(dense - row, axis=1).min() for row in q])
    assert np.linalg.norm(foot.off, axis=1) == pytest.approx(least, abs=1e-8)
    assert (near(np.stack([START + (START - MIDDLE), GOAL + (GOAL - MIDDLE)])).s == [0, 1]).all()


@pytest.mark.parametrize("words", ["0.1rad", "0.02m"])
def test_rows_have_the_derivatives_of_their_values(panda: Robot, words: str) -> None:
    path = through(POINTS)
    tube = Tube.of(panda, path, words, tool_of(panda.body, "panda_hand_tcp,0.02,0,0.1"))
    rows = tube.places(lambda u: path(u))
    rng = np.random.default_rng(3)
    q = path(rows.u) + rng.normal(size=(len(rows.u), 7)) * 0.03
    q[0], q[-1] = START - 0.05 * (MIDDLE - START), GOAL + 0.05 * (GOAL - MIDDLE)  # beyond the ends
    weight, h = rng.normal(size=len(rows.place)), 1e-6
    gradient, hessian = rows.gradient(q).copy(), rows.hessian(q, weight)
    for j in range(7):
        step = np.zeros(7)
        step[j] = h
        after, before = rows.value(q + step).copy(), rows.value(q - step).copy()
        assert gradient[:, j] == pytest.approx((after - before) / (2 * h), abs=2e-5 * np.abs(gradient).max())
        after, before = rows.gradient(q + step).copy(), rows.gradient(q - step).copy()
        change = np.zeros((len(q), 7))
        np.add.at(change, rows.place, weight[:, None] * (after - before) / (2 * h))
        assert hessian[:, j] == pytest.approx(change, abs=2e-5 * np.abs(hessian).max())


def deviation(robot: Robot, t: object, words: str) -> float:
    """How far a written trajectory is from the path, by places of both and Pinocchio."""
    q, path = t.sample(np.linspace(0, t.duration, 801))[0], spline(POINTS, 4001)
    if words.endswith("rad"):
        return max(np.abs(path - row)[np.linalg.norm(path - row, axis=1).argmin()].max() for row in q)
    model = pin.buildModelFromUrdf(str(robot.urdf))
    data, frame = model.createData(), model.getFrameId("panda_hand_tcp")

    def tool(rows: np.ndarray) -> np.ndarray:
        out = []
        for row in rows:
            pin.framesForwardKinematics(model, data, np.concatenate([row, [0.0, 0.0]]))
            out.append(data.oMf[frame].translation.copy())
        return np.array(out)

    path = tool(path)
    return max(np.linalg.norm(path - x, axis=1).min() for x in tool(q))


@pytest.mark.parametrize("words", ["0.1rad", "0.02m"])
def test_a_solved_move_stays_in_it(panda: Robot, model: PowerModel, words: str) -> None:
    planner = Planner(panda, model, Settings(tube=words, tool="panda_hand_tcp", **QUICK))
    result = planner.solve(Move(START, GOAL, path=through(POINTS), duration=3.0))
    most, found = float(words.rstrip("radm")), deviation(panda, result.trajectory, words)
    assert result.status == "solved" and result.chosen == "reshape" and result.saving["loss_percent"] > 3
    assert 0.9 * most < found <= most * (1 + 1e-3)  # it is what holds the move back
    assert result.certificate.max_violation["tube"] == pytest.approx(found / most - 1, abs=5e-3)
    assert result.certificate.max_violation["tube"] <= 1e-6
    retimed = planner.solve(Move(START, GOAL, "retime", path=through(POINTS), duration=3.0))
    assert retimed.certificate.max_violation["tube"] < -0.999 and retimed.energy.total > result.energy.total


def test_a_closed_path_is_reshaped_within_it_and_keeps_its_shape_without(panda: Robot, model: PowerModel) -> None:
    """It kept its shape in a tube, too, and nothing said so."""
    there = through(POINTS)(np.linspace(0, 1, 9))
    loop = through(np.vstack([there, there[::-1][1:] + 0.1 * np.sin(np.linspace(0, np.pi, 9))[1:, None]]))
    move = Move(loop.start, loop.start, path=loop, duration=6.0)
    inside, outside = (Planner(panda, model, Settings(tube=w, **QUICK)).solve(move) for w in ("0.05rad", None))
    assert inside.chosen == "reshape" and inside.energy.loss < 0.97 * outside.energy.loss
    assert np.ptp(inside.trajectory.position, axis=0).max() > 0.8 * np.ptp(there, axis=0).max()
    said = "the path ends where it begins: its shape is kept"
    assert outside.warnings[-1].startswith(said) and not any(said in line for line in inside.warnings)
    still = Planner(panda, model, Settings(tube="0.05rad", **QUICK)).solve(Move(START, START, duration=1.0))
    assert still.status == "solved" and not np.ptp(still.trajectory.position, axis=0).any()


def test_in_a_narrow_one_the_answer_is_no_worse_than_the_path_in_its_best_timing(
    panda: Robot, model: PowerModel
) -> None:
    """A converged curve of few control points took a tenth more, and counted as better than any timing."""
    planner = Planner(panda, model, Settings(tube="0.001rad", **QUICK))
    asked = Move(START, GOAL, path=through(POINTS), duration=3.0)
    result, retimed = planner.solve(asked), planner.solve(replace(asked, mode="retime"))
    assert result.status == "solved" and result.certificate.valid
    assert result.energy.total <= retimed.energy.total * (1 + 1e-9)


@pytest.mark.nightly
def test_one_too_narrow_to_search_is_answered_all_the_same(panda: Robot, model: PowerModel) -> None:
    """The path itself is within it, in its best timing."""
    planner = Planner(panda, model, Settings(tube="0.00003m", tool="panda_hand_tcp", **QUICK))
    asked = Move(START, GOAL, path=through(POINTS), duration=3.0)
    result, retimed = planner.solve(asked), planner.solve(replace(asked, mode="retime"))
    assert result.status == "solved" and result.certificate.valid
    assert result.energy.total <= retimed.energy.total * (1 + 1e-9)


def test_words_that_are_no_tube_and_ends_that_are_outside(panda: Robot, model: PowerModel, tmp_path, capsys) -> None:
    for wrong in ("0.1", "0rad", "-1m", "nanrad", "rad", "5deg", "infm"):
        with pytest.raises(BadInput, match=r"tube .* 0\.1rad"):
            Settings(tube=wrong)
    with pytest.raises(Infeasible, match=r"goal: panda_joint1: 0\.2 rad from the path, allowed are 0\.1"):
        away = GOAL + [0.2, 0, 0, 0, 0, 0, 0]
        Planner(panda, model, Settings(tube="0.1rad", **QUICK)).solve(Move(START, away, path=through(POINTS)))
    ends = [",".join(f"{x:.6g}" for x in q) for q in (START, START + 0.1)]
    words = ["optimize", "--robot", "panda", f"--start={ends[0]}", f"--goal={ends[1]}", "--mode", "retime", "--quiet"]
    assert main([*words, "--tube", "0.05rad", "--out", str(tmp_path), "--json"]) == 0
    assert '"tube": ' in capsys.readouterr().out
