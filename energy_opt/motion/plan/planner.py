"""The planner: moves of one robot under one model, retimed or reshaped, judged, never worse than their baselines."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from energy_opt.dynamics import torque_function
from energy_opt.effects import Payload
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion.judge.certificate import ALLOWED, Certificate, certify
from energy_opt.motion.judge.energy import Energy, Scorer
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
from energy_opt.robot import Limits, Robot


def _but_payload(model: PowerModel) -> tuple[tuple[str, ...], ...]:
    return model.without(Payload.name).structure


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
        self._reshapers: dict[tuple[object, ...], Reshaper] = {}
        self._compiled = False
        self._build_seconds = 0.0
        self._structure = _but_payload(model)
        self.set_model(model)
        if self.settings.dynamics != "auto":  # a source that is not there is told now, not when a move needs it
            torque_function(robot.body, self.settings.dynamics)

    def set_model(self, model: PowerModel) -> None:
        """Other values of the same effects, with or without a payload; nothing is built again.

        (But for the first payload where the planner was built for a model that has none: there it costs nothing.)

        Raises:
            BadInput: the model has other effects than the planner was built for.
        """
        if _but_payload(model) != self._structure:
            raise BadInput("the planner was built for other effects; build a new one")
        model.check(self.robot.n)
        self.model = model
        self._scorer = Scorer(self.robot, model)
        self._certified: tuple[Trajectory, Certificate] | None = None  # the last, which is often asked for again
        self._values = model.values(self.robot.n)

    def score(self, trajectory: Trajectory) -> Energy:
        """The energy of any trajectory under the planner's model."""
        return self._scorer.energy(trajectory)

    def certify(self, trajectory: Trajectory) -> Certificate:
        """How far any trajectory stays inside the robot's limits."""
        if self._certified is None or self._certified[0] is not trajectory:
            certificate = certify(trajectory, self._scorer, self.robot.limits, self.settings.verify_samples)
            self._certified = trajectory, certificate
        return self._certified[1]

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
        limits = self.robot.limits
        for what, q in (("start", move.start), ("goal", move.goal), *(("via", q) for q in move.via)):
            if np.shape(q) != (self.robot.n,):
                raise BadInput(f"--{what}: {np.size(q)} positions; {self.robot.name} has {self.robot.n} joints")
            excess = np.maximum(q - limits.upper, limits.lower - q)
            j = int(np.argmax(excess))
            if excess[j] > 1e-9:
                raise Infeasible(
                    f"{what}: {self.robot.joints[j]} = {q[j]:.4g} rad is outside its position limits "
                    f"[{limits.lower[j]:.4g}, {limits.upper[j]:.4g}]",
                    joint=self.robot.joints[j],
                    limit="position",
                    position=1.0 if what == "goal" else 0.0,
                    excess=float(excess[j]),
                )
        self._check_holding(move)

    def _check_holding(self, move: Move) -> None:
        """An arm that begins or ends at rest must be able to stand there."""
        rest = [not np.any(v) for v in move.end_velocities]
        ends = np.stack([move.start, move.goal])
        tau, _, _ = self._scorer.drive(ends, np.zeros_like(ends), np.zeros_like(ends), np.zeros(2))
        excess = np.where(np.array(rest)[:, None], np.abs(tau) / self.robot.limits.effort - 1, -1.0)
        k, j = np.unravel_index(int(np.argmax(excess)), excess.shape)
        if excess[k, j] > ALLOWED:
            raise Infeasible(
                f"{('start', 'goal')[k]}: {self.robot.joints[j]} needs {abs(tau[k, j]):.4g} N m to stand still, beyond "
                f"its effort limit {self.robot.limits.effort[j]:.4g}; a lighter payload or another posture would work",
                joint=self.robot.joints[j],
                limit="effort",
                position=float(k),
                excess=float(excess[k, j]),
            )

    def _path(self, move: Move) -> JointPath:
        if move.path is not None:
            return move.path
        if move.via:
            return through(np.vstack([move.start, *move.via, move.goal]))
        return straight(move.start, move.goal)

    def _fastest(self, move: Move, limits: Limits | None = None) -> Timing:
        path = self._path(move)
        return fastest(
            self.robot,
            self.model,
            path,
            limits=limits,
            start_speed=path.start_speed,
            end_speed=path.end_speed,
        )

    def _reshaper(self, objective: str) -> Reshaper:
        key = (objective, *self.model.structure)
        if key not in self._reshapers:
            begin = time.perf_counter()
            nodes = node_functions(self.model, self.robot.body, objective, self.settings.dynamics)
            functions, self._compiled = compiled(nodes.as_list(), self.settings.compile, self._batch)
            free = self.settings.end_acceleration == "free"
            self._reshapers[key] = Reshaper(NodeFunctions(*functions), self.robot.n, self.settings.controls, free)
            self._build_seconds += time.perf_counter() - begin
        return self._reshapers[key]
