"""Motions to be evaluated come with the payload that a result states, and say what they are not."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from energy_opt import formats
from energy_opt.cli.main import main
from energy_opt.effects import IdleHold, MotionPower
from energy_opt.errors import BadInput
from energy_opt.evaluations.source import load
from energy_opt.files import write_json
from energy_opt.formats.waypoints import Samples
from energy_opt.front.evaluate import evaluate
from energy_opt.motion.path import straight, through
from energy_opt.motion.timing.toppra import fastest
from energy_opt.motion.trajectory import Trajectory, joined
from energy_opt.power import PowerModel, source_method_2
from energy_opt.robot import Robot, load_robot

Z1 = load_robot("z1")
START, GOAL = np.array([0, 1, -1, 0, 0, 0.0]), np.array([0.5, 1.2, -1.2, 0, 0, 0.0])


def motion(robot: Robot) -> Trajectory:
    """The fastest straight move from START to GOAL."""
    return fastest(robot, source_method_2(robot), straight(START, GOAL)).trajectory(robot.joints)


def test_a_result_states_its_payload(tmp_path: Path) -> None:
    formats.write(motion(Z1), tmp_path / "trajectory.csv")
    payload = {"mass": [1.5], "com": [0.0, 0.0, 0.1]}
    write_json(tmp_path / "result.json", {"request": {"payload": payload}})
    for given in (tmp_path, tmp_path / "result.json", tmp_path / "trajectory.csv"):
        (stretch,) = load(given, Z1.joints).stretches
        assert stretch.load == (1.5, 0.0, 0.0, 0.1)
    for document in ({"request": {}}, {"request": None}, {}):
        write_json(tmp_path / "result.json", document)
        (stretch,) = load(tmp_path, Z1.joints).stretches
        assert stretch.load is None


def test_other_files_of_a_result_and_steps_of_a_job_have_its_payload(tmp_path: Path) -> None:
    """They had been judged without one: the energies of two files with the same motion differed."""
    for name in ("trajectory.yaml", "trajectory.csv"):
        formats.write(motion(Z1), tmp_path / name)
    write_json(tmp_path / "result.json", {"request": {"payload": {"mass": [1.5], "com": [0.0, 0.0, 0.1]}}})
    (stretch,) = load(tmp_path / "trajectory.yaml", Z1.joints).stretches
    assert stretch.load == (1.5, 0.0, 0.0, 0.1)
    job = tmp_path / "job"
    job.mkdir()
    steps = [
        {"start": 0.0, "payload": 0.0, "centre": None, "brakes": False},
        {"start": 1.0, "payload": 2.0, "centre": [0.0, 0.1, 0.0], "brakes": True},
    ]
    write_json(job / "job.json", {"steps": steps, "request": {}})
    for name, state in (("step_01.csv", (0.0, 0.0, 0.0, 0.0, False)), ("step_02.csv", (2.0, 0.0, 0.1, 0.0, True))):
        formats.write(motion(Z1), job / name)
        (stretch,) = load(job / name, Z1.joints).stretches
        assert (*(stretch.load or ()), stretch.brakes) == state
        assert (stretch.start, stretch.end) == (0.0, motion(Z1).duration)


def test_steps_of_a_job_without_a_wait_between_them_have_baselines(tmp_path: Path) -> None:
    """Where accelerations are spread over milliseconds, the arm does not quite stop there: no timing was found."""
    side = np.array([0.4, 1.1, -1.3, 0.3, 0.0, -0.2])
    ends = [(START, GOAL), (GOAL, side), (side, START)]
    moves = [fastest(Z1, source_method_2(Z1), straight(*pair)).slowed(1.5).trajectory(Z1.joints) for pair in ends]
    formats.write(joined(moves).averaged(0.01), tmp_path / "cycle.csv")
    steps = [{"start": 1.5 * k, "payload": 0.5 * k, "centre": None, "brakes": False} for k in range(3)]
    write_json(tmp_path / "job.json", {"steps": steps, "request": {}})
    (found,) = evaluate(tmp_path, Z1, "source-method-2").found
    assert not found.remark and [row.name for row in found.baselines] == ["toppra", "scaled"]
    quick, scaled = found.baselines
    assert quick.valid and scaled.valid and quick.duration < 0.8 * scaled.duration


def test_the_table_marks_baselines_that_break_a_limit() -> None:
    """A motion that is faster than its limits: the even timing of its path in the same time is as fast."""
    time = np.linspace(0.0, 0.3, 101)
    u, way = (time / 0.3)[:, None], GOAL - START
    position = START + (10 * u**3 - 15 * u**4 + 6 * u**5) * way
    velocity, acceleration = (30 * u**2 * (1 - u) ** 2 / 0.3) * way, ((60 * u - 180 * u**2 + 120 * u**3) / 0.09) * way
    found = evaluate(Trajectory(Z1.joints, time, position, velocity, acceleration), Z1, "source-method-2")
    valid = {row.name: row.valid for row in found.found[0].baselines}
    lines = str(found).splitlines()
    marked = {name: next(x for x in lines if x.split()[0] == name).endswith("*") for name in valid}
    assert valid == {"toppra": True, "scaled": False} and marked == {"toppra": False, "scaled": True}
    assert "* breaks a limit or is not clear of bodies: no energy to compare with" in lines


def test_a_job_of_several_robots_names_its_motions(tmp_path: Path) -> None:
    """Its folder was refused for a missing cycle.csv, and a robot's motion was judged without its payload unsaid."""
    formats.write(motion(Z1), tmp_path / "cycle_a.csv")
    write_json(tmp_path / "job.json", {"robots": [{"name": "a", "steps": []}], "request": {}})
    for given in (tmp_path, tmp_path / "job.json"):
        with pytest.raises(BadInput, match=r"a job of several robots; .*such as .*cycle_a\.csv$"):
            load(given, Z1.joints)
    (note,) = load(tmp_path / "cycle_a.csv", Z1.joints).notes
    assert "whose payloads and modes of waits are not taken; contact between" in note


def test_a_users_own_file_in_a_results_folder_has_no_payload(tmp_path: Path) -> None:
    """A user's `trajectory_mine.csv`, or an edited trajectory.csv, had been judged with the payload of the result."""
    for name in ("trajectory.csv", "trajectory_mine.csv", "trajectory.yaml"):
        formats.write(motion(Z1), tmp_path / name)
    files = [
        {"name": name, "sha256": hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()}
        for name in ("trajectory.csv", "trajectory.yaml")
    ]
    payload = {"mass": [1.5], "com": [0.0, 0.0, 0.1]}
    write_json(tmp_path / "result.json", {"request": {"payload": payload}, "files": files})
    formats.write(motion(Z1).slowed(9.0), tmp_path / "trajectory.yaml")
    for name, expected in (
        ("trajectory.csv", (1.5, 0.0, 0.0, 0.1)), ("trajectory_mine.csv", None), ("trajectory.yaml", None)
    ):  # fmt: skip
        found = load(tmp_path / name, Z1.joints)
        assert found.stretches[0].load == expected
        said = f"{tmp_path / name}: not written by the result.json beside it, whose payload is not taken"
        assert (said in found.notes) == (expected is None)


def test_rates_of_each_joint_are_compared_in_files_and_from_python(tmp_path: Path) -> None:
    """A joint with small changes had been hidden by the others, and a trajectory from Python had not been compared."""
    found = motion(Z1)
    velocity = found.velocity * np.where(np.arange(6) == 1, 2.0, 1.0)
    with pytest.raises(BadInput, match="trajectory 01: velocity of joint2 is 2 times"):
        evaluate(replace(found, velocity=velocity), robot=Z1, self_collision=False)


def test_a_trajectory_from_python_has_finite_rows_of_one_shape() -> None:
    """These had ended in errors of libraries."""
    found = motion(Z1)
    with pytest.raises(BadInput, match=r"trajectory 01: row 2, column joint1.velocity: 'nan' is not finite"):
        evaluate(replace(found, velocity=np.nan * found.velocity), robot=Z1)
    with pytest.raises(BadInput, match=r"trajectory: velocity has shape \(\d+, 6\); expected numbers of shape"):
        evaluate(replace(found, velocity=found.velocity[1:]), robot=Z1)
    with pytest.raises(BadInput, match=r"trajectory: position has shape \(\d+, 6\); expected numbers of shape"):
        evaluate(replace(found, time=found.time[1:]), robot=Z1)


def test_recorded_rates_with_noise_lag_and_offset_are_taken(tmp_path: Path) -> None:
    t = np.arange(0.0, 4.0, 0.01)
    noise = np.random.default_rng(1).normal(size=(2, 400, 6))
    q = 0.3 * np.sin(2.0 * t)[:, None] * np.array([1.0, 0.5, 0.2, 0.0, 0.0, 0.0]) + 1e-4 * noise[0]
    v = 0.6 * np.cos(2.0 * (t - 0.04))[:, None] * np.array([1.0, 0.5, 0.2, 0.0, 0.0, 0.0]) + 0.02 * noise[1] + 2e-3
    Samples("", Z1.joints, q + 1e-3 * t[:, None], t, v).trajectory()


def test_accelerations_of_a_coarse_plan_with_steps_are_taken() -> None:
    """Ten samples of a bang-bang motion, whose acceleration is late by a sample: its sums are 0.78 of the speed."""
    t = np.linspace(0.0, 0.9, 10)
    early, late = np.minimum(t, 0.45), np.maximum(t - 0.45, 0.0)
    q = early**2 + 0.9 * late - late**2
    a = np.where(t < 0.45, 2.0, -2.0) * (t > 0) * (t < 0.9)
    a[1] = 0.0
    columns = [x[:, None] for x in (q, 2 * early - 2 * late, a)]
    Samples("", ("joint1",), columns[0], t, columns[1], columns[2], planned=True).trajectory()


def test_a_motion_that_stops_in_every_row_is_remarked(tmp_path: Path) -> None:
    found = motion(Z1)
    formats.write(replace(found, velocity=0 * found.velocity, acceleration=0 * found.velocity), tmp_path / "m.csv")
    said = "velocity is 0 in every row: the arm is assumed to stop at each"
    assert load(tmp_path / "m.csv", Z1.joints).notes == (f"{tmp_path / 'm.csv'}: {said}",)


def test_a_folder_without_a_motion_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"a folder without result\.json or job\.json"):
        load(tmp_path, Z1.joints)


def test_degrees_and_rates_of_the_other_sign_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found, file = motion(Z1), tmp_path / "motion.csv"
    words = ["evaluate", str(file), "--robot", "z1", "--self-collision", "off", "--out", str(tmp_path / "out")]
    turned = {name: np.degrees(getattr(found, name)) for name in ("position", "velocity", "acceleration")}
    cases: list[tuple[dict[str, Any], str]] = [
        (turned, "these look like degrees"),
        ({"velocity": -found.velocity}, "velocity of joint1 is -1 times the rate at which its position changes"),
        ({"velocity": 2 * found.velocity}, "velocity of joint1 is 2 times the rate at which its position changes"),
        ({"acceleration": 0.5 * found.acceleration}, "acceleration of joint1 is 0.5"),
        ({"time": 1.5 * found.time}, "velocity of joint1 is 1.5"),
    ]
    for wrong, says in cases:
        formats.write(replace(found, **wrong), file)
        assert main(words) == 2
        said = capsys.readouterr().err
        assert says in said and said.count("\n") == 1 and str(file) in said


def test_requests_by_hand_say_what_they_may_hold(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "request.json"
    cases: list[tuple[dict[str, Any], str]] = [
        ({"payload": {"mas": 1.0}}, "payload: keys mas; expected mass and com"),
        ({"verb": "run"}, "no verb 'run' to run; verbs are optimize"),
    ]
    for changed, says in cases:
        write_json(file, {"verb": "optimize", "robot": "z1", "start": START, "goal": GOAL, **changed})
        assert main(["run", str(file), "--out", str(tmp_path / "out")]) == 2
        assert says in capsys.readouterr().err


def test_payloads_of_models_stay_theirs_when_a_result_is_evaluated(tmp_path: Path) -> None:
    """That of the result's first model was taken for all."""
    import energy_opt as eo

    places: Any = {"start": START, "goal": GOAL, "mode": "retime", "duration": 2.0, "self_collision": False}
    names = [tmp_path / "heavy.toml", tmp_path / "light.toml"]
    for file, mass in zip(names, (2.0, 0.5), strict=True):
        (eo.source_model(Z1) + eo.effects.Payload(mass=mass, com=[0.0, 0.0, 0.1])).save(file)
    models = [str(file) for file in names]
    for payload in (None, 1.0):
        result = eo.optimize(Z1, models, **places, payload=payload)
        folder = result.save(tmp_path / f"out {payload}")
        found = eo.evaluate([folder / "result.json"], model=models, self_collision=False).found[0].energies
        stated = {row["name"]: row["total"] for row in result.models[:2]}
        assert {name: energy.total for name, energy in found.items()} == pytest.approx(stated, rel=1e-9)
        assert (abs(stated[models[0]] - stated[models[1]]) > 1e-6) == (payload is None)


def test_joints_that_move_outside_of_the_arm_are_remarked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A rail under the arm moved, and its motion was left out without a word; joints that follow the arm's count."""
    moved, file = motion(Z1), tmp_path / "on_a_rail.csv"
    more = {"joints": (*moved.joints, "rail", "door"), "effort": None}
    for kind in ("position", "velocity", "acceleration"):
        own = getattr(moved, kind)
        more[kind] = np.column_stack([own, own[:, 0], 0 * own[:, 0]])
    formats.write(replace(moved, **more), file)
    assert main(["evaluate", str(file), "--robot", "z1", "--out", str(tmp_path / "seen")]) == 0
    assert f"{file}: motion of rail does not count: the arm has no such joint" in capsys.readouterr().err
    main(["check", str(file), "--robot", "z1"])
    assert "motion of rail does not count" in capsys.readouterr().err
    assert not load(file, Z1.joints, following=("rail",)).notes


def test_a_result_of_another_base_is_remarked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It was evaluated upright, at other energies than it states; now its base is taken unless another one is given."""
    file = tmp_path / "out" / "trajectory.csv"
    file.parent.mkdir()
    formats.write(motion(Z1), file)
    files = [{"name": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}]
    write_json(file.parent / "result.json", {"request": {"robot": "z1", "base": [0, 0, 1, 0, 1.5, 0]}, "files": files})
    for base, remarks in (([], 0), (["--base", "0,0,1,0,1.5,0"], 0), (["--base", "0,0,1,0,0,0"], 1)):
        assert main(["evaluate", str(file), "--out", str(tmp_path / f"seen {len(base)}"), "--force", *base]) == 0
        said = capsys.readouterr().err
        assert said.count("planned with --base 0,0,1,0,1.5,0, which is not given") == remarks
        assert ("--base 0,0,1,0,1.5,0, as the result states" in said) == (not base)


def test_the_fastest_timing_of_a_curve_is_a_valid_baseline() -> None:
    """It exceeded the limits on acceleration by some millionths between the grid points of its program."""
    low, high = Z1.limits.lower, Z1.limits.upper
    path = through(low + (high - low) * np.random.default_rng(3).uniform(0.3, 0.7, (4, 6)))
    slow = fastest(Z1, source_method_2(Z1), path).slowed(4.0).trajectory(Z1.joints)
    (found,) = evaluate(slow, robot=Z1, model=source_method_2(Z1), self_collision=False).document()["motions"]
    assert [row["valid"] for row in found["baselines"]] == [True, True]


@pytest.mark.parametrize("step", [2.5, 0.5, 0.1, 0.02, 0.002])
def test_positions_from_rest_to_rest_have_baselines(step: float, tmp_path: Path) -> None:
    """A spline's velocities at the ends are not quite zero: the fastest timing had to keep these, and took hours."""
    t = np.round(np.arange(0.0, 2.5 + 1e-9, step), 9)
    x = (t / 2.5)[:, None]
    q = START + (GOAL - START) * (10 * x**3 - 15 * x**4 + 6 * x**5)
    (tmp_path / "recorded.csv").write_text(
        "\n".join(",".join(map(str, row)) for row in [["time", *Z1.joints], *np.column_stack([t, q]).tolist()])
    )
    (found,) = evaluate(tmp_path / "recorded.csv", robot=Z1, model=source_method_2(Z1)).document()["motions"]
    assert [row["valid"] for row in found["baselines"]] == [True, True]
    assert found["baselines"][0]["duration"] < 1.0


def test_recordings_that_end_in_motion_do_so() -> None:
    t = np.arange(0.0, 2.0, 0.01)
    q = 0.3 * np.sin(1.0 + t)[:, None] * np.ones(6) + 1e-4 * np.random.default_rng(0).normal(size=(len(t), 6))
    found = Samples("", Z1.joints, q, t).trajectory()
    np.testing.assert_allclose(found.velocity[[0, -1]], 0.3 * np.cos(1.0 + t[[0, -1]])[:, None] * np.ones(6), atol=0.15)


@pytest.mark.parametrize("logged", [False, True])
def test_noise_of_a_recording_is_no_motion(logged: bool, tmp_path: Path) -> None:
    """The arm moves for one second of five; noise of 1e-5 rad at 125 Hz looks like 2e-3 rad/s."""
    time = np.arange(626) / 125
    way = np.interp(time, [1.0, 1.5, 3.5, 4.0], [0.0, 1.0, 1.0, 2.0])
    u = way % 1.0 + (way == 2.0)
    share = np.floor(np.minimum(way, 1.999)) * (way < 2) + u**3 * (10 - 15 * u + 6 * u**2) + (way == 2.0)
    q = START + 2 * share[:, None] * (GOAL - START)
    rng = np.random.default_rng(3)
    columns, names = [time, q + rng.normal(0, 1e-5, q.shape)], [f"{joint}.position" for joint in Z1.joints]
    if logged:
        columns.append(np.gradient(q, time, axis=0) + rng.normal(0, 2e-3, q.shape))
        names += [f"{joint}.velocity" for joint in Z1.joints]
    header = ",".join(["time", *names])
    np.savetxt(tmp_path / "run.csv", np.column_stack(columns), delimiter=",", header=header, comments="")
    effects = MotionPower(power=10.0), IdleHold(power=20.0, duration=0.3)
    (found,) = evaluate(tmp_path / "run.csv", Z1, PowerModel("z1", effects)).found
    (energy,) = found.energies.values()
    assert energy.by_effect["motion_power"] == pytest.approx(10.0, rel=0.1)
    assert energy.by_effect["idle_hold"] == pytest.approx(12.0, rel=0.1)
    assert "is at rest" in found.motion.notes[-1]


def test_the_motions_of_a_measured_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Columns and units as log.toml states them; the runs of poses are left out, and `run` repeats the request."""
    t = motion(Z1).slowed(2.0)
    header = ",".join(["ms", *(f"q{k} [deg]" for k in range(Z1.n)), "W"])
    moving = np.column_stack([1e3 * t.time, np.degrees(t.position), np.full(len(t.time), 40.0)])
    still = np.column_stack([10.0 * np.arange(300), np.degrees(np.tile(START, (300, 1))), np.full(300, 30.0)])
    for name, rows in (("move.csv", moving), ("pose.csv", still)):
        np.savetxt(tmp_path / name, rows, delimiter=",", header=header, comments="", fmt="%.10g")
    columns = [f'"{j}.position" = {{ column = "q{k} [deg]", unit = "deg" }}' for k, j in enumerate(Z1.joints)]
    head = ['format = "energy-opt/log/1"', 'robot = "z1"', "[columns]", 'power = { column = "W", unit = "W" }']
    runs = [f'[[run]]\nfile = "{name}.csv"\nkind = "{kind}"' for name, kind in (("move", "motion"), ("pose", "static"))]
    lines = [*head, 'time = { column = "ms", unit = "ms" }', *columns, *runs]
    (tmp_path / "log.toml").write_text("\n".join(lines) + "\n")
    (found,) = evaluate(tmp_path, model="source-method-2").found
    assert found.motion.name == str(tmp_path / "move.csv")
    exact = evaluate(t, Z1, "source-method-2").found[0].energies["source-method-2"]
    assert found.energies["source-method-2"].total == pytest.approx(exact.total, rel=1e-3)
    out = tmp_path / "out"
    assert (
        main(["evaluate", str(tmp_path / "log.toml"), "--model", "source-method-2", "--out", str(out), "--quiet"]) == 0
    )
    capsys.readouterr()
    assert main(["run", str(out / "evaluate.json"), "--out", str(tmp_path / "again"), "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out)["motions"][0]["file"] == found.motion.name
    (tmp_path / "log.toml").write_text("\n".join([*lines[:-2], runs[1]]) + "\n")
    with pytest.raises(BadInput, match="no run is a motion"):
        evaluate(tmp_path)
