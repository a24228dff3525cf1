"""Single joints rest in fronts and jobs under several models, as they do in the answer of `optimize`."""

from __future__ import annotations

import numpy as np
import pytest

import energy_opt as eo

START = np.array([-1.38, 0.27, -1.0, 0.53, -1.44, -0.57])
GOAL = START + [1.0, -0.002, 0.0, 0.0, 0.0, 0.0]  # the shoulder bears the load, and has hardly to move
LOAD = 4.0


def resting(trajectory: eo.Trajectory) -> float:
    """The share of the samples at which the shoulder rests."""
    return float(np.mean(np.abs(trajectory.velocity[:, 1]) < 1e-9))


@pytest.mark.slow
def test_a_joint_with_hardly_a_way_to_go_rests_in_a_front():
    front = eo.tradeoff("ur10e", start=START, goal=GOAL, durations=[1.1], payload=LOAD)
    assert front.front is not None
    (point,) = front.front.points
    assert point.trajectory is not None
    assert resting(point.trajectory) > 0.9


def test_a_joint_with_hardly_a_way_to_go_rests_in_a_job_that_takes_no_more_than_evenly_slowed():
    steps = [{"name": "there", "to": GOAL.tolist()}, {"name": "back", "to": "home"}]
    content = {"format": "energy-opt/job/1", "robot": "ur10e", "cycle_time": 3.0, "home": START.tolist()}
    found = eo.job({**content, "payload": LOAD, "step": steps})
    assert max(resting(answer.trajectory) for answer in found.result.plan.answers) > 0.9
    assert all(row["saving_joules"] >= 0 for row in found["models"])
