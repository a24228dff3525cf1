"""The planner: moves of one robot under one model, retimed or reshaped, judged, never worse than their baselines."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cache
from time import process_time
from typing import Any

import numpy as np

from energy_opt.arguments import typed
from energy_opt.cell.cell import Cell
from energy_opt.dynamics import torque_function
from energy_opt.effects import Payload
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.judge.clearance import cell_beside
from energy_opt.motion.judge.energy import Energy, Scorer
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.early_check import check_pose, least_duration
from energy_opt.motion.limits.registry import limits_of
from energy_opt.motion.move import LONGEST, Move, Settings, long_turns
from energy_opt.motion.path import JointPath
from energy_opt.motion.plan.anytime import LATE, Progress
from energy_opt.motion.plan.choice import with_trajectory, within_limits
from energy_opt.motion.plan.context import Context, Judge, Workshop, path_of
from energy_opt.motion.plan.first_path import check_free, first_path
from energy_opt.motion.plan.single import Single
from energy_opt.motion.plan.sketch import Settled, settled, sketched
from energy_opt.motion.plan.unsearched import below_resolution
from energy_opt.motion.reshape.open import FIXED, Open
from energy_opt.motion.result import FirstPath, Result
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory
from energy_opt.numerics.threads import one_thread
from energy_opt.power import PowerModel
from energy_opt.power.drive_law import rigid_inputs
from energy_opt.robot import Robot

log = logging.getLogger(__name__)
REMEMBERED = 64  # first paths to remember: a job has at most so many moves, and a batch asks for each once
OTHER = 1000  # offset of the seed of each further initial path
LONGER = 1.0, 1.05, 1.2  # multiples of the shortest duration found: the first that works is reported
CONFIRMING = 10.0  # [s] CPU time for all searches; later only the largest duration is tried, without a search
BEYOND = 1.0, 1.01, 1.05  # multiples of a reported duration that must work too
AT_REST = 1e-6  # [rad/s^2] smaller accelerations count as zero

Shares = Mapping[str, Any]  # of limits' bounds, by name: a number, or one for each joint (n,)
Start = tuple[Move, FirstPath, tuple[JointPath, ...]]


@typed
class Planner:
    """Plans many moves of one robot under one model and in one cell; all moves share what the first one built.

    `under` and `around` give planners for another model and another cell that share it too.

    Args:
        robot, model, settings: BadInput is raised where they do not fit each other; no settings are the defaults.
        cell: the arm's body and bodies around it, to keep clear of (`load_cell`); without one no collision is checked.
        stopped: called between solves; True ends the work with the best result so far.
    """

    def __init__(
        self,
        robot: Robot,
        model: PowerModel,
        settings: Settings | None = None,
        *,
        cell: Cell | None = None,
        stopped: Callable[[], bool] = bool,  # `bool()` is False, and is pickled
    ) -> None:
        self.robot, self.settings = robot, settings or Settings()
        self._shares: Shares = {}
        self._starts: list[tuple[Cell | None, Move, Start]] = []  # first paths, with their cell and move
        # their fastest timings, with the model, the shares of limits and the settings that they hold for
        self._timings: list[tuple[Move, PowerModel, Shares, Settings, Timing]] = []
        self.workshop, self.stopped = Workshop(), stopped
        self._take_cell(cell)
        self._take_model(model)
        self.limits()  # report faults now, not when a move needs the limits
        if self.settings.dynamics != "auto":  # report a missing source now, not when a move needs it
            torque_function(robot.body, self.settings.dynamics)

    def _take_model(self, model: PowerModel) -> None:
        model.check(self.robot.n)
        self.model = model
        self.scorer = Scorer(self.robot, model)

    def _take_cell(self, cell: Cell | None) -> None:
        self.cell = cell if cell is not None and cell.checks else None
        self._cell_warnings = [] if cell is None else cell.warnings
        self._beside: tuple[JointPath, Cell] | None = None  # the last given path and its cell

    def under(self, model: PowerModel) -> Planner:
        """A planner of the same moves under other values of the same effects, with or without a payload.

        It shares what was built. Only the first payload builds new functions, if the planner's model has none.

        Raises:
            BadInput: the model has other effects than the planner's.
        """
        ours, theirs = (m.without(Payload.name).structure for m in (self.model, model))
        if ours != theirs:
            raise BadInput("the planner was built for other effects; build a new one")
        out = copy(self)
        out._take_model(model)
        return out

    def around(self, cell: Cell | None) -> Planner:
        """A planner of the same moves that keeps clear of another cell (None: of nothing). It shares what was built."""
        out = copy(self)
        out._take_cell(cell)
        return out

    def score(self, trajectory: Trajectory) -> Energy:
        """The energy [J] of any trajectory of the robot's joints, under the planner's model."""
        return self.scorer.energy(trajectory)

    def limits(self, move: Move | None = None) -> tuple[Limit, ...]:
        """The limits in force: the robot's, those that the settings ask for, and the move's own."""
        held = limits_of(self.robot, self.settings, move, rigid_inputs(self.model, self.robot.body)[1])
        count = len(self.model.weighted)
        return tuple(limit.for_models(count).scaled(self._shares.get(limit.name, 1.0)) for limit in held)

    def within(self, shares: Shares) -> Planner:
        """A planner of the same moves that uses these shares of its limits' bounds; it builds nothing."""
        out = copy(self)
        out._shares = {**self._shares, **{name: share * self._shares.get(name, 1.0) for name, share in shares.items()}}
        out._starts = list(self._starts)
        return out

    def as_ending(self, trajectory: Trajectory) -> Planner:
        """A planner of the same moves with free end accelerations if this trajectory's are not zero."""
        jumps = np.any(np.abs(trajectory.acceleration[[0, -1]]) > AT_REST)
        return self.with_settings(end_acceleration="free") if jumps else self

    def with_settings(self, **changes: Any) -> Planner:
        """A planner of the same moves with other settings; it keeps what is built."""
        out = copy(self)
        out.settings = replace(self.settings, **changes)
        return out

    def with_trajectory(self, result: Result, move: Move, trajectory: Trajectory) -> Result:
        """The result with another trajectory of the move, judged by the planner's limits, with its own baselines."""
        single = self.single(move)
        return with_trajectory(single.context, single.move, single.timing, result, trajectory)

    def certify(self, trajectory: Trajectory, move: Move | None = None) -> Certificate:
        """Limits and clearance of any trajectory, recomputed; the limits of its move are included."""
        judge = Judge(self.scorer, self.limits(move), self.settings.verify_samples, self._cell_of(move))
        return judge(trajectory).stated

    def _cell_of(self, move: Move | None) -> Cell | None:
        """The cell that a move keeps clear of; a given path may come nearer than the default (`Cell.beside`)."""
        if self.cell is None or move is None or move.path is None:
            return self.cell
        if self._beside is None or self._beside[0] is not move.path:
            self._beside = move.path, cell_beside(self.cell, move.path)
        return self._beside[1]

    def minimum_time(self, move: Move) -> float:
        """The shortest duration [s] of the move's first path within all limits, by TOPP-RA; raises as `timing`."""
        return self.timing(self.first_path(move)[0]).duration

    def slowed(self, move: Move, duration: float) -> Trajectory | None:
        """The fastest timing of the move's first path, slowed evenly to `duration` s; None if that is not valid."""
        move, _, _ = self.first_path(move)
        try:
            trajectory = self.timing(move).slowed(duration).trajectory(self.robot.joints)
        except Infeasible:
            return None
        return trajectory if self.certify(trajectory, move).valid else None

    @one_thread
    def timing(self, move: Move, judge: Judge | None = None) -> Timing:
        """The fastest timing of a move along its path, computed once for all durations. `judge`: checks it.

        Raises:
            Infeasible: the path breaks limits at any timing.
        """
        timeless, given = replace(move, duration=None, max_duration=None), (self.model, self._shares, self.settings)
        for asked, *under, timing in self._timings:
            if all(a is b for a, b in zip(under, given, strict=True)) and asked == timeless:
                return timing
        context = self.context(timeless)
        look = context.judge if judge is None else judge
        found = within_limits(context.fastest(path_of(timeless)), lambda t: look.slowed(t, t.duration).within)
        self._timings[:] = [*self._timings[1 - REMEMBERED :], (timeless, *given, found)]
        return found

    def first_path(self, move: Move) -> Start:
        """The move with the path that it starts from, the source of that path, and further free paths.

        The path is found once for a move that is solved at several durations.

        Raises:
            Infeasible: a move that keeps its path would touch something, or no way around was found.
        """
        timeless = replace(move, duration=None, max_duration=None)
        found = next((b for cell, asked, b in self._starts if cell is self.cell and asked == timeless), None)
        if found is None:
            found = self._new_path(timeless, self.settings)
            if not (found[1].blocked and self.stopped()):
                self._starts[:] = [*self._starts[1 - REMEMBERED :], (self.cell, timeless, found)]
        started, first, initial_paths = found
        return replace(started, duration=move.duration, max_duration=move.max_duration), first, initial_paths

    def _new_path(self, move: Move, settings: Settings) -> Start:
        cell, stopped = self._cell_of(move), self.stopped
        return first_path(self.robot, self.model, cell, settings, self.limits(move), move, stopped)

    def solve(
        self, move: Move, warm: Sequence[Trajectory] = (), deadline: float | None = None, confirm: bool = True
    ) -> Result:
        """Find the move of least energy, or of least `settings.objective`.

        Args:
            move: ends (n,) in the robot's order, duration and via points.
            warm: trajectories to start from besides the usual ones; where they have the move's duration and stay within
                limits, the result is never worse than they are.
            deadline: seconds until the best proven answer so far is given; None for the settings'.
            confirm: if no motion is found, solve the move at the shortest duration before an error states it.

        Raises:
            BadInput: the move does not fit the robot or the settings.
            Infeasible: no timing or no path holds the limits; says which, where and what would work.
        """
        progress = Progress(self.settings.deadline if deadline is None else deadline, self.stopped)
        self.check(move)
        log.info("first path")
        search = copy(self)
        search.stopped = progress.ended
        single = search.single(move)
        single.refuse_below_bound(move)
        try:
            found = single.at(move.duration, move.max_duration, warm, progress).result
            result = single.rested(move, found, progress)
        except Infeasible as error:
            raise (self._confirmed(error, move, progress) if confirm else error) from None
        return replace(result, warnings=(*result.warnings, *self._cell_warnings, *long_turns(self.robot, move)))

    def sketch(self, move: Move, *, rough: bool = False) -> Trajectory:
        """A quick estimate of the answer: no bodies, limits approximately held; `rough`: coarser, in half the time."""
        if move.mode == "retime" or below_resolution(move):
            return self.around(None).solve(move, confirm=False).trajectory
        return sketched(replace(self.context(move), cell=None), move, rough)

    def settle(self, move: Move, motion: Trajectory, open_: Open = FIXED, clear: bool = True) -> Settled:
        """The optimum near `motion`, with the coordinates `open_` free, and its via positions; `clear`: of bodies."""
        if move.mode == "retime" or self.settings.objective != "energy" or below_resolution(move):
            return motion, move.via
        planner = (self if clear else self.around(None)).as_ending(motion)
        return settled(planner.context(move), move, motion, open_)

    def _confirmed(self, error: Infeasible, move: Move, progress: Progress) -> Infeasible:
        """The error with a shortest duration, rounded up as in its message, from which on moves were solved."""
        named = error.shortest_duration
        if named is None or progress.ended():
            late = named is not None and progress.late()
            return error.with_shortest_duration(None, LATE) if late else error
        single, begin, tries = self.single(move), process_time(), [longer * named for longer in LONGER]
        if single.timing is not None and single.timing.duration > tries[-1]:
            tries.append(single.timing.duration)  # without a search too, the first path is an answer there
        for longer in tries:
            if process_time() - begin > CONFIRMING and longer < tries[-1]:
                continue
            digits = 5 - int(np.floor(np.log10(longer)))
            tried = float(np.ceil(longer * 10**digits) / 10**digits)
            if tried * BEYOND[-1] > LONGEST:
                break
            if all(self._is_solvable(single, share * tried, begin) for share in BEYOND):
                return error.with_shortest_duration(tried)
        return error.with_shortest_duration(None)

    def _is_solvable(self, single: Single, duration: float, begin: float) -> bool:
        """Is a valid motion of that duration found before the time for confirming, counted from `begin`, is over?"""
        progress = Progress(max(CONFIRMING - (process_time() - begin), 0.0), self.stopped, enough=True)
        try:
            return single.at(duration, None, (), progress).result.status == "solved"
        except Infeasible:
            return False

    def single(self, move: Move) -> Single:
        """The solver of a move under the planner's present settings, at any duration; raises as `first_path`."""
        started, first, initial_paths = self.first_path(move)
        further = cache(lambda: self._another_path(move, first.source))  # all durations share one search for it
        context = replace(self.context(started), initial_paths=initial_paths, further=further)
        return Single(context, started, first, self.timing)

    def _another_path(self, asked: Move, source: str) -> tuple[JointPath, ...]:
        """Another initial path, if the first went around a body; called if the result saves too little."""
        settings = self.settings
        as_asked = settings.initial_paths is not None or settings.objective != "energy"
        if as_asked or self.cell is None or source == "straight":
            return ()
        try:
            other = replace(settings, initial_paths=1, seed=settings.seed + OTHER)
            move, first, initial_paths = self._new_path(asked, other)
        except Infeasible:
            return ()
        return (path_of(move),) if first.source in ("own", "ompl") else initial_paths

    def context(self, move: Move) -> Context:
        """The input of a solve: the planner's present state, with a judge for this move."""
        limits, cell = self.limits(move), self._cell_of(move)
        return Context(
            robot=self.robot,
            model=self.model,
            settings=self.settings,
            scorer=self.scorer,
            limits=limits,
            standing=self.limits(),
            judge=Judge(self.scorer, limits, self.settings.verify_samples, cell),
            workshop=self.workshop,
            stopped=self.stopped,
            cell=cell,
        )

    def check(self, move: Move) -> None:
        """Check what can be checked before a search: the objective, the ends and the duration of a move.

        Raises:
            BadInput: the move does not fit settings or robot. Infeasible: an end or the duration breaks a limit.
        """
        objective = self.settings.objective
        if objective not in ("energy", "time") and move.mode == "retime":
            raise BadInput(f"--objective {objective} is for --mode reshape; retime minimises energy or time")
        if objective not in ("energy", "time") and move.duration is None:
            raise BadInput(f"--objective {objective} does not determine the duration; give --duration")
        limits, rest = self.limits(move), [not np.any(v) for v in move.end_velocities]
        unseen = [limit.name for limit in limits if move.mode == "retime" and not limit.along]
        if unseen:
            raise BadInput(
                f"the limit {unseen[0]} bounds no timing of a path: it has no `use`, or its value depends on time; "
                "--mode reshape keeps it"
            )
        poses = [("start", move.start, rest[0]), ("goal", move.goal, rest[1]), *(("via", q, False) for q in move.via)]
        for what, q, _ in poses:
            if np.shape(q) != (self.robot.n,):
                raise BadInput(f"--{what}: {np.size(q)} positions; {self.robot.name} has {self.robot.n} joints")
        for what, q, resting in poses:
            check_pose(limits, self.robot, self.model, q, what, resting)
            if self.cell is not None:
                check_free(self.cell, q, what)
        least_duration(limits, self.robot, move)
