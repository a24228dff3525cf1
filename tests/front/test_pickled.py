"""Results and planners travel between processes, and a result that came back saves the same files."""

import pickle
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.motion import Move

START, GOAL = [0, 1, -1, 0, 0, 0], [0.8, 1.3, -1.2, 0.2, 0.3, 0.4]
GIVEN: dict[str, Any] = {"model": "source-method-2", "floor": -0.2}


def planned(goal: list[float]) -> Any:
    return eo.optimize("z1", start=START, goal=goal, duration=1.5, mode="retime", write=("urscript",), **GIVEN)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def answer() -> Any:
    return planned(GOAL)


@pytest.mark.parametrize("verb", ["optimize", "evaluate", "job"])
def test_a_result_is_pickled(verb: str, answer: Any, tmp_path: Path) -> None:
    """Results with bodies could not be: `concurrent.futures` gave an error in their place."""
    found = answer
    if verb == "evaluate":
        found = eo.evaluate(answer.trajectory, "z1", write=("urscript",), **GIVEN)
    elif verb == "job":
        steps = [{"to": GOAL, "mode": "retime"}, {"to": START, "mode": "retime"}]
        job = {"format": "energy-opt/job/1", "robot": "z1", "cycle_time": 4.0, "step": steps}
        found = eo.job(job, **GIVEN)
    check_pickled(found, tmp_path)


def test_a_result_of_several_robots_is_pickled(tmp_path: Path) -> None:
    """Its arms keep the solvers of their moves, which cannot be pickled."""
    steps = [{"name": name, "to": q, "mode": "retime"} for name, q in (("there", GOAL), ("back", START))]
    robots = [{"name": "a", "robot": "z1", "step": steps}]
    job = {"format": "energy-opt/job/2", "cycle_time": 4.0, "robot": robots}
    check_pickled(eo.job(job, **GIVEN), tmp_path)


def check_pickled(found: Any, tmp_path: Path) -> None:
    pickled = pickle.dumps(found)
    assert len(pickled) < 5e6  # the meshes of this arm alone would be 80 MB
    other = pickle.loads(pickled)
    assert other.to_json() == deepcopy(found).to_json() == found.to_json()
    assert contents(other.save(tmp_path / "pickled")) == contents(found.save(tmp_path / "own"))


def test_a_planner_is_pickled(answer: Any) -> None:
    planner = eo.Planner(answer.arm, eo.source_model(answer.arm), cell=answer.cell)
    move = Move(START, GOAL, "retime", 1.5)
    for other in (pickle.loads(pickle.dumps(planner)), deepcopy(planner)):
        found, own = other.solve(move), planner.solve(move)
        assert np.array_equal(found.trajectory.position, own.trajectory.position)
        assert found.certificate.clearance == own.certificate.clearance and own.certificate.clearance.proven


def test_the_bodies_of_a_pickled_cell_are_built_from_its_files(answer: Any) -> None:
    cell = pickle.loads(pickle.dumps(answer.cell))
    assert "bodies" not in vars(cell) and cell.checks and cell.free(np.array(START))
    with pytest.raises(AttributeError, match="'Cell' object has no attribute 'body'"):
        _ = cell.body
