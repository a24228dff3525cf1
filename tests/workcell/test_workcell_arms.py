"""Two arms in one cycle: the proof between them against distances by Pinocchio and coal alone, and a small cell."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import tomli_w

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.cli.main import main
from energy_opt.motion.trajectory import Trajectory
from energy_opt.robot import Robot, load_robot
from energy_opt.workcell.around import MovingCell, others_during
from energy_opt.workcell.between import TwoArms, prove_apart
from energy_opt.workcell.motion import Part, PeriodicMotion

REST = np.array([0.0, -0.5, 0.0, -2.3, 0.0, 1.8, 0.8])
CYCLE = 3.0
BASE = (0.5, 0.0, 0.2, 0.1, 0.0, 2.0)


def swing(joints: tuple[str, ...], goal: np.ndarray, wait: float) -> PeriodicMotion:
    """From rest to a goal, back, and a wait."""
    parts, at, start = [], REST, 0.0
    duration = (CYCLE - wait) / 2
    for name, to in (("there", goal), ("back", REST)):
        x = np.linspace(0, 1, 31)
        s, v, a = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x)
        q = [np.outer(f, to - at) / duration**k for k, f in enumerate((s, v, a))]
        parts.append(Part(name, start, duration, Trajectory(joints, x * duration, at + q[0], q[1], q[2])))
        start, at = start + duration, to
    still = np.zeros((2, 7))
    parts.append(
        Part("wait", start, wait, Trajectory(joints, np.array([0.0, wait]), np.array([REST] * 2), still, still))
    )
    return PeriodicMotion(parts, CYCLE)


def least_distance(one: PeriodicMotion, two: PeriodicMotion, base: np.ndarray, jitter: float) -> float:
    """The least distance over a dense grid of time and lateness, by Pinocchio and coal alone."""
    robot = load_robot("panda")
    model = pin.buildModelFromUrdf(str(robot.urdf))
    locked = [model.getJointId(n) for n in model.names[1:] if n not in robot.joints]
    geometry = pin.buildGeomFromUrdf(model, str(robot.urdf), pin.GeometryType.COLLISION, package_dirs=packages(robot))
    model, geometry = pin.buildReducedModel(model, geometry, locked, pin.neutral(model))
    placed = pin.SE3(base)
    data, gdata = [model.createData() for _ in range(2)], [geometry.createData() for _ in range(2)]
    import coal

    request, least = coal.DistanceRequest(), np.inf
    hulls = []
    for thing in geometry.geometryObjects:
        shape = thing.geometry
        if isinstance(shape, coal.BVHModelBase):
            shape.buildConvexHull(True, "Qt")
            shape = shape.convex
        hulls.append(shape)
    for late in np.linspace(-2 * jitter, 2 * jitter, 3):
        for t in np.linspace(0, CYCLE, 40):
            for k, (motion, time) in enumerate(((one, t), (two, t + late))):
                pin.updateGeometryPlacements(model, data[k], geometry, gdata[k], motion.at(np.array([time]))[0])
            for a, x in zip(hulls, gdata[0].oMg, strict=True):
                for b, y in zip(hulls, gdata[1].oMg, strict=True):
                    y = placed * y
                    if np.linalg.norm(x.translation - y.translation) > 0.6:
                        continue
                    result = coal.DistanceResult()
                    coal.distance(
                        a, coal.Transform3s(x.rotation, x.translation), b, coal.Transform3s(y.rotation, y.translation),
                        request, result,
                    )  # fmt: skip
                    least = min(least, result.min_distance)
    return least


def packages(robot: object) -> list[str]:
    """Folders in which the URDF's package:// is looked for."""
    return [str(folder) for folder in Path(robot.urdf).parents]


@pytest.fixture(scope="module")
def panda() -> object:
    return load_robot("panda")


@pytest.mark.parametrize(("gap", "jitter"), [(1.6, 0.02), (1.25, 0.02), (1.0, 0.0)])
def test_the_proof_between_two_arms_agrees_with_dense_distances(panda: object, gap: float, jitter: float) -> None:
    bases = ((0.0,) * 6, (gap, 0.05, 0.0, 0.0, 0.0, np.pi))
    cells = [Cell(panda, CellRequest(base=base)) for base in bases]
    goal = REST + np.array([0.3, 0.9, 0.0, 0.7, 0.0, 0.2, 0.0])
    one, two = swing(panda.joints, goal, 0.4), swing(panda.joints, goal, 0.9)
    found = prove_apart(TwoArms(*cells), (0, 1), one, two, jitter)
    least = least_distance(one, two, cells[1].request.base_pose, jitter)
    if found.verdict == "proven":
        assert found.lower_bound <= least + 1e-5
        assert least > 0.002
    else:
        assert least < 0.06  # hulls over-estimate meshes; between samples arms move
    assert (found.verdict == "proven") == (gap > 1.1)


def test_the_proof_shifts_time_as_lateness_says(panda: object) -> None:
    cells = [Cell(panda, CellRequest(base=base)) for base in ((0.0,) * 6, (1.2, 0.0, 0.0, 0.0, 0.0, np.pi))]
    away = REST + np.array([0.0, 0.9, 0.0, 0.7, 0.0, 0.2, 0.0])
    one = swing(panda.joints, away, 1.6)
    late = PeriodicMotion([Part(p.name, p.start + 1.5, p.duration, p.trajectory) for p in one.parts], CYCLE)
    arms = TwoArms(*cells)
    assert prove_apart(arms, (0, 1), one, one, 0.0).verdict == "colliding"
    assert prove_apart(arms, (0, 1), one, late, 0.005).verdict == "proven"
    assert prove_apart(arms, (0, 1), one, late, 0.8).verdict != "proven"


def test_the_bodies_of_an_arm_that_moves_are_where_it_is_at_that_instant(panda: object) -> None:
    bases = ((0.0,) * 6, (0.9, 0.05, 0.0, 0.0, 0.0, np.pi))
    cells = [Cell(panda, CellRequest(base=base, clearance=1e-9)) for base in bases]
    goal = REST + np.array([0.3, 0.5, 0.0, 0.4, 0.0, 0.2, 0.0])
    one, two = swing(panda.joints, goal, 0.4), swing(panda.joints, goal, 0.9)
    others = others_during(cells[0], [(cells[1], two, None)], 0.0, CYCLE, 0.0)
    moving = MovingCell(cells[0], others, REST, REST)
    u = np.linspace(0, 1, 40)
    apart = moving.gap(u, one.at(u * CYCLE - 1e-12), 1.0)
    assert apart < 0.15
    least = least_distance(one, two, cells[1].request.base_pose, 0.0)
    own = min(d for q in one.at(u * CYCLE) for _, d in cells[0].distances(q, 1.0))
    assert apart == pytest.approx(min(least, own), abs=2e-3)


def test_arms_keep_half_of_what_their_poses_leave_where_that_is_less_than_the_default(panda: object) -> None:
    second = CellRequest(base=(0.877, 0.05, 0.0, 0.0, 0.0, np.pi))
    still = swing(panda.joints, REST, 1.0)
    apart = least_distance(still, still, second.base_pose, 0.0)
    assert 0.0002 < apart < 0.003
    arms = TwoArms(Cell(panda, CellRequest()), Cell(panda, second))
    forward, back = (REST + np.array([0.0, by, 0.0, by, 0.0, 0.0, 0.0]) for by in (0.6, -0.3))
    near, touching, far = (np.concatenate([q, q]) for q in (REST, forward, back))
    rested = arms.at_rest_in(np.array([near, touching, far])).wanted
    assert rested.min() == pytest.approx(apart / 2, abs=2e-5)
    assert 0 < (rested < 0.002).sum() < 6 and rested.max() == 0.002  # of the bodies that are near there alone
    assert (arms.at_rest_in(np.array([touching, far])).wanted == 0.002).all()


@pytest.mark.nightly
def test_an_arm_makes_way_where_both_must_move_at_once(tmp_path: Path) -> None:
    def robot(name: str, base: list[float], *ends: list[float]) -> dict:
        steps = [{"name": step, "to": q} for step, q in zip(("there", "back"), ends, strict=True)]
        return {"name": name, "robot": "panda", "base": base, "step": steps}

    one = [0.685, -0.096, 0.138, -1.761, 0.03, 1.846, 0.975], [-0.434, 0.397, -0.063, -2.172, 0.043, 1.913, 0.737]
    two = [0.61, 0.033, 0.193, -1.957, -0.014, 1.884, 0.927], [-0.618, 0.3, 0.158, -2.175, 0.018, 1.998, 1.071]
    document = {
        "format": "energy-opt/job/2",
        "cycle_time": 3.422,
        "robot": [  # across the middle, past each other
            robot("a", [0.0] * 6, *one),
            robot("b", [0.739, -0.0919, 0.0, 0.0, 0.0, float(np.pi)], *two),
        ],
        "lag": [
            {"from": f"{x}.{step}", "to": f"{y}.{step}", "length": -0.1} for x, y in ("ab", "ba")
            for step in ("there", "back")
        ],
    }  # fmt: skip
    file = tmp_path / "cell.toml"
    file.write_bytes(tomli_w.dumps(document).encode())
    options = ["--model", "source-method-2", "--starts", "1", "--quiet"]
    assert main(["job", str(file), "--out", str(tmp_path / "out"), *options]) == 0
    found = json.loads((tmp_path / "out" / "job.json").read_text())
    assert found["clearance"]["verdict"] == "proven" and found["around"]
    from cell_judge import faults_of_cell

    assert faults_of_cell(document, tmp_path / "out") == []


def one_arm(**more: object) -> dict:
    """An arm that moves to and fro in 6 s, with brakes in the pose `up`."""
    steps = [
        {"name": "pick", "to": "down"},
        {"name": "grip", "wait": 0.5},
        {"name": "place", "to": [0.6, 0.1, 0.0, -1.9, 0.0, 2.2, 0.7]},
    ]
    return {
        "format": "energy-opt/job/2",
        "cycle_time": 6.0,
        "poses": {"down": [0.0, 0.5, 0.0, -1.6, 0.0, 2.1, 0.7], "up": [0.0, 0.2, 0.0, -1.6, 0.0, 1.8, 0.7]},
        "mode": [{"name": "brakes", "power": 60.0, "least": 1.0, "posture": ["up"]}],
        "robot": [{"name": "a", "robot": "panda", "step": steps}],
        **more,
    }


def written(folder: Path, document: dict) -> Path:
    file = folder / "cell.toml"
    file.write_bytes(tomli_w.dumps(document).encode())
    return file


@pytest.mark.parametrize(
    ("step", "more", "said"),
    [
        (1, {"modes": ["brakes"]}, "robot a: step grip: none of modes = ['brakes'] is possible here"),
        (1, {"power": {"motors": 9.0}}, "robot a: step grip: power: the power of its motors follows"),
        (1, {"wait": None, "duration": [1.0, 2.0], "curve": [[1, 9.0]]}, "a curve belongs to a robot without an arm"),
        (0, {"to": [0.0, 0.5]}, "robot a: step 1 (pick): 2 values; the robot has 7 joints"),
        (0, {"duration": [1.0, 2.0]}, "`duration` does not belong to a step with `to`"),
        (0, {"as_is": 0.1}, "robot a: pick: as_is = 0.1; its limits allow durations between"),
    ],
)
def test_what_an_arm_cannot_do_is_refused(
    step: int, more: dict, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = one_arm()
    steps = document["robot"][0]["step"]
    steps[step] = {key: value for key, value in (steps[step] | more).items() if value is not None}
    file = written(tmp_path, document)
    assert main(["job", str(file), "--out", str(tmp_path / "out"), "--quiet", "--model", "careful"]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_an_arm_waits_in_the_modes_of_its_step_and_of_its_home(tmp_path: Path) -> None:
    document = one_arm()
    document["robot"][0] |= {"home": [0.6, 0.1, 0.0, -1.9, 0.0, 2.2, 0.7]}
    document["robot"][0]["step"][2]["to"] = "home"
    document["robot"][0]["step"][1] |= {"wait": [0.5, 2.0], "power": {"gripping": 20.0}}
    document["mode"][0]["posture"] = ["home", "grip"]
    options = ["--model", "careful", "--starts", "1", "--quiet", "--out", str(tmp_path / "out")]
    assert main(["job", str(written(tmp_path, document)), *options]) == 0
    steps = {s["name"]: s for s in json.loads((tmp_path / "out" / "job.json").read_text())["robots"][0]["steps"]}
    assert steps["grip"]["mode"] == "gripping" and steps["grip"]["duration"] == pytest.approx(2.0)
    assert steps["grip"]["energy_total"] == pytest.approx(40.0)
    assert steps["wait after place"]["mode"] == "brakes"
    assert steps["wait after pick"]["duration"] < 1e-6  # its motors take more than the brakes at home


@pytest.mark.slow
def test_two_arms_over_one_table_take_turns(tmp_path: Path) -> None:
    near = [0.0, 0.5, 0.0, -1.6, 0.0, 2.1, 0.7]
    far = [1.5, 0.0, 0.0, -1.9, 0.0, 2.2, 0.7]
    steps = [
        {"name": "pick", "to": near, "payload": 0.0},
        {"name": "grip", "wait": 0.5},
        {"name": "place", "to": far, "payload": 2.0},
    ]
    document = {
        "format": "energy-opt/job/2",
        "cycle_time": 9.0,
        "supply": {"shared": True, "capacity": 20.0, "max_power": 600.0},
        "robot": [
            {"name": "a", "robot": "panda", "base": [0.0] * 6, "step": steps},
            {"name": "b", "robot": "panda", "base": [0.9, 0.0, 0.0, 0.0, 0.0, float(np.pi)], "step": steps},
        ],
    }
    file = tmp_path / "cell.toml"
    file.write_bytes(tomli_w.dumps(document).encode())
    options = ["--model", "source-method-2", "--floor", "-0.01", "--starts", "2", "--quiet"]
    options += ["--write", "follow-joint-trajectory", "--write", "franka"]
    code = main(["job", str(file), "--out", str(tmp_path / "out"), *options])
    found = json.loads((tmp_path / "out" / "job.json").read_text())
    assert code == 0, found["warnings"]
    assert found["robots"][0]["steps"][0]["start"] == 0  # the cycle begins there, whatever was shifted for the supply
    assert found["clearance"]["verdict"] == "proven"
    assert [lever["name"] for lever in found["levers"]] == ["as_is", "speeds", "modes", "paths", "supply"]
    energies = [lever["energy_total"] for lever in found["levers"]]
    assert energies == sorted(energies, reverse=True)
    # one supply may take less than the robots' own: the bound is of one that loses nothing
    assert 0.5 * found["energy_total"] < found["bound"] <= found["energy_total"] - found["supply"]["lost"] + 1.0
    assert found["optimality"]["lower_bound"] == found["bound"]
    assert found["energy_total"] <= found["supply"]["energy_own"] * (1 + 1e-14)  # sums in another order
    from cell_circuit import PANDA, cycle_of

    measured = cycle_of(document, tmp_path / "out", dict.fromkeys("ab", PANDA))  # at a meter, by a circuit of its own
    assert measured.energy == pytest.approx(found["energy_total"], rel=0.01)
    assert measured.peak <= 600.0
    assert measured.lost == pytest.approx(found["supply"]["lost"], rel=0.05, abs=1.0)
    for robot in found["robots"]:
        assert sum(step["duration"] for step in robot["steps"]) == pytest.approx(9.0)
        files = {row["file"]: row for row in found["written"] if row["robot"] == robot["name"]}
        assert list(files) == [f"cycle_{robot['name']}{end}" for end in (".csv", ".goal.yaml", ".franka.csv")]
        assert all(row["valid"] and row["starts_at"] == robot["steps"][0]["start"] for row in files.values())
        with (tmp_path / "out" / f"cycle_{robot['name']}.csv").open() as lines:
            rows = list(csv.DictReader(lines))
        for row in rows:
            values = {
                kind: [float(x) for key, x in row.items() if key.endswith(kind)] for kind in (".velocity", "ation")
            }
            if not any(values[".velocity"]):
                assert np.abs(values["ation"]).max() < 1e-6  # no jump of the acceleration at a join


def test_the_base_of_another_arm_is_an_obstacle(panda: Robot, tmp_path: Path, capsys) -> None:
    """Moves through it were led around by chance only, after the schedule; else the job was infeasible."""
    there, reach = [0.3, *REST[1:]], [0.0, 0.9, 0.0, -1.7, 0.0, 2.6, 0.7]
    robots = [
        {"name": "a", "robot": "panda", "step": [{"name": "in", "to": reach}, {"name": "out", "to": REST.tolist()}]},
        {"name": "b", "robot": "panda", "base": [0.62, 0, 0, 0, 0, 0], "step": [{"to": there}, {"to": REST.tolist()}]},
    ]
    path = tmp_path / "cell.toml"
    path.write_bytes(tomli_w.dumps({"format": "energy-opt/job/2", "cycle_time": 9.0, "robot": robots}).encode())
    assert main(["job", str(path), "--quiet", "--model", "source-method-2", "--out", str(tmp_path / "out")]) == 3
    assert "a: in, at its end: panda_link7 touches b: panda_link0" in capsys.readouterr().err
    # the pose of b's base as a sees it, and none of its links that move
    alone, beside = (Cell(panda, CellRequest(base=(0, 1, 0, 0, 0, 1.0), beside=b)) for b in ((), (("b", panda, BASE),)))
    (body,) = beside.bodies.all[beside.links :]
    assert len(beside.bodies.all) == len(alone.bodies.all) + 1 and body.name == "b: panda_link0"
    at = pin.SE3(pin.rpy.rpyToMatrix(0, 0, 1.0), np.array([0.0, 1, 0])).inverse() * pin.SE3(
        pin.rpy.rpyToMatrix(0.1, 0, 2.0), np.array([0.5, 0, 0.2])
    )
    assert body.pose == pytest.approx(at.homogeneous)


@pytest.mark.slow
def test_steps_that_do_not_stop_are_listed_and_keep_their_zone(tmp_path: Path) -> None:
    """The zone of the step after one that is passed was ignored, and only the first of both was listed."""
    near, far, rest = ([x, 1.2 + y, -1.2, 0.0, 0.0, 0.0] for x, y in ((0.3, 0.0), (0.6, 0.1), (-0.3, -0.1)))
    steps = [{"name": "go", "to": rest}, {"name": "pass", "to": near, "stop": False}, {"name": "on", "to": far}]
    arm = {
        "name": "arm",
        "robot": "z1",
        "model": "source-method-2",
        "step": [*steps[:2], {**steps[2], "zone": "table"}],
    }
    weld = {"name": "weld", "duration": [6.0, 6.0], "curve": [[0, 100.0]], "zone": "table", "after": "arm.go"}
    other = {"name": "other", "step": [{**weld, "lag": [0.0, 0.5]}, {"name": "wait", "wait": [0.0, 9.0]}]}
    cell = {"format": "energy-opt/job/2", "cycle_time": 9.0, "jitter": 0.05, "mode": [{"name": "on", "power": 50.0}]}
    (tmp_path / "cell.toml").write_bytes(tomli_w.dumps({**cell, "robot": [arm, other]}).encode())
    assert main(["job", str(tmp_path / "cell.toml"), "--quiet", "--out", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "job.json").read_text())
    arms, welds = ({step["name"]: step for step in robot["steps"]} for robot in found["robots"])
    passed, on = arms["pass"], arms["on"]
    assert (passed["zone"], on["zone"]) == ("table", "table")
    assert on["start"] == pytest.approx(passed["start"] + passed["duration"], abs=1e-9)
    begin, end = passed["start"], on["start"] + on["duration"]
    gap = (welds["weld"]["start"] - end) % 9.0
    assert gap >= 0.1 - 1e-6 and gap + 6.0 + (end - begin) <= 9.0 - 0.1 + 1e-6
