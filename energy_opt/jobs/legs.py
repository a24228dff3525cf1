"""A job as its steps, the motions between its stops, and their energy as a function of duration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from energy_opt.cell.load import scene_of
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput
from energy_opt.jobs.allocate import Front, Solved
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.move import Move
from energy_opt.motion.path import JointPath, straight, through
from energy_opt.motion.retime.program import Retiming
from energy_opt.motion.retime.solve import FLOOR
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.poses.estimate import holding
from energy_opt.poses.given import in_base
from energy_opt.poses.pose import Pose
from energy_opt.robot import Robot

SAME = 1e-9  # [rad] positions that differ by less are the same
Load = tuple[float, float, float, float]  # mass [kg] and its centre [m] in the last joint's frame


@dataclass(frozen=True)
class Step:
    """One step of a job, ready to run.

    Attributes:
        name: for messages and results.
        start, goal: (n,) [rad]; equal for a wait.
        wait: seconds, None for a move; brakes: it waits without holding losses.
        mode: "retime" or "reshape"; least, most: of the duration, s.
        payload: (4,) mass [kg] and its centre [m] in the last joint's frame.
        scene: file of the scene, if the job names one.
        stop: does the arm stand still at its end?
        pose: required pose of the tool at its end, while `goal` is still to be chosen (nan then, see `Job.at`).
    """

    name: str
    start: np.ndarray
    goal: np.ndarray
    wait: float | None = None
    brakes: bool = False
    mode: Literal["retime", "reshape"] = "reshape"
    least: float = 0.0
    most: float = np.inf
    payload: Load = (0.0, 0.0, 0.0, 0.0)
    scene: Path | None = None
    stop: bool = True
    pose: Pose | None = None


@dataclass(frozen=True)
class Job:
    """A cycle of steps; the last ends where the first begins.

    Attributes:
        cycle_time: s; brakes: may brakes hold the arm during remaining time?
        remarks: parts of the file that may be meant differently.
    """

    name: str
    robot: Robot
    cycle_time: float
    steps: tuple[Step, ...]
    brakes: bool = False
    remarks: tuple[str, ...] = ()

    @property
    def waiting(self) -> float:
        """Total time [s] of the waits in the job."""
        return sum(step.wait for step in self.steps if step.wait is not None)

    @property
    def open(self) -> tuple[int, ...]:
        """The steps whose joint positions are still to be chosen."""
        return tuple(k for k, step in enumerate(self.steps) if np.isnan(step.goal).any() and step.wait is None)

    def given_before(self, k: int) -> np.ndarray | None:
        """Positions (n,) at the end of the last step before step `k` of the cycle that has given ones; None if none."""
        before = (step.goal for step in (*self.steps[:k][::-1], *self.steps[k:][::-1]))
        return next((goal for goal in before if not np.isnan(goal).any()), None)

    def at(self, ends: Mapping[int, np.ndarray]) -> Job:
        """The job whose steps k end at positions `ends[k]` (n,) [rad]."""
        goals = {k: ends.get(k, step.goal) for k, step in enumerate(self.steps) if step.wait is None}
        at = goals[max(goals)] if goals else self.steps[0].start
        steps = []
        for k, step in enumerate(self.steps):
            begin, at = at, goals.get(k, at)
            steps.append(replace(step, start=begin, goal=at))
        return replace(self, steps=tuple(steps))


@dataclass(frozen=True)
class Leg:
    """A motion from rest to rest: one step, or several that are joined through their ends.

    Attributes:
        steps: their places in the job.
        points: (K, n) [rad] the start, the via points, and the end.
        initial_path: the first path, if it is neither the straight line nor the curve through the points.
        begins: source of the first path, as in `first_path.source` of a result.
    """

    steps: tuple[int, ...]
    names: tuple[str, ...]
    points: np.ndarray
    mode: str
    least: float
    most: float
    step: Step
    initial_path: JointPath | None = None
    begins: str = "straight"

    @property
    def name(self) -> str:
        """The names of its steps, for messages."""
        return " and ".join(self.names)

    @property
    def moves(self) -> bool:
        """False if it ends where it begins and has no other point between."""
        return bool(np.abs(self.points - self.points[0]).max() > SAME)

    @property
    def path(self) -> JointPath:
        """The first path: the straight line, the smooth curve through the points, or a path around obstacles."""
        if self.initial_path is not None:
            return self.initial_path
        return through(self.points) if len(self.points) > 2 else straight(self.points[0], self.points[-1])

    def move(self, duration: float | None) -> Move:
        """The leg as a move of exactly `duration` seconds, with its ends and via points; None: of any duration."""
        start, goal = self.points[0], self.points[-1]
        if self.mode == "retime":
            return Move(start, goal, "retime", duration, path=through(self.points) if len(self.points) > 2 else None)
        return Move(start, goal, "reshape", duration, via=tuple(self.points[1:-1]))


def legs_of(steps: Sequence[Step]) -> list[Leg]:
    """The motions of a job in order; a joined leg is reshaped if one of its steps is, the last bounds its time."""
    out: list[Leg] = []
    part: list[int] = []
    for k, step in enumerate(steps):
        if step.wait is not None:
            continue
        part.append(k)
        if step.stop:
            joined = [steps[i] for i in part]
            names, points = tuple(s.name for s in joined), np.vstack([joined[0].start, *(s.goal for s in joined)])
            mode = "reshape" if any(s.mode == "reshape" for s in joined) else "retime"
            out.append(Leg(tuple(part), names, points, mode, step.least, step.most, step))
            part = []
    return out


def at_step(cell: CellRequest, step: Step) -> CellRequest:
    """Body and cell at a step, whose own scene replaces that of the request."""
    return replace(cell, scene=step.scene or cell.scene)


def pose_in_base(step: Step, robot: Robot, cell: CellRequest) -> Pose:
    """The pose of a step in the frame of the robot's base.

    Args:
        step: one with a pose. cell: as requested; the step's own scene replaces its scene.

    Raises:
        BadInput: the pose names an unknown frame, or one that moves with the arm.
    """
    assert step.pose is not None
    scene = scene_of(at_step(cell, step), robot) if step.pose.frame else None
    return in_base(step.pose, robot, scene, cell.base_pose)


def wrong_frames(job: Job, cell: CellRequest) -> list[str]:
    """Faults of the frames that poses of a job name, one line each."""
    faults: dict[str, None] = {}
    for k in job.open:
        try:
            pose_in_base(job.steps[k], job.robot, cell)
        except BadInput as error:
            faults[str(error)] = None
    return list(faults)


LONGEST = 50.0  # longest duration of a leg, as a multiple of its shortest
SLOWER = 1.02  # ratio of durations in a difference quotient
SAMPLES = 40  # samples of the path for its holding power


def front_of(leg: Leg, timing: Timing, scorer: Scorer, limits: Sequence[Limit], most: float) -> Front:
    """The front of a leg up to a duration of `most` [s]; `timing` is its fastest."""
    robot, model = scorer.robot, scorer.model
    shortest, longest = max(timing.duration, leg.least), min(leg.most, LONGEST * timing.duration, most)
    power = holding([scorer], leg.path(np.linspace(0, 1, SAMPLES)))
    held = float(power.mean())
    if not leg.path.moves:
        return Front(shortest, shortest, held, lambda price: Solved(shortest, held * shortest, None))
    work = Retiming(robot, model, timing, limits)
    last = [timing]

    def at_price(price: float) -> Solved:
        # from this price on, standing at the cheapest place pays: only the longest duration ends the slowing
        bounded = bool(price >= power.min())
        found = work.optimise(last[0], price=price, longest=longest, floor=FLOOR, bounded=bounded)
        if not found.solved and last[0] is not timing:
            found = work.optimise(timing, price=price, longest=longest, floor=FLOOR, bounded=bounded)
        if not found.solved:
            slowed = timing.slowed(float(np.clip(last[0].duration, shortest, longest)))
            return Solved(slowed.duration, work.energy(slowed), None)
        last[0] = found.timing
        bound = found.bound if leg.least <= timing.duration else None  # the bound ignores a least duration
        return Solved(found.timing.duration, found.energy, bound)

    return Front(shortest, longest, held, at_price)


def slope_of_slowing(legs: Sequence[Leg], timings: Sequence[Timing], scorers: Sequence[Scorer], factor: float) -> float:
    """Power [W] that another second saves when all legs are slowed evenly by `factor`."""
    energy, time = [0.0, 0.0], [0.0, 0.0]
    for leg, timing, scorer in zip(legs, timings, scorers, strict=True):
        for k, more in enumerate((factor, SLOWER * factor)):
            duration = float(np.clip(more * timing.duration, max(timing.duration, leg.least), leg.most))
            slowed = timing.slowed(duration).trajectory(scorer.robot.joints)
            energy[k] += scorer.energy(slowed).total
            time[k] += duration
    return (energy[1] - energy[0]) / (time[1] - time[0]) if time[1] > time[0] else 0.0
