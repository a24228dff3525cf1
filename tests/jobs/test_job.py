"""Jobs: how time is shared, what is written, and what is refused."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from job_texts import AROUND, POST, RETIMED, written

import energy_opt as eo
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.errors import Infeasible
from energy_opt.formats import read_trajectory
from energy_opt.jobs.allocate import Front, Solved, allocate
from energy_opt.jobs.cycle import assembled
from energy_opt.jobs.file import job_of, load_job
from energy_opt.jobs.job_files import split
from energy_opt.jobs.solve_job import run_job
from energy_opt.motion import Settings
from energy_opt.motion.judge.clearance import clearance_of
from energy_opt.motion.path import straight
from energy_opt.motion.retime.solve import retime
from energy_opt.power import source_method_2
from energy_opt.robot import Robot


def _front(k: float, holding: float, shortest: float) -> Front:
    """E(T) = h T + k / (3 T^3) + 0.1 k^(1/2) / T^5: not quite the model that prices are found on."""

    def at_price(price: float) -> Solved:
        t = np.linspace(shortest, 60 * shortest, 100_001)
        cost = holding * t + k / (3 * t**3) + 0.1 * np.sqrt(k) / t**5 - price * t
        best = int(np.argmin(cost))
        return Solved(float(t[best]), float(cost[best] + price * t[best]), float(cost[best]))

    return Front(shortest, 60 * shortest, holding, at_price)


@pytest.mark.parametrize("time", [4.0, 6.0, 30.0])
def test_shares_equal_those_of_a_fine_grid(time: float) -> None:
    fronts = [_front(40.0, 95.0, 0.6), _front(300.0, 92.0, 1.1), _front(8.0, 99.0, 0.4)]
    shares = allocate(fronts, time, 90.0)
    assert shares.durations.sum() + shares.left == pytest.approx(time, rel=1e-12)

    def energy(t: np.ndarray) -> float:
        k, h = np.array([40.0, 300.0, 8.0]), np.array([f.holding for f in fronts])
        return float(np.sum(h * t + k / (3 * t**3) + 0.1 * np.sqrt(k) / t**5) + 90.0 * (time - t.sum()))

    grid = [np.linspace(f.shortest, min(4.0, time), 36) for f in fronts]
    best = min(energy(np.array(t)) for t in itertools.product(*grid) if sum(t) <= time)
    assert energy(shares.durations) <= best * (1 + 1e-4)
    assert shares.bound is not None and shares.bound <= energy(shares.durations) <= shares.bound * (1 + 1e-3)


def test_a_retimed_job_is_as_good_as_a_grid_of_durations(panda: Robot, tmp_path: Path) -> None:
    text = """
format = "energy-opt/job/1"
robot = "panda"
cycle_time = 2.2
mode = "retime"
[poses]
a = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
b = [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]
[[step]]
to = "b"
payload = 2.0
[[step]]
to = "a"
payload = 0.0
"""
    job = load_job(written(tmp_path, text), lambda name: panda)
    result = run_job(job, source_method_2())
    scorers = [result.scorers.of(step) for step in job.steps]

    def energy(k: int, duration: float) -> float:
        step = job.steps[k]
        found = retime(panda, scorers[k].model, straight(step.start, step.goal), duration=duration)
        return scorers[k].energy(found.trajectory).total

    best = min(energy(0, t) + energy(1, 2.2 - t) for t in np.linspace(0.95, 1.25, 7))
    assert result.energy <= best * 1.001
    assert result.bound is not None and result.bound <= result.energy <= result.bound * 1.001
    assert all(energy is None or result.energy <= energy for energy in result.energies.values())


@pytest.mark.slow
def test_the_example_on_the_command_line(panda: Robot, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["job", str(written(tmp_path, RETIMED)), "--out", str(out), "--quiet"]) == 0
    found = json.loads((out / "job.json").read_text())
    steps = found["steps"]
    assert sum(row["duration"] for row in steps) == pytest.approx(found["cycle_time"], abs=1e-9)
    assert sum(row["energy_total"] for row in steps) == pytest.approx(found["energy_total"], rel=1e-9)
    assert {row["name"] for row in found["baselines"]} == {"fastest_then_wait", "evenly_slowed"}
    assert all(found["energy_total"] <= row["energy_total"] for row in found["baselines"])
    assert [row["payload"] for row in steps if row["name"] in ("grip", "look", "back")] == [0.0, 2.0, 0.0]
    at = None
    for k, row in enumerate(steps, start=1):
        part = read_trajectory(out / f"step_{k:02d}.csv", panda.joints)
        assert part.duration == pytest.approx(row["duration"], abs=1e-9)
        assert at is None or np.abs(part.position[0] - at).max() < 1e-9
        at = part.position[-1]
    whole = read_trajectory(out / "cycle.csv", panda.joints)
    assert np.abs(whole.position[0] - whole.position[-1]).max() < 1e-9
    assert whole.duration == pytest.approx(found["cycle_time"], abs=1e-9)
    motion = read_trajectory(out / "step_02.csv", panda.joints)  # passed into without stopping
    assert np.abs(motion.velocity[0]).max() > 0.05
    assert (out / "report.html").stat().st_size < 6e6


def test_a_step_that_is_passed_ends_where_the_motion_is_nearest_to_its_pose(panda: Robot, tmp_path: Path) -> None:
    """It ended at the nearest sample, up to half a millimetre away."""
    text = RETIMED.replace('mode = "retime"', 'mode = "reshape"')
    job = load_job(written(tmp_path, text), lambda _: panda)
    result = run_job(job, source_method_2(), Settings(starts=1, controls=16))
    parts = [part.trajectory for part in split(result.pieces[0], result)]
    assert np.abs(parts[0].position[-1] - job.steps[0].goal).max() < 1e-7
    assert (parts[0].position[-1] == parts[1].position[0]).all() and (np.diff(parts[1].time) > 1e-6).all()
    assert sum(part.duration for part in parts) == pytest.approx(result.pieces[0].trajectory.duration, abs=1e-12)


def test_brakes_wait_without_holding_losses(panda: Robot, tmp_path: Path) -> None:
    held, braked = (
        run_job(load_job(written(tmp_path, RETIMED.replace("brakes = true", word)), lambda _: panda), source_method_2())
        for word in ("brakes = false", "brakes = true")
    )
    looks = [next(p for p in result.pieces if p.name == "look") for result in (held, braked)]
    assert looks[1].energy == pytest.approx(88.04 * looks[1].trajectory.duration, rel=1e-9)
    assert looks[0].energy / looks[0].trajectory.duration > 88.1


def test_waits_last_as_long_as_the_job_says(panda: Robot, tmp_path: Path) -> None:
    """Time left over was added to the last wait: it lasted longer, and brakes that the energy counts were open."""
    text = RETIMED.replace("brakes = false ", "brakes = true ", 1).replace("cycle_time = 5.5", "cycle_time = 9.0")
    text += '\n[[step]]\nname = "rest"\nwait = 0.6\n'
    result = run_job(load_job(written(tmp_path, text), lambda _: panda), source_method_2())
    *_, rest, left = result.pieces
    assert (rest.name, rest.trajectory.duration, rest.mode) == ("rest", 0.6, "")
    assert left.mode == "brakes" and left.energy == pytest.approx(88.04 * left.trajectory.duration, rel=1e-9)
    assert rest.energy > 88.1 * 0.6


@pytest.mark.parametrize("brakes", [False, True])
def test_brakes_hold_in_unused_time_where_the_job_says_so(brakes: bool, panda: Robot) -> None:
    """They held wherever a wait had brakes; baselines never had them, so a part of the saving was that of brakes."""
    bound = {"mode": "retime", "max_duration": 1.2}
    job = {
        "format": "energy-opt/job/1", "robot": "panda", "cycle_time": 4.0, "brakes": brakes,
        "step": [
            {"to": [0.9, 0.35, 0.2, -1.9, 0.0, 2.2, 0.9], **bound},
            {"wait": 0.1, "brakes": True},
            {"to": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], **bound},
        ],
    }  # fmt: skip
    result = run_job(job_of(job, Path("job.toml"), lambda _: panda), source_method_2())
    for plan in (result.plan, *result.baselines.values()):
        assert plan is not None
        left = next(p for p in assembled(result.job, result.scorers, plan) if p.name == "time left over")
        assert left.trajectory.duration > 1.0
        assert (left.energy == pytest.approx(88.04 * left.trajectory.duration, rel=1e-9)) == brakes


def test_no_lower_bound_is_above_the_energy() -> None:
    """Joints that turn round under dry friction take less than retiming assumes."""
    steps = [
        {"to": [0.6652, -1.3685, 1.1695, -0.7458, -1.6316, 0.147], "stop": False},
        {"to": [0.1043, -1.7112, 0.9341, -0.8828, -1.4773, 0.1789]},
    ]
    job = {
        "format": "energy-opt/job/1",
        "robot": "ur10e",
        "cycle_time": 2.5,
        "mode": "retime",
        "step": [*steps, {"wait": 0.5, "brakes": True}],
    }
    robot = eo.load_robot("ur10e")
    friction = eo.effects.CoulombFriction(tau_c=[18.475, 18.6607, 4.943, 1.7099, 2.2375, 2.4977])
    result = eo.job(job, model=eo.source_model(robot) + friction)
    assert 0.99 * result["energy_total"] < result["optimality"]["lower_bound"] <= result["energy_total"]


SWING = """format = "energy-opt/job/1"
robot = "panda"
cycle_time = 1.6
home = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
[[step]]
to = [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]
[[step]]
to = "home"
"""  # straight lines take 1.628 s


def test_a_cycle_may_be_shorter_than_straight_lines_allow(panda: Robot, tmp_path: Path) -> None:
    result = run_job(load_job(written(tmp_path, SWING), lambda _: panda), source_method_2())
    assert result.solved
    assert sum(answer.trajectory.duration for answer in result.plan.answers) == pytest.approx(1.6, abs=1e-9)
    assert sum("is too slow" in warning for warning in result.warnings) == 2
    for answer in result.plan.answers:
        q, v, a, _ = answer.trajectory.sample(np.linspace(0, answer.trajectory.duration, 400))
        torque, limits = panda.body.torque(q, v, a), panda.limits
        assert (np.abs(v) <= limits.velocity * 1.0001).all() and (np.abs(torque) <= limits.effort * 1.0001).all()
    late = SWING.replace("cycle_time = 1.6", "cycle_time = 1.4")
    with pytest.raises(Infeasible, match=r"its moves take 1\.59\d s at least"):
        run_job(load_job(written(tmp_path, late), lambda _: panda), source_method_2())


NEAR_BODY = """format = "energy-opt/job/1"
robot = "ur5e"
cycle_time = 4.0
mode = "retime"
home = [0.2456, 0.4867, -0.9533, 0.3033, 1.1155, -0.1777]
[[step]]
to = [-0.4521, 1.3116, -0.6365, -0.2418, 1.4252, 0.7092]
[[step]]
to = [0.2456, 0.4867, -0.9533, 0.3033, 1.1155, -0.1777]
"""


def test_a_cycle_keeps_the_clearance_that_its_steps_keep(tmp_path: Path) -> None:
    # at the first step's end, the upper arm is 8 mm from the base: less than the 10 mm that are asked for
    out, job = tmp_path / "out", written(tmp_path, NEAR_BODY)
    asked = ["--clearance", "0.01", "--model", "source-method-2", "--write", "yaml", "--quiet"]
    assert main(["job", str(job), "--out", str(out), *asked]) == 0
    files = json.loads((out / "job.json").read_text())["written"]
    assert [row["valid"] for row in files] == [True, True]


def test_a_job_moves_around_obstacles(panda: Robot, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(f"objects:\n  - {POST}\n")
    (tmp_path / "empty.yaml").write_text("objects: []\n")
    there, out = AROUND.replace("payload = 0.0", 'scene = "empty.yaml"'), tmp_path / "out"
    one = ["--out", str(out), "--quiet", "--model", "source-method-2"]
    assert main(["job", str(written(tmp_path, there)), *one]) == 0
    found = json.loads((out / "job.json").read_text())
    over, back = (next(row for row in found["steps"] if row["name"] == name) for name in ("over", "back"))
    assert over["first_path"] in ("own", "ompl") and back["first_path"] == "straight"
    # the baselines follow the path around the post; they had followed the straight line through it
    assert all(row["valid"] and row["energy_total"] >= found["energy_total"] for row in found["baselines"])
    cell = load_cell(panda, CellRequest(scene=tmp_path / "scene.yaml"))
    assert cell is not None
    for number, proven in ((1, True), (2, False)):  # the way back is made in the empty scene, through the post
        t = read_trajectory(out / f"step_{number:02d}.csv", panda.joints)
        assert clearance_of(cell, t).proven is proven
    assert found["optimality"]["gap_percent"] < 0.1
    assert [row["name"] for row in found["models"]] == ["source-method-2", "careful"]
    assert found["request"]["job"]["cycle_time"] == 3.2 and any("careful" in said for said in found["warnings"])
    for option in (["--clearance", "0.002"], ["--starts", "3"]):  # another request's answer is not overwritten
        assert main(["job", str(tmp_path / "job.toml"), *one, *option]) == 2
