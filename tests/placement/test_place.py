"""The base, or a fixture, is placed where a job costs least."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tool_poses import JOB, by_pinocchio

from energy_opt.cell.load import load_cell, scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.errors import BadInput, Infeasible
from energy_opt.front.given import source_model
from energy_opt.jobs.file import Job, load_job
from energy_opt.jobs.posed import Posed
from energy_opt.jobs.solve_job import JobResult
from energy_opt.motion import Settings
from energy_opt.placement import PlaceRequest, place
from energy_opt.placement.base_search import Rough, Search
from energy_opt.placement.placement import headline
from energy_opt.poses.inverse import ToolKinematics
from energy_opt.requests import moves
from energy_opt.robot import load_robot

STEP = '[[step]]\nmin_duration = 2.0\nmax_duration = 2.0\npose = [{}, 3.14159265, 0, 0]\nfree = ["rz"]\n'
PANDA = "".join((
    'format = "energy-opt/job/1"\nrobot = "panda"\ncycle_time = 4.0\n',
    STEP.format("0.5, 0.2, 0.2"), STEP.format("0.3, -0.4, 0.3"), "payload = 1.0\n",
))  # fmt: skip


@pytest.fixture(scope="module")
def ur() -> ToolKinematics:
    return ToolKinematics(load_robot("ur5e"))


def test_place_says_that_joint_goals_do_not_change_with_the_base(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "job.toml"
    words = JOB.partition("[[step]]")[0] + '[[step]]\nto = [0.1, -1.5, 1.5, -1.5, -1.5, 0.1]\n[[step]]\nto = "home"\n'
    path.write_text(words)
    assert main(["place", str(path), "--base-box=0,1,0,1,0,0", "--out", str(tmp_path / "out")]) == 2
    assert "joint positions do not change with the base" in capsys.readouterr().err
    assert main(["place", str(path), "--base-box=0,1,0,1,0", "--out", str(tmp_path / "out")]) == 2
    assert "expected X0,X1" in capsys.readouterr().err
    for count in ("seeds", "looked-at"):  # without both, only the given base was judged
        words = ["place", str(path), "--base-box=0,1,0,1,0,0", f"--{count}", "0", "--out", str(tmp_path / "out")]
        assert main(words) == 2 and f"--{count} 0: expected 1 to 10000" in capsys.readouterr().err


def test_a_proven_placement_comes_before_a_cheaper_one_that_is_none(
    tmp_path: Path, ur: ToolKinematics, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    points = [np.zeros(4), np.array([0.2, 0.0, 0.0, 0.0])]

    def solve(search: Search, point: np.ndarray, kind: str, ends: object = None) -> SimpleNamespace:
        proven = point[0] == 0.0
        return SimpleNamespace(solved=proven, energy=5.0 if proven else 1.0, warnings=())

    def settled(search: Search, point: np.ndarray, kind: str, ends: object = None) -> Rough:
        return Rough(point, {}, SimpleNamespace(), 4.0 + point[0])

    monkeypatch.setattr(Search, "solve", solve)
    monkeypatch.setattr(Search, "settled", settled)
    monkeypatch.setattr(Search, "estimates", lambda search: [(points[1], 1.0), (points[0], 5.0)])
    job = load_job(path, lambda name: ur.robot)
    found = place(job, source_model(ur.robot), PlaceRequest((-0.2, 0.2, 0.0, 0.0, 0.0, 0.0), seeds=2, steps=0))
    assert found.solved and found.place[0] == 0.0 and found.result.energy == 5.0


def test_a_search_that_is_stopped_before_it_has_found_anything_is_no_proof(
    tmp_path: Path, ur: ToolKinematics, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was reported, and written down, as a job that cannot be done in the box."""
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    monkeypatch.setattr(Search, "solve", lambda *_: None)
    monkeypatch.setattr(Search, "estimates", lambda search: [(np.zeros(4), 1.0)])
    job, box = load_job(path, lambda name: ur.robot), PlaceRequest((-0.2, 0.2, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(KeyboardInterrupt):
        place(job, source_model(ur.robot), box, stopped=lambda: True)


@pytest.mark.parametrize("kind", ["yaml", "json"])  # as lines of ours, and as MoveIt's message with an object's pose
def test_a_fixture_is_placed_with_its_shape_and_the_poses_in_its_frame(
    tmp_path: Path, ur: ToolKinematics, kind: str
) -> None:
    scene, path = tmp_path / f"scene.{kind}", tmp_path / "job.toml"
    if kind == "yaml":
        scene.write_text("objects: [{name: tray, type: box, size: [0.2, 0.2, 0.02], position: [0.4, 0.1, 0.1]}]\n")
    else:
        turn = {"x": 0, "y": 0, "z": 0, "w": 1}
        at = [{"position": {"x": x, "y": y, "z": z}, "orientation": turn} for x, y, z in ((0.4, 0.1, 0.1), (0, 0, 0))]
        tray = {"id": "tray", "pose": at[0], "primitives": [{"type": 1, "dimensions": [0.2, 0.2, 0.02]}],
                "primitive_poses": at[1:]}  # fmt: skip
        scene.write_text(json.dumps({"world": {"collision_objects": [tray]}}))
    path.write_text(JOB.replace('"world: -0.2, 0.5, 0.2,', '"tray: 0, 0, 0.2,'))
    job, request = load_job(path, lambda name: ur.robot), CellRequest(scene=scene)
    box = PlaceRequest((0.2, 0.4, 0.0, 0.5, 0.1, 0.2), (0.0, 1.0), fixture="tray")
    search = Search(
        job, source_model(ur.robot), box, Settings(), request, stopped=lambda: False, progress=lambda t, s: None
    )
    assert search.given == pytest.approx((0.4, 0.1, 0.1, 0, 0, 0))
    cell = search.at(np.array([0.3, 0.4, 0.2, 0.5]))
    q = search.posed(np.array([0.3, 0.4, 0.2, 0.5])).sets[1][0]
    assert by_pinocchio(ur.robot, q)[:3, 3] == pytest.approx([0.3, 0.4, 0.4], abs=1e-6)
    box_ = next(scene_of(cell).placed())  # its shape has moved, too
    assert box_.pose[:3, 3] == pytest.approx([0.3, 0.4, 0.2])
    assert box_.pose[:2, :2] == pytest.approx(np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]]))
    assert load_cell(ur.robot, cell).touching(q) is None
    for name, says in (("desk", "no step ends at a pose in the frame of 'desk'"), ("box", "no object 'box' is fixed")):
        path.write_text(path.read_text().replace("tray: 0, 0, 0.2", "box: 0, 0, 0.2") if name == "box" else JOB)
        other = PlaceRequest(box.box, fixture=name)
        with pytest.raises(BadInput, match=says):
            place(load_job(path, lambda name: ur.robot), source_model(ur.robot), other, cell=request)
        path.write_text(JOB.replace('"world: -0.2, 0.5, 0.2,', '"tray: 0, 0, 0.2,'))


@pytest.mark.slow
def test_a_rough_cycle_follows_the_base_and_a_step_costs_less(tmp_path: Path, ur: ToolKinematics) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB.replace("cycle_time = 6.0", "cycle_time = 8.0"))
    job, model = load_job(path, lambda name: ur.robot), source_model(ur.robot)
    box = PlaceRequest((-0.1, 0.1, -0.1, 0.1, 0.0, 0.0))
    search = Search(job, model, box, Settings(starts=1), CellRequest(), lambda: False, lambda text, share: None)
    here = search.settled(np.zeros(4), "seed")
    there, _ = search.step(here, 1.0, 1)
    assert there is not None and there.energy < here.energy
    # complete solves at both placements confirm most of the promised saving
    before, after = (search.solve(rough.point, "grid", ends=rough.ends) for rough in (here, there))
    assert before is not None and after is not None
    assert before.energy - after.energy > 0.5 * (here.energy - there.energy)
    for k, wanted in ((0, [0.45, 0.2, 0.1]), (1, [-0.2, 0.5, 0.2])):
        answer = there.plan.answers[k]
        at = by_pinocchio(ur.robot, answer.trajectory.position[-1])[:3, 3] + there.point[:3]
        assert np.linalg.norm(at - wanted) <= (1e-3 if k else 1e-6)


def test_a_shorter_step_is_tried_where_the_whole_one_leads_to_contact(
    tmp_path: Path, ur: ToolKinematics, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search had gone on along the axes of the box, and ended 7 J above what a shorter step finds."""
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    box = PlaceRequest((-0.4, 0.4, 0.0, 0.0, 0.0, 0.0))
    job, free = load_job(path, lambda name: ur.robot), lambda: False
    search = Search(job, source_model(ur.robot), box, Settings(), CellRequest(), free, lambda text, share: None)

    def settled(search: Search, point: np.ndarray, kind: str, near: object = None, ends: object = None) -> Rough:
        return Rough(point, {}, None, 100.0 - 10.0 * point[0] if point[0] < 0.1 else np.inf)

    monkeypatch.setattr(Search, "settled", settled)
    monkeypatch.setattr(Search, "better", lambda search, here: (here.point + np.array([0.2, 0.0, 0.0, 0.0]), 2.0))
    monkeypatch.setattr(Search, "ends_at", lambda search, point, ends: {})
    plan = SimpleNamespace(answers=[SimpleNamespace(energy=SimpleNamespace(loss=20.0))])
    found, _ = search.step(Rough(np.zeros(4), {}, plan, 100.0), 1.0, 5)  # type: ignore[arg-type]
    assert found is not None and 0.0 < found.point[0] < 0.1


def test_alternatives_reach_the_poses_by_different_positions_and_cost_more_in_turn(
    tmp_path: Path, ur: ToolKinematics
) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    job, model = load_job(path, lambda name: ur.robot), source_model(ur.robot)
    posed = Posed(job, model, Settings(starts=1), CellRequest())
    likely = posed.choices()[0]
    found = posed.alternatives(4)
    assert 2 <= len(found) <= 4
    away = [max(np.abs(a[k] - b[k]).max() for k in a) for i, a in enumerate(found) for b in found[:i]]
    assert min(away) > 0.1
    assert any(all(np.allclose(ends[k], likely[k]) for k in likely) for ends in found)
    for ends in found:
        for k, pose in posed.poses.items():
            missed = np.linalg.norm(by_pinocchio(ur.robot, ends[k])[:3, 3] - pose.matrix[:3, 3])
            assert missed <= pose.tolerance[0] + 1e-6


@pytest.mark.nightly
def test_other_branches_at_a_placement_cost_less_than_the_likely_ones(tmp_path: Path) -> None:
    path = tmp_path / "job.toml"
    path.write_text(PANDA)
    job = load_job(path, load_robot)
    box = PlaceRequest((-0.2, 0.2, -0.2, 0.2, 0.0, 0.1))
    model = source_model(job.robot)
    search = Search(job, model, box, Settings(starts=1), CellRequest(), lambda: False, lambda text, share: None)
    here = search.settled(np.array([0.2, -0.07, 0.0, 0.0]), "seed")
    there = search.varied(here)
    assert len(search.path) == 1  # it is the same placement
    losses = sum(answer.energy.loss for answer in here.plan.answers)
    assert there.energy < here.energy - 0.01 * losses


@pytest.mark.slow
def test_a_job_of_poses_costs_no_more_than_with_the_nearest_and_placed_no_more_than_there(tmp_path: Path) -> None:
    path = tmp_path / "job.toml"
    steps = JOB.partition("[[step]]")[2].rpartition("[[step]]")[0].replace("world: ", "")
    path.write_text(JOB.partition("home =")[0] + "[poses]\n" + JOB.partition("[poses]\n")[2].partition("[[step]]")[0]
                    + "[[step]]" + steps)  # fmt: skip
    out = tmp_path / "out"
    words = ["--model", "source-method-2", "--starts", "1", "--quiet", "--out", str(out)]
    assert main(["job", str(path), *words]) == 0
    found = json.loads((out / "job.json").read_text())
    assert found["energy_total"] <= found["choice"]["greedy_nearest"] + 1e-9
    for row, wanted in zip(found["poses"], ([0.45, 0.2, 0.1], [-0.2, 0.5, 0.2]), strict=True):
        number = 1 + next(k for k, step in enumerate(found["steps"]) if step["name"] == row["name"])  # waits count
        last = np.loadtxt(out / f"step_{number:02d}.csv", delimiter=",", skiprows=1)[-1, 1:7]
        off = np.linalg.norm(by_pinocchio(load_robot("ur5e"), last)[:3, 3] - wanted)
        assert off <= (1e-3 if row["step"] == 2 else 1e-6)
    words[-1] = str(tmp_path / "placed")
    counts = ["--looked-at", "10", "--seeds", "1", "--steps", "1"]
    assert main(["place", str(path), "--base-box=-0.1,0.1,-0.1,0.1,0,0", *counts, *words]) == 0
    placed = json.loads((tmp_path / "placed" / "place.json").read_text())
    assert placed["energy_total"] <= placed["given"]["energy_total"]
    assert main(["check", str(tmp_path / "placed"), str(tmp_path / "placed" / "job"), "--quiet"]) == 0
    job = json.loads((tmp_path / "placed" / "job" / "job.json").read_text())
    assert job["energy_total"] == pytest.approx(placed["energy_total"])
    for row, wanted in zip(placed["goals"], ([0.45, 0.2, 0.1], [-0.2, 0.5, 0.2]), strict=True):
        at = by_pinocchio(load_robot("ur5e"), np.array(row["goal"]))[:3, 3] + placed["base"][:3]
        assert np.linalg.norm(at - wanted) <= (1e-3 if row["step"] == 2 else 1e-6)


@pytest.mark.slow
def test_a_placement_at_which_the_likely_positions_fail_is_solved_with_the_nearest(
    tmp_path: Path, ur: ToolKinematics, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    tried: list[Job] = []

    def run(job: Job, *given: object, **more: object) -> JobResult:
        tried.append(job)
        if len(tried) == 1:
            raise Infeasible("too short")
        return JobResult(job, None, {}, next(energies), None, None)  # type: ignore[arg-type]

    monkeypatch.setattr("energy_opt.jobs.run_posed.run_job", run)
    monkeypatch.setattr(JobResult, "energy", property(lambda found: found.bound))
    monkeypatch.setattr(JobResult, "solved", True)
    box = PlaceRequest((0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    job, model = load_job(path, lambda name: ur.robot), source_model(ur.robot)
    search = Search(job, model, box, Settings(), CellRequest(), stopped=lambda: False, progress=lambda t, s: None)
    energies = iter([3.0, 5.0, 4.0])
    found = search.solve(np.zeros(4), "given")
    assert found is not None and found.energy == 3.0
    cheaper = search.solve(np.zeros(4), "given")
    assert cheaper is not None and cheaper.energy == 4.0  # a job takes the better of both, too
    nearest = search.posed(np.zeros(4)).greedy()
    assert all(np.array_equal(tried[1].steps[k].goal, nearest[k]) for k in nearest)


@pytest.mark.nightly
def test_the_choice_of_positions_compares_energies_under_the_same_models(tmp_path: Path) -> None:
    """Without --model a job is planned for the mean of two models, and stated under the first."""
    out = tmp_path / "out"
    path = tmp_path / "job.toml"
    path.write_text("""format = "energy-opt/job/1"
robot = "ur5e"
cycle_time = 6.0
mode = "retime"
home = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
[[step]]
pose = [0.45, 0.2, 0.2, 3.14159, 0, 0]
[[step]]
to = "home"
""")
    assert main(["job", str(path), "--self-collision", "off", "--quiet", "--out", str(out)]) == 0
    found = json.loads((out / "job.json").read_text())
    choice, first, mean = found["choice"], found["energy_total"], found["robust"]["total"]
    assert choice["energy_total"] <= choice["greedy_nearest"] + 1e-9
    assert abs(choice["energy_total"] - mean) < abs(choice["energy_total"] - first) / 5


def test_the_command_and_the_search_have_the_same_defaults() -> None:
    search, command = ({field.name: field.default for field in fields(c)} for c in (PlaceRequest, moves.PlaceRequest))
    for name in ("looked_at", "seeds", "steps"):
        assert command[name] == search[name]


@pytest.mark.parametrize(("energy", "says"), [(99.0, "1 % less than"), (102.0, "2 % more than")])
def test_the_headline_says_whether_the_answer_takes_more_or_less(energy: float, says: str) -> None:
    """A given base outside of the box may be cheaper: it said "-2 % less"."""
    found = {
        "base": [0.1, 0, 0, 0, 0, 0], "energy_total": energy, "given": {"energy_total": 100.0},
        "saving": {"joules": 100 - energy, "percent": 100 - energy}, "request": {},
    }  # fmt: skip
    assert says in headline(found)


def test_an_interrupted_search_says_so_though_the_job_at_its_answer_is_solved(
    tmp_path: Path, ur: ToolKinematics, monkeypatch: pytest.MonkeyPatch
) -> None:
    """place.json said `solved`."""
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    known = SimpleNamespace(solved=True, energy=5.0, warnings=())
    monkeypatch.setattr(Search, "solve", lambda *_: known)
    monkeypatch.setattr(Search, "estimates", lambda search: [])
    job, box = load_job(path, lambda name: ur.robot), PlaceRequest((-0.2, 0.2, 0.0, 0.0, 0.0, 0.0))
    found = place(job, source_model(ur.robot), box, stopped=lambda: True)
    assert found.interrupted and not found.solved
    assert place(job, source_model(ur.robot), box, stopped=lambda: False).solved


def test_a_search_that_is_stopped_tells_of_a_cheaper_place_that_it_did_not_solve(
    tmp_path: Path, ur: ToolKinematics, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It gave the given base, and no word on the base that a rough cycle had found."""
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    asked = iter([False, True])  # before the first seed, and before the answer is solved
    known = SimpleNamespace(solved=True, energy=5.0, warnings=())
    monkeypatch.setattr(Search, "solve", lambda *_: known)
    monkeypatch.setattr(Search, "varied", lambda search, at: at)
    monkeypatch.setattr(Search, "settled", lambda search, point, kind: Rough(point, {}, SimpleNamespace(), 4.0))
    monkeypatch.setattr(Search, "estimates", lambda search: [(np.array([0.2, 0.0, 0.0, 0.0]), 1.0)])
    job, box = load_job(path, lambda name: ur.robot), PlaceRequest((-0.2, 0.2, 0.0, 0.0, 0.0, 0.0), steps=0)
    found = place(job, source_model(ur.robot), box, stopped=lambda: next(asked, True))
    said = "at x, y, z, yaw = 0.2, 0, 0, 0 a rough cycle, unproven, takes 4 J; the answer takes 5 J"
    assert found.interrupted and any(said in warning for warning in found.warnings)
