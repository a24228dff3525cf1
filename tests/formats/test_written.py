"""What is written is what was judged: files read back, judged again, and said to hold or not."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from poses import GOAL, START
from urscript_arm import Controller

import energy_opt as eo
from energy_opt.cell.cell import Clearance
from energy_opt.cli.main import main
from energy_opt.formats import FORMATS, read_trajectory, write
from energy_opt.formats.controller_files import Written, wanted
from energy_opt.formats.controller_program import Part
from energy_opt.formats.cycle_file import certificates, without_jumps, write_cycle
from energy_opt.formats.judging import CycleJudging, Window, apart
from energy_opt.jobs import job_files
from energy_opt.jobs.file import load_job
from energy_opt.jobs.job_files import write_programs
from energy_opt.jobs.solve_job import run_job
from energy_opt.motion import Settings
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.trajectory import Trajectory, standing, whole
from energy_opt.motion.trajectory import joined as joined_parts
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
brakes = true
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
    _, row = write_programs(cycle, wanted(["urscript"]), tmp_path)
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
    _, *rows = write_programs(cycle, wanted(names), tmp_path, 200.0)
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
        whole_cycle = joined_parts(trajectories)
        assert not judge(whole_cycle).valid and judge.of_motions(whole_cycle).valid
        moving = replace(whole_cycle, velocity=whole_cycle.velocity + 0.1)
        assert len(apart(whole_cycle)) > 1 and len(apart(moving)) == 1  # the arm must be at rest where it jumps
        parts = [Part(t, waits=t is wait) for t in trajectories]
        # a program of a UR runs each motion by itself; a jump within a nanosecond was a jerk of 1e13 rad/s^3 there
        (alone,) = certificates(parts, judge, wanted(["urscript"]), 500.0)
        assert alone.within_limits
        (part,), _ = without_jumps(parts, panda.limits)
        assert judge(part.trajectory).within_limits
        assert part.trajectory.duration == pytest.approx(sum(t.duration for t in trajectories), abs=2e-9)
        time = np.linspace(0, part.trajectory.duration, 500)
        moved = part.trajectory.sample(time)[0] - joined_parts(trajectories).sample(time)[0]
        assert np.abs(moved).max() < 0.01
    still = [Part(wait, waits=True), Part(wait, waits=True)]
    assert without_jumps(still, panda.limits)[0] is still
    back = cubic(middle, START)  # begins with the acceleration that the way there ends with, but for rounding
    back = replace(back, acceleration=back.acceleration * (1 + 3e-8))
    assert not judge(joined_parts([moves[0], back])).within_limits
    turned = joined_parts([p.trajectory for p in without_jumps([Part(moves[0]), Part(back)], panda.limits)[0]])
    assert judge(turned).within_limits and turned.duration == pytest.approx(3.6, abs=1e-9)


def test_a_file_says_by_how_much_its_waits_are_shorter(panda: Robot, model: PowerModel, tmp_path: Path) -> None:
    """At 25 Hz a grip of 0.4 s was 0.28 s at rest, without a word."""
    x = np.linspace(0, 1, 301)[:, None]
    way, time = 0.2 * (GOAL - START), 1.8
    rows = START + way * x**2 * (3 - 2 * x), way * 6 * x * (1 - x) / time, way * 6 * (1 - 2 * x) / time**2
    there = Trajectory(panda.joints, whole(x[:, 0] * time), *rows)
    back = replace(there, position=rows[0][::-1], velocity=-rows[1], acceleration=rows[2][::-1])
    parts = [Part(there), Part(standing(panda.joints, START + way, 0.4), "", True, "brakes"), Part(back)]
    judge = CycleJudging.of([(4.0, Scorer(panda, model), None)])
    row = write_cycle(parts, judge, FORMATS["csv"], tmp_path, 25.0)
    assert row.valid and row.rate == 25.0
    again = read_trajectory(tmp_path / row.file, panda.joints)
    still = again.time[np.abs(again.position - (START + way)).max(axis=1) < 1e-9]
    stated = re.search(r"waits are up to ([0-9.]+) ms shorter", row.text)
    assert stated and 0.4 - float(stated[1]) / 1e3 == pytest.approx(still[-1] - still[0], abs=1e-3)
    assert still[-1] - still[0] < 0.39
    assert f"brakes from {still[0]:.6g} to {still[-1]:.6g} s" in row.text  # not while the arm still moves in the file
    on = replace(there, position=there.position + way)
    row = write_cycle([Part(there), Part(on)], judge, FORMATS["csv"], tmp_path, 25.0)  # no wait, no word about it
    assert row.rate is not None and "shorter" not in row.text and "passes poses" not in row.text
    # it turns there without a wait: in the mean of both motions it turns before
    far, half = (Trajectory(panda.joints, there.time, end + k * (rows[0] - START), k * rows[1], k * rows[2])
                 for k, end in ((3.0, START), (-1.5, START + 3 * way)))  # fmt: skip
    row = write_cycle([Part(far), Part(half)], judge, FORMATS["csv"], tmp_path, 10.0)
    again = read_trajectory(tmp_path / row.file, panda.joints)
    off = np.abs(again.sample(np.linspace(0, again.duration, 20001))[0] - half.position[0]).max(axis=1).min()
    stated = re.search(r"passes poses of steps at distances of up to ([0-9.e-]+) rad or m", row.text)
    assert row.rate == 10.0 and off > 1e-3 and stated and float(stated[1]) == pytest.approx(off, rel=0.05)


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
    (part,), _ = without_jumps(parts, slow.limits)
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
    (part,), _ = without_jumps([*map(Part, moves), Part(standing(panda.joints, q[0], 3.0), waits=True)], limits)
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
    job = job_files.write(cycle, {"robot": "ur5"}, tmp_path / "job")
    told = [line for line in job["warnings"] if "ms; motions begin and end up to " in line]
    assert len(told) == (cycle.job.steps[4].mode == "retime")
    seen = eo.evaluate(tmp_path / "job", None, model)
    seen.save(tmp_path / "slow", ["urscript", "yaml"], 25)
    slow = json.loads((tmp_path / "slow" / "evaluate.json").read_text())
    other = [row["file"] for row in slow["written"] if row["rate"] != 25]
    assert [line.partition(": ")[0] for line in slow["warnings"]] == other  # and why: the file alone had not said it
    assert all("at 25 Hz the " in line for line in slow["warnings"])
    rates = {row["format"]: row["rate"] for row in slow["written"]}
    assert all((rate is None) == (cycle.job.steps[4].mode == "retime") for rate in rates.values())
    seen.save(tmp_path / "out", ["urscript", "yaml"])
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
    for file in ("out/trajectory.yaml", "out/trajectory.script", "slow/trajectory.script"):
        assert read_trajectory(tmp_path / file, ur5.joints).duration == 5.0


def test_files_are_made_and_judged_in_the_call(ur5: Robot, tmp_path: Path, monkeypatch) -> None:
    """`save` writes what the result has judged; in Python the result stated no file and exit code 0, also after it."""

    def rounded(trajectory: Trajectory, path: Path) -> None:
        write(replace(trajectory, position=trajectory.position.round(2)), path.parent / "whole.csv")
        (path.parent / "whole.csv").rename(path)

    monkeypatch.setitem(FORMATS, "coarse", replace(FORMATS["csv"], name="coarse", suffix=".coarse.csv", write=rounded))
    asked: dict[str, Any] = {"model": "source-method-2", "self_collision": False}
    start, goal = [0.0, -1.5, 1.2, -1.0, 0.3, 0.0], [0.8, -1.0, 0.7, -1.4, -0.2, 0.3]
    steps = [{"to": goal, "mode": "retime"}, {"to": start, "mode": "retime"}]
    job = {"format": "energy-opt/job/1", "robot": "ur5", "cycle_time": 4.0, "step": steps}
    for name, call in {
        "result": lambda names: eo.optimize(ur5, start=start, goal=goal, mode="retime", write=names, **asked),
        "job": lambda names: eo.job(job, write=names, **asked),
    }.items():
        good = call(["json"])
        assert good.exit_code == 0 and [row["valid"] for row in good["written"] if row["format"] == "json"] == [True]
        with pytest.warns(UserWarning, match=r"trajectory\.coarse\.csv: .*THIS FILE BREAKS A LIMIT"):
            found = call(["coarse"])
        assert found.exit_code == 4 and "BREAKS A LIMIT" in "".join(found["warnings"])
        saved = json.loads((found.save(tmp_path / name) / f"{name}.json").read_text())
        assert saved["written"][-1] == found["written"][-1] and saved["warnings"] == found["warnings"]
        assert saved["written"][-1]["valid"] is False and (tmp_path / name / "trajectory.coarse.csv").is_file()


@pytest.mark.parametrize(
    ("value", "says"),
    [(15.7079814, ", exceeded by 1.2e-06 of it"), (-15.7079814, ", exceeded by 1.2e-06 of it"), (15.7079632, "")],
)
def test_a_value_that_looks_like_its_bound_says_by_how_much_it_exceeds_it(value: float, says: str) -> None:
    worst = {"limit": "acceleration", "joint": "elbow", "time": 29.95, "value": value, "bound": 15.7079633}
    assert Written("a.csv", "csv", None, False, worst).broken.endswith(f"its bound is 15.708{says}")


@pytest.mark.parametrize(
    ("bounds", "least"), [([0.03, 0.01, None], 0.01), ([None, None], None), ([0.03, "undecided", 0.01], "undecided")]
)
def test_the_clearance_of_a_cycle_is_the_least_of_its_parts(bounds: list[object], least: object) -> None:
    """It was that of the first part."""

    def judged(bound: object, near: float) -> Certificate:
        verdict, bound = ("undecided", None) if bound == "undecided" else ("proven", bound)
        found = Clearance(
            verdict, pairs=1, disabled_pairs=(), source="", lower_bound=bound, min_distance=near, time=0.5
        )
        return Certificate(1, (), 0.0, found, True)

    windows = [
        Window(k, k + 1.0, lambda part, bound=bound, near=0.09 + 0.01 * k: judged(bound, near))
        for k, bound in enumerate(bounds)
    ]
    t, q = np.linspace(0.0, len(bounds), 50), np.zeros((50, 1))
    found = CycleJudging(None, (), windows=tuple(windows))(Trajectory(("a",), t, q, q, q)).clearance
    assert (found.lower_bound if found.proven else found.verdict) == least
    where = bounds.index(least) if not found.proven else 0  # the first is nearest, though another has the least bound
    assert found.time == pytest.approx(where + 0.5, abs=0.05) and found.min_distance == pytest.approx(
        0.09 + 0.01 * where
    )
