"""One arm of a cell: its steps as a job, the energy of every move over its duration, and the power of waiting."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.errors import BadInput, Infeasible, at_least
from energy_opt.formats.controller_program import load_of
from energy_opt.jobs.cycle import Answer, standing_power
from energy_opt.jobs.file import Job, Step
from energy_opt.jobs.legs import Leg, legs_of
from energy_opt.jobs.posed import Posed
from energy_opt.jobs.solve_job import RoughCycles
from energy_opt.jobs.work import Cells, Worker
from energy_opt.motion.move import Settings
from energy_opt.motion.plan.first_path import check_free
from energy_opt.motion.plan.planner import Shares
from energy_opt.motion.trajectory import Trajectory, standing, whole
from energy_opt.poses.given import poses_of_request
from energy_opt.power import PowerModel
from energy_opt.robot import Robot
from energy_opt.schedule import Hull, Mode, Move, Ring, Wait
from energy_opt.schedule.problem import SAME
from energy_opt.workcell.as_job import at_positions, explicit_steps, job_of, request_of
from energy_opt.workcell.curves import ADDED, mode_of
from energy_opt.workcell.file import MOTORS, RobotTable, StepTable, WorkCell, step_name
from energy_opt.workcell.motion import ArmMove, Part, Scoring, at_link, at_rest, nearest

# durations of evenly slowed moves to evaluate, as multiples of the shortest
SLOWER = (1.0, 1.15, 1.35, 1.6, 2.0, 2.5, 3.2, 4.2, 6.0)
# durations at which moves are optimized before the first schedule, as multiples of the shortest; short cycles need 1
SOLVED = (1.0, 1.6, 3.2)
# [s] least rise time of the acceleration at a move's ends, and its factor over that of jerk-limited ramps
BLEND, ROOM = 4e-3, 1.05
WITHIN = 1.001  # times the shortest duration: programs round times to nanoseconds, and all files must hold the limits
# shares of limits to use, because programs round numbers too
USED = dict.fromkeys(("velocity", "acceleration", "jerk", "effort"), 0.9999)
AT_ENDS = 1e-6  # [rad/s^2] a smaller acceleration at a move's ends counts as zero


class Arm:
    """An arm of a cell, ready to be scheduled.

    Args:
        cell: the whole file. table: the arm's table in it; path: of the file, the base of other files' paths.
        load: loads a robot from its name or URDF. model_of: the power model of the table's entry (None: no entry).
        request: body and cell, without the arm's base. stopped: True ends a solve with the best so far.
        shares: of limits' bounds that moves may use, by the limits' names: a number, or one for each joint (n,).

    Raises:
        BadInput: a fault in its steps. Infeasible: a pose touches something, or a move has no free path.
    """

    def __init__(
        self,
        cell: WorkCell,
        table: RobotTable,
        path: Path,
        load: Callable[[str], Robot],
        model_of: Callable[[str | None, Robot], PowerModel],
        settings: Settings,
        request: CellRequest,
        stopped: Callable[[], bool],
        shares: Shares = MappingProxyType({}),
    ) -> None:
        self.table, self.name = table.model_copy(update={"step": explicit_steps(table)}), table.name
        self.request = request_of(cell, table, path, request)
        named = poses_of_request(self.request)
        self._read = partial(job_of, cell, path=path, allow_outside=request.allow_outside, named=named)
        self.job: Job = self._read(self.table, load)
        model = model_of(table.model, self.job.robot).standing(table.base[3], table.base[4])
        carried = load_of(model)
        if carried is not None and "payload" not in table.model_fields_set:  # the model's, as in a job of one robot
            steps = explicit_steps(table.model_copy(update={"payload": carried}))
            self.table = self.table.model_copy(update={"step": steps})
            self.job = self._read(self.table, lambda _: self.job.robot)
        if self.job.open:
            posed = Posed(self.job, model, settings, self.request)
            chosen = posed.likely(RoughCycles(model, settings, self.job, stopped))[0]
            self.table = at_positions(self.table, {k: chosen[k] for k in self.job.open})
            self.job = replace(self.job.at(chosen), remarks=(*self.job.remarks, *posed.near(chosen)))
        self.scoring = Scoring(self.job.robot, model, None if cell.supply is None else cell.supply.capacity)
        room, bodies = {**shares, **{k: x * shares.get(k, 1.0) for k, x in USED.items()}}, Cells(self.job, self.request)
        self._worker_of = partial(Worker, self.job, settings=settings, cells=bodies, stopped=stopped, shares=room)
        self.worker = self._worker_of(model=self.scoring.of(False).model)
        self.worker.check_poses()
        self._known: dict[tuple[object, ...], ArmMove] = {}
        ramps = self.job.robot.limits.acceleration / (room["jerk"] * self.job.robot.limits.jerk)
        self._blend = float(whole(max(ROOM * ramps[np.isfinite(ramps)].max(initial=0.0), BLEND)))
        self.moves = [self._move(leg) for leg in legs_of(self.job.steps)]
        again = self.scoring.used_again(self.moves, self.job.cycle_time)
        if again < 1:
            self.optimize_using_again(again)
        self.modes = {mode.name: mode for mode in (*cell.mode, *table.mode)}

    def optimize_using_again(self, share: float) -> None:
        """Optimize moves from now on as if the link stored this share of their braking energy; scores stay exact."""
        self.worker = self._worker_of(model=at_link(self.scoring.model, self.job.robot, share))

    def _move(self, leg: Leg) -> ArmMove:
        """A leg's move; a move that several arrangements of the steps share is prepared once.

        Raises:
            Infeasible: no free path, or it takes longer than it may.
        """
        key = leg.points.tobytes(), leg.mode, leg.least, leg.most, leg.step.payload, leg.step.scene
        if key not in self._known:
            initial = self.worker.with_first_path(leg)
            timing = self.worker.timing(initial)
            timing = timing.slowed(WITHIN * timing.duration)
            shortest = max(float(whole(timing.duration + self._blend)), leg.least)
            longest = min(leg.most, self.job.cycle_time)
            if shortest > longest * (1 + 1e-12):
                raise Infeasible(
                    f"{self.name}: {leg.name} takes {at_least(shortest)} s at least; it may take {longest:.6g} s",
                    limit="duration",
                    shortest_duration=shortest,
                )
            self._known[key] = ArmMove(leg.steps[0], initial, timing, shortest, longest)
        return replace(self._known[key], place=leg.steps[0])  # all arrangements share its answers

    def arranged(self, steps: Sequence[StepTable]) -> Arm:
        """The arm with its steps in another order, or with further ones, ready to be scheduled.

        Raises:
            Infeasible: a pose touches something, or a move has no free path.
        """
        return self.listing(steps).ready()

    def among(self, steps: Sequence[StepTable]) -> Arm:
        """The arm with only those of its steps that are named in `steps`; itself if all are."""
        names = {step.name for step in steps}
        kept = [step for step in self.table.step if step.name in names]
        return self if len(kept) == len(self.table.step) else self.arranged(kept)

    def own_answers(self) -> Arm:
        """A copy of the arm whose answers to its moves are not shared with other arrangements of its steps."""
        out = copy(self)
        out.moves = [replace(move, answers=dict(move.answers)) for move in self.moves]
        return out

    def listing(self, steps: Sequence[StepTable]) -> Arm:
        """The arm with these steps, not yet `ready`; known answers to its moves are kept.

        Raises:
            Infeasible: a pose of the tool has no joint positions.
        """
        out = copy(self)
        poses = dict(self.table.poses)
        if self.table.home is not None:  # the ring begins where its last step ends
            home = self.table.home
            poses.setdefault("home", poses.get(home, []) if isinstance(home, str) else home)
        out.table = self.table.model_copy(update={"step": list(steps), "home": None, "poses": poses})
        out.job = self._read(out.table, lambda _: self.job.robot)
        if out.job.open:
            raise Infeasible(f"{self.name}: a pose of the tool whose joint positions are not chosen", limit="pose")
        return out

    def ready(self) -> Arm:
        """The arm with its moves evaluated.

        Raises:
            Infeasible: a pose touches something, or a move has no free path.
        """
        cell = self.cell
        if cell is not None and cell.checks:
            for step in self.job.steps:
                check_free(cell, step.goal, f"{step.name}, at its end")
        self.moves = [self._move(leg) for leg in legs_of(self.job.steps)]
        self.slow()
        return self

    @property
    def cell(self) -> Cell | None:
        """Body and scene of the first step; None if nothing is checked."""
        return self.worker.cells.of(self.job.steps[0])

    def slow(self) -> None:
        """Evaluate every move's first path, slowed evenly to several durations, if not yet done.

        Raises:
            BadInput: `as_is` of a step is no duration that its limits allow.
            Infeasible: the move keeps its limits at none of these durations.
        """
        for move in self.moves:
            if not move.slowed:
                today = self.table.step[move.place].as_is
                if today is not None and not move.shortest * (1 - SAME) <= today <= move.longest * (1 + SAME):
                    raise BadInput(
                        f"robot {self.name}: {move.leg.name}: as_is = {today:g}; its limits allow durations between "
                        f"{move.shortest:.6g} and {move.longest:.6g} s"
                    )
                for duration in (*(move.shortest * factor for factor in SLOWER), *(() if today is None else (today,))):
                    self._slowed(move, min(duration, move.longest))
            if not move.slowed:
                raise Infeasible(f"{self.name}: {move.leg.name} keeps its limits at no duration", limit="duration")

    def _slowed(self, move: ArmMove, duration: float) -> None:
        """Keep the evenly slowed move of a duration [s] if it holds all limits."""
        timing = move.timing.slowed(max(duration - self._blend, move.timing.duration))
        answer = self._blended(move, timing.trajectory(self.job.robot.joints), "scaled")
        if answer.status == "solved":
            move.slowed[duration] = self.scoring.scored(move, answer)
            move.answers.setdefault(duration, move.slowed[duration])

    def _blended(self, move: ArmMove, trajectory: Trajectory, source: str) -> Answer:
        """A trajectory averaged over `_blend` s: its acceleration begins and ends at 0, and does not jump at joins."""
        return self.worker.judged(move.leg, trajectory.averaged(self._blend), source)

    def optimize(self, move: ArmMove, duration: float) -> bool:
        """Optimize a move at a duration [s] if not yet done; True if anything was done."""
        if move.was_tried(duration):
            return False
        move.tried.add(duration)
        duration = float(np.clip(duration, move.shortest, move.longest))
        duration = next((known for known in move.answers if abs(duration / known - 1) < SAME), duration)
        try:
            answer = self.worker.solved(move.leg, move.timing, duration)
            if np.abs(answer.trajectory.acceleration[[0, -1]]).max() > AT_ENDS:
                answer = self.worker.solved(move.leg, move.timing, duration - self._blend)
                answer = self._blended(move, answer.trajectory, answer.source)
        except Infeasible:  # too short for this move; others are known
            self._slowed(move, duration)
            return True
        if answer.status != "solved":
            self._slowed(move, duration)
        known, answer = move.answers.get(duration), self.scoring.scored(move, answer)
        if answer.status == "solved" and (known is None or answer.energy.total < known.energy.total):
            move.answers[duration] = replace(answer, trajectory=at_rest(answer.trajectory))
        return True

    def ring(
        self, optimized: bool, hold: dict[int, float] | None = None, lossless: bool = False, first: bool = False
    ) -> Ring:
        """The arm's steps for the schedule.

        Args:
            optimized: curves of optimized moves, else of evenly slowed ones.
            lossless: the link loses nothing, so no supply draws less.
            hold: fixed durations [s] of moves, by the index of their step.
            first: under the first of several models, not their mean.
        """
        moves = {move.place: move for move in self.moves}
        steps: list[Move | Wait] = []
        for k, (name, step, table) in enumerate(zip(self.names, self.job.steps, self.table.step, strict=True)):
            if step.wait is not None:
                least, most = table.span
                steps.append(Wait(name, least, max(most, least), self.modes_at(k, first)))
            elif k in moves:
                move = moves[k]
                known = move.answers if optimized else move.slowed
                if hold is not None:  # the energy of that motion, which may be above the hull
                    known = {hold[k]: known[nearest(known, hold[k])]}
                of = partial(self.scoring.energy, step, lossless=lossless, first=first)
                points = [(d, (of(a.trajectory) if lossless or first else a.energy).total) for d, a in known.items()]
                curve = Hull.of(points)
                least, most = float(curve.durations[0]), float(curve.durations[-1])
                mixed, stated = self.scoring.mixed, partial(self.scoring.between, step, dict(known), curve.durations)
                steps.append(Move(name, least, most, curve, table.as_is, stated if mixed else None))
            if step.stop and not (step.wait is not None and table.span[1] > table.span[0]):
                steps.append(Wait(ADDED.format(name), 0.0, self.job.cycle_time, self.modes_at(k, first)))
        return Ring(self.name, tuple(steps))

    def modes_at(self, k: int, first: bool = False) -> tuple[Mode, ...]:
        """The modes in which the arm may wait at the end of step k; the first is being held by its motors.

        Args:
            k: index of the step. first: under the first of several models, not their mean.

        Raises:
            BadInput: none of those that the step lists is possible there.
        """
        table, here = self.table.step[k], (self._pose(k), self.names[k])
        power, stated = (
            standing_power(self.scoring.of(of_first), self.job.steps[k], False) for of_first in (first, True)
        )
        modes = [Mode(MOTORS, power, stated=stated)]
        for mode in self.modes.values():
            if mode.name != MOTORS and (mode.posture == "any" or any(name in mode.posture for name in here)):
                modes.append(mode_of(mode, table.power.get(mode.name)))
        modes += [Mode(name, power) for name, power in table.power.items() if name not in self.modes]
        possible = tuple(mode for mode in modes if table.modes is None or mode.name in table.modes)
        if not possible:
            raise BadInput(
                f"robot {self.name}: step {self.names[k]}: none of modes = {table.modes} is possible here; `posture` "
                "of each names other poses"
            )
        return possible

    @property
    def names(self) -> list[str]:
        """The name of every step, as in its ring."""
        return [step_name(k, step) for k, step in enumerate(self.table.step)]

    @property
    def postures(self) -> list[str]:
        """Names of the poses in which the arm may wait: its own, and those that a mode names (without its steps)."""
        named = (pose for mode in self.modes.values() if mode.posture != "any" for pose in mode.posture)
        return [pose for pose in dict.fromkeys([*self.table.poses, *named]) if pose not in self.names]

    def _pose(self, k: int) -> object:
        """The file's name of the arm's pose after step k."""
        steps = self.table.step
        return next((s.to for s in (*reversed(steps[: k + 1]), *reversed(steps)) if s.to is not None), None)

    def powers(self, part: Part, at: np.ndarray, first: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Power (M,) [W] of the drives, negative while they return some (see `Scoring`), and other power (M,) [W].

        Args:
            at: seconds (M,) after the step's start. first: under the first of several models, not their mean.
        """
        scorer = self.scoring.of(first).of(self.step_of(part.name))
        t = part.trajectory
        q, v, a, _ = t.sample(t.time[0] + at * t.duration / part.duration)
        clock = at if t.velocity.any() else np.zeros(len(at))  # a wait does not warm up, as in its energy
        power = scorer.drive(q, v, a, clock)[1]
        rest = np.full(len(at), scorer.model.constant_power(scorer.robot.n))
        return power - rest, rest

    def step_of(self, name: str) -> Step:
        """The step with a ring's `name`; for an added wait, the step before it."""
        steps = dict(zip((step.name for step in self.job.steps), self.job.steps, strict=True))
        return steps[name] if name in steps else steps[name.removeprefix(ADDED.format(""))]

    def parts(self, ring: Ring, starts: np.ndarray, durations: np.ndarray) -> list[Part]:
        """The motion of every step of the ring, as scheduled.

        Args:
            ring: the arm's steps. starts, durations: (steps,) [s].
        """
        moves = {self.names[move.place]: move for move in self.moves}
        out = []
        for step, start, duration in zip(ring.steps, starts.tolist(), durations.tolist(), strict=True):
            if isinstance(step, Move):
                move = moves[step.name]
                trajectory = move.answers[nearest(move.answers, duration)].trajectory
            else:
                trajectory = standing(self.job.robot.joints, self.step_of(step.name).goal, max(duration, 1e-9))
            out.append(Part(step.name, start, duration, trajectory))
        return out
