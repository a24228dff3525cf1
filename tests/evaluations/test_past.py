"""Effects that depend on what came before, in motions with waits: by their laws over the whole motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import energy_opt as eo
from energy_opt import formats
from energy_opt.jobs.file import load_job
from energy_opt.jobs.job_files import found_of, write
from energy_opt.jobs.solve_job import run_job
from energy_opt.motion.path import straight
from energy_opt.motion.timing.toppra import fastest
from energy_opt.motion.trajectory import Trajectory, joined, standing
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot

START, GOAL = np.array([0.0, 1, -1, 0, 0, 0]), np.array([0.8, 1.2, -1.2, 0, 0, 0])
OVERHEAD = eo.effects.Standby(power=10.0), eo.effects.CopperLoss(r_over_kt2=0.01)


@pytest.fixture(scope="module")
def z1() -> Robot:
    return load_robot("z1")


def _move(robot: Robot, start: np.ndarray, goal: np.ndarray, seconds: float) -> Trajectory:
    timing = fastest(robot, source_method_2(robot), straight(start, goal))
    return timing.slowed(seconds).trajectory(robot.joints)


def _parts(robot: Robot) -> list[Trajectory]:
    """A move of 1 s, a wait of 2 s, the move back in 1 s and a wait of 0.5 s."""
    return [
        _move(robot, START, GOAL, 1.0),
        standing(robot.joints, GOAL, 2.0),
        _move(robot, GOAL, START, 1.0),
        standing(robot.joints, START, 0.5),
    ]


def _evaluated(robot: Robot, file: Path, motion: Trajectory, *effects: eo.effects.Effect) -> dict[str, float]:
    """Energies of a motion by effect."""
    formats.write(motion, file)
    (found,) = eo.evaluate(file, robot, eo.PowerModel("z1", (*OVERHEAD, *effects))).found
    (energy,) = found.energies.values()
    return energy.by_effect


def _energy(robot: Robot, folder: Path, *effects: eo.effects.Effect) -> dict[str, float]:
    """Energies by effect of the parts as one motion."""
    return _evaluated(robot, folder / "motion.csv", joined(_parts(robot)), *effects)


def test_a_wait_stands_still_after_a_motion_that_ends_with_an_acceleration(z1: Robot, tmp_path: Path) -> None:
    """The wait had begun with the acceleration that its motion ended with: it seemed to move."""
    separate = [_evaluated(z1, tmp_path / f"{k}.csv", part)["copper_loss"] for k, part in enumerate(_parts(z1))]
    assert _energy(z1, tmp_path)["copper_loss"] == pytest.approx(sum(separate), rel=1e-6)


def test_power_after_a_motion_is_counted_in_every_wait(z1: Robot, tmp_path: Path) -> None:
    """It had been left out: every wait counted as if no motion came before it."""
    held = _energy(z1, tmp_path, eo.effects.IdleHold(power=20.0, duration=0.8))["idle_hold"]
    assert held == pytest.approx(20.0 * (0.8 + 0.5), rel=0.01)


def test_warming_goes_on_over_waits(z1: Robot, tmp_path: Path) -> None:
    """Time had started anew with every motion and wait."""
    drift = _energy(z1, tmp_path, eo.effects.StandbyDrift(power=6.0, time_constant=2.0))["standby_drift"]
    assert drift == pytest.approx(6.0 * (4.5 - 2.0 * (1 - np.exp(-4.5 / 2.0))), rel=1e-3)


def test_a_store_keeps_its_energy_over_a_wait(z1: Robot, tmp_path: Path) -> None:
    """What braking stores, holding uses first: with a large store nothing is lost."""
    lost = {c: _energy(z1, tmp_path, eo.effects.DcLink(capacity=c))["dc_link"] for c in (0.0, 50.0)}
    assert lost[0.0] > 0.1
    assert lost[50.0] < 0.05 * lost[0.0]


JOB = """
format = "energy-opt/job/1"
robot = "z1"
cycle_time = 6.0
mode = "retime"
home = [0, 1, -1, 0, 0, 0]
[[step]]
to = [0.8, 1.2, -1.2, 0, 0, 0]
min_duration = 1.0
max_duration = 1.0
[[step]]
wait = 2.0
[[step]]
to = "home"
min_duration = 1.0
max_duration = 1.0
[[step]]
wait = 2.0
brakes = true
"""


def test_a_job_counts_what_came_before_each_step(z1: Robot, tmp_path: Path) -> None:
    """Holding after a motion and warming had been left out of its waits; a braked wait's file showed holding power."""
    (tmp_path / "job.toml").write_text(JOB)
    hold = eo.effects.IdleHold(power=20.0, duration=0.8)
    drift = eo.effects.StandbyDrift(power=6.0, time_constant=2.0)
    job = load_job(tmp_path / "job.toml", lambda name: z1)
    plain, full = (run_job(job, eo.PowerModel("z1", (*OVERHEAD, *more))) for more in ((), (hold, drift)))
    warm = 6.0 * (6.0 - 2.0 * (1 - np.exp(-6.0 / 2.0)))
    assert full.energy - plain.energy == pytest.approx(16.0 + warm, rel=0.01)
    write(full, {}, tmp_path / "out")
    steps = found_of(full, {})["steps"]
    assert sum(step["energy_total"] for step in steps) == pytest.approx(full.energy)
    time, *_, power = np.genfromtxt(tmp_path / "out" / "step_04.csv", delimiter=",", skip_header=1).T
    seconds = time + steps[3]["start"]
    assert power == pytest.approx(10.0 + 6.0 * (1 - np.exp(-seconds / 2.0)), rel=1e-6)


def test_no_bound_is_stated_that_leaves_out_what_came_before(z1: Robot, tmp_path: Path) -> None:
    """Braking of one leg fed the next: the bound of the legs alone was 0.6 % above the energy."""
    free = [line for line in JOB.splitlines() if "duration" not in line]
    (tmp_path / "job.toml").write_text("\n".join(free))
    job = load_job(tmp_path / "job.toml", lambda name: z1)
    plain, stored = (
        run_job(job, eo.PowerModel("z1", (*OVERHEAD, *more))) for more in ((), (eo.effects.DcLink(capacity=50.0),))
    )
    assert plain.bound is not None and plain.bound <= plain.energy
    assert stored.bound is None
