"""Cells of several robots known by curves: schedules, bounds, and an independent check of what was written."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from cell_checker import faults_of_schedule
from machine import allowed

from energy_opt.cli.main import main
from energy_opt.schedule import Hull, Mode, Move, Problem, Ring, Wait, solve

SKODA = Path(__file__).parents[3] / "shared" / "data" / "skoda.json"


BARE = """<robot name="bare"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="revolute">
<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="50"/>
</joint></robot>"""


def run(tmp_path: Path, document: dict, *options: str) -> tuple[int, dict]:
    file = tmp_path / "cell.toml"
    file.write_bytes(tomli_w.dumps(document).encode())
    code = main(["job", str(file), "--out", str(tmp_path / "out"), "--quiet", "--force", *options])
    result = tmp_path / "out" / "job.json"
    return code, json.loads(result.read_text()) if result.is_file() else {}


def two_robots(**more: object) -> dict:
    curve = [[-1, 400.0], [0, 20.0], [1, 60.0]]
    wait = {"name": "rest", "wait": [0.0, 20.0]}
    robots = [
        {"name": n, "step": [{"name": "move", "duration": [1.0, 9.0], "curve": curve}, dict(wait)]} for n in ("a", "b")
    ]
    modes = [{"name": "motors", "power": 200.0}, {"name": "brakes", "power": 50.0, "least": 2.0, "enter": [0.3, 90.0]}]
    return {"format": "energy-opt/job/2", "cycle_time": 10.0, "mode": modes, "robot": robots, **more}


def test_a_wait_takes_the_mode_that_costs_less_and_the_curve_its_best_duration(tmp_path: Path) -> None:
    code, found = run(tmp_path, two_robots())
    assert code == 0
    # brakes: E(d) = 400/d + 20 + 60 d + 90 + 50 (10 - d - 0.3), least where 400/d^2 = 10: beyond 8 s, so at d = 8 s
    durations = np.linspace(1.0, 8.0, 70001)
    brakes = 400 / durations + 20 + 60 * durations + 90 + 50 * (10 - durations - 0.3)
    motors = 400 / durations + 20 + 60 * durations + 200 * (10 - durations)
    assert found["energy_total"] == pytest.approx(2 * min(brakes.min(), motors.min()), rel=1e-6)
    assert found["bound"] <= found["energy_total"] <= found["bound"] * (1 + 1e-6)
    assert [lever["name"] for lever in found["levers"]] == ["as_is", "speeds", "modes"]
    assert found["levers"][0]["energy_total"] == pytest.approx(2 * (480 + 200 * 9))


def test_lags_and_zones_are_kept_cycle_by_cycle(tmp_path: Path) -> None:
    document = two_robots()
    for robot in document["robot"]:
        robot["step"][0] |= {"zone": "table"}
    document["robot"][1]["step"][0] |= {"after": "a.move", "lag": [0.5, 1.0]}
    code, found = run(tmp_path, document)
    assert code == 0
    assert faults_of_schedule(document, found) == []
    a, b = (robot["steps"][0] for robot in found["robots"])
    assert 0.5 - 1e-6 <= (b["start"] - a["start"] - a["duration"]) % 10.0 <= 1.0 + 1e-6


def test_a_cell_that_cannot_be_says_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = two_robots()
    for robot in document["robot"]:
        robot["step"][0] |= {"zone": "table", "duration": [6.0, 9.0]}
    document["robot"][1]["step"][0] |= {"after": "a.rest", "lag": [0.0, 30.0]}  # always kept
    code, found = run(tmp_path, document)
    assert code == 3
    said = capsys.readouterr().err
    assert "no schedule keeps all lags and zones" in said
    assert said.strip().endswith("these cannot be kept together: a.move and b.move not at once, 0.04 s apart")
    assert found["status"] == "infeasible" and found["request"]["job"] == document  # in place of an older answer
    document["robot"][0]["step"][0]["duration"] = [12.0, 13.0]
    assert run(tmp_path, document)[0] == 3
    assert "a: its steps take 12 s at least" in capsys.readouterr().err
    document = two_robots(lag=[{"from": "a.move", "to": "a.rest", "length": 21.0, "height": 1}])  # 11 s in one cycle
    assert run(tmp_path, document)[0] == 3
    assert "cannot be kept together: a.rest 11 s or more after a.move begins" in capsys.readouterr().err
    document = two_robots()
    document["robot"][1]["step"].append({"name": "grip", "wait": 1.0, "modes": ["brakes"]})
    assert run(tmp_path, document)[0] == 3
    assert "b.grip takes 1 s at most, its modes (brakes) 2 s at least" in capsys.readouterr().err


def test_a_lag_over_many_cycles_is_kept(tmp_path: Path) -> None:
    document = two_robots(lag=[{"from": "a.move", "to": "b.move", "length": 3.0, "height": -30}])
    document["robot"][1]["step"][0] |= {"after": "a.move", "lag": [1200.5, 1201.0]}
    code, found = run(tmp_path, document)
    assert code == 0
    assert faults_of_schedule(document, found) == []
    a, b = (robot["steps"][0] for robot in found["robots"])
    assert b["start"] - a["start"] >= 303.0 - 1e-6


def test_starts_are_exact_where_zones_meet(tmp_path: Path) -> None:
    document = two_robots()
    for robot in document["robot"]:
        robot["step"].insert(0, {"name": "weld", "wait": [3.0, 9.0], "modes": ["motors"], "zone": "table"})
    document["robot"][1]["step"][0] |= {"after": "a.weld", "lag": [0.0, 0.04]}  # no more than the jitter of both
    code, found = run(tmp_path, document)
    assert code == 0
    assert found["robots"][1]["steps"][0]["start"] % 10.0 == pytest.approx(3.04, abs=1e-9)


def test_durations_of_today_are_the_first_lever(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = two_robots()
    document["robot"][0]["step"][0]["as_is"] = 4.0
    code, found = run(tmp_path, document)
    assert code == 0
    today = (100 + 20 + 240 + 200 * 6) + (480 + 200 * 9)
    assert found["levers"][0] == {"name": "as_is", "energy_total": pytest.approx(today), "moves": "curves"}
    document["robot"][0]["step"][0]["as_is"] = 9.5
    assert run(tmp_path, document)[0] == 2
    assert "as_is = 9.5 is outside duration = [1, 9]" in capsys.readouterr().err


def test_jitter_is_an_option_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = two_robots()
    for robot in document["robot"]:
        robot["step"][0] |= {"zone": "table", "duration": [4.0, 9.0]}
    code, found = run(tmp_path, document, "--jitter", "0.4")
    a, b = (robot["steps"][0] for robot in found["robots"])
    assert code == 0 and found["jitter"] == 0.4
    for one, two in ((a, b), (b, a)):
        assert (two["start"] - one["start"]) % 10.0 >= one["duration"] + 0.8 - 1e-6
    assert run(tmp_path, document, "--jitter", "0.6")[0] == 3
    assert run(tmp_path, document, "--jitter", "-1")[0] == 2
    assert "jitter = -1.0; expected 0 or more" in capsys.readouterr().err


@pytest.mark.parametrize("option", [("--robot", "panda"), ("--payload", "2"), ("--base", "0,0,1,0,0,0"), ("--resume",)])
def test_options_of_one_robot_are_refused(
    option: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, two_robots(), *option)[0] == 2
    assert f"{option[0]} belongs to a job of one robot" in capsys.readouterr().err


def test_a_job_of_several_is_not_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The option was ignored."""
    assert run(tmp_path, two_robots(), "--resume")[0] == 2
    assert "--resume belongs to a job of one robot" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("step", "more", "said"),
    [
        (1, {"power": {"motor": 3.0}}, "power: no mode 'motor'; did you mean 'motors'?"),
        (0, {"power": {"motors": 3.0}}, "`power` does not belong to a step with `curve`"),
        (0, {"stop": False}, "`stop` does not belong to a step with `curve`"),
        (1, {"duration": [1.0, 2.0]}, "`duration` does not belong to a step with `wait`"),
        (1, {"max_duration": 2.0}, "`max_duration` does not belong to a step with `wait`"),
    ],
)
def test_a_key_of_another_kind_of_step_is_a_fault(
    step: int, more: dict, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = two_robots()
    document["robot"][0]["step"][step] |= more
    assert run(tmp_path, document)[0] == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("step", "says"),
    [
        (
            {"curve": [[-1, 1e300]]},
            "its curve gives 1e+300 J at 1 s and 1.11111e+299 J at 9 s; expected 1e+12 J at most",
        ),
        ({"curve": [[900, 1.0]]}, "curve 1 1 = 900; expected 20 or less"),
        ({"curve": []}, "curve: expected 1 or more entries"),
        ({"curve": [3]}, "curve 1 = 3; expected a list"),
        ({"duration": [1.0]}, "step 1 (move): duration 2 is missing"),
        (
            {"duration": None, "curve": None, "wait": 1.0, "power": {"motors": -3.0}},
            "motors = -3.0; expected 0 or more",
        ),
        ({"name": "two\nlines", "stop": 3}, "step 1: stop = 3"),
    ],
)
def test_a_value_of_a_step_that_cannot_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], step: dict, says: str
) -> None:
    document = two_robots()
    changed = {**document["robot"][0]["step"][0], **step}
    document["robot"][0]["step"][0] = {key: value for key, value in changed.items() if value is not None}
    assert run(tmp_path, document)[0] == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"base": [0, 0, 0, 0, 0, 90]}, "robot arm: --base 0,0,0,0,0,90: R,P,Y in degrees?"),
        ({"base": [20000, 0, 0, 0, 0, 0]}, "robot arm: --base 20000,0,0,0,0,0: 20000 m is too far"),
        ({"model": "nope"}, "--model nope: neither a model file nor a name"),
        ({"model": "cell.toml"}, "cell.toml: format = 'energy-opt/job/2'; expected 'energy-opt/model/1'"),
        ({"tool": "nowhere"}, "--tool nowhere: no frame 'nowhere'"),
        ({"step": [{"to": [0, 1, -1, 0, 0, 0], "free": ["rz"]}]}, "free belongs to a pose of the tool"),
        (
            {"step": [{"to": [0, 1, -1, 0, 0, 0], "stop": False, "zone": z} for z in "tu"]},
            "steps step 1 and step 2: one motion, as stop = false, in two zones",
        ),
        ({"step": [{"to": [0, 1, -1, 0, 0, 0], "stop": "no"}]}, "stop = 'no'; expected true or false, without quotes"),
    ],
)
def test_check_finds_what_a_plan_of_an_arm_would_refuse(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], table: dict, says: str
) -> None:
    arm = {"name": "arm", "robot": "z1", "step": [{"to": [0, 1, -1, 0, 0, 0]}]}
    file, document = tmp_path / "cell.toml", two_robots()
    file.write_bytes(tomli_w.dumps({**document, "robot": [*document["robot"], arm]}).encode())
    assert main(["check", str(file)]) == 0
    file.write_bytes(tomli_w.dumps({**document, "robot": [*document["robot"], {**arm, **table}]}).encode())
    assert main(["check", str(file)]) == 2
    said = capsys.readouterr().err
    assert says in said and said.startswith(f"energy-opt: {file}: ") and said.count("\n") == 1


def test_standard_output_holds_one_document(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    file.write_bytes(tomli_w.dumps(two_robots()).encode())
    words = [sys.executable, "-m", "energy_opt", "job", str(file), "--json", "--out", str(tmp_path / "out")]
    printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert json.loads(printed)["status"] == "solved"


def test_a_mode_is_named_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = two_robots()
    document["mode"].append({"name": "brakes", "power": 20.0})
    assert run(tmp_path, document)[0] == 2
    assert "two modes are named 'brakes'" in capsys.readouterr().err


def test_a_mode_with_postures_is_possible_there_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = two_robots()
    document["robot"][1]["step"].append({"name": "parked", "wait": [0.0, 20.0]})
    document["mode"][1]["posture"] = ["parked"]
    code, found = run(tmp_path, document)
    assert code == 0
    waits = {(r["name"], s["name"]): s for r in found["robots"] for s in r["steps"] if s["mode"] == "brakes"}
    assert list(waits) == [("b", "parked")] and waits["b", "parked"]["duration"] >= 2.0
    document["mode"][1]["posture"] = ["barked"]
    assert run(tmp_path, document)[0] == 2
    assert "mode brakes: posture 'barked' is no pose and no wait; did you mean 'parked'?" in capsys.readouterr().err


def test_faults_of_a_file_are_named_with_their_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = two_robots()
    document["robot"][0]["step"][1]["weit"] = 1
    document["robot"][1]["step"][0]["curve"] = [[2, -1.0]]
    document["cycle_time"] = True
    assert run(tmp_path, document)[0] == 2
    said = capsys.readouterr().err
    assert "robot 1 (a): step 2 (rest): unknown key 'weit'; did you mean 'wait'?" in said
    assert "cycle_time = True; expected a number" in said
    document = two_robots()
    document["robot"][1]["step"][0] |= {"curve": [[2, -1.0]], "after": "a.mov"}
    assert run(tmp_path, document)[0] == 2
    assert "no such step; did you mean 'a.move'?" in capsys.readouterr().err
    del document["robot"][1]["step"][0]["after"]
    assert run(tmp_path, document)[0] == 2
    assert "its curve is not convex" in capsys.readouterr().err
    document = two_robots() | {"supply": {"max_power": 500.0}}
    assert run(tmp_path, document)[0] == 2
    assert "supply: max_power needs an arm" in capsys.readouterr().err


def skoda(path: Path) -> dict:
    """The published cell as a job file; its stays become waits, its points are named."""
    data = json.loads(path.read_text())
    robots, named = [], {}
    for robot in data["robots"]:
        stays, moves = {s["point"]: s for s in robot["stays"]}, {m["from"]: m for m in robot["moves"]}
        last = next(s for s in robot["stays"] if s["last_in_cycle"])
        at, steps = last, []
        while True:
            move = moves[at["point"]]
            at = stays[move["to"]]
            possible = {m["name"]: p for m, p in zip(robot["modes"], at["power"], strict=True) if p < 10000}
            curve = [[t["degree"], t["coefficient"]] for t in move["energy"]]
            steps += [
                {"name": f"move {move['id']}", "duration": [move["least"], move["most"]], "curve": curve},
                {
                    "name": f"stay {at['id']}",
                    "wait": [at["least"], at["most"]],
                    "power": possible,
                    "modes": list(possible),
                },
            ]
            named |= {x["id"]: f"{robot['name']}.{s['name']}" for x, s in zip((move, at), steps[-2:], strict=True)}
            if at is last:
                break
        robots.append({"name": robot["name"], "mode": robot["modes"], "step": steps})
    lags = [{**lag, "from": named[lag["from"]], "to": named[lag["to"]]} for lag in data["lags"]]
    return {"format": "energy-opt/job/2", "cycle_time": data["cycle_time"], "robot": robots, "lag": lags}


@pytest.mark.skipif(not SKODA.is_file(), reason="needs the shared data")
def test_the_published_cell_comes_out_as_published(tmp_path: Path) -> None:
    document = skoda(SKODA)
    code, found = run(tmp_path, document)
    assert code == 0
    assert faults_of_schedule(tomllib.loads(tomli_w.dumps(document)), found) == []
    energies = {lever["name"]: lever["energy_total"] for lever in found["levers"]}
    assert energies["as_is"] == pytest.approx(491971, abs=1)
    assert energies["speeds"] == pytest.approx(400298, abs=2)
    assert found["levers_alone"][0]["energy_total"] == pytest.approx(450397, abs=1)
    assert 390655 <= found["bound"] <= energies["modes"] <= 390660
    assert found["solve_seconds"] < allowed(5)


def test_a_hull_takes_durations_that_differ_by_rounding_as_one() -> None:
    points = [(1.0, 92.0), (1.0 + 1e-10, 88.8), (1.2, 80.0), (2.0, 120.0)]
    hull = Hull.of(points)
    assert np.diff(hull.durations).min() > 0.1 and hull.value(1.0) == 88.8
    move, wait = Move("m", 1.0, 2.0, hull), Wait("w", 0.0, 9.0, (Mode("motors", 50.0),))
    found = solve(Problem(9.0, (Ring("a", (move, wait)),)))  # with a slope of 1e10 W, HiGHS calls it infeasible
    assert found.energy == pytest.approx(min(80.0 + 50.0 * 7.8, 88.8 + 50.0 * 8.0, 120.0 + 50.0 * 7.0))


def test_arms_without_bodies_are_not_checked_against_each_other(tmp_path: Path) -> None:
    """It had ended with an error of a library after the schedule."""
    (tmp_path / "bare.urdf").write_text(BARE)
    robots = [{"name": n, "robot": "bare.urdf", "home": [0.0], "step": [{"wait": [1.0, 9.0]}]} for n in ("a", "b")]
    code, found = run(tmp_path, {"format": "energy-opt/job/2", "cycle_time": 4.0, "robot": robots})
    assert code == 0 and found["clearance"] is None
    assert any("not every two arms were checked" in warning for warning in found["warnings"])
