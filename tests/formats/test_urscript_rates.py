"""Programs for Universal Robots: the rate that is chosen for them, and arms whose joints have other names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from swings import UR_GOAL, UR_START, swing

from energy_opt.formats import controller_files
from energy_opt.formats.judging import Judging
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.robot import Robot


def test_a_program_at_the_controllers_own_rate_is_judged_as_positions(ur5: Robot, model: PowerModel) -> None:
    """Quintics between samples hold from 500 Hz on; positions at 500 Hz hold where the motion is slowed a little."""
    curve = swing(ur5.joints, UR_START, UR_GOAL, 1.2347)

    class Judge:
        scorer = Scorer(ur5, model)

        def __call__(self, trajectory: Trajectory) -> Any:
            return SimpleNamespace(valid=len(trajectory.time) > 500 * trajectory.duration)

        def at_steps(self, trajectory: Trajectory, rate: float) -> Any:
            assert rate == 500
            held = trajectory.duration > 1.01 * curve.duration
            return SimpleNamespace(valid=held, within_limits=held, violation=0.01)

    (form,) = controller_files.wanted(["urscript"])
    got = controller_files.sampled(curve, Judge(), form, None)  # type: ignore[arg-type]
    assert got.rate == 500 and 1.01 < got.trajectory.duration / curve.duration < 1.03


def test_a_program_for_an_arm_that_may_be_no_ur_says_so(tmp_path: Path, ur5: Robot, model: PowerModel) -> None:
    curve, (form,) = swing(ur5.joints, UR_START, UR_GOAL, 2.0), controller_files.wanted(["urscript"])
    judge = Judging(Scorer(ur5, model), joint_limits(ur5.limits))
    (row,) = controller_files.write(curve, judge, [form], tmp_path)
    assert "UR's" not in str(row)
    row = controller_files.read_back(
        tmp_path / "trajectory.script", form, controller_files.Sampled(curve, row.rate), judge, "",
        replace(curve, joints=tuple(f"joint{k}" for k in range(6))),
    )  # fmt: skip
    assert "the joints are not named as a UR's" in str(row)
