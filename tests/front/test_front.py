"""The front door: what a person writes in Python, what comes back, and how wrong arguments are named."""

from __future__ import annotations

import doctest
import inspect
import json
import pickle
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.effects import ALL_EFFECTS
from energy_opt.errors import BadInput
from energy_opt.front.given import payload_from, positions, robot_of, source_model
from energy_opt.front.jobs import job_from
from energy_opt.motion.path import straight
from energy_opt.motion.reshape.nodes import node_functions
from energy_opt.requests.moves import JobRequest, OptimizeRequest
from energy_opt.requests.verbs import EvaluateRequest
from energy_opt.robot import load_robot

README = Path(__file__).parents[2] / "README.md"
START, GOAL = [0, -0.785, 0, -2.356, 0, 1.571, 0.785], (1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4)
QUICK = {"starts": 1, "controls": 16, "compile": "never"}


@pytest.fixture(scope="module")
def result(panda):
    return eo.optimize(panda, eo.source_model(panda), start=START, goal=GOAL, duration=2.0, **QUICK)


def test_importing_the_package_is_fast_and_brings_nothing_heavy():
    code = (
        "import sys, energy_opt as eo; before = set(sys.modules); assert 'numpy' not in before, 'numpy';"
        "assert {'optimize', 'effects'} <= set(dir(eo)); eo.BadInput; eo.effects.CoulombFriction(tau_c=1);"
        "print([m for m in ('pinocchio', 'toppra', 'matplotlib', 'scipy', 'pyarrow') if m in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"


def test_every_name_is_there():
    assert len(eo.__all__) <= 30 and set(eo.__all__) < set(dir(eo)) and type(eo) is ModuleType
    for name in dir(eo):
        assert getattr(eo, name) is not None
    assert all(getattr(eo.effects, kind.__name__) is kind for kind in ALL_EFFECTS)
    with pytest.raises(AttributeError, match="optimise"):
        eo.optimise  # noqa: B018


def test_no_package_has_the_name_of_a_verb():
    rooms = {path.name for path in Path(eo.__file__).parent.iterdir() if path.is_dir()}
    assert not rooms & (set(eo.__all__) - {"effects", "conditions"})


def test_a_result_prints_in_five_lines_and_saves_what_the_command_writes(result, tmp_path):
    assert len(str(result).splitlines()) == 5 and "loss" in str(result)
    assert len(repr(result)) < 120 and repr(result).startswith("Answer('solved', 'panda'")
    assert result.duration == result["duration"] == result.trajectory.time[-1]
    assert "<table>" in result._repr_html_() and "scaled" in result._repr_html_()
    assert repr(result.trajectory).startswith("Trajectory(7 joints") and repr(result.arm) == "Robot('panda', 7 joints)"
    out = result.save(tmp_path / "out")
    assert {f.name for f in out.iterdir()} >= {
        "result.json", "trajectory.csv", "trajectory.yaml", "plot.png", "report.html",
    }  # fmt: skip
    stored = json.loads((out / "result.json").read_text())
    assert stored["format"] == "energy-opt/result/1" and stored["request"]["goal"] == list(GOAL)
    assert stored["request"]["version"] == eo.__version__ and stored["request"]["seed"] == 0
    assert stored["request"]["model"]["effect"][0] == {"name": "standby", "power": 88.04}
    assert pickle.loads(pickle.dumps(result.energy)) == result.energy


def test_arguments_as_people_have_them(panda):
    by_name = dict(zip(reversed(panda.joints), reversed(GOAL), strict=True))
    common = {"mode": "retime", "max_duration": 4.0}
    one = eo.optimize("panda", "source_method_2", start=START, goal=by_name, payload=1.5, **common)
    assert one.request["payload"] == {"mass": [1.5], "com": [0.0, 0.0, 0.0]}
    scalar = lambda s: [a + (b - a) * float(s) for a, b in zip(START, GOAL, strict=True)]  # noqa: E731
    for path in (np.array([START, GOAL]), lambda s: straight(START, GOAL)(s), scalar, one.trajectory):
        again = eo.optimize(panda, eo.source_model("panda"), path=path, payload=(1.5, 0, 0, 0), **common)
        assert again.energy.total == pytest.approx(one.energy.total, rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"start": START[:3], "goal": GOAL}, r"^start: 3 numbers; panda has 7 joints"),
        ({"start": START}, "^goal is missing; give start and goal, or path"),
        ({"start": START, "goal": {"panda_joint1": 0, "panda_jont2": 0}}, "did you mean 'panda_joint2'"),
        ({"start": START, "goal": GOAL, "duration": -1}, "^duration -1: not a duration"),
        ({"start": START, "goal": GOAL, "duratoin": 1}, "no argument 'duratoin'; did you mean"),
        ({"start": START, "goal": GOAL, "out": "folder"}, r"no argument 'out'; save\(FOLDER\) of the result"),
        ({"start": START, "goal": [np.nan] * 7}, "^goal: expected finite"),
        (
            {"start": START, "goal": [GOAL, START]},
            r"^goal: .* is not a list of numbers; .* for several goals give eo.AnyOf",
        ),
        ({"start": START, "goal": eo.AnyOf([])}, "^goal: AnyOf without a goal; expected one or more"),
        ({"path": lambda s: "north"}, r"^path: expected waypoints \(K, 7\) \[rad\], or a function of s in \[0, 1\]"),
        ({"path": "no/such/file"}, r"^no/such/file: No such file or directory$"),
        ({"path": np.zeros((3, 4))}, r"^path: shape \(3, 4\); expected waypoints \(K, 7\)"),
        ({"start": START, "goal": GOAL, "payload": [1, 2]}, r"^payload \[1, 2\]: expected a mass"),
        ({"start": START, "goal": GOAL, "model": "source-metod-2"}, "did you mean 'source-method-2'"),
        ({"start": START, "goal": "here"}, "^goal here: "),
        ({"robot": ["panda"]}, r"^robot \['panda'\]: expected a name, the path of a URDF, or a Robot"),
        ({"start": START, "goal": GOAL, "model": 3}, "^model 3: expected a name, a file, a PowerModel"),
        ({"lock": {"panda_joint1": "a"}}, "^lock panda_joint1=a: 'a' is not a number"),
        ({"lock": "panda_joint1=0,panda_joint2=b"}, "^lock panda_joint2=b: 'b' is not a number"),
        ({"keep": [3]}, "^keep 3: expected text"),
        ({"tube": 0.1}, "^tube 0.1: expected text: .*0.1rad"),
        ({"tool": ["hand"]}, r"^tool \['hand'\]: expected text"),
        ({"write": 3}, "^write 3: expected text"),
        ({"base": 3}, "^base 3: 1 numbers; expected X,Y,Z"),
        ({"conditions": "nope.py"}, "^conditions nope.py: no such Python file"),
        ({"start": START, "goal_pose": [0.4, 0, 0.4, 3, 0, 0], "pose_tolerance": 0.01}, "the tolerance is 0.01"),
    ],
)
def test_wrong_arguments_are_named_as_arguments(panda, arguments, says):
    with pytest.raises(eo.BadInput, match=says):
        eo.optimize(**{"robot": panda, **arguments})


def test_iterators_and_scalars_of_numpy_are_taken(panda):
    asked = OptimizeRequest(panda, start=iter(START), via=map(list, [GOAL]), keep=None, duration=np.array(2.0))
    assert (asked.start, asked.via, asked.keep, asked.duration) == (list(START), (list(GOAL),), (), 2.0)
    assert OptimizeRequest(panda, self_collision=np.bool_(False)).self_collision is False


def test_a_job_may_hold_arrays_and_a_box_must_be_one(panda):
    steps = [{"to": np.array(GOAL)}, {"to": "home"}]
    job = {"format": "energy-opt/job/1", "robot": "panda", "cycle_time": 6, "home": np.array(START), "step": steps}
    assert job_from(JobRequest(job), robot=panda).steps[0].goal.tolist() == list(GOAL)
    with pytest.raises(eo.BadInput, match=r"^base_box 3: expected X0"):
        eo.place(job, base_box=3)


@pytest.mark.parametrize(("key", "says"), [("goals", "expected a list"), ("settings", "expected a table")])
def test_a_request_with_a_number_in_place_of_a_table_is_refused(key, says):
    with pytest.raises(eo.BadInput, match=f"the request: {key} = 3: {says}"):
        eo.repeat({"verb": "optimize", "robot": "panda", key: 3})


def test_models_add_and_subtract(tmp_path):
    model = eo.source_model("panda") + eo.effects.CoulombFriction(tau_c=0.3)
    assert repr(model) == (
        "PowerModel('panda': Standby(power=88.04) + CopperLoss(r_over_kt2=0.0036) + CoulombFriction(tau_c=0.3))"
    )
    model.save(str(tmp_path / "m.toml"))
    assert eo.load_model(str(tmp_path / "m.toml")) == model
    assert model - "coulomb_friction" == model - eo.effects.CoulombFriction == eo.source_model("panda")
    with pytest.raises(eo.BadInput, match="twice"):
        model + eo.effects.CoulombFriction(tau_c=0.1)
    with pytest.raises(eo.BadInput, match="has no 'coulomb_fricton'; did you mean"):
        model - "coulomb_fricton"


def test_moves_compare():
    assert eo.Move(START, GOAL) == eo.Move(np.array(START), np.array(GOAL)) != eo.Move(START, GOAL, duration=2.0)
    one, other = (eo.Move(START, GOAL, "retime", path=straight(START, q)) for q in (GOAL, START))
    assert one != other and len({eo.Move(START, GOAL), eo.Move(START, GOAL)}) == 1


def test_a_payload_is_added_to_a_planner_without_building_it_again(monkeypatch):
    built = []
    monkeypatch.setattr(
        "energy_opt.motion.plan.context.node_functions", lambda *a: built.append(a) or node_functions(*a)
    )
    lock = {"panda_finger_joint1": 0.0123}  # no other test builds functions for this hand
    panda = eo.load_robot("panda", lock=lock)
    model = eo.source_model(panda)
    planner = eo.Planner(panda, model, eo.Settings(**QUICK))
    move = eo.Move(START, GOAL, duration=2.5)
    losses = []
    for mass in (0.0, 1.0, 2.5, 0.0):
        planner = planner.under(model if mass == 0 else model + eo.effects.Payload(mass=mass, com=[0, 0, 0.1]))
        losses.append(planner.solve(move).energy.loss)
    assert len(built) == 2 and losses[0] < losses[1] < losses[2] and losses[3] == pytest.approx(losses[0])
    with pytest.raises(eo.BadInput, match="other effects"):
        planner.under(model + eo.effects.CoulombFriction(tau_c=0.1))
    again = eo.load_robot("panda", lock=lock)
    assert again.body == panda.body != eo.load_robot("panda", lock={"panda_finger_joint1": 0.0124}).body
    assert eo.Planner(again, model, eo.Settings(**QUICK)).solve(move).energy.loss == pytest.approx(losses[0])
    assert len(built) == 2  # another load of the same description shares them


def test_a_front_and_measured_data_through_the_door(panda, tmp_path):
    found = eo.tradeoff(panda, start=START, goal=GOAL, mode="retime", durations=[2.0, 3.0])
    assert found.durations.tolist() == [2.0, 3.0] and np.isfinite(found.energies).all() and "2 points" in repr(found)
    assert found.document()["status"] == "solved" and found.document()["models"][1]["name"] == "careful"
    found.save(tmp_path / "front")
    assert (tmp_path / "front/tradeoff.json").is_file()
    with pytest.raises(eo.BadInput, match=r"log\.toml"):
        eo.diagnose(tmp_path, "source-method-2")


def test_a_front_keeps_clear_and_says_what_cannot_be_done(tmp_path):
    ends = {"start": [0, 1, -1, 0, 0, 0], "goal": [0.5, 1, -1, 0, 0, 0], "mode": "retime"}
    found = eo.tradeoff("z1", **ends, durations=[0.01, 0.02])
    assert found.document()["status"] == "infeasible" and "shortest possible one" in found.document()["message"]
    (tmp_path / "s.yaml").write_text("objects: [{name: box, type: box, size: [2, 2, 2], position: [0, 0, 1.2]}]")
    with pytest.raises(eo.Infeasible, match="touches box"):
        eo.tradeoff("z1", **ends, durations=[2.0], scene=tmp_path / "s.yaml")


def test_readme_shows_what_works(tmp_path, monkeypatch):
    """README's Python is run as it stands there."""
    monkeypatch.chdir(tmp_path)
    text = README.read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    test = doctest.DocTestParser().get_doctest(block, {}, "README", str(README), 0)
    assert len(test.examples) >= 4
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert runner.run(test).failed == 0
    assert (tmp_path / "out/result.json").is_file()


@pytest.mark.parametrize("word", ["0.1,0.2,0.3,0.4,0.5,0.6", "0.1 0.2 0.3 0.4 0.5 0.6", " .1, .2 ,.3 .4,0.5, 6e-1,"])
def test_positions_are_separated_by_commas_or_spaces(word: str) -> None:
    assert np.allclose(positions(word, load_robot("z1"), "start"), np.arange(1, 7) / 10)
    by_name = ", ".join(f"joint{k} = {value}" for k, value in enumerate(word.replace(",", " ").split(), start=1))
    assert np.allclose(positions(by_name, load_robot("z1"), "start"), np.arange(1, 7) / 10)


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("0.1,,0.2,0.3,0.4,0.5", "'' is not a number"),
        ("0.1 0.2 0.3 0.4 0.5 3_0", "'3_0' is not a number"),
        ("0.1 0.2", "2 positions; the robot has 6"),
        ("0.1;0.2;0.3;0.4;0.5;0.6", r"expected commas between the positions"),
        ("no such pose", "no pose is named"),
        ("joint1=0, joint1=1", "joint joint1 is given twice"),
        ("joint1=0, joint2=1", "no value for joint3, joint4, joint5, joint6"),
        (object(), r"is not 6 numbers \[rad\]"),
    ],
)
def test_positions_that_are_none_are_refused(word: str, says: str) -> None:
    with pytest.raises(BadInput, match=says):
        positions(word, load_robot("z1"), "goal")


def test_a_loaded_robot_accepts_no_further_files() -> None:
    robot = load_robot("z1")
    for more in ({"limits": "limits.yaml"}, {"lock": {"joint1": 0.0}}):
        with pytest.raises(BadInput, match="belongs to a robot that is loaded"):
            robot_of(EvaluateRequest(files=(), robot=robot, **more))
    with pytest.raises(BadInput, match="method 3; expected 1 or 2"):
        source_model(robot, 3)


def test_payloads_are_numbers_or_payloads() -> None:
    payload = payload_from((1.5, 0.0, 0.0, 0.1))
    assert payload_from(payload) is payload and payload_from("1.5,0,0,0.1") == payload
    with pytest.raises(BadInput, match="expected a mass, or mass and centre of mass"):
        payload_from(["heavy"])


@pytest.mark.parametrize("verb", [eo.optimize, eo.tradeoff, eo.bench, eo.evaluate, eo.simulate, eo.import_logs])
def test_the_text_of_a_verb_speaks_of_arguments(verb) -> None:
    """`help(eo.optimize)` named options (`--start`), began with what is seldom given, and took no arrays."""
    text = inspect.getdoc(verb).partition("Args:\n")[2].partition("\n\n")[0]
    listed = [line.strip().partition(":")[0] for line in text.splitlines()]
    assert "--" not in text.replace("`energy-opt --example suite`", "")
    given = [name for name in inspect.signature(verb).parameters if name != "stopped"]
    assert listed == [*given, "stopped"]
    assert "`evaluate` also" not in text
    if verb is eo.optimize:
        assert "own_limits: set by `conditions`" in text
        assert "a sequence (n,) in the robot's order" in text and "`standard` moves may add" in text
        assert inspect.getdoc(verb).endswith('by name, as `["peak_power"]`, the values of result.json.')


def test_the_document_of_a_duration_that_is_too_short_has_the_time_of_its_message() -> None:
    """`time` was null, though the message named it."""
    goal = [0.8, 1.5, -1.3, 0.3, 0.2, 0.1]
    quick: dict[str, object] = {"starts": 1, "controls": 12, "self_collision": False, "duration": 0.05}
    with pytest.raises(eo.Infeasible, match=r"binds at 0\.\d+ s") as caught:
        eo.optimize("z1", "source-method-2", start=[0, 1, -1, 0, 0, 0], goal=goal, **quick)
    document = caught.value.document()
    assert f"binds at {document['time']:.4g} s" in document["message"]
    assert 0 < document["time"] < document["shortest_duration"]


def test_a_job_from_python_continues_no_earlier_run() -> None:
    """`resume` was ignored: a call from Python has no folder."""
    steps = [{"to": [0.3, 1, -1, 0, 0, 0]}, {"to": [0, 1, -1, 0, 0, 0]}]
    job = {"format": "energy-opt/job/1", "robot": "z1", "cycle_time": 4.0, "step": steps}
    for verb in (lambda **more: eo.job(job, **more), lambda **more: eo.tradeoff(job=job, **more)):
        with pytest.raises(BadInput, match="resume needs the folder of the earlier run"):
            verb(resume=True)


def test_the_signature_of_a_verb_says_what_it_returns() -> None:
    """`help(eo.optimize)` said that it returns None."""
    assert {str(inspect.signature(verb).return_annotation) for verb in (eo.optimize, eo.place)} == {
        "Answer",
        "PlaceAnswer",
    }
