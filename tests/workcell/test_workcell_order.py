"""The order of steps in a cell: against all orders, each written as a file of its own."""

from __future__ import annotations

import json
from copy import deepcopy
from itertools import permutations
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import tomli_w
from cell_checker import faults_of_schedule

from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.front.given import source_model
from energy_opt.motion import Settings
from energy_opt.robot import load_robot
from energy_opt.workcell.arm import Arm
from energy_opt.workcell.file import load_workcell
from energy_opt.workcell.motion import ArmMove


def run(folder: Path, document: dict, *options: str) -> tuple[int, dict]:
    folder.mkdir(exist_ok=True)
    file = folder / "cell.toml"
    file.write_bytes(tomli_w.dumps(document).encode())
    code = main(["job", str(file), "--out", str(folder / "out"), "--quiet", "--force", *options])
    return code, json.loads((folder / "out" / "job.json").read_text()) if code == 0 else {}


def as_done(document: dict, found: dict) -> dict:
    """The document with its steps in the order of the answer."""
    out = deepcopy(document)
    for robot, answer in zip(out["robot"], found["robots"], strict=True):
        by_name = {step["name"]: step for step in robot["step"]}
        robot["step"] = [by_name[step["name"]] for step in answer["steps"]]
    return out


def two_robots(rng: np.random.Generator) -> dict:
    """One with three moves in any order, one that follows each of them in an order of its own."""

    def move(name: str, least: float) -> dict:
        power = float(rng.uniform(50, 150))
        return {"name": name, "duration": [least, 8.0], "curve": [[-1, 4 * power], [1, power]]}

    lengths = rng.uniform(0.8, 2.0, 6)
    first = [step for k in range(3) for step in (move(f"m{k}", lengths[k]), {"name": f"w{k}", "wait": 0.5})]
    for step in first:
        step["any_order"] = True
    first.append({"name": "rest", "wait": [0.0, 12.0]})
    second = [
        step for k in range(3) for step in (move(f"n{k}", lengths[3 + k]), {"name": f"v{k}", "wait": [0.0, 12.0]})
    ]
    for k, wanted in enumerate(rng.permutation(3)):  # each a little after one of the other robot's
        second[2 * k] |= {"after": f"a.w{wanted}", "lag": [0.0, 0.4]}
    modes = [{"name": "motors", "power": 200.0}, {"name": "brakes", "power": 80.0, "least": 1.5, "enter": [0.3, 60.0]}]
    return {
        "format": "energy-opt/job/2",
        "cycle_time": 12.0,
        "mode": modes,
        "robot": [{"name": "a", "step": first}, {"name": "b", "step": second}],
    }


@pytest.mark.parametrize("seed", range(4))
def test_a_free_order_is_the_best_of_all_orders(tmp_path: Path, seed: int) -> None:
    document = two_robots(np.random.default_rng([7, seed]))
    code, found = run(tmp_path, document)
    assert code == 0
    assert faults_of_schedule(as_done(document, found), found) == []
    energies = []
    for order in permutations(range(3)):
        fixed = deepcopy(document)
        steps = fixed["robot"][0]["step"]
        fixed["robot"][0]["step"] = [*(steps[2 * k + i] for k in order for i in (0, 1)), steps[-1]]
        for step in fixed["robot"][0]["step"]:
            step.pop("any_order", None)
        code, one = run(tmp_path, fixed)
        energies.append(one["energy_total"] if code == 0 else np.inf)
    assert found["energy_total"] == pytest.approx(min(energies), rel=1e-6)
    assert max(energies) > min(energies) * 1.001  # the order matters here
    assert found["bound"] <= min(energies) * (1 + 1e-6)
    levers = {lever["name"]: lever["energy_total"] for lever in found["levers"]}
    assert list(levers)[-1] == "order" and levers["order"] == found["energy_total"]


def test_after_orders_the_steps_of_a_group(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = two_robots(np.random.default_rng(3))
    del document["robot"][1]
    steps = document["robot"][0]["step"]
    steps[0]["after"], steps[4]["after"] = "a.m1", "a.m0"
    code, found = run(tmp_path, document)
    assert code == 0
    assert [s["name"] for s in found["robots"][0]["steps"]] == ["m1", "w1", "m0", "w0", "m2", "w2", "rest"]
    steps[2]["after"] = "a.m2"
    assert run(tmp_path, document)[0] == 2
    assert "robot a: steps m0 and m1 and m2: each is `after` another" in capsys.readouterr().err


@pytest.mark.slow
def test_an_arm_takes_its_steps_in_the_shortest_order_and_waits_where_it_pays(tmp_path: Path) -> None:
    at = [-1.2, 1.2, -0.6]  # of the first joint: as listed, the arm swings to and fro
    steps = [
        {"name": f"to {k}", "to": [angle, 0.3, 0.0, -1.9, 0.0, 2.2, 0.8], "any_order": True}
        for k, angle in enumerate(at)
    ]
    steps.append({"name": "home", "to": [-1.6, 0.3, 0.0, -1.9, 0.0, 2.2, 0.8]})
    document = {
        "format": "energy-opt/job/2",
        "cycle_time": 10.0,
        "mode": [{"name": "parked", "power": 30.0, "least": 1.0, "posture": ["up"]}],
        "robot": [
            {"name": "a", "robot": "panda", "poses": {"up": [-1.6, -0.1, 0.0, -1.9, 0.0, 1.9, 0.8]}, "step": steps}
        ],
    }
    code, found = run(tmp_path, document, "--model", "source-method-2", "--starts", "1")
    assert code == 0
    names = [s["name"] for s in found["robots"][0]["steps"] if not s["name"].startswith("wait")]
    moves = [n for n in names if n.startswith("to ") and "wait" not in n]
    assert moves in (["to 0", "to 2", "to 1"], ["to 1", "to 2", "to 0"])
    levers = {lever["name"]: lever["energy_total"] for lever in found["levers"]}
    assert list(levers) == ["as_is", "speeds", "modes", "order", "paths"]
    assert levers["order"] < levers["modes"] * 0.999
    waits = {s["name"]: (s["duration"], s["mode"]) for s in found["robots"][0]["steps"] if s["mode"]}
    assert "to wait at up" in names and max(waits.values()) == waits["wait after to wait at up"]
    assert waits["wait after to wait at up"][0] > 1 and waits["wait after to wait at up"][1] == "parked"


@pytest.mark.nightly
def test_an_arm_stays_where_going_elsewhere_saves_nothing_once_moves_are_optimized(tmp_path: Path) -> None:
    at = [-1.2, 1.2]
    steps = [{"name": f"to {k}", "to": [angle, 0.3, 0.0, -1.9, 0.0, 2.2, 0.8]} for k, angle in enumerate(at)]
    robot = {"name": "a", "robot": "panda", "step": steps}
    document = {"format": "energy-opt/job/2", "cycle_time": 7.0, "robot": [robot]}
    options = "--model", "source-method-2", "--starts", "1"
    _, alone = run(tmp_path / "alone", document, *options)
    robot["poses"] = {"up": [-1.6, -0.1, 0.0, -1.9, 0.0, 1.9, 0.8]}
    code, found = run(tmp_path / "up", document, *options)
    assert code == 0 and found["energy_total"] <= alone["energy_total"] * (1 + 1e-9)
    assert [s["name"] for s in found["robots"][0]["steps"]] == [s["name"] for s in alone["robots"][0]["steps"]]
    levers = [{lever["name"]: lever["energy_total"] for lever in result["levers"]} for result in (alone, found)]
    assert levers[0] == pytest.approx(levers[1], rel=1e-9)  # none of them claims what the answer does not do


def test_durations_are_looked_for_between_known_ones_until_little_can_be_saved() -> None:
    def energy(duration: float) -> float:
        return 300 / duration**3 + 60 * duration

    move = ArmMove(0, None, None, 1.0, 8.0)
    for duration in (1.0, 1.6, 3.2, 8.0):
        move.tried.add(duration)
    for _ in range(8):
        known = {d: energy(d) for d in move.tried}
        move.answers = {d: SimpleNamespace(energy=SimpleNamespace(total=e)) for d, e in known.items()}
        looked = move.beside(min(known, key=known.get), 1.0)
        move.tried |= set(looked)
        if not looked:
            break
    best = min(energy(d) for d in np.linspace(1, 8, 2001))
    assert not looked and best <= min(known.values()) < best + 1.0
    assert len(known) <= 12 and min(energy(d) for d in (1.0, 1.6, 3.2, 8.0)) > best + 4


def test_moves_leave_room_for_the_rounding_of_programs(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    there, back = [1.2, -1.0, 1.3, -1.9, -1.5, 0.5], [0, -1.5, 1.6, -1.7, -1.5, 0]
    steps = [{"name": "there", "to": there}, {"name": "back", "to": back}]
    robot = {"name": "a", "robot": "ur5e", "step": steps}
    file.write_bytes(tomli_w.dumps({"format": "energy-opt/job/2", "cycle_time": 6.0, "robot": [robot]}).encode())
    cell = load_workcell(file)
    arm = Arm(cell, cell.robot[0], file, load_robot, lambda name, robot: source_model(robot), Settings(starts=1),
              CellRequest(self_collision=False), lambda: False)  # fmt: skip
    move = arm.moves[0]
    assert arm.optimize(move, 1.02 * move.shortest)
    limits = arm.job.robot.limits
    for answer in move.answers.values():
        t = answer.trajectory
        _, v, a, _ = t.sample(np.linspace(t.time[0], t.time[-1], 4001))
        used = max(np.abs(v / limits.velocity).max(), np.abs(a / limits.acceleration).max())
        assert 0.9 < used < 0.99999
