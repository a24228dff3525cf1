"""The time of a cycle is shared by the energies of its reshaped moves."""

from __future__ import annotations

from pathlib import Path

import pytest

from energy_opt.cli.main import example
from energy_opt.jobs.file import load_job
from energy_opt.jobs.solve_job import run_job
from energy_opt.power import source_method_2
from energy_opt.robot import Robot

EXAMPLE = example("job")


def written(folder: Path, text: str) -> Path:
    """The text as a job file."""
    path = folder / "job.toml"
    path.write_text(text)
    return path


def test_reshaped_moves_share_the_time_by_their_own_energies(panda: Robot, tmp_path: Path) -> None:
    """Shared by the energies of straight moves, the cycle took 516.3 J."""
    job = load_job(written(tmp_path, EXAMPLE), lambda _: panda)
    assert run_job(job, source_method_2()).energy < 515.0


@pytest.mark.slow
def test_a_longer_step_does_not_make_a_reshaped_cycle_cheaper(panda: Robot, tmp_path: Path) -> None:
    """It took 0.3 J less when one step had 7 % more time, 1.3 % of the losses."""
    job = load_job(written(tmp_path, EXAMPLE), lambda _: panda)
    found = run_job(job, source_method_2())
    long = next(piece for piece in found.pieces if piece.name == "to the camera").trajectory.duration
    longer = EXAMPLE.replace('to = "camera"', f'to = "camera"\nmin_duration = {1.07 * long}')
    again = run_job(load_job(written(tmp_path, longer), lambda _: panda), source_method_2())
    assert again.energy > found.energy - 0.1
