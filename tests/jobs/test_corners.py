"""A cycle that costs more than the evenly slowed one at a corner of assumed friction is planned again for that."""

import pytest

from energy_opt import job
from energy_opt.jobs.solve_job import run_job

CYCLE = """
format = "energy-opt/job/1"
robot = "z1"
cycle_time = 6.3339
home = [0.76704, 0.62319, -1.28714, 0.33442, -0.26611, -0.76217]
[[step]]
to = [0.35383, 0.91649, -1.76737, -0.10924, 0.17941, -0.48002]
[[step]]
wait = 0.4
[[step]]
to = "home"
"""


@pytest.mark.slow
def test_a_cycle_is_planned_again_at_the_corner_where_the_evenly_slowed_one_costs_less(tmp_path, monkeypatch) -> None:
    """The evenly slowed cycle was the answer: it costs less at one corner, and more in the mean."""
    planned = []
    monkeypatch.setattr("energy_opt.front.job.run_job", lambda *a, **k: planned.append(a) or run_job(*a, **k))
    file = tmp_path / "job.toml"
    file.write_text(CYCLE)
    answer = job(file, self_collision=False)
    assert planned and answer.result.solved and answer.result.energy < answer.result.slowed - 0.1
    assert all(row["saving_joules"] >= -1e-6 for row in answer.result.models)
