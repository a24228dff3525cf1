"""The planner: moves of one robot under one model, retimed or reshaped, judged, never worse than their baselines."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from energy_opt.dynamics import torque_function
from energy_opt.errors import BadInput
from energy_opt.motion.judge.certificate import Certificate, certify
from energy_opt.motion.judge.energy import Energy, Scorer
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.check import check_pose
from energy_opt.motion.limits.registry import limits_of
from energy_opt.motion.move import Move, Settings
from energy_opt.motion.path import JointPath, straight, through
from energy_opt.motion.plan.candidates import Solve
from energy_opt.motion.reshape.nodes import NodeFunctions, node_functions
from energy_opt.motion.reshape.search import Reshaper
from energy_opt.motion.result import Result
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.timing.toppra import fastest
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.compile import compiled
from energy_opt.power import PowerModel
from energy_opt.robot import Robot


class Planner:
    """Plans many moves of one robot; what is built for the first serves all others.

    Args:
        batch: many moves are coming, so that compiling at once pays.
        stopped: asked between solves; True ends the work with the best known so far.
    """

    def __init__(
        self,
        robot: Robot,
        model: PowerModel,
        settings: Settings | None = None,
        *,
        batch: bool = False,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self.robot, self.settings = robot, settings or Settings()
        self._batch, self._stopped = batch, stopped
        self._reshapers: dict[str, Reshaper] = {}
        self._compiled = False
        self._build_seconds = 0.0
        self._structure = model.structure
        self.set_model(model)
        if self.settings.dynamics != "auto":  # a source that is not there is told now, not when a move needs it
            torque_function(robot.body, self.settings.dynamics)

    def set_model(self, model: PowerModel) -> None:
        """Other values of the same effects; nothing is built again.

        Raises:
            BadInput: the model has other effects than the planner was built for.
        """
        if model.structure != self._structure:
            raise BadInput("the planner was built for other effects; build a new one")
        model.check(self.robot.n)
        self.model = model
        self._scorer = Scorer(self.robot, model)
        self._certified: tuple[Trajectory, Move | None, Certificate] | None = (
            None  # the last, which is often asked for again
        )
        self._values = model.values(self.robot.n)

    def score(self, trajectory: Trajectory) -> Energy:
        """The energy of any trajectory under the planner's model."""
        return self._scorer.energy(trajectory)

    def limits(self, move: Move | None = None) -> tuple[Limit, ...]:
        """The limits in force: the robot's, those that the settings ask for, and the move's own."""
        return limits_of(self.robot, self.settings, move)

    def certify(self, trajectory: Trajectory, move: Move | None = None) -> Certificate:
        """How far any trajectory stays inside the limits, those of the move it is for among them."""
        known = self._certified
        if known is None or known[0] is not trajectory or known[1] is not move:
            certificate = certify(trajectory, self._scorer, self.limits(move), self.settings.verify_samples)
            self._certified = known = trajectory, move, certificate
        return known[2]

    def minimum_time(self, move: Move) -> float:
        """The shortest duration of the move's path within all limits, by TOPP-RA, s."""
        return self._fastest(move).duration

    def solve(self, move: Move, warm: Sequence[Trajectory] = ()) -> Result:
        """The move with the least energy that is found, or by another objective if the settings say so.

        Args:
            warm: trajectories to start from besides the usual ones; where they have the move's duration and stay within
                limits, the result is never worse than they are.

        Raises:
            Infeasible: no timing or no path holds the limits; says which, where and what would work.
        """
        self._check_ends(move)
        self._check_objective(move)
        return Solve(self, move, warm).run()

    def _check_objective(self, move: Move) -> None:
        objective = self.settings.objective
        if objective in ("energy", "time"):
            return
        if move.mode == "retime":
            raise BadInput(f"--objective {objective} is for --mode reshape; retime minimises energy or time")
        if move.duration is None:
            raise BadInput(f"--objective {objective} says nothing of duration; give --duration")

    def _check_ends(self, move: Move) -> None:
        limits, rest = self.limits(move), [not np.any(v) for v in move.end_velocities]
        poses = [("start", move.start, rest[0]), ("goal", move.goal, rest[1]), *(("via", q, False) for q in move.via)]
        for what, q, _ in poses:
            if np.shape(q) != (self.robot.n,):
                raise BadInput(f"--{what}: {np.size(q)} positions; {self.robot.name} has {self.robot.n} joints")
        for what, q, resting in poses:
            check_pose(limits, self.robot, self.model, q, what, resting)

    def _path(self, move: Move) -> JointPath:
        if move.path is not None:
            return move.path
        if move.via:
            return through(np.vstack([move.start, *move.via, move.goal]))
        return straight(move.start, move.goal)

    def _fastest(self, move: Move, limits: Sequence[Limit] | None = None) -> Timing:
        path = self._path(move)
        return fastest(
            self.robot,
            self.model,
            path,
            limits=self.limits(move) if limits is None else limits,
            start_speed=path.start_speed,
            end_speed=path.end_speed,
        )

    def _reshaper(self, objective: str) -> Reshaper:
        if objective not in self._reshapers:
            begin = time.perf_counter()
            nodes = node_functions(self.model, self.robot.body, self.limits(), objective, self.settings.dynamics)
            functions, self._compiled = compiled(nodes.as_list(), self.settings.compile, self._batch)
            free = self.settings.end_acceleration == "free"
            self._reshapers[objective] = Reshaper(NodeFunctions(*functions), self.robot.n, self.settings.controls, free)
            self._build_seconds += time.perf_counter() - begin
        return self._reshapers[objective]
