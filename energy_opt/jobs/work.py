"""The solves of a job's legs: one planner for all payloads and scenes, and answers that survive a killed run."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from energy_opt import formats
from energy_opt.cell.cell import Cell
from energy_opt.cell.load import load_cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import EnergyOptError, Infeasible
from energy_opt.files import to_json
from energy_opt.jobs.allocate import Front
from energy_opt.jobs.cycle import Answer, Scorers
from energy_opt.jobs.file import Job, Step
from energy_opt.jobs.legs import Leg, Load, at_step, front_of
from energy_opt.motion import Settings, Trajectory
from energy_opt.motion.limits.early_check import check_pose
from energy_opt.motion.path import JointPath, of_trajectory
from energy_opt.motion.plan.first_path import check_free
from energy_opt.motion.plan.neighbour import Neighbours, Optimum
from energy_opt.motion.plan.planner import Planner, Shares
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.poses.distance import is_free
from energy_opt.power import PowerModel

LOOKS = 40  # samples of a rough motion that are checked for contact
Key = tuple[bytes, str, Load, Path | None]  # points, mode, payload and scene of a leg


class Cells:
    """The cell of every step, by the job's files and the request; each is read once."""

    def __init__(self, job: Job, request: CellRequest) -> None:
        self._job, self._request = job, request
        self._kept: dict[Path | None, Cell | None] = {}

    def of(self, step: Step) -> Cell | None:
        """The cell of a step; None if there is nothing to keep clear of."""
        asked = at_step(self._request, step)
        if asked.scene not in self._kept:
            try:
                self._kept[asked.scene] = load_cell(self._job.robot, asked)
            except EnergyOptError as error:
                error.args = (f"{step.name}: {error.args[0]}",)
                raise
        return self._kept[asked.scene]


FOLDER = ".answers"


class Answers:
    """Trajectories on disk; their key is leg, duration and `about` (all else: model, limits, settings)."""

    def __init__(self, out: Path, joints: Sequence[str], about: object, resume: bool) -> None:
        """In `out`; without `resume` the answers of an earlier run are ignored."""
        self._folder, self._joints, self._resume = Path(out) / FOLDER, tuple(joints), resume
        self._about = to_json(about)

    def known(self, leg: Leg, duration: float) -> Trajectory | None:
        """The earlier answer; None if there is none that can be read."""
        path = self._path(leg, duration)
        if not self._resume or not path.is_file():
            return None
        try:
            return formats.read_trajectory(path, self._joints)
        except EnergyOptError:
            return None

    def keep(self, leg: Leg, duration: float, trajectory: Trajectory) -> None:
        """Write the answer to a leg of a duration [s], completely or not at all.

        Raises:
            BadInput: the file cannot be written.
        """
        formats.write(trajectory, self._path(leg, duration))

    def forget(self) -> None:
        """Remove the answers of a finished job."""
        for path in self._folder.glob("*.csv"):
            path.unlink(missing_ok=True)
        if self._folder.is_dir():
            self._folder.rmdir()

    def _path(self, leg: Leg, duration: float) -> Path:
        """The file of an answer; its name changes with everything that the answer depends on."""
        what = to_json([leg.points, leg.mode, leg.step.payload, str(leg.step.scene), repr(duration)])
        return self._folder / f"{hashlib.sha256((self._about + what).encode()).hexdigest()[:24]}.csv"


class Worker:
    """Solves legs: one planner for all payloads and scenes."""

    def __init__(
        self, job: Job, model: PowerModel, settings: Settings, cells: Cells, stopped: Callable[[], bool],
        shares: Shares = MappingProxyType({}), planner: Planner | None = None, answers: Answers | None = None,
    ) -> None:  # fmt: skip
        """`answers`: of an earlier run, which are judged again before use; every new one is kept there."""
        self.job, self.scorers, self.stopped = job, Scorers(job.robot, model), stopped
        self.cells, self._answers = cells, answers
        # solvers of equal legs at several durations, by points, mode, payload and scene
        self._steps: dict[Key, Neighbours] = {}
        self._quickest: dict[Key, tuple[JointPath, Timing] | None] = {}
        planner = planner or Planner(job.robot, self.scorers.model, settings, stopped=stopped)
        self._planner = planner.within(shares) if shares else planner

    def __getstate__(self) -> dict[str, Any]:
        """The content of a pickled worker: no solvers, which are built again when they are needed."""
        return {**vars(self), "_steps": {}}

    def check_poses(self) -> None:
        """Raise Infeasible if the arm touches something at a step's ends, or cannot hold its load there.

        Where brakes hold the arm, the motors hold it before these close and after they open.
        """
        for before, step in zip([self.job.steps[-1], *self.job.steps], self.job.steps, strict=False):
            cell, planner = self.cells.of(step), self.planner(step)
            for q, rests, place in ((step.start, before.stop, "beginning"), (step.goal, step.stop, "end")):
                name = f"{step.name}, at its {place}"
                check_pose(planner.limits(), self.job.robot, planner.model, q, name, rests)
                if cell is not None and cell.checks:
                    check_free(cell, q, name)

    def planner(self, step: Step) -> Planner:
        """The planner under a step's payload, in its scene."""
        return self._planner.under(self.scorers.of(step).model).around(self.cells.of(step))

    @staticmethod
    def _key(leg: Leg) -> Key:
        return leg.points.tobytes(), leg.mode, leg.step.payload, leg.step.scene

    def with_first_path(self, leg: Leg) -> Leg:
        """The leg with the first path that the planner starts from.

        If a retimed leg's path is not free, the leg is reshaped instead.

        Raises:
            Infeasible: no way around was found.
        """
        planner = self.planner(leg.step)
        try:
            move, first, _ = planner.first_path(leg.move(None))
        except Infeasible as error:
            if leg.mode == "reshape" or error.limit != "clearance":
                raise Infeasible(f"{leg.name}: {error}", joint=error.joint, limit=error.limit) from None
            leg = replace(leg, mode="reshape")
            move, first, _ = planner.first_path(leg.move(None))
        return replace(leg, initial_path=move.path, begins=first.source)

    def timing(self, leg: Leg) -> Timing:
        """The fastest timing of the leg's first path.

        Raises:
            Infeasible: the path breaks limits at any timing; says which leg.
        """
        move = leg.move(None)
        if leg.initial_path is not None:
            move = replace(move, path=leg.initial_path)
        try:
            return self.planner(leg.step).timing(move)
        except Infeasible as error:
            said, joint, limit = f"{leg.name}: {error}", error.joint, error.limit
            raise Infeasible(said, joint=joint, limit=limit, position=error.position) from None

    def quickest(self, leg: Leg, timing: Timing) -> tuple[Leg, Timing]:
        """The leg along the path of its fastest reshaped move, and its timing there; as given if that is not faster."""
        key = self._key(leg)
        if key not in self._quickest:
            self._quickest[key] = self._fastest(leg) if leg.mode == "reshape" and leg.moves else None
        found = self._quickest[key]
        if found is None or found[1].duration >= timing.duration:
            return leg, timing
        return replace(leg, initial_path=found[0]), found[1]

    def _fastest(self, leg: Leg) -> tuple[JointPath, Timing] | None:
        """The path of a leg's fastest reshaped move, and its fastest timing; None if no such move is found."""
        planner = self.planner(leg.step).with_settings(objective="time", starts=1)
        try:
            motion = planner.solve(leg.move(None), confirm=False).trajectory
            path = of_trajectory(motion)
            return path, self.timing(replace(leg, initial_path=path))
        except Infeasible:
            return None

    def front(self, leg: Leg, timing: Timing, most: float) -> Front:
        """The leg's front over the timing of its first path, up to a duration of `most` [s]."""
        planner, scorer = self.planner(leg.step), self.scorers.of(leg.step)
        return front_of(leg, timing, scorer, planner.limits(), most)

    def slowed(self, leg: Leg, timing: Timing, duration: float, name: str = "scaled") -> Answer:
        """The leg's fastest timing, slowed evenly; infeasible if it exceeds a limit."""
        return self.judged(leg, timing.slowed(duration).trajectory(self.job.robot.joints), name)

    def judged(self, leg: Leg, trajectory: Trajectory, source: str) -> Answer:
        """A trajectory as an answer to a leg; infeasible if it exceeds a limit or touches something."""
        valid = self.planner(leg.step).certify(trajectory).valid
        energy = self.scorers.of(leg.step).energy(trajectory)
        return Answer(trajectory, energy, source, "solved" if valid else "infeasible")

    def solved(self, leg: Leg, timing: Timing, duration: float, alone: bool = False) -> Answer:
        """The leg in `duration` s with the least energy found.

        The first time, or if `alone`, it is a single move; else it continues the optimum of the nearest known duration,
        in a fifth of the time.
        """
        planner = self.planner(leg.step)
        known = None if self._answers is None else self._answers.known(leg, duration)
        try:
            planner.check(leg.move(duration))
            key = self._key(leg)
            if key not in self._steps:
                self._steps[key] = Neighbours(planner.single(leg.move(None)))
            steps = self._steps[key]
            if known is not None and planner.certify(known).valid:
                energy = planner.score(known)
                steps.learn(duration, Optimum(known, energy, True))
                return Answer(known, energy, "resumed")
            found = steps.single_move(duration) if alone else steps.near(duration)
        except Infeasible as error:
            return self._slowed_or(error, leg, timing, duration)
        if found is None:
            none = Infeasible(f"nothing within limits was found in {duration:g} s", limit="duration")
            return self._slowed_or(none, leg, timing, duration)
        if self._answers is not None and found.converged and not self.stopped():
            self._answers.keep(leg, duration, found.trajectory)
        return Answer(found.trajectory, found.energy, found.chosen, "solved" if found.converged else "not_converged")

    def rough(self, leg: Leg, duration: float, near: Answer | None = None) -> Answer:
        """The leg near its optimum in a fraction of the time of `solved`; it is not proven.

        Args:
            near: an answer to start from, of any ends; None for the first path.

        Raises:
            Infeasible: nothing within limits was found, or the motion found touches something.
        """
        move, planner, cell = leg.move(duration), self.planner(leg.step), self.cells.of(leg.step)
        blind = planner.around(None)
        retimed = move.mode == "retime" or (near is not None and near.source == "retime")
        for first in () if retimed else (near, None) if near is not None else (None,):
            try:
                guess = blind.sketch(move) if first is None else first.trajectory
            except Infeasible:
                break
            motion, _ = blind.settle(move, guess)
            if motion is not guess and _touching(cell, motion):
                motion, _ = planner.settle(move, motion)
            if motion is not guess and not _touching(cell, motion):
                return Answer(motion, blind.score(motion), "sketch", "not_converged")
        motion = blind.solve(replace(move, mode="retime", path=leg.path, via=())).trajectory
        if _touching(cell, motion):
            raise Infeasible(f"{leg.name}: the motion of {duration:.4g} s that a rough search found touches something")
        return Answer(motion, blind.score(motion), "retime", "not_converged")

    def _slowed_or(self, error: Infeasible, leg: Leg, timing: Timing, duration: float) -> Answer:
        """The first path slowed evenly, in place of a solve that failed.

        Raises:
            Infeasible: it breaks a limit, too; the message is that of the solve.
        """
        slowed = self.slowed(leg, timing, duration)
        if slowed.status == "solved":
            return slowed
        raise Infeasible(f"{leg.name}: {error}", joint=error.joint, limit=error.limit) from None


def _touching(cell: Cell | None, motion: Trajectory) -> bool:
    """Whether a motion touches something at LOOKS of its instants."""
    looks = motion.sample(np.linspace(motion.time[0], motion.time[-1], LOOKS))[0]
    return not all(is_free(cell, q) for q in looks)
