"""What is written is what was judged: files read back, judged again, and said to hold or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from urscript_arm import Controller

from energy_opt.formats import read_trajectory
from energy_opt.formats.output import wanted
from energy_opt.job import load_job, run_job
from energy_opt.job.cycle import joined
from energy_opt.job.program import write_programs
from energy_opt.motion import Settings
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
    assert "# 3. settle" in text and "# the brakes may hold the arm here" in text
    arm = Controller(np.array([0.0, -1.5, 1.2, -1.0, 0.3, 0.0]))
    arm.run(text)
    assert arm.time == pytest.approx(5.0, abs=1e-3)
    masses = [(round(t, 2), m) for t, m, _ in arm.payloads]
    change = sum(p.trajectory.duration for p in cycle.pieces[:1])
    assert masses == [(0.0, 0.5), (pytest.approx(change, abs=0.01), 2.0)]
    assert arm.payloads[1][2] == pytest.approx([0, -0.05, -0.0823], abs=1e-4)  # from the last joint's frame to tool0
    plan = joined(cycle.pieces)
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
    plan = joined(cycle.pieces)
    for row in rows:
        assert row.valid and "set them yourself: 0.5 kg from 0 s on, 2 kg from " in row.text
        again = read_trajectory(tmp_path / row.file, ur5.joints)
        assert again.duration == pytest.approx(5.0, abs=1e-6)
        time = np.linspace(0, 4.99, 300)
        np.testing.assert_allclose(again.sample(time)[0], plan.sample(time)[0], atol=2e-4)
