"""A job, or its front, that is interrupted says so in its file and in its warnings."""

from __future__ import annotations

from typing import Any

import energy_opt as eo
from energy_opt.front import job as front

JOB: dict[str, Any] = {
    "format": "energy-opt/job/1",
    "robot": "z1",
    "cycle_time": 4.0,
    "home": [0, 1, -1, 0, 0, 0],
    "mode": "retime",
    "step": [{"to": [0.8, 1.3, -1.2, 0.2, 0.3, 0.4]}, {"to": "home"}],
}
WORDS = "interrupted: this is the best so far, not a finished search; --resume continues it"


def test_an_interrupted_job_says_so() -> None:
    found = eo.job(JOB, model="source-method-2", stopped=lambda: True)
    assert found["interrupted"] and found["status"] == "not_converged" and WORDS in found["warnings"]


def test_a_job_whose_last_check_is_interrupted_is_not_solved(monkeypatch: Any) -> None:
    pressed: list[bool] = []
    inner = front.grounded
    monkeypatch.setattr(front, "grounded", lambda *words: pressed.append(True) or inner(*words))
    found = eo.job(JOB, model="source-method-2", stopped=lambda: bool(pressed))
    assert found["interrupted"] and found["status"] == "not_converged" and found.exit_code == 130


def test_an_interrupted_front_says_so() -> None:
    found = eo.tradeoff(job=JOB, model="source-method-2", durations=[4.0], stopped=lambda: True)
    assert found["status"] == "interrupted" and found["warnings"][0] == WORDS
    move = {"start": JOB["home"], "goal": JOB["step"][0]["to"], "mode": "retime", "model": "source-method-2"}
    found = eo.tradeoff("z1", **move, durations=[1.5, 2.0], stopped=lambda: True)
    assert found["status"] == "interrupted" and found["warnings"][0].startswith("interrupted: ")
