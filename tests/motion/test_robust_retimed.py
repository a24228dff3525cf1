"""Reshaped moves that cost too much under some model: the answer is no worse than the best timing of the first path."""

from __future__ import annotations

import pytest

import energy_opt as eo


@pytest.mark.parametrize("payload", [None, 1.0])
def test_reshaping_under_several_models_is_not_worse_than_retiming(payload: float | None) -> None:
    """It gave the evenly slowed move, which costs more than the retimed one under each of the models."""
    asked = {"start": [0, 1, -1, 0, 0, 0], "goal": [0.8, 1.5, -1.3, 0.3, 0.2, 0.1], "duration": 2.0, "payload": payload}
    answers = {mode: eo.optimize("z1", mode=mode, compile="never", **asked) for mode in ("retime", "reshape")}
    totals = {mode: answer.document()["robust"]["total"] for mode, answer in answers.items()}
    assert totals["reshape"] <= totals["retime"] * (1 + 1e-9)
    assert all(row["saving_joules"] >= 0 for row in answers["reshape"].document()["models"])
    assert answers["reshape"].status == "solved" and answers["reshape"].energy.loss > 0


def test_a_mean_with_the_move_of_one_model_is_better_than_the_evenly_slowed_move() -> None:
    """One timing of the first path cost too much at a corner, too: the answer was the evenly slowed move."""
    asked = {
        "start": [-0.7, 1.2, -1.1, 0.7, -0.4, -0.2], "goal": [0, 1.3, -0.7, 0.9, -0.8, -0.9], "duration": 2.0,
        "payload": 2.0, "self_collision": "off", "compile": "never", "starts": 1, "controls": 12,
    }  # fmt: skip
    reshaped, retimed = (eo.optimize("z1", mode=mode, **asked).document() for mode in ("reshape", "retime"))
    assert reshaped["robust"]["total"] < retimed["robust"]["total"]
    assert all(row["saving_joules"] >= 0 for row in reshaped["models"]) and "evenly slowed" not in reshaped["message"]
