"""Faults of job files: each is named with its step."""

from __future__ import annotations

from pathlib import Path

import pytest
from faults import faults_of
from job_texts import AROUND, EXAMPLE, POST, RETIMED, written

from energy_opt.batches.suite import load_suite
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.errors import BadInput, Infeasible
from energy_opt.front.check import check
from energy_opt.jobs.file import load_job
from energy_opt.jobs.legs import wrong_frames
from energy_opt.jobs.solve_job import run_job
from energy_opt.poses.given import poses_of_request
from energy_opt.power import source_method_2
from energy_opt.robot import Robot, load_robot

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
    path = written(tmp_path, EXAMPLE.replace(before, after, 1))
    (tmp_path / "empty.yaml").write_text("objects: []\n")
    with pytest.raises(BadInput, match=said):
        load_job(path, lambda name: panda)
    assert faults_of(load_job, path, lambda name: panda)


def test_a_cycle_that_is_too_short_says_what_would_do(panda: Robot, tmp_path: Path) -> None:
    text = RETIMED.replace("cycle_time = 5.5", "cycle_time = 2.0")
    with pytest.raises(Infeasible, match="the longest is") as caught:
        run_job(load_job(written(tmp_path, text), lambda _: panda), source_method_2())
    shortest = caught.value.shortest_duration
    assert shortest is not None
    text = RETIMED.replace("cycle_time = 5.5", f"cycle_time = {shortest + 1e-6}")
    assert run_job(load_job(written(tmp_path, text), lambda _: panda), source_method_2()).pieces


def test_a_cycle_that_is_too_short_for_a_min_duration_names_it(panda: Robot, tmp_path: Path) -> None:
    text = RETIMED.replace('to = "home"', 'to = "home"\nmin_duration = 5')
    job = load_job(written(tmp_path, text), lambda _: panda)
    last = job.steps[-1].name
    with pytest.raises(Infeasible, match=f"the longest is {last} with 5 s; without min_duration of {last} its moves"):
        run_job(job, source_method_2())


def test_waits_that_are_longer_than_the_cycle_say_so(panda: Robot, tmp_path: Path) -> None:
    head = EXAMPLE[: EXAMPLE.index("[[step]]")]
    job = load_job(written(tmp_path, head + "[[step]]\nwait = 6.5\n"), lambda _: panda)
    with pytest.raises(Infeasible, match=r"5\.5 s is too short: it waits 6\.5 s") as caught:
        run_job(job, source_method_2())
    assert caught.value.shortest_duration == 6.5


def test_check_reads_a_job_as_job_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "jobs").mkdir()
    (tmp_path / "jobs/arm.urdf").write_text(load_robot("ur5e").urdf.read_text())
    (tmp_path / "scene.yaml").write_text("objects: []\n")
    text = 'format = "energy-opt/job/1"\nrobot = "arm.urdf"\ncycle_time = 2\nhome = [0, -1, 1, 0, 0, 0]\n'
    path = written(tmp_path / "jobs", f'{text}scene = "../scene.yaml"\n[[step]]\nwait = 1\n')
    assert main(["check", str(path), "--quiet"]) == 2
    assert "--allow-outside" in capsys.readouterr().err
    assert main(["check", str(path), "--quiet", "--allow-outside"]) == 0


def test_a_payload_that_a_limit_cannot_hold_names_the_step(panda: Robot, tmp_path: Path) -> None:
    text = RETIMED.replace("payload = 2.0", "payload = 60.0")
    with pytest.raises(Infeasible, match="to the camera"):
        run_job(load_job(written(tmp_path, text), lambda _: panda), source_method_2())


@pytest.mark.parametrize("brakes", ["false", "true"])
def test_a_payload_that_is_held_only_in_a_wait_must_be_within_the_limits(brakes: str, tmp_path: Path) -> None:
    """With brakes too: the motors hold it before these close."""
    text = "\n".join([
        'format = "energy-opt/job/1"', 'robot = "panda"', "cycle_time = 6", "home = [1, 0, 0, -1.5, 0, 2, 0]",
        '[[step]]', 'name = "grip"', "wait = 0.5", "payload = 20", f"brakes = {brakes}", "[[step]]", "wait = 0.5",
        "payload = 0",
    ])  # fmt: skip
    # the arm alone needs 29 N m (Pinocchio), 20 kg at 0.54 m another 105 N m
    with pytest.raises(Infeasible, match=r"^grip, at its beginning: panda_joint2: holding still needs 134\.8 N m, "):
        run_job(load_job(written(tmp_path, text), load_robot), source_method_2())


def test_a_payload_that_cannot_be_held_where_it_is_carried_to_names_that_step(panda: Robot, tmp_path: Path) -> None:
    """The next step, which begins there with the same payload, was named."""
    text = "\n".join([
        'format = "energy-opt/job/1"', 'robot = "panda"', "cycle_time = 5", "home = [0, 0, 0, -2, 0, 2, 0]", "[[step]]",
        'name = "stretch"', "to = [0, 1.5, 0, -0.3, 0, 1.6, 0]", "payload = 6", "[[step]]", 'to = "home"',
    ])  # fmt: skip
    with pytest.raises(Infeasible, match=r"^stretch, at its end: panda_joint2: holding still needs"):
        run_job(load_job(written(tmp_path, text), lambda _: panda), source_method_2())


def test_a_pose_in_a_new_scene_is_named_with_its_step(panda: Robot, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(f"objects:\n  - {POST.replace('0.5, 0.1, 0.25', '0.37, -0.47, 0.5')}\n")
    with pytest.raises(Infeasible, match=r"^over, at its end: .*post"):
        run_job(load_job(written(tmp_path, AROUND), lambda _: panda), source_method_2())


def test_a_pose_at_fault_is_named_once(tmp_path: Path) -> None:
    """Not again as an unknown pose by each step that goes there."""
    text = "\n".join([
        'format = "energy-opt/job/1"', 'robot = "panda"', "cycle_time = 5", 'home = "a"', "[poses]",
        "a = [9, -0.785, 0, -2.356, 0, 1.571, 0.785]", "[[step]]", 'to = "a"', "[[step]]", 'to = "nowhere"',
    ])  # fmt: skip
    with pytest.raises(BadInput) as caught:
        load_job(written(tmp_path, text), load_robot)
    said = str(caught.value)
    assert "outside its position limits" in said and "unknown pose 'a'" not in said and "unknown pose 'nowhere'" in said


def test_positions_in_quotes_are_named(tmp_path: Path) -> None:
    """As on the command line; of six numbers, a pose of the tool was made without a word."""
    six = 'format = "energy-opt/job/1"\nrobot = "ur5e"\ncycle_time = 5\n[[step]]\nto = "0.5,-0.4,0.4,-1.5,-1.5,0"\n'
    (said,) = load_job(written(tmp_path, six), load_robot).remarks
    assert "step 1: these 6 numbers are read as a pose of the tool; joint positions are a list of numbers" in said
    assert check(tmp_path / "job.toml").remarks[str(tmp_path / "job.toml")] == [said]
    (said,) = faults_of(load_job, written(tmp_path, six.replace("ur5e", "panda").replace("0.5", "0,0")), load_robot)
    assert "quaternion" in said and said.endswith("joint positions are a list of numbers, without quotes")


@pytest.mark.parametrize("line", ["über = [0, 0]", "[poses.über]", "  zu.über.b = 1"])
def test_a_name_that_needs_quotes_is_named(line: str, tmp_path: Path) -> None:
    """Only line and column were."""
    (said,) = faults_of(load_job, written(tmp_path, f'format = "energy-opt/job/1"\n[poses]\n{line}\n'), load_robot)
    assert "at line 3" in said and "put the name über in quotes" in said


def test_degrees_are_named(tmp_path: Path) -> None:
    """They were positions outside of limits, each step to `home` another fault, and in a suite a path in contact."""
    home = "[0, -45, 0, -135, 0, 90, 45]"
    text = f'format = "energy-opt/job/1"\nrobot = "panda"\ncycle_time = 5\nhome = {home}\n[[step]]\nto = "home"\n'
    (said,) = faults_of(load_job, written(tmp_path, text), load_robot)
    assert "home: -45 rad for panda_joint2" in said and said.endswith("(-45 deg = -0.7854 rad)")
    suite = tmp_path / "suite.toml"
    suite.write_text(f'format = "energy-opt/suite/1"\nrobots = "panda"\n[[moves]]\nstart = {home}\ngoal = {home}\n')
    (said,) = faults_of(load_suite, suite)
    assert "moves 1 (move01) on panda: -45 rad" in said


def test_check_names_a_frame_that_no_pose_can_be_in(panda: Robot, tmp_path: Path) -> None:
    step = '[[step]]\nname = "pick"\npose = "table: 0, 0, 0.1, 3.14, 0, 0"\n'
    path = written(tmp_path, f'format = "energy-opt/job/1"\nrobot = "panda"\ncycle_time = 8.0\n{step}')
    (fault,) = wrong_frames(load_job(path, lambda name: panda), CellRequest())
    assert "no frame 'table'; frames are world, panda_link0" in fault
    assert "step 1 (pick): " in fault and "pick: step" not in fault
    scene = tmp_path / "scene.yaml"
    scene.write_text("objects:\n  - {name: table, type: box, size: [0.3, 0.3, 0.1], position: [0.5, 0, 0]}\n")
    cell = CellRequest(scene=scene)
    assert wrong_frames(load_job(path, lambda name: panda, named=poses_of_request(cell)), cell) == []


def test_a_job_states_warnings_on_its_scene(tmp_path: Path, panda: Robot) -> None:
    """A move stated them; a job and a placement did not."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(f"objects: [{POST}]\nallow: [[post, nothing]]\n")
    job = load_job(written(tmp_path, RETIMED), lambda _: panda)
    found = run_job(job, source_method_2(panda), cell=CellRequest(scene=scene, self_collision=False))
    assert any("nothing" in said for said in found.warnings)
