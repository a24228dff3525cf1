"""Which branches and whole turns of a goal pose are compared by solved motions."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from tool_poses import pose_at

import energy_opt as eo
from energy_opt.errors import Infeasible
from energy_opt.front.given import source_model
from energy_opt.motion import Move, Planner, Settings
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.poses.turns import with_turns

TURN = 2 * np.pi


@pytest.mark.parametrize(
    ("start", "reached", "duration", "best"),
    [
        (  # it took 123 % of the loss more
            [1.2319, -0.088, 0.0457, 1.6065, -0.8501, 1.7077],
            [1.3424, -1.0385, 1.059, -0.2139, -1.599, 0.9851],
            2.208,
            [1.3424, 0.3433, -1.2363, 3.8412, -4.6842, -2.1565],
        ),
        (  # 13 %
            [-1.7128, -1.6518, -0.3758, 1.9365, 0.7666, 0.3156],
            [-1.0986, -1.321, 1.4946, -0.1273, 1.8616, 1.9392],
            1.894,
            [-1.0986, -5.7184, -1.8162, -1.8439, -1.8616, -1.2024],
        ),
    ],
)
def test_the_best_of_all_branches_and_turns_is_found_where_estimates_rank_it_late(
    ur: ToolKinematics, start: list[float], reached: list[float], duration: float, best: list[float]
) -> None:
    """`best` costs least of all branches and turns, each solved in full as a joint goal."""
    planner = Planner(ur.robot, source_model(ur.robot), Settings())
    least = planner.solve(Move(start, best, "reshape", duration)).energy
    pose = pose_at(ur, np.array(reached))
    found = eo.optimize(
        ur.robot, "source-method-2", start=start, goal=pose, duration=duration, self_collision=False
    ).document()
    assert found["energy"]["total"] <= least.total + 0.05 * least.loss
    assert found["solves"]["full"] <= 4


@pytest.mark.slow
def test_a_turn_whose_motion_is_clear_is_chosen_over_turns_that_lead_around_the_own_body() -> None:
    """Motions to the cheapest turns touch the forearm with the wrist; going around it took 65 % of the loss more."""
    start, best = (
        [0.1332, -0.4927, 1.1526, -0.7187, -0.6514, 1.5723],
        [-3.506, 1.9071, -1.5916, -4.0041, -2.5685, 4.4458],
    )
    least = eo.optimize("ur5e", "source-method-2", start=start, goal=best, duration=2.611).energy
    pose = pose_at(ToolKinematics(eo.load_robot("ur5e")), np.array(best))
    found = eo.optimize("ur5e", "source-method-2", start=start, goal=pose, duration=2.611)
    assert found.energy.total <= least.total + 0.05 * least.loss


def test_joints_are_turned_together_within_their_limits(ur: ToolKinematics) -> None:
    limits, near = ur.robot.limits, np.zeros(6)
    q = np.array([2.0, -2.5, 1.0, 3.0, -0.5, -3.1])
    found = {tuple(np.round((row - q) / TURN).astype(int)) for row in with_turns(ur, q, near)}
    expected = set()
    for turns in product((-1, 0, 1), repeat=6):
        there = q + TURN * np.array(turns)
        inside = (there >= limits.lower).all() and (there <= limits.upper).all()
        if inside and np.count_nonzero(turns) <= 3:
            expected.add(turns)
    assert found == expected and len(found) > 20
    assert np.array_equal(with_turns(ur, q, near)[0], q)


def test_where_all_positions_touch_the_least_deep_contact_is_named(tmp_path: Path) -> None:
    """It was the first one: the forearm, 102 mm deep. In another position only a wrist touches, 69 mm deep.

    In a short duration, it was a lack of time: positions that take too long had counted as free.
    """
    scene = tmp_path / "scene.yaml"
    scene.write_text("objects: [{name: ball, type: sphere, radius: 0.12, position: [0.3, -0.3, 0.35]}]")
    given = {"goal_pose": [0.4, -0.3, 0.3, 3.14, 0, 0], "scene": scene}
    joints = {"start": [0, -1.57, 1.57, -1.57, -1.57, 0]}
    for start, duration in ((joints, 2.0), (joints, 0.2), ({"start_pose": [0.4, 0.3, 0.3, 3.14, 0, 0]}, 2.0)):
        with pytest.raises(Infeasible, match=r"every joint position .* touches something; wrist_2_link touches ball"):
            eo.optimize("ur5e", "source-method-2", duration=duration, **start, **given)
