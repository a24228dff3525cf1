"""Where every reshaped move costs too much under some model, the best timing of the first path is the answer."""

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
