"""One question has one answer: every verb plans under the same models where none is given."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import energy_opt as eo
from energy_opt.batches.executors import solve_task
from energy_opt.batches.suite import load_suite
from energy_opt.cli.main import main
from energy_opt.motion.judge.energy import Scorer
from energy_opt.power.known import careful

START, GOAL = [0.3, -1.9, 1.5, -1.2, -1.6, 0.2], [-0.6, -1.2, 0.9, -1.6, -1.1, 0.9]
JOB = """format = "energy-opt/job/1"
robot = "ur5"
cycle_time = 4.0
home = {start}
[[step]]
name = "there"
to = {goal}
mode = "retime"
min_duration = 2.0
max_duration = 2.0
[[step]]
name = "stay"
wait = 0.5
[[step]]
name = "back"
to = "home"
mode = "retime"
"""


@pytest.fixture(scope="module")
def alone() -> dict[str, float]:
    """Energies of the move in 2 s as `optimize` plans it."""
    answer = eo.optimize("ur5", start=START, goal=GOAL, duration=2.0, mode="retime", compile="never")
    return answer.energy.document() | {"careful": answer.models[1]["total"]}


def test_a_front_has_the_energies_of_single_moves(alone: dict[str, float]) -> None:
    front = eo.tradeoff("ur5", start=START, goal=GOAL, durations=[2.0, 3.0], mode="retime", compile="never")
    point = front.document()["points"][0]
    assert point["energy_loss"] == pytest.approx(alone["loss"], rel=1e-3)
    assert point["energy_total"] == pytest.approx(alone["total"], rel=1e-5)
    names = [row["name"] for row in front.document()["models"]]
    assert names[:2] == ["source-method-2", "careful"] and len(names) == 6  # and the corners of assumed friction
    assert front.document()["request"]["robust"]["kind"] == "mean"
    assert any(row["source"] == "assumed" for row in front.document()["assumptions"])
    for row in front.document()["models"]:
        assert row["saving_joules"] is None or row["saving_joules"] >= -1e-6
    scorer = Scorer(front.robot, careful(front.robot))
    assert scorer.energy(front.front.points[0].trajectory).total == pytest.approx(alone["careful"], rel=1e-5)


def test_a_batch_has_the_energies_of_single_moves(alone: dict[str, float], tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(
        'format = "energy-opt/suite/1"\nname = "s"\nrobots = ["ur5"]\nmodes = ["retime"]\ndurations = [2.0]\n'
        f"[[moves]]\nstart = {START}\ngoal = {GOAL}\n"
    )
    (task,) = load_suite(tmp_path / "s.toml", compile="never").tasks
    row = solve_task(task)["row"]
    assert task.model == "mean" and row["status"] == "solved"
    assert row["energy_loss"] == pytest.approx(alone["loss"], rel=1e-3)


def test_a_job_has_the_energies_of_single_moves(alone: dict[str, float], tmp_path: Path) -> None:
    (tmp_path / "job.toml").write_text(JOB.format(start=START, goal=GOAL))
    out = tmp_path / "out"
    assert main(["job", str(tmp_path / "job.toml"), "--compile", "never", "--out", str(out), "--quiet"]) == 0
    found = json.loads((out / "job.json").read_text())
    there = next(row for row in found["steps"] if row["name"] == "there")
    assert there["duration"] == pytest.approx(2.0) and there["energy_total"] == pytest.approx(alone["total"], rel=1e-4)
    assert [row["name"] for row in found["models"][:2]] == ["source-method-2", "careful"]
    assert found["models"][0]["total"] == pytest.approx(found["energy_total"])
    assert all(row["saving_joules"] >= -1e-6 for row in found["models"])
    assert found["request"]["robust"]["kind"] == "mean" and found["assumptions"]
    assert {row["step"] for row in found["travel"]} <= {"there", "back"} and "break_even_friction" in found
    assert "Values that were not given" in (out / "report.html").read_text()
