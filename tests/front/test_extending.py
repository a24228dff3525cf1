"""What the documentation shows in Python, and of limits and formats of your own, works as it stands there."""

from __future__ import annotations

import importlib.util
import json
import re
import signal
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from time import process_time

import casadi as ca
import numpy as np
import pytest
from machine import allowed

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.formats import FORMATS
from energy_opt.requests.moves import OptimizeRequest

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
START, GOAL = [0, -0.785, 0, -2.356, 0, 1.571, 0.785], [1.2, 0.3, 0.4, -1.2, -0.5, 2.2, -0.4]


def example(name):
    """A file of the documentation as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_limit_of_ones_own_is_kept_and_judged(panda):
    settings = {"starts": 1, "controls": 16, "compile": "never", "model": "source-method-2"}
    ends = {"start": START, "goal": GOAL, "duration": 2.5}
    for mode in ("reshape", "retime"):
        free = eo.optimize(panda, mode=mode, **ends, **settings)
        used = np.abs(free.trajectory.effort * free.trajectory.velocity).max(axis=0)
        bound = np.maximum(0.9 * used, 1.0)
        own = example("my_limit").DrivePower(bound)
        held = eo.optimize(panda, mode=mode, **ends, **settings, conditions=[own])
        assert held.certificate.max_violation["drive_power"] <= 1e-6 and held.status == "solved"
        power = np.abs(held.trajectory.effort * held.trajectory.velocity)
        assert (power <= bound * (1 + 1e-5)).all() and (used > bound).any()


class Slower(eo.conditions.Limit):
    """The first joint's speed, with a bound that falls from 1 rad/s at the start to 0.5 rad/s after 2 s."""

    name, unit, binds, bound = "slower", "rad/s", "arm", 1.0

    def value(self, x):
        return x.v[0] * (1 + x.t / 2)


def test_a_limit_that_depends_on_time_is_kept_by_reshaping_and_refused_for_a_timing(panda):
    settings = {"starts": 1, "controls": 16, "compile": "never", "model": "source-method-2", "conditions": [Slower()]}
    ends = {"start": START, "goal": GOAL}
    with pytest.raises(eo.BadInput, match="slower bounds no timing of a path"):
        eo.optimize(panda, mode="retime", duration=3.0, **ends, **settings)
    held = eo.optimize(panda, duration=2.5, **ends, **settings)
    time, speed = held.trajectory.time, np.abs(held.trajectory.velocity[:, 0])
    assert held.status == "solved" and (speed * (1 + time / 2)).max() == pytest.approx(1.0, abs=1e-2)
    assert (speed * (1 + time / 2) <= 1 + 1e-5).all()


def test_a_request_with_a_limit_that_no_file_defines_says_what_would_work(tmp_path):
    """`eo.repeat` said that `__main__.DrivePower` is no Python file."""
    asked = OptimizeRequest("z1", start=[0] * 6, goal=[1] * 6, conditions=[Slower()]).document()
    with pytest.raises(
        eo.BadInput, match=r"Slower: no such Python file; a request repeats own limits only if FILE\.py"
    ):
        eo.repeat(asked)


def test_conditions_are_options(panda, tmp_path, capsys):
    ends = {"start": START, "goal": GOAL, "mode": "retime", "model": "source-method-2"}
    conditions = [eo.conditions.MaxPower(400), eo.conditions.ToolSpeed(0.9), eo.conditions.KeepLine(2000)]
    request = OptimizeRequest("panda", **ends, conditions=conditions)
    assert request == OptimizeRequest("panda", **ends, max_power=400.0, tool_speed=0.9, keep="line:2000")
    for wrong, says in (
        (["nowhere.py"], "no such Python file"), ([3], "expected a condition"),
        ([conditions[0], conditions[0]], "given twice"),
    ):  # fmt: skip
        with pytest.raises(eo.BadInput, match=says):
            OptimizeRequest("panda", **ends, conditions=wrong)
    with pytest.raises(eo.BadInput, match="given twice"):
        OptimizeRequest("panda", **ends, max_power=300.0, conditions=conditions)
    assert OptimizeRequest("panda", **ends, conditions=[eo.conditions.Tube(metres=0.02)]).tube == "0.02m"
    for text, says in (
        ("x = 1\n", "defines no condition"), ("1 / 0\n", r"ZeroDivisionError: division by zero \(line 1\)"),
        ("raise SystemExit(0)\n", "SystemExit: 0"), ("conditions = 3\n", "conditions = 3; expected a list"),
    ):  # fmt: skip
        (tmp_path / "wrong.py").write_text(text)
        with pytest.raises(eo.BadInput, match=says):
            OptimizeRequest("panda", **ends, conditions=[tmp_path / "wrong.py"])
    file = tmp_path / "mine.py"
    file.write_text((EXAMPLES / "my_limit.py").read_text().replace("bound = 25.0", "bound = 1e-6"))
    out = ["--out", str(tmp_path / "out"), "--quiet"]
    words = ["optimize", "--robot", "panda", "--path", str(file), "--conditions", str(file), *out]
    assert main(words) == 2  # a Python file is no path
    moves = [
        "optimize",
        "--robot",
        "panda",
        f"--start={','.join(map(str, START))}",
        f"--goal={','.join(map(str, GOAL))}",
    ]
    retime = ["--mode", "retime", "--duration", "2.5", "--model", "source-method-2"]
    began = process_time()
    assert main([*moves, *retime, "--conditions", str(file), *out]) == 3
    assert "the drive_power limit does not hold even 50 times slower" in capsys.readouterr().err
    assert process_time() - began < allowed(15)  # such a bound took minutes


def test_an_own_limit_that_the_start_breaks_is_named_in_a_sentence():
    class Elbow(eo.conditions.Limit):
        name, unit, binds, bound = "elbow_sum", "rad", "arm", 3.0

        def value(self, x):
            return x.q[1] + x.q[3]

    with pytest.raises(eo.Infeasible, match=r"^start: the arm: elbow_sum is 3\.141 rad, above its limit of 3 rad$"):
        eo.optimize("panda", "source-method-2", start=START, goal=GOAL, conditions=[Elbow()], self_collision=False)


OWN = """import energy_opt as eo
class Own(eo.conditions.Limit):
    name, unit, binds, bound = {name}, "W", "joint", {bound}
    def value(self, x):
        return {value}
"""


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"value": "None"}, "drive: value: NotImplementedError: Wrong number or type of arguments"),
        ({"value": "x.torque"}, "drive: value: AttributeError: 'State' object has no attribute 'torque' (line 5)"),
        ({"value": "exit(0)"}, "drive: value: SystemExit: 0"),
        ({"value": "float(x.v[0]) * x.v"}, "drive: its value is not a number"),
        ({"bound": "float('inf')"}, "drive: bound inf; expected one number above 0"),
        ({"bound": "'250 W'"}, "drive: bound '250 W'; expected one number above 0"),
        ({"bound": "'250'"}, "drive: bound '250'; expected one number above 0"),
        ({"name": "'velocity'"}, "two limits are named 'velocity'"),
        ({"name": "'a/b'"}, "Own: name = 'a/b'; expected letters, digits and _"),
    ],
)
def test_a_limit_of_ones_own_that_cannot_be_judged_is_refused(tmp_path, capsys, changed, says):
    file = tmp_path / "own.py"
    file.write_text(OWN.format(**{"name": "'drive'", "bound": "250.0", "value": "x.effort * x.v", **changed}))
    words = ["optimize", "--robot", "z1", "--start=0,1,-1,0,0,0", "--goal=0.3,1,-1,0,0,0", "--mode", "retime"]
    assert main([*words, "--self-collision", "off", "--conditions", str(file), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1


@pytest.mark.slow
def test_the_python_page_runs_as_it_stands(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (EXAMPLES.parent / "python.md").read_text(encoding="utf-8")
    names: dict[str, object] = {}
    for block in re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        exec(block, names)
        assert names["result"].status == "solved"
    request = tmp_path / "request.json"
    request.write_text(re.search(r"^```json\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)[1])
    assert main(["run", str(request), "--out", str(tmp_path / "again"), "--quiet"]) == 0


def test_examples_are_short():
    for name in ("my_limit", "my_effects"):
        assert len((EXAMPLES / f"{name}.py").read_text().splitlines()) <= 40


def test_a_format_of_ones_own_is_read_and_written(tmp_path):
    """The page's first example had no times, so `write` could not judge it; the message named a folder that is gone."""
    text = example("my_format")
    ends = {"start": START, "goal": GOAL, "duration": 2.0, "mode": "retime", "write": ["text"]}
    try:
        plan = eo.optimize("panda", "source-method-2", **ends)
        assert [(row["file"], row["valid"]) for row in plan.written] == [("trajectory.joints", True)]
        path, out = plan.save(tmp_path / "plan") / "trajectory.joints", tmp_path / "out"
        assert json.loads((tmp_path / "plan" / "result.json").read_text())["written"][-1] == plan.written[0]
        assert main(["optimize", "--robot", "panda", "--path", str(path), "--mode", "retime", "--duration", "2",
                     "--model", "source-method-2", "--out", str(out), "--quiet"]) == 0  # fmt: skip
        result = eo.optimize("panda", "source-method-2", path=path, mode="retime", duration=2.0)
        np.testing.assert_allclose(result.trajectory.position[[0, -1]], [START, GOAL], atol=1e-9)
        FORMATS["text"] = replace(FORMATS["text"], read=lambda file: replace(text.read(file), time=None))
        with pytest.raises(eo.BadInput, match=r"^trajectory\.joints: waypoints without times"):
            eo.optimize("panda", "source-method-2", **ends)
    finally:
        del FORMATS["text"]


@pytest.mark.parametrize("value", ["0.05m", None, True, [1.0]])
def test_a_condition_takes_numbers_only(value: object) -> None:
    with pytest.raises(eo.BadInput, match=r"MaxPower: watts .*: expected a number"):
        eo.conditions.MaxPower(value)  # type: ignore[arg-type]


@pytest.mark.parametrize("verb", [eo.optimize, eo.tradeoff])
@pytest.mark.parametrize("lost", [False, True])
def test_ctrl_c_in_code_of_ones_own_ends_the_call(verb, lost, panda):
    """Even if that code loses it, as libraries do that call Python."""

    class Pressed(eo.conditions.Limit):
        name, unit, binds, bound = f"pressed_{verb.__name__}_{lost}", "rad/s", "arm", 2.0

        def value(self, x):
            with suppress(KeyboardInterrupt) if lost else nullcontext():
                signal.raise_signal(signal.SIGINT)
            return x.v[0]

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            verb(panda, "source-method-2", start=START, goal=GOAL, conditions=[Pressed()])
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_limit_of_ones_own_that_forbids_a_duration_is_named(panda):
    """Another limit, that binds for a moment only, may grow faster with the speed."""

    class Elbow(eo.conditions.Limit):
        name, unit, binds, bound = "elbow_speed", "rad/s", "arm", 0.3

        def value(self, x):
            return x.v[3]

    settings = {"start": START, "goal": GOAL, "mode": "retime", "self_collision": False}
    with pytest.raises(eo.Infeasible, match=r"^the arm: the elbow_speed limit .* exceeded") as caught:
        eo.optimize(panda, "source-method-2", duration=2.0, conditions=[Elbow()], **settings)
    assert caught.value.shortest_duration > abs(GOAL[3] - START[3]) / 0.3
    with pytest.raises(eo.Infeasible, match=r"the (acceleration|velocity) limit .* exceeded"):
        eo.optimize(panda, "source-method-2", duration=0.7, **settings)


class Sum(eo.conditions.Limit):
    """The sum of all |a|, with kinks."""

    name, unit, binds, bound, one_sided = "sum", "rad/s2", "arm", 1.6, True

    def value(self, x: eo.conditions.State) -> ca.SX:
        """[rad/s^2]."""
        return ca.sum1(ca.fabs(x.a))


def test_a_limit_with_kinks_gives_no_worse_answer_than_timing_the_first_path() -> None:
    """The search stopped at a kink, and its curve took more than the first path in its best timing."""
    asked = {"start": [0, 1, -1, 0, 0, 0], "goal": [0.3, 1.2, -1.2, 0.1, 0, 0], "duration": 2.0, "conditions": [Sum()]}
    found = {
        mode: eo.optimize("z1", "source-method-2", mode=mode, starts=1, controls=10, self_collision=False, **asked)
        for mode in ("retime", "reshape")
    }
    assert found["reshape"].energy.total <= found["retime"].energy.total + 1e-9
