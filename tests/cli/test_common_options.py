"""Options that mean the same wherever a motion is made or judged: tool, payload, base, locks, models."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from poses import GOAL, START

from energy_opt.cell.cell import Cell
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.cell.scene_files import read_scene
from energy_opt.cli.main import example, main
from energy_opt.errors import BadInput
from energy_opt.files import read_json
from energy_opt.formats import write
from energy_opt.front.given import cell_of, request_of_set
from energy_opt.front.verbs import VERBS
from energy_opt.motion import Settings
from energy_opt.motion.trajectory import Trajectory
from energy_opt.requests.verbs import DiagnoseRequest
from energy_opt.robot import Robot

EXAMPLE = example("job")

SMALL = START + 0.05 * (GOAL - START)


def words_of(*more: str) -> list[str]:
    ends = [f"--{name}={','.join(map(str, q))}" for name, q in (("start", START), ("goal", SMALL))]
    return ["optimize", "--robot", "panda", *ends, "--mode", "retime", "--quiet", *more]


def slow(robot: Robot, seconds: float) -> Trajectory:
    t = np.linspace(0, seconds, 101)
    u = t[:, None] / seconds
    rates = 30 * u**2 * (1 - u) ** 2 / seconds, 60 * u * (1 - u) * (1 - 2 * u) / seconds**2
    ramp = u**3 * (10 - 15 * u + 6 * u**2)
    return Trajectory(robot.joints, t, START + ramp * (SMALL - START), *(r * (SMALL - START) for r in rates))


def test_an_answer_under_other_models_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = ["--out", str(tmp_path)]
    assert main(words_of(*out, "--model", "source-method-2")) == 0
    for others in ([], ["--robust", "worst"], ["--model", "source-method-2", "--model", "careful"]):
        assert main(words_of(*out, *others)) == 2
        assert "another request (robust)" in capsys.readouterr().err
    assert main(words_of(*out, "--force")) == 0
    assert [m["name"] for m in read_json(tmp_path / "result.json")["request"]["robust"]["models"]] == [
        "source-method-2", "careful",
    ]  # fmt: skip
    held = words_of(*out, "--lock", "panda_finger_joint1=0.02")
    assert main(held) == 2 and "another request" in capsys.readouterr().err


def test_attached_objects_are_in_the_frame_of_the_tool(panda: Robot, tmp_path: Path) -> None:
    file = tmp_path / "held.yaml"
    file.write_text("objects:\n  - {name: part, type: sphere, radius: 0.02, position: [0, 0, 0.15], attach: true}\n")
    places = []
    for tool in (None, "panda_hand", "panda_hand,0.0,0.0,0.1"):
        cell = Cell(panda, CellRequest(tool=tool), read_scene(file))
        places.append(next(body.pose for body in cell.bodies.all if body.name == "part"))
    hand = panda.body.link_frames()["panda_hand"][1]
    assert np.allclose(places[1], hand @ places[0])
    assert np.allclose(places[2][:3, 3], places[1][:3, 3] + 0.1 * hand[:3, 2])


def test_a_tool_that_there_is_not_is_refused_by_every_verb(
    panda: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(BadInput, match="no frame 'nowhere'"):
        load_cell(panda, CellRequest(self_collision=False, tool="nowhere"))
    write(slow(panda, 1.0), tmp_path / "t.csv")
    (tmp_path / "job.toml").write_text(EXAMPLE)
    (tmp_path / "suite.toml").write_text(
        'format = "energy-opt/suite/1"\nname = "s"\nrobots = ["panda"]\nmodes = ["retime"]\nrandom = { count = 1 }\n'
    )
    for verb, *files in (("check", "t.csv"), ("job", "job.toml"), ("bench", "suite.toml")):
        given = [verb, *(str(tmp_path / file) for file in files), "--tool", "nowhere"]
        where = [] if verb == "check" else ["--out", str(tmp_path / verb)]
        assert main([*given, *where, "--quiet"]) != 0
        assert verb == "bench" or "no frame 'nowhere'" in capsys.readouterr().err


def test_check_judges_with_payload_and_base(panda: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "t.csv"
    write(slow(panda, 1.0), file)
    assert main(["check", str(file), "--robot", "panda"]) == 0
    assert main(["check", str(file), "--robot", "panda", "--payload", "60"]) == 2
    assert "effort of panda_joint" in capsys.readouterr().err
    assert main(["check", str(file), "--robot", "panda", "--payload", "14", "--base=0,0,0,0,0,0"]) == 2
    assert main(["check", str(file), "--robot", "panda", "--payload", "14", "--base=0,0,0,3.14159,0,0"]) == 2
    upright, hanging = capsys.readouterr().err.splitlines()
    assert upright.split(" is ")[1].split(" at ")[0] != hanging.split(" is ")[1].split(" at ")[0]


def test_check_names_every_limit_that_is_broken(
    panda: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(slow(panda, 0.02), tmp_path / "t.csv")
    assert main(["check", str(tmp_path / "t.csv"), "--robot", "panda"]) == 2
    said = capsys.readouterr().err
    assert all(f": {limit} of panda_joint" in said for limit in ("velocity", "acceleration", "jerk", "effort"))
    assert "(row " in said


@pytest.mark.parametrize("begin", [0.0, 100.0, -100.0])
def test_check_names_the_row_and_the_time_of_the_file(
    panda: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str], begin: float
) -> None:
    """The header is row 1, as in all messages on tables; times are the file's own, wherever they begin."""
    motion = slow(panda, 1.0)
    motion = replace(motion, time=begin + motion.time, velocity=motion.velocity.copy())
    motion.velocity[5, 0] = 4.0
    write(motion, tmp_path / "t.csv")
    assert main(["check", str(tmp_path / "t.csv"), "--robot", "panda"]) == 2
    (said,) = (line for line in capsys.readouterr().err.splitlines() if "velocity of panda_joint1" in line)
    assert f"is 4 at {motion.time[5]:.4f} s (row 7)" in said


@pytest.mark.slow
def test_a_job_carries_the_payload_that_is_given(tmp_path: Path) -> None:
    file = tmp_path / "job.toml"
    there, back = GOAL.tolist(), START.tolist()
    file.write_text(
        'format = "energy-opt/job/1"\nrobot = "panda"\ncycle_time = 4.0\nmode = "retime"\n'
        f"[[step]]\nto = {there}\n[[step]]\nto = {back}\npayload = 2.0\n"
    )
    (tmp_path / "held.toml").write_text(
        'format = "energy-opt/model/1"\n[[effect]]\nname = "standby"\npower = 88\n'
        '[[effect]]\nname = "copper_loss"\nr_over_kt2 = 0.0036\n'
        '[[effect]]\nname = "payload"\nmass = 0.7\ncom = [0.0, 0.0, 0.1]\n'
    )
    held = ["--model", str(tmp_path / "held.toml")]
    for name, option, mass in (("both", [*held, "--payload", "0.5"], 0.5), ("model", held, 0.7)):
        assert main(["job", str(file), "--out", str(tmp_path / name), "--quiet", *option]) == 0
        steps = read_json(tmp_path / name / "job.json")["steps"]
        assert [step["payload"] for step in steps[:2]] == [mass, 2.0]


def test_nonsense_is_refused_before_the_work(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BadInput, match="compile 'maybe'"):
        Settings(compile="maybe")
    front = ["tradeoff", *words_of("--out", str(tmp_path))[1:], "--durations", "1:2:100000000"]
    for words, said in (
        (front, "at most 1000 durations"),
        (["identify", "--robot", "panda", "--suggest", "1000000000", "--out", str(tmp_path)], "at most 1000 poses"),
        (["identify", "--robot", "panda", "--suggest", "4", "--seed", "-1", "--out", str(tmp_path)], "--seed -1"),
    ):
        assert main(words) == 2
        assert said in capsys.readouterr().err


MESHED = """<robot name="two">
<link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="arm"><inertial><origin xyz="0.25 0 0"/><mass value="2"/>
<inertia ixx="0.001" iyy="0.04" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.3 0 0"/><geometry><mesh filename="package://two/arm.stl"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 -1 0"/>
<limit lower="-2" upper="2" effort="60" velocity="3"/></joint></robot>"""


def test_an_arm_without_its_meshes_moves_with_self_collision_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import trimesh

    monkeypatch.chdir(tmp_path)
    Path("two.urdf").write_text(MESHED)
    move = ["--robot", "two.urdf", "--start", "0", "--goal", "1", "--mode", "retime", "--quiet"]
    move += ["--model", "source-method-2"]
    assert main(["optimize", *move, "--out", "a"]) == 2
    assert "--package-dir" in capsys.readouterr().err
    assert main(["optimize", *move, "--out", "b", "--self-collision", "off"]) == 0
    front = ["--out", "c", "--self-collision", "off", "--durations", "1:1:1"]
    assert main(["tradeoff", *move, *front]) == 0
    Path("meshes/two").mkdir(parents=True)
    trimesh.creation.box((0.4, 0.05, 0.05)).export("meshes/two/arm.stl")
    assert main(["optimize", *move, "--out", "d", "--package-dir", "meshes"]) == 0  # a folder by its relative name


def test_standard_moves_of_free_duration_take_the_time_that_they_need(tmp_path: Path) -> None:
    ends = ["--start", "0,-1.5,1.2,-1,0,0", "--goal", "1,-1,0.8,-0.5,0.5,0.3", "--mode", "retime", "--quiet"]
    model = ["--model", "source-method-2", "--as", "moves", "--out", str(tmp_path)]
    # no ramps of one move save anything here: the evenly slowed motion is written, in the time that the moves need
    assert main(["optimize", "--robot", "ur3", *ends, *model]) == 4
    result = read_json(tmp_path / "result.json")
    quickest = min(b["duration"] for b in result["baselines"] if b["name"] == "toppra")
    assert quickest < result["duration"] < 1.05 * quickest
    assert result["request"]["duration"] is None and result["status"] == "not_converged"


def test_a_seed_below_zero_is_refused_where_a_set_is_read(panda: Robot, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="seed -1: expected 0"):
        request_of_set(DiagnoseRequest(tmp_path, seed=-1), panda)


@pytest.mark.parametrize("verb", ["check", "identify", "simulate", "evaluate"])
def test_verbs_that_look_for_no_path_take_a_planner_and_do_not_offer_one(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Scripts may give every verb the same options of the cell; a wrong name is refused as elsewhere."""
    with pytest.raises(SystemExit):
        main([verb, "--help-all"])
    assert "--planner" not in capsys.readouterr().out
    request = VERBS[verb]
    fields = {"simulate": {"trajectories": "a", "plant": "b"}, "check": {"files": "a"}, "evaluate": {"files": "a"}}
    assert cell_of(request(**fields.get(verb, {}), planner="none")).planner == "none"
    with pytest.raises(BadInput, match="planner 'nothing'; expected auto, none, ompl"):
        cell_of(request(**fields.get(verb, {}), planner="nothing"))
