"""What is written is what was judged: files read back, judged again, and said to hold or not."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from poses import GOAL, START
from urscript_arm import Controller

import energy_opt as eo
from energy_opt.cli.main import main
from energy_opt.errors import BadInput
from energy_opt.formats import read_trajectory, write
from energy_opt.formats.controller_files import wanted
from energy_opt.formats.controller_program import Part, standing
from energy_opt.formats.controller_program import joined as joined_parts
from energy_opt.formats.cycle_file import certificates, without_jumps, write_cycle
from energy_opt.formats.judging import CycleJudging
from energy_opt.front.evaluate import table
from energy_opt.jobs import job_files
from energy_opt.jobs.file import load_job
from energy_opt.jobs.job_files import write_programs
from energy_opt.jobs.solve_job import run_job
from energy_opt.motion import Settings
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.trajectory import Trajectory, whole
from energy_opt.power import PowerModel
from energy_opt.robot import Robot


def test_rows_lie_on_whole_nanoseconds_of_the_same_curve() -> None:
    """What moves rows by half a nanosecond leaves position, velocity and acceleration on the curve."""
    time = np.sort(np.random.default_rng(1).uniform(0, 2, 60))
    x = (time - time[0])[:, None]
    curve = Trajectory(("a", "b"), time, np.hstack([x**3, x**4]), np.hstack([3 * x**2, 4 * x**3]),
                       np.hstack([6 * x, 12 * x**2]))  # fmt: skip
    out = curve.on_nanoseconds()
    np.testing.assert_array_equal(out.time, whole(out.time))
    assert out.on_nanoseconds() is out and out.time != pytest.approx(time, abs=1e-13)
    moved = (out.time - time[0])[1:-1]
    np.testing.assert_allclose(out.position[1:-1, 0], moved**3, atol=1e-13)
    np.testing.assert_allclose(out.acceleration[1:-1, 1], 12 * moved**2, atol=1e-9)


CYCLE = """
format = "energy-opt/job/1"
robot = "ur5"
cycle_time = 5.0
home = [0.0, -1.5, 1.2, -1.0, 0.3, 0.0]
payload = 0.5
[[step]]
name = "over"
to = [0.4, -1.3, 0.9, -1.2, 0.1, 0.1]
stop = false
[[step]]
name = "to the part"
to = [0.8, -1.0, 0.7, -1.4, -0.2, 0.3]
[[step]]
name = "grip"
wait = 0.3015
payload = [2.0, 0.0, 0.0, 0.05]
[[step]]
name = "settle"
wait = 0.0113
[[step]]
name = "back"
to = "home"
mode = "MODE"
[[step]]
name = "rest"
wait = 0.5
brakes = true
"""


@pytest.fixture(scope="module", params=["reshape", "retime"])
def cycle(request, ur5: Robot, model: PowerModel, tmp_path_factory: pytest.TempPathFactory):
    """A cycle with via, payloads, waits and brakes; its last motion with or without accelerations at its ends."""
    file = tmp_path_factory.mktemp("job") / "job.toml"
    file.write_text(CYCLE.replace("MODE", request.param))
    return run_job(load_job(file, lambda _: ur5), model, Settings(starts=1, controls=16, compile="never"))


def test_a_cycle_as_one_program(cycle, ur5: Robot, tmp_path: Path) -> None:
    """Run by an interpreter: the cycle's time to 1 ms, the planned positions, limits, payloads when they change."""
    (row,) = write_programs(cycle, wanted(["urscript"]), tmp_path)
    assert row.valid and row.file == "trajectory.script"
    text = (tmp_path / "trajectory.script").read_text()
    assert "# 3. settle" in text and "# waits in mode brakes" in text
    arm = Controller(np.array([0.0, -1.5, 1.2, -1.0, 0.3, 0.0]))
    arm.run(text)
    assert arm.time == pytest.approx(5.0, abs=1e-3)
    masses = [(round(t, 2), m) for t, m, _ in arm.payloads]
    change = sum(p.trajectory.duration for p in cycle.pieces[:1])
    assert masses == [(0.0, 0.5), (pytest.approx(change, abs=0.01), 2.0)]
    assert arm.payloads[1][2] == pytest.approx([0, -0.05, -0.0823], abs=1e-4)  # from the last joint's frame to tool0
    plan = joined_parts([piece.trajectory for piece in cycle.pieces])
    time, q = np.array([t for t, _ in arm.targets]), np.array([q for _, q in arm.targets])
    assert np.abs(plan.sample(np.minimum(time, plan.time[-1]))[0] - q).max() < 3e-4  # at a part's end a step late
    close = np.diff(time) < 0.0021
    speed = np.diff(q, axis=0)[close] / 0.002
    assert (np.abs(speed) <= ur5.limits.velocity * (1 + 1e-6)).all()
    slow = Controller(np.array([0.0, -1.5, 1.2, -1.0, 0.3, 0.0]))
    slow.run(text, speed="0.25")
    assert slow.time == pytest.approx(20.0, abs=4e-3)


def test_a_cycle_in_messages_keeps_its_waits_and_says_its_payloads(cycle, ur5: Robot, tmp_path: Path) -> None:
    names = ["follow-joint-trajectory", "mcap", "csv"]
    rows = write_programs(cycle, wanted(names), tmp_path, 200.0)
    plan = joined_parts([piece.trajectory for piece in cycle.pieces])
    for row in rows:
        assert row.valid and "set them yourself: 0.5 kg from 0 s on, 2 kg from " in row.text
        again = read_trajectory(tmp_path / row.file, ur5.joints)
        assert again.duration == pytest.approx(5.0, abs=1e-6)
        even = row.rate is None or np.diff(again.time).max() < 1.01 / row.rate
        assert even != ("each motion is sampled from its own start" in row.text)
        time = np.linspace(0, 4.99, 300)
        late = 2e-4 if cycle.job.steps[4].mode == "reshape" else 0.03  # accelerations that jump are spread over 20 ms
        np.testing.assert_allclose(again.sample(time)[0], plan.sample(time)[0], atol=late)


def test_accelerations_that_jump_between_motions_are_spread_over_milliseconds(panda: Robot, model: PowerModel) -> None:
    """Retimed motions of an arm with a jerk limit, of which a cycle is made: its time is kept, its jerk holds."""
    x = np.linspace(0, 1, 301)[:, None]

    def cubic(a: np.ndarray, b: np.ndarray) -> Trajectory:
        d, time = b - a, 1.8
        rows = a + d * x**2 * (3 - 2 * x), d * 6 * x * (1 - x) / time, d * 6 * (1 - 2 * x) / time**2
        return Trajectory(panda.joints, whole(x[:, 0] * time), *rows)

    middle = START + 0.6 * (GOAL - START)
    moves = [cubic(START, middle), cubic(middle, GOAL)]
    judge = CycleJudging.of([(4.0, Scorer(panda, model), None)])
    wait = standing(panda.joints, GOAL, 0.4)
    for trajectories in ([*moves, wait], moves):
        assert not judge(joined_parts(trajectories)).valid
        parts = [Part(t, waits=t is wait) for t in trajectories]
        # a program of a UR runs each motion by itself; a jump within a nanosecond was a jerk of 1e13 rad/s^3 there
        (alone,) = certificates(parts, judge, wanted(["urscript"]), 500.0)
        assert alone.within_limits
        (part,) = without_jumps(parts, panda.limits)
        assert judge(part.trajectory).within_limits
        assert part.trajectory.duration == pytest.approx(sum(t.duration for t in trajectories), abs=2e-9)
        time = np.linspace(0, part.trajectory.duration, 500)
        moved = part.trajectory.sample(time)[0] - joined_parts(trajectories).sample(time)[0]
        assert np.abs(moved).max() < 0.01
    still = [Part(wait, waits=True), Part(wait, waits=True)]
    assert without_jumps(still, panda.limits) is still
    back = cubic(middle, START)  # begins with the acceleration that the way there ends with, but for rounding
    back = replace(back, acceleration=back.acceleration * (1 + 3e-8))
    assert not judge(joined_parts([moves[0], back])).within_limits
    turned = joined_parts([p.trajectory for p in without_jumps([Part(moves[0]), Part(back)], panda.limits)])
    assert judge(turned).within_limits and turned.duration == pytest.approx(3.6, abs=1e-9)


def test_a_file_says_by_how_much_its_waits_are_shorter(panda: Robot, model: PowerModel, tmp_path: Path) -> None:
    """At 25 Hz a grip of 0.4 s was 0.28 s at rest, without a word."""
    x = np.linspace(0, 1, 301)[:, None]
    way, time = 0.2 * (GOAL - START), 1.8
    rows = START + way * x**2 * (3 - 2 * x), way * 6 * x * (1 - x) / time, way * 6 * (1 - 2 * x) / time**2
    there = Trajectory(panda.joints, whole(x[:, 0] * time), *rows)
    back = replace(there, position=rows[0][::-1], velocity=-rows[1], acceleration=rows[2][::-1])
    parts = [Part(there), Part(standing(panda.joints, START + way, 0.4), waits=True), Part(back)]
    judge = CycleJudging.of([(4.0, Scorer(panda, model), None)])
    (row,) = write_cycle(parts, judge, wanted(["csv"]), tmp_path, 25.0)
    assert row.valid and row.rate == 25.0
    again = read_trajectory(tmp_path / row.file, panda.joints)
    still = again.time[np.abs(again.position - (START + way)).max(axis=1) < 1e-9]
    stated = re.search(r"waits are up to ([0-9.]+) ms shorter", row.text)
    assert stated and 0.4 - float(stated[1]) / 1e3 <= still[-1] - still[0] + 1e-6 < 0.39
    on = replace(there, position=there.position + way)
    (row,) = write_cycle([Part(there), Part(on)], judge, wanted(["csv"]), tmp_path, 25.0)  # no wait, no word about it
    assert row.rate is not None and "shorter" not in row.text


def test_a_jump_beside_an_acceleration_that_changes_keeps_the_jerk_limit(panda: Robot, model: PowerModel) -> None:
    """The acceleration grows after a jump in the same direction: the jerk of both together was above the limit."""
    x = np.linspace(0, 1, 301)[:, None]

    def quartic(a: np.ndarray, b: np.ndarray) -> Trajectory:
        d, time = b - a, 1.8
        rows = a + d * x**3 * (4 - 3 * x), d * 12 * x**2 * (1 - x) / time, d * (24 * x - 36 * x**2) / time**2
        return Trajectory(panda.joints, whole(x[:, 0] * time), *rows)

    middle = (START + GOAL) / 2
    moves = [quartic(START, middle), quartic(middle, GOAL)]
    largest = np.abs(moves[0].sample(np.linspace(0, 1.8, 301))[3]).max(axis=0)
    slow = replace(panda, limits=replace(panda.limits, jerk=1.1 * largest + 1e-3))
    wait = standing(panda.joints, GOAL, 3.0)
    parts = [*map(Part, moves), Part(wait, waits=True)]
    (part,) = without_jumps(parts, slow.limits)
    judge = CycleJudging.of([(6.6, Scorer(slow, model), None)])
    assert judge(part.trajectory).within_limits and part.trajectory.duration == pytest.approx(6.6, abs=2e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_jump_beside_few_samples_keeps_the_jerk_limit(seed: int, panda: Robot) -> None:
    """Between samples the acceleration changes faster than from one to the next; the jerk was up to 86 % above."""
    rng, n = np.random.default_rng(seed), 4
    time = whole(np.sort(np.concatenate([[0, 1.8], rng.uniform(0.1, 1.7, 2)])))
    q, v, a = (rng.normal(size=(n, panda.n)) * scale for scale in (0.1, 0.3, 2.0))
    v[[0, -1]] = 0
    moves = [Trajectory(panda.joints, time, q, v, a), Trajectory(panda.joints, time, q[::-1], -v[::-1], -0.8 * a[::-1])]
    largest = np.max([np.abs(move.sample(np.linspace(0, 1.8, 2001))[3]).max(axis=0) for move in moves], axis=0)
    limits = replace(panda.limits, jerk=1.02 * largest)
    (part,) = without_jumps([*map(Part, moves), Part(standing(panda.joints, q[0], 3.0), waits=True)], limits)
    jerk = part.trajectory.sample(part.trajectory.denser(20))[3]
    assert (np.abs(jerk).max(axis=0) <= limits.jerk * (1 + 1e-6)).all()


def test_a_standstill_on_the_way_is_no_path_of_one_move(cycle, tmp_path: Path, capsys) -> None:
    write(joined_parts([piece.trajectory for piece in cycle.pieces]), tmp_path / "cycle.csv")
    words = ["optimize", "--robot", "ur5", "--path", str(tmp_path / "cycle.csv"), "--out", str(tmp_path / "out")]
    assert main(words) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and "stands still from " in said[0] and "energy-opt job" in said[0]
    assert not (tmp_path / "out" / "result.json").exists()


def test_evaluate_gives_a_jobs_energy_and_writes_it_with_its_waits(
    cycle, ur5: Robot, model: PowerModel, tmp_path: Path
) -> None:
    """Payloads and brakes come from job.json; baselines keep the waits."""
    job_files.write(cycle, {"robot": "ur5"}, tmp_path / "job")
    eo.evaluate(tmp_path / "job", None, model).save(tmp_path / "out", ["urscript", "yaml"])
    found = json.loads((tmp_path / "out" / "evaluate.json").read_text())
    (motion,) = found["motions"]
    energy = motion["models"][0]["energy"]
    spread = 1e-6 if cycle.job.steps[4].mode == "reshape" else 5e-4  # accelerations that jump are spread over 3 ms
    assert energy["total"] == pytest.approx(cycle.energy, rel=spread)
    assert energy["total"] == pytest.approx(energy["standby"] + energy["stored"] + energy["loss"])
    assert [w["duration"] > 0.29 for w in motion["waits"]] == [True, True]
    assert all(row["valid"] for row in found["written"])
    named = {row["name"]: row["energy_total"]["model 1"] for row in motion["baselines"]}
    assert named["scaled"] >= energy["total"] * (1 - 1e-6) and set(named) == {"toppra", "scaled"}
    arm = Controller(np.array([0.0, -1.5, 1.2, -1.0, 0.3, 0.0]))
    arm.run((tmp_path / "out" / "trajectory.script").read_text())
    assert arm.time == pytest.approx(5.0, abs=1e-3) and len(arm.payloads) == 2
    assert read_trajectory(tmp_path / "out" / "trajectory.yaml", ur5.joints).duration == pytest.approx(5.0, abs=1e-8)


def test_evaluate_on_the_command_line(panda: Robot, tmp_path: Path, capsys) -> None:
    time = np.linspace(0, 2, 201)
    x = (time / 2)[:, None]
    rows = (START + (GOAL - START) * x**3 * (10 - 15 * x + 6 * x**2), (GOAL - START) * 15 * x**2 * (1 - x) ** 2,
            (GOAL - START) * 15 * x * (1 - x) * (1 - 2 * x))  # fmt: skip
    write(Trajectory(panda.joints, time, *rows), tmp_path / "a.csv")
    words = ["evaluate", str(tmp_path / "a.csv"), "--out", str(tmp_path / "out"), "--payload", "1", "--quiet", "--json"]
    assert main([*words, "--write", "franka"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["robot"] == "panda" and len(found["motions"][0]["models"]) == 2 and found["motions"][0]["valid"]
    assert found["written"][0]["file"] == "trajectory.franka.csv" and found["written"][0]["valid"]
    assert main(["evaluate", str(tmp_path / "b.csv"), "--out", str(tmp_path / "out"), "--quiet"]) == 2


def test_a_motion_that_comes_to_rest_on_a_position_limit_has_baselines(panda: Robot) -> None:
    """The spline through its positions passes the limit by 3e-8 rad where joint 6 stops while joint 1 goes on."""
    time = np.linspace(0, 4, 401)
    q, v, a = np.tile(START, (401, 1)), np.zeros((401, 7)), np.zeros((401, 7))
    for joint, first, length, end, by in ((5, 0.0, 2.0, panda.limits.upper[5], 0.4), (0, 0.0, 4.0, 1.0, 1.0)):
        x = np.clip((time - first) / length, 0, 1)
        q[:, joint] = end - by * (1 - x**3 * (10 - 15 * x + 6 * x**2))
        v[:, joint] = by * 30 * x**2 * (1 - x) ** 2 / length
        a[:, joint] = by * 60 * x * (1 - 3 * x + 2 * x**2) / length**2
    found = eo.evaluate(Trajectory(panda.joints, time, q, v, a), "panda", "source-method-2", self_collision=False)
    (motion,) = found.document()["motions"]
    assert motion["certificate"]["max_violation"]["position"] <= 0
    assert [row["name"] for row in motion["baselines"]] == ["toppra", "scaled"]
    assert all(row["valid"] for row in motion["baselines"])


def test_evaluate_from_python_under_several_models_side_by_side(panda: Robot) -> None:
    """Energies by hand: Pinocchio's torque and the model's law on a fine grid; a recording with noise is smoothed."""
    import pinocchio as pin

    time = np.linspace(0, 2, 401)
    x = (time / 2)[:, None]
    q = START + (GOAL - START) * x**3 * (10 - 15 * x + 6 * x**2)
    v = (GOAL - START) * 30 * x**2 * (1 - x) ** 2 / 2
    a = (GOAL - START) * 60 * x * (1 - x) * (1 - 2 * x) / 4
    t = Trajectory(panda.joints, time, q, v, a)
    found = eo.evaluate([t, t.slowed(4.0)], "panda", ["source-method-2", "careful"])
    text = str(found)
    assert "under source-method-2" in text and "under careful" in text and text.count("all limits kept") == 2
    lines = [line.split() for line in text.splitlines()]
    begin = lines.index(["the", "total", "by", "effect"])
    parts = [float(line[1]) for line in lines[begin + 1 : [line[0] for line in lines].index("toppra")]]
    assert len(parts) >= 3 and abs(sum(parts) - float(lines[begin - 4][1])) < 1e-3 * (len(parts) + 1)
    model = pin.buildModelFromUrdf(str(panda.urdf))
    names = list(model.names)[1:]
    lock = [model.getJointId(n) for n in names if n not in panda.joints]
    q0 = pin.neutral(model)
    for n, value in panda.locked.items():
        q0[model.joints[model.getJointId(n)].idx_q] = value
    arm = pin.buildReducedModel(model, lock, q0)
    data = arm.createData()
    loss = [0.0036 * np.sum(pin.rnea(arm, data, *row) ** 2) for row in zip(q, v, a, strict=True)]
    energy = found.found[0].energies["source-method-2"]
    assert energy.by_effect["copper_loss"] == pytest.approx(np.trapezoid(loss, time), rel=1e-4)
    assert energy.standby == pytest.approx(2 * 88.04)
    assert found.found[1].energies["source-method-2"].standby == pytest.approx(4 * 88.04)
    two = [
        replace(e, motion=replace(e.motion, name=f"{folder}/trajectory.csv"))
        for folder, e in zip(("declared", "diagnosed"), found.found, strict=True)
    ]
    assert table(two).splitlines()[0].split() == ["declared/trajectory.csv", "diagnosed/trajectory.csv"]


def test_standard_moves_have_their_motion_in_a_file_beside_them(tmp_path: Path) -> None:
    """Their timing is the controller's own."""
    joints = ", ".join(f"j{k}" for k in range(6))
    (tmp_path / "moves.script").write_text(f"# {joints}\n  local start = [0,0,0,0,0,0]\n  movej([1,0,0,0,0,0])\n")
    (tmp_path / "moves.yaml").write_text("format: energy-opt/moves/1\nmoves:\n- to: [1.0]\n")
    for name in ("moves.script", "moves.yaml"):
        with pytest.raises(BadInput, match=r"standard moves.*trajectory\.csv beside"):
            eo.evaluate(tmp_path / name, "ur5e")


def test_a_recording_with_noise_is_smoothed(panda: Robot, tmp_path: Path) -> None:
    time = np.linspace(0, 3, 301)
    q = START + (GOAL - START) * (0.5 - 0.5 * np.cos(np.pi * time / 3))[:, None]
    noisy = q + np.random.default_rng(0).normal(0, 2e-4, q.shape)
    header = ",".join(["time", *(f"{joint}.position" for joint in panda.joints)])
    np.savetxt(tmp_path / "run.csv", np.column_stack([time, noisy]), delimiter=",", header=header, comments="")
    found = eo.evaluate(tmp_path / "run.csv", panda, "source-method-2").found[0]
    exact = Trajectory(
        panda.joints, time, q, *(np.gradient(x, time, axis=0) for x in (q, np.gradient(q, time, axis=0)))
    )
    clean = eo.evaluate(exact, panda, "source-method-2").found[0].energies["source-method-2"]
    assert "noisy recording" in found.motion.notes[0]
    assert found.energies["source-method-2"].loss == pytest.approx(clean.loss, rel=0.02)


def test_the_message_of_write_is_the_one_in_the_folder(panda: Robot, tmp_path: Path) -> None:
    """`--write yaml --rate 50` was replaced by the judged samples, with joint names without the prefix."""
    start, goal = (",".join(map(str, q)) for q in (START, START + 0.2))
    words = ["optimize", "--robot", "panda", f"--start={start}", f"--goal={goal}", "--mode", "retime", "--quiet"]
    words += ["--model", "source-method-2", "--compile", "never", "--out", str(tmp_path / "out")]
    assert main([*words, "--write", "yaml", "--rate", "50", "--joint-prefix", "left_"]) == 0
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [(row["file"], row["rate"]) for row in found["written"]] == [
        ("trajectory.csv", None),
        ("trajectory.yaml", 50),
    ]
    again = read_trajectory(tmp_path / "out" / "trajectory.yaml", panda.joints, "left_")
    np.testing.assert_allclose(np.diff(again.time)[:-1], 0.02, rtol=1e-6)
    assert main([*words, "--write", "csv", "--joint-prefix", "left_", "--force"]) == 0
    for file, prefix in (("trajectory.csv", ""), ("trajectory_prefixed.csv", "left_")):
        assert len(read_trajectory(tmp_path / "out" / file, panda.joints, prefix).time) > 100
