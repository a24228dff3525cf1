# ruff: noqa: E501
"""`energy-opt VERB` and `eo.verb` are one: the same request gives the same JSON, and a written request repeats it."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import energy_opt as eo
from energy_opt.cli.main import example, main
from energy_opt.errors import speaking_of_options
from energy_opt.files import to_json
from energy_opt.front.robots import effects as described
from energy_opt.front.verbs import VERBS, asked_in
from energy_opt.requests.option import options_of
from energy_opt.tables import write_table

EXAMPLE = example("job")

# What differs from run to run, or is about files: times, the words of the command line, digests.
VOLATILE = {"command", "files", "written", "seconds", "build_seconds", "solve_seconds", "moves_per_second", "out", "set",
            "progress", "compiled", "times"}  # fmt: skip
A, B = [0.0, 1.0, -1.0, 0.0, 0.0, 0.0], [0.6, 1.3, -1.2, 0.2, 0.1, 0.1]
MOVE: dict[str, Any] = {"robot": "z1", "start": A, "goal": B, "mode": "retime"}
JOB = """format = "energy-opt/job/1"
robot = "z1"
cycle_time = {cycle}
mode = "retime"
[[step]]
to = [0.6, 1.3, -1.2, 0.2, 0.1, 0.1]
[[step]]
wait = 0.2
[[step]]
to = [0.0, 1.0, -1.0, 0.0, 0.0, 0.0]
"""
SUITE = """format = "energy-opt/suite/1"
name = "s"
robots = ["z1"]
modes = ["retime"]
durations = [{duration}]
[[moves]]
start = [0.0, 1.0, -1.0, 0.0, 0.0, 0.0]
goal = [0.6, 1.3, -1.2, 0.2, 0.1, 0.1]
"""


def requests() -> dict[str, list[dict[str, Any]]]:
    """Ten requests of each verb, as Python has them; files are those of `files`."""
    one = {"model": "source-method-2"}
    common: list[dict[str, Any]] = [
        one, {"duration": 1.5}, {"payload": 0.5, **one}, {"base": [0, 0, 0, 0, 0.3, 0], **one}, {"floor": -0.5, **one},
        {"max_power": 400.0, **one}, {"tool_speed": 0.5, **one}, {"robust": "worst", "model": ["source-method-2", "careful"]},
        {"lock": {"jointGripper": -0.1}, **one}, {"self_collision": "off", "seed": 3, "cycles_per_year": 1e5, "price": 0.3, **one},
    ]  # fmt: skip
    judged: list[dict[str, Any]] = [
        one, {}, {"payload": 0.5}, {"base": [0, 0, 0, 0, 0.3, 0]}, {"floor": -0.5}, {"self_collision": False},
        {"model": ["source-method-1", "careful"]}, {"model": "careful", "clearance": 0.01}, {"payload": [0.4, 0, 0, 0.1]},
        {"robot": "z1"},
    ]  # fmt: skip
    return {
        "optimize": [{**MOVE, **each} for each in common],
        "tradeoff": [{**MOVE, "durations": [1.0, 1.5], **{k: v for k, v in each.items() if k != "duration"}} for each in common],
        "job": [{"job": "job.toml", **one, "starts": k + 1} for k in range(5)]
        + [{"job": "slow.toml", **each} for each in ({}, one, {"payload": 0.3}, {"cycles_per_year": 10.0}, {"seed": 2})],
        "bench": [{"suite": "suite.toml", "jobs": 1, **one, "seed": k} for k in range(5)]
        + [{"suite": "slow.suite.toml", "jobs": 1, **each} for each in (one, {"payload": 0.3}, {"floor": -0.5}, {"cycles_per_year": 9.0}, {"clearance": 0.01})],
        "evaluate": [{"files": "move.csv", **each} for each in judged],
        "check": [{"files": "move.csv", **each} for each in judged[2:6]]
        + [{"files": "job.toml"}, {"files": "suite.toml"}, {"files": ["move.csv", "job.toml"]}, {"files": "nowhere"},
           {"files": "move.csv", "robot": "panda"}, {"files": "move.csv", "joint_prefix": "arm_"}],
        "identify": [{"robot": "z1", "suggest": 3 + k, "self_collision": False} for k in range(5)]
        + [{"robot": "ur5", "suggest": 4, "seed": k, "self_collision": False} for k in range(5)],
        "simulate": [{"trajectories": "move.csv", "plant": "plant.toml", "self_collision": False, **each} for each in (
            {}, {"repeat": 2}, {"static": 1.0}, {"noise": 0.1}, {"rate": 250.0}, {"seed": 4}, {"payload": 0.3},
            {"rest": 0.5}, {"log": ["velocity"]}, {"meter_rate": 50.0})],
        "import": [{"files": "log.csv", "robot": "z1", "power": power} for power in (None, "power", "power:W", "power:kW", "power:mW")]
        + [{"files": "log.csv", "time": time} for time in (None, "time", "time:s", "time:ms")] + [{"files": ["log.csv"]}],
        "diagnose": [{"set": "measured", "model": "plant.toml", "tolerance": 2.0 + k} for k in range(10)],
        "passport": [{"models": name} for name in ("panda", "ur5e", "z1", "plant.toml", "ur10e", "ur3e")]
        + [{"models": ["panda", "ur5e"]}, {"models": ["plant.toml", "z1"]}, {"models": "plant.toml", "robot": "z1"}, {"models": ["ur3", "ur5"]}],
        "robots": [{"names": name} for name in ("z1", "panda", "ur3", "ur5", "ur10", "kinova", "xarm7", "ur3e", "ur5e", "ur10e")],
        "effects": [{"names": kind.name} for kind in eo.effects.ALL_EFFECTS[:10]],
    }  # fmt: skip


DEFAULT = {
    "diagnose": 0,
    "bench": 1,
    "job": 1,
    "tradeoff": 1,
    "simulate": 1,
}  # of each verb run by default; two of others


def marks(verb: str, number: int) -> list[pytest.MarkDecorator]:
    """The first requests run by default, one more among slow tests, all others at night."""
    quick = DEFAULT.get(verb, 2)
    return [] if number < quick else [pytest.mark.slow if number == quick else pytest.mark.nightly]


CASES = [
    pytest.param(verb, given, id=f"{verb}-{k}", marks=marks(verb, k))
    for verb, given_to_it in requests().items()
    for k, given in enumerate(given_to_it)
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that requests name."""
    out = tmp_path_factory.mktemp("files")
    (out / "job.toml").write_text(JOB.format(cycle=3.0))
    (out / "slow.toml").write_text(JOB.format(cycle=4.0))
    (out / "suite.toml").write_text(SUITE.format(duration=1.5))
    (out / "slow.suite.toml").write_text(SUITE.format(duration=2.0))
    (eo.source_model("z1") + eo.effects.CoulombFriction(tau_c=0.2)).save(out / "plant.toml")
    joints = eo.load_robot("z1").joints
    t = np.linspace(0, 1.5, 151)
    ramp = (t / 1.5) ** 3 * (10 - 15 * (t / 1.5) + 6 * (t / 1.5) ** 2)
    q = np.array(A) + ramp[:, None] * (np.array(B) - np.array(A))
    write_table(out / "move.csv", ["time", *(f"{j}.position" for j in joints)], [t, *q.T])
    long = np.arange(0, 12, 0.01)
    swing = [0.2 * (1 - np.cos(long * (0.8 + 0.1 * k))) + a for k, a in enumerate(A)]
    power = 40 + 5 * np.abs(np.sin(long))
    write_table(out / "log.csv", ["time", *(f"{j}.position" for j in joints), "power"], [long, *swing, power])
    return out


def words_of(verb: str, given: dict[str, Any]) -> list[str]:
    """A request as words of the command line."""
    out, behind = [verb], []
    for name, value in given.items():
        option = options_of(VERBS[verb])[name][1]
        if value is None:
            continue
        if isinstance(value, dict):
            value = [f"{key}={x}" for key, x in value.items()]
        if option.place:
            behind += [value] if isinstance(value, str) else list(value)
        elif isinstance(value, bool):
            out += (
                [f"--{name.replace('_', '-')}"]
                if name == "force"
                else [f"--{name.replace('_', '-')}", "on" if value else "off"]
            )
        elif name == "durations":
            out += ["--durations", f"{value[0]}:{value[-1]}:{len(value)}"]
        elif option.many and not option.nargs:
            for each in value if isinstance(value, list) else [value]:
                out += [f"--{name.replace('_', '-')}", str(each)]
        else:
            text = ",".join(map(str, value)) if isinstance(value, list) else str(value)
            out.append(f"--{name.replace('_', '-')}={text}")
    return [*out, *behind]


def steady(value: Any) -> Any:
    """A document without what differs from run to run."""
    if isinstance(value, dict):
        return {key: steady(each) for key, each in value.items() if key not in VOLATILE}
    return [steady(each) for each in value] if isinstance(value, list) else value


@pytest.mark.parametrize(("verb", "given"), CASES)
def test_the_command_and_the_function_give_the_same_json(
    verb: str, given: dict[str, Any], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(folder)
    if verb == "diagnose" and not (folder / "measured").exists():
        played = {"rest": 0.5, "static": 4.0, "repeat": 4, "self_collision": False}
        eo.simulate("move.csv", "plant.toml", "measured", **played)
    known = options_of(VERBS[verb])
    words = words_of(verb, given)
    words += ["--out", str(tmp_path / "a")] if "out" in known or VERBS[verb].results else []
    code = main([*words, "--json", "--quiet"])
    printed = json.loads(capsys.readouterr().out)
    function = {"import": eo.import_logs, "effects": described}.get(verb) or getattr(eo, verb)
    try:
        with speaking_of_options():  # else messages name arguments, as Python has them
            found = function(**given, **({"out": tmp_path / "b"} if "out" in known else {}))
    except (eo.BadInput, eo.Infeasible) as error:
        assert code == error.exit_code and printed["message"]
        return
    assert found.exit_code == code
    assert steady(json.loads(found.to_json())) == steady(printed)


@pytest.mark.parametrize("verb", ["optimize", "evaluate", "passport"])
def test_a_written_request_repeats_its_result(
    verb: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    given = requests()[verb][3]
    found = getattr(eo, verb)(**given)
    found.save(tmp_path)
    (answer,) = (p for p in tmp_path.glob("*.json") if "request" in json.loads(p.read_text()))
    assert steady(json.loads(eo.repeat(answer).to_json())) == steady(json.loads(found.to_json()))


def test_a_request_by_hand_and_its_faults(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "request.json"
    file.write_text(json.dumps({"verb": "optimize", **MOVE, "model": "source-method-2", "duration": 1.5}))
    assert main(["run", str(file), "--out", str(tmp_path / "out"), "--json", "--quiet"]) == 0
    assert capsys.readouterr().out == (tmp_path / "out" / "result.json").read_text()  # as `optimize` prints it
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(file)]) == 0
    assert (
        "files: energy_opt_out/result.json" in capsys.readouterr().out and Path("energy_opt_out/result.json").exists()
    )
    for change, says in (
        ({"verb": "optimise"}, "did you mean 'optimize'"),
        ({"verb": None}, "no request"),
        ({"duratoin": 1}, "did you mean 'duration'"),
        ({"duration": "soon"}, "--duration 'soon': expected a number"),
        ({"write": ["urscrpt"]}, "did you mean 'urscript'"),
        ({"version": "99.1.0"}, f"version = '99.1.0'; expected {eo.__version__} or an earlier version"),
        ({"version": 7}, f"version = 7; expected {eo.__version__} or an earlier version"),
        ({"version": "newest"}, f"version = 'newest'; expected {eo.__version__} or an earlier version"),
    ):
        file.write_text(json.dumps({"verb": "optimize", **MOVE, **change}))
        assert main(["run", str(file), "--out", str(tmp_path / "x"), "--quiet"]) == 2
        assert says in capsys.readouterr().err


def test_requests_survive_being_written() -> None:
    for verb, rows in requests().items():
        for given in rows:
            out = {"out": "set"} if verb == "import" else {}
            request = VERBS[verb](**given, **out)
            again = asked_in(json.loads(to_json(request.document())))
            assert to_json(again.document()) == to_json(request.document()), verb


def test_every_field_is_explained_and_has_a_schema() -> None:
    for name, verb in VERBS.items():
        schema = verb.schema()
        for field in fields(verb):
            option = options_of(verb)[field.name][1]
            assert option.help and (option.written == (field.name in schema["properties"])), (name, field.name)


@pytest.mark.parametrize("verb", VERBS)
def test_help_shows_the_options_that_matter_and_help_all_the_rest(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = {}
    for flag in ("--help", "--help-all"):
        with pytest.raises(SystemExit):
            main([verb, flag])
        shown[flag] = {word for word in capsys.readouterr().out.split() if word.startswith("--")}
    assert shown["--help"] <= shown["--help-all"]
    own = shown["--help"] - {"--json", "--quiet", "--effects", "--help-all", "--help", "--force", "--view"}
    assert len(own) <= 16, own


def test_an_example_job_is_read_from_its_request(tmp_path: Path) -> None:
    (tmp_path / "job.toml").write_text(EXAMPLE)
    request = VERBS["job"](tmp_path / "job.toml")
    assert asked_in(json.loads(to_json(request.document()))).document() == json.loads(to_json(request.document()))


SCRIPT = """import numpy as np
import energy_opt as eo
from energy_opt.motion import Move

robot = eo.load_robot("z1")
model = eo.source_model(robot) + eo.effects.CoulombFriction(tau_c=[0.1] * 6)
ends = [0.0, 1.0, -1.0, 0.0, 0.0, 0.0], [0.6, 1.3, -1.2, 0.2, 0.1, 0.1]
limits = [eo.conditions.MaxPower(400), eo.conditions.KeepUpright(degrees=5)]
result = eo.optimize(robot, model, start=list(ends[0]), goal=np.array(ends[1]), via=[list(ends[0])], conditions=limits)
text: str = result.status
front = eo.tradeoff("z1", [model, "careful"], start=ends[0], goal=ends[1], durations=[1.0, 2.0])
front.save("out")
again = eo.Planner(robot, model).solve(Move(list(ends[0]), list(ends[1]), duration=2.0, via=[list(ends[0])]))
limit: type[eo.conditions.Limit] = eo.conditions.Limit
scene = eo.load_scene("scene.yaml", floor=0.0)


def along(s: float) -> list[float]:
    return [0.6 * s, 1.0, -1.0, 0.0, 0.0, 0.0]


eo.optimize("z1", path=along, mode="retime")
eo.optimize("z1", path=lambda s: np.multiply.outer(s, ends[1]), mode="retime")
"""
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


@pytest.mark.slow
def test_a_script_that_hands_in_lists_and_the_examples_are_well_typed(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    for path in EXAMPLES.glob("my_*.py"):
        (tmp_path / path.name).write_text(path.read_text())
    files = sorted(path.name for path in tmp_path.glob("*.py"))
    words = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", *files]
    root = Path(eo.__file__).parents[1]  # mypy finds an installed package by itself, and refuses its folder in MYPYPATH
    found = {"PYTHONPATH": str(root), "MYPYPATH": str(root)} if (root / "pyproject.toml").is_file() else {}
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"} | found)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", ["load_model", "load_robot", "load_scene", "diagnose", "evaluate", "optimize"])
@pytest.mark.parametrize("given", [3, None])
def test_what_is_no_file_is_bad_input(name: str, given: object) -> None:
    with pytest.raises(eo.BadInput):
        getattr(eo, name)(given)
