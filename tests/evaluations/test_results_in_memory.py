"""Results and trajectories from Python are evaluated as their files are, and the saved request can be repeated."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import energy_opt as eo

START = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
GOAL = [0.6, -0.3, 0.2, -1.9, 0, 1.7, 0.785]
MODEL = "source-method-2"


@pytest.fixture(scope="module")
def result():
    return eo.optimize("panda", MODEL, start=START, goal=GOAL, duration=2.0, mode="retime", payload=1.5, floor=-0.2)


def energies(found) -> list[float]:
    return [motion["models"][0]["energy"]["total"] for motion in found["motions"]]


def test_a_result_brings_its_payload_and_cell(result):
    found = eo.evaluate(result, model=MODEL)
    assert energies(found) == pytest.approx([result.energy.total])
    assert found.request.floor == -0.2


def test_a_saved_request_holds_what_was_in_memory(result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """It named the file "trajectory", which nobody had written."""
    monkeypatch.chdir(tmp_path)
    found = eo.evaluate([result, result.trajectory], "panda", MODEL, self_collision=False)
    found.save("first")
    shutil.move("first", "moved")
    again = eo.repeat("moved/evaluate.json")
    assert energies(again) == energies(found) and energies(found)[0] != energies(found)[1]
    again.save("moved")
    assert eo.check("moved").exit_code == 0


def test_a_cycle_brings_the_payloads_of_its_steps():
    steps = [{"to": GOAL, "payload": 1.5}, {"wait": 0.5}, {"to": START, "payload": 0.0}]
    job = {"format": "energy-opt/job/1", "robot": "panda", "cycle_time": 6.0, "mode": "retime", "step": steps}
    cycle = eo.job(job, model=MODEL, self_collision=False)
    assert energies(eo.evaluate(cycle, model=MODEL)) == pytest.approx([cycle["energy_total"]], rel=1e-4)


def test_what_is_no_motion_is_named_in_one_line(result):
    long = "<robot>\n" + 5000 * "x"
    for call, says in (
        (lambda: eo.evaluate([3], "panda"), r"^3: expected files, trajectories, or results"),
        (lambda: eo.evaluate(long), "^FILE .*: too long; expected the name of a file, not its text$"),
        (lambda: eo.load_robot(long), "^robot .*: too long; expected the name of a file, not its text$"),
        (lambda: eo.load_model(long), "^model .*: too long; expected the name of a file, not its text$"),
        (lambda: eo.optimize("panda", path=long), "^path .*: too long"),
    ):
        with pytest.raises(eo.BadInput, match=says):
            call()


def test_a_path_may_be_that_of_a_result(result):
    again = eo.optimize("panda", MODEL, path=result, mode="retime", payload=1.5, floor=-0.2)
    assert again.duration == pytest.approx(2.0)
