"""Jobs: how time is shared, what is written, what is refused, and that a killed job goes on."""

from __future__ import annotations

import itertools
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from faults import faults_of

from energy_opt.batches.suite import load_suite
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import example, main
from energy_opt.errors import BadInput, Infeasible
from energy_opt.formats import read_trajectory
from energy_opt.front.check import check
from energy_opt.jobs.allocate import Front, Solved, allocate
from energy_opt.jobs.file import load_job
from energy_opt.jobs.legs import wrong_frames
from energy_opt.jobs.solve_job import run_job
from energy_opt.jobs.work import Answers
from energy_opt.motion import Settings
from energy_opt.motion.judge.clearance import clearance_of
from energy_opt.motion.path import straight
from energy_opt.motion.retime.solve import retime
from energy_opt.poses.given import poses_of_request
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot

EXAMPLE = example("job")

RETIMED = EXAMPLE.replace('mode = "reshape" ', 'mode = "retime"  ')


def _written(folder: Path, text: str) -> Path:
    path = folder / "job.toml"
    path.write_text(text)
    return path


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
    job = load_job(_written(tmp_path, text), lambda name: panda)
    result = run_job(job, source_method_2())
    scorers = [result.scorer(step) for step in job.steps]

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
    assert main(["job", str(_written(tmp_path, RETIMED)), "--out", str(out), "--quiet"]) == 0
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


def test_brakes_wait_without_holding_losses(panda: Robot, tmp_path: Path) -> None:
    held, braked = (
        run_job(
            load_job(_written(tmp_path, RETIMED.replace("brakes = true", word)), lambda _: panda), source_method_2()
        )
        for word in ("brakes = false", "brakes = true")
    )
    looks = [next(p for p in result.pieces if p.name == "look") for result in (held, braked)]
    assert looks[1].energy == pytest.approx(88.04 * looks[1].trajectory.duration, rel=1e-9)
    assert looks[0].energy / looks[0].trajectory.duration > 88.1


def test_waits_last_as_long_as_the_job_says(panda: Robot, tmp_path: Path) -> None:
    """Time left over was added to the last wait: it lasted longer, and brakes that the energy counts were open."""
    text = RETIMED.replace("brakes = false ", "brakes = true ", 1).replace("cycle_time = 5.5", "cycle_time = 9.0")
    text += '\n[[step]]\nname = "rest"\nwait = 0.6\n'
    result = run_job(load_job(_written(tmp_path, text), lambda _: panda), source_method_2())
    *_, rest, left = result.pieces
    assert (rest.name, rest.trajectory.duration, rest.mode) == ("rest", 0.6, "")
    assert left.mode == "brakes" and left.energy == pytest.approx(88.04 * left.trajectory.duration, rel=1e-9)
    assert rest.energy > 88.1 * 0.6


FAULTS = [
    ('to = "tray"', 'to = "trai"', r"step 6 \(to the tray\).*'trai'; did you mean 'tray'"),
    ("wait = 0.3", "wait = -1", r"step 7 \(release\): wait"),
    ('to = "home"\n', 'to = "tray"\n', r"step 9 \(back\).*does not return.*panda_joint1"),
    ("cycle_time = 5.5", 'cycle_time = "5.5"', "cycle_time"),
    ("cycle_time = 5.5", "cycle_tim = 5.5", "unknown key 'cycle_tim'; did you mean 'cycle_time'"),
    ("payload = 2.0", "payload = -2.0", r"step 4 \(to the camera\): payload"),
    ("max_duration = 4.0", "max_duration = 4.0\nmin_duration = 5.0", r"step 6 \(to the tray\): min_duration"),
    (
        "stop = false ",
        "max_duration = 0.6\nstop = false ",
        r"step 1 \(over the part\): stop = false; .*the step that stops",
    ),
    ("part = [0.9,", "part = [9.0,", "panda_joint1 = 9 is outside"),
    ("stop = false", "stop = 0", "stop = 0; expected true or false"),
    ('to = "part"\n', 'to = "part"\nwait = 1.0\n', "either `to` or `wait`"),
    ("payload = 2.0", 'payload = 2.0\nscene = "../x.yaml"', "outside"),
    ('format = "energy-opt/job/1"', 'format = "energy-opt/job/9"', "energy-opt/job/1"),
    ("cycle_time = 5.5", "cycle_time = 1e6", "100000 or less$"),  # no file of a longer motion can be read
    ("cycle_time = 5.5 ", "", "cycle_time is missing"),
    ('to = "part"\n', 'to = "part"\nscene = "empty.yaml"\n', r"step 2 \(to the part\): .*stop = false.*scene"),
    ('robot = "panda"', 'robot = "../arm.urdf"', "robot: .*outside"),
]


@pytest.mark.parametrize(("before", "after", "said"), FAULTS)
def test_faults_are_named_with_their_step(before: str, after: str, said: str, panda: Robot, tmp_path: Path) -> None:
    assert before in EXAMPLE
    path = _written(tmp_path, EXAMPLE.replace(before, after, 1))
    (tmp_path / "empty.yaml").write_text("objects: []\n")
    with pytest.raises(BadInput, match=said):
        load_job(path, lambda name: panda)
    assert faults_of(load_job, path, lambda name: panda)


def test_a_cycle_that_is_too_short_says_what_would_do(panda: Robot, tmp_path: Path) -> None:
    text = RETIMED.replace("cycle_time = 5.5", "cycle_time = 2.0")
    with pytest.raises(Infeasible, match="the longest is") as caught:
        run_job(load_job(_written(tmp_path, text), lambda _: panda), source_method_2())
    shortest = caught.value.shortest_duration
    assert shortest is not None
    text = RETIMED.replace("cycle_time = 5.5", f"cycle_time = {shortest + 1e-6}")
    assert run_job(load_job(_written(tmp_path, text), lambda _: panda), source_method_2()).pieces


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
    result = run_job(load_job(_written(tmp_path, SWING), lambda _: panda), source_method_2())
    assert result.solved
    assert sum(answer.trajectory.duration for answer in result.plan.answers) == pytest.approx(1.6, abs=1e-9)
    assert sum("is too slow" in warning for warning in result.warnings) == 2
    for answer in result.plan.answers:
        q, v, a, _ = answer.trajectory.sample(np.linspace(0, answer.trajectory.duration, 400))
        torque, limits = panda.body.torque(q, v, a), panda.limits
        assert (np.abs(v) <= limits.velocity * 1.0001).all() and (np.abs(torque) <= limits.effort * 1.0001).all()
    late = SWING.replace("cycle_time = 1.6", "cycle_time = 1.4")
    with pytest.raises(Infeasible, match=r"its moves take 1\.59\d s at least"):
        run_job(load_job(_written(tmp_path, late), lambda _: panda), source_method_2())


def test_waits_that_are_longer_than_the_cycle_say_so(panda: Robot, tmp_path: Path) -> None:
    head = EXAMPLE[: EXAMPLE.index("[[step]]")]
    job = load_job(_written(tmp_path, head + "[[step]]\nwait = 6.5\n"), lambda _: panda)
    with pytest.raises(Infeasible, match=r"5\.5 s is too short: it waits 6\.5 s") as caught:
        run_job(job, source_method_2())
    assert caught.value.shortest_duration == 6.5


def test_check_reads_a_job_as_job_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "jobs").mkdir()
    (tmp_path / "jobs/arm.urdf").write_text(load_robot("ur5e").urdf.read_text())
    (tmp_path / "scene.yaml").write_text("objects: []\n")
    text = 'format = "energy-opt/job/1"\nrobot = "arm.urdf"\ncycle_time = 2\nhome = [0, -1, 1, 0, 0, 0]\n'
    path = _written(tmp_path / "jobs", f'{text}scene = "../scene.yaml"\n[[step]]\nwait = 1\n')
    assert main(["check", str(path), "--quiet"]) == 2
    assert "--allow-outside" in capsys.readouterr().err
    assert main(["check", str(path), "--quiet", "--allow-outside"]) == 0


def test_a_payload_that_a_limit_cannot_hold_names_the_step(panda: Robot, tmp_path: Path) -> None:
    text = RETIMED.replace("payload = 2.0", "payload = 60.0")
    with pytest.raises(Infeasible, match="to the camera"):
        run_job(load_job(_written(tmp_path, text), lambda _: panda), source_method_2())


@pytest.mark.slow
def test_a_killed_job_is_continued_with_the_same_result(panda: Robot, tmp_path: Path) -> None:
    path, whole, killed = _written(tmp_path, RETIMED), tmp_path / "whole", tmp_path / "killed"
    assert main(["job", str(path), "--out", str(whole), "--quiet"]) == 0
    words = [sys.executable, "-m", "energy_opt", "job", str(path), "--out", str(killed), "--quiet"]
    process = subprocess.Popen(words)
    for _ in range(600):
        if list((killed / ".answers").glob("*.csv")) or process.poll() is not None:
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert main([*words[3:], "--resume"]) == 0
    first, second = (json.loads((out / "job.json").read_text()) for out in (whole, killed))
    assert second["energy_total"] == pytest.approx(first["energy_total"], rel=1e-9)
    assert not (killed / ".answers").exists()


SHUTTLE = """
format = "energy-opt/job/1"
robot = "panda"
cycle_time = 2.0
home = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
[[step]]
to = [0.9, 0.35, 0.2, -1.9, 0.0, 2.2, 0.9]
[[step]]
to = "home"
"""


def test_a_move_whose_search_was_stopped_is_searched_again(panda: Robot, tmp_path: Path) -> None:
    job, asked = load_job(_written(tmp_path, SHUTTLE), lambda _: panda), [0]

    def progress(text: str, _: float) -> None:
        asked[0] += text.startswith("2/2")

    def stopped() -> bool:  # within the search for the second move
        asked[0] += bool(asked[0])
        return asked[0] > 2

    settings, kept = Settings(starts=1, controls=16), Answers(tmp_path, panda.joints, "", resume=False)
    found = run_job(job, source_method_2(), settings, stopped=stopped, progress=progress, answers=kept)
    assert [piece.status for piece in found.pieces] == ["solved", "not_converged"]
    # it was kept as an answer, so `--resume` took the first guess for the solved move
    assert len(list((tmp_path / ".answers").iterdir())) == 1


AROUND = """
format = "energy-opt/job/1"
robot = "panda"
cycle_time = 3.2
mode = "retime"
[poses]
left = [0.9, 0.35, 0.2, -1.9, 0.0, 2.2, 0.9]
right = [-0.9, 0.35, -0.2, -1.9, 0.0, 2.2, 0.9]
[[step]]
name = "over"
to = "right"
payload = 2.0
scene = "scene.yaml"
[[step]]
name = "back"
to = "left"
payload = 0.0
"""
POST = "{name: post, type: box, size: [0.1, 0.1, 0.5], position: [0.5, 0.1, 0.25]}"


def test_a_job_moves_around_obstacles(panda: Robot, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(f"objects:\n  - {POST}\n")
    (tmp_path / "empty.yaml").write_text("objects: []\n")
    there, out = AROUND.replace("payload = 0.0", 'scene = "empty.yaml"'), tmp_path / "out"
    one = ["--out", str(out), "--quiet", "--model", "source-method-2"]
    assert main(["job", str(_written(tmp_path, there)), *one]) == 0
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


def test_a_pose_in_a_new_scene_is_named_with_its_step(panda: Robot, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(f"objects:\n  - {POST.replace('0.5, 0.1, 0.25', '0.37, -0.47, 0.5')}\n")
    with pytest.raises(Infeasible, match=r"^over, at its end: .*post"):
        run_job(load_job(_written(tmp_path, AROUND), lambda _: panda), source_method_2())


def test_a_pose_at_fault_is_named_once(tmp_path: Path) -> None:
    """Not again as an unknown pose by each step that goes there."""
    text = "\n".join([
        'format = "energy-opt/job/1"', 'robot = "panda"', "cycle_time = 5", 'home = "a"', "[poses]",
        "a = [9, -0.785, 0, -2.356, 0, 1.571, 0.785]", "[[step]]", 'to = "a"', "[[step]]", 'to = "nowhere"',
    ])  # fmt: skip
    with pytest.raises(BadInput) as caught:
        load_job(_written(tmp_path, text), load_robot)
    said = str(caught.value)
    assert "outside its position limits" in said and "unknown pose 'a'" not in said and "unknown pose 'nowhere'" in said


def test_positions_in_quotes_are_named(tmp_path: Path) -> None:
    """As on the command line; of six numbers, a pose of the tool was made without a word."""
    six = 'format = "energy-opt/job/1"\nrobot = "ur5e"\ncycle_time = 5\n[[step]]\nto = "0.5,-0.4,0.4,-1.5,-1.5,0"\n'
    (said,) = load_job(_written(tmp_path, six), load_robot).remarks
    assert "step 1: these 6 numbers are read as a pose of the tool; joint positions are a list of numbers" in said
    assert check(tmp_path / "job.toml").remarks[str(tmp_path / "job.toml")] == [said]
    (said,) = faults_of(load_job, _written(tmp_path, six.replace("ur5e", "panda").replace("0.5", "0,0")), load_robot)
    assert "quaternion" in said and said.endswith("joint positions are a list of numbers, without quotes")


def test_degrees_are_named(tmp_path: Path) -> None:
    """They were positions outside of limits, each step to `home` another fault, and in a suite a path in contact."""
    home = "[0, -45, 0, -135, 0, 90, 45]"
    text = f'format = "energy-opt/job/1"\nrobot = "panda"\ncycle_time = 5\nhome = {home}\n[[step]]\nto = "home"\n'
    (said,) = faults_of(load_job, _written(tmp_path, text), load_robot)
    assert "home: -45 rad for panda_joint2" in said and said.endswith("(-45 deg = -0.7854 rad)")
    suite = tmp_path / "suite.toml"
    suite.write_text(f'format = "energy-opt/suite/1"\nrobots = "panda"\n[[moves]]\nstart = {home}\ngoal = {home}\n')
    (said,) = faults_of(load_suite, suite)
    assert "moves 1 (move01) on panda: -45 rad" in said


def test_check_names_a_frame_that_no_pose_can_be_in(panda: Robot, tmp_path: Path) -> None:
    step = '[[step]]\nname = "pick"\npose = "table: 0, 0, 0.1, 3.14, 0, 0"\n'
    path = _written(tmp_path, f'format = "energy-opt/job/1"\nrobot = "panda"\ncycle_time = 8.0\n{step}')
    (fault,) = wrong_frames(load_job(path, lambda name: panda), CellRequest())
    assert "no frame 'table'; frames are world, panda_link0" in fault
    assert "step 1 (pick): " in fault and "pick: step" not in fault
    scene = tmp_path / "scene.yaml"
    scene.write_text("objects:\n  - {name: table, type: box, size: [0.3, 0.3, 0.1], position: [0.5, 0, 0]}\n")
    cell = CellRequest(scene=scene)
    assert wrong_frames(load_job(path, lambda name: panda, named=poses_of_request(cell)), cell) == []
