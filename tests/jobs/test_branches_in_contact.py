"""Branches of a pose whose straight moves touch a body: a short detour costs less than another branch."""

from pathlib import Path

import numpy as np
import pytest

from energy_opt.cell.request import CellRequest
from energy_opt.errors import Infeasible
from energy_opt.front.given import source_model
from energy_opt.jobs import run_posed as module
from energy_opt.jobs.file import Job, load_job
from energy_opt.jobs.posed import Ends, Posed
from energy_opt.jobs.run_posed import run_posed
from energy_opt.jobs.solve_job import RoughCycles
from energy_opt.motion import Settings
from energy_opt.robot import load_robot

JOB = """format = "energy-opt/job/1"
robot = "ur5e"
cycle_time = 5.0
home = [0.42, -1.29, 1.83, -2.11, -1.57, 0.0]
[[step]]
name = "put"
pose = "world: 0.37, -0.45, 0.13, 3.14159265, 0, 0"
[[step]]
to = "home"
"""
SCENE = "objects:\n  - {name: post, type: cylinder, radius: 0.05, height: 0.5, position: [0.55, 0.05, 0.2]}\n"
NATURAL = [-1.11, -1.24, 1.82]  # the branch without the post


@pytest.fixture
def job(tmp_path: Path) -> tuple[Job, CellRequest]:
    (tmp_path / "job.toml").write_text(JOB)
    (tmp_path / "scene.yaml").write_text(SCENE)
    return load_job(tmp_path / "job.toml", load_robot), CellRequest(
        scene=tmp_path / "scene.yaml", tool="tool0,0,0,0.12"
    )


def natural(ends: Ends) -> bool:
    return bool(np.allclose(ends[0][:3], NATURAL, atol=0.02))


def test_the_branch_with_the_cheaper_rough_cycle_comes_first(
    job: tuple[Job, CellRequest], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A straight move in contact cost 1 MJ, so that its branch was never compared."""
    model, settings = source_model(job[0].robot), Settings(starts=1)
    posed, rough = Posed(job[0], model, settings, job[1]), RoughCycles(model, settings, job[0], lambda: False)
    alone = Posed(job[0], model, settings, CellRequest(tool=job[1].tool)).choices()
    assert [natural(ends) for ends in alone] == [True]
    assert [natural(ends) for ends in posed.choices()] == [False, True]
    for around, first in ((1.0, True), (3.0, False), (np.inf, False)):
        of = lambda posed, rough, ends, e=around: (ends, None, e if natural(ends) else 2.0)  # noqa: E731
        monkeypatch.setattr(Posed, "settled", of)
        assert [natural(ends) for ends in posed.likely(rough)] == [first, not first]


def test_the_other_branch_follows_where_the_first_cannot_be_done(
    job: tuple[Job, CellRequest], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Posed, "settled", lambda posed, rough, ends: (ends, None, 1.0 if natural(ends) else 2.0))
    tried: list[bool] = []

    def run(at: Job, *given: object, **more: object) -> object:
        tried.append(natural({0: at.steps[0].goal}))
        if tried[-1]:
            raise Infeasible("no path around the post")
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "run_job", run)
    with pytest.raises(KeyboardInterrupt):
        run_posed(job[0], source_model(job[0].robot), cell=job[1])
    assert tried == [True, False]


@pytest.mark.nightly
def test_a_pose_behind_a_post_takes_no_more_than_its_best_position(job: tuple[Job, CellRequest]) -> None:
    model = source_model(job[0].robot)
    found = run_posed(job[0], model, cell=job[1])
    assert found.solved and found.choice is not None and natural(dict(found.choice.ends))
