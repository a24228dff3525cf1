"""One move on its way from request to result: baselines, candidates, judgement and choice."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.move import Move
from energy_opt.motion.reshape.layout import Ends
from energy_opt.motion.reshape.level import Outcome
from energy_opt.motion.reshape.search import FEASIBLE, Reshaper, Task, trajectory_of
from energy_opt.motion.result import Baseline, Optimality, Result, SolverReport
from energy_opt.motion.retime.solve import RetimeSolution, retime
from energy_opt.motion.timing.law import Timing
from energy_opt.motion.trajectory import Trajectory

if TYPE_CHECKING:
    from energy_opt.motion.plan.planner import Planner

MENDS = 6  # times that limits are tightened where the judge finds them broken
LONGEST = 30.0  # a free duration ends at this multiple of the fastest on the first path
SHORTEST = 0.2


class Solve:
    """One move on its way from request to result."""

    def __init__(self, planner: Planner, move: Move, warm: Sequence[Trajectory]) -> None:
        self.p, self.move, self.warm = planner, move, list(warm)
        self.robot, self.limits = planner.robot, planner.limits(move)
        self.objective = planner.settings.objective
        self.iterations, self.converged, self.message = 0, True, ""

    def run(self) -> Result:
        """Baselines, candidates, choice."""
        self.p._build_seconds = 0.0
        begin = time.perf_counter()
        self.timing = self._first_timing()
        retimed = self._retimed(held=self.move.mode == "retime")
        candidates: list[tuple[str, Trajectory]] = []
        if self.objective == "time" and self.move.mode == "retime" and self.timing is not None:
            timing = self.timing if self.move.duration is None else self.timing.slowed(self.move.duration)
            candidates.append(("retime", timing.trajectory(self.robot.joints)))
        elif retimed is not None:
            candidates.append(("retime", retimed.trajectory))
        if self.move.mode == "reshape" and not self._stands_still():
            curve = self._reshaped(retimed)
            if curve is not None:
                candidates.insert(0, ("reshape", curve))
        duration = self._duration(candidates)
        build = self.p._build_seconds + (retimed.build_seconds if retimed else 0.0)
        solve = time.perf_counter() - begin - build
        return self._result(candidates, retimed, duration, build, solve)

    def _stands_still(self) -> bool:
        move = self.move
        return bool(not move.via and np.abs(move.goal - move.start).max() < 1e-12 and not np.any(move.end_velocities))

    def _first_timing(self) -> Timing | None:
        """TOPP-RA's timing of the first path; a reshaped move may do without one."""
        try:
            return self.p._fastest(self.move)
        except Infeasible:
            if self.move.mode == "retime":
                raise
            return None

    def _retimed(self, held: bool) -> RetimeSolution | None:
        """The least energy on the first path; None where the duration is too short. With `held`, judged and mended."""
        move = self.move
        if self.timing is None:
            return None
        wanted = move.duration if move.duration is not None else move.max_duration
        shortest = self.timing.duration
        if move.mode == "reshape" and wanted is not None and self.timing.path.moves and wanted < shortest * (1 - 1e-9):
            return None
        path = self.p._path(move)
        tight = self.limits
        timing = self.timing
        for _ in range(3):
            try:
                solution = retime(
                    self.robot, self.p.model, path, duration=move.duration, max_duration=move.max_duration,
                    shortest=timing, limits=tight,
                )  # fmt: skip
            except Infeasible:
                if move.mode == "retime":
                    raise
                return None
            if not held:  # a start and a candidate, judged as such
                return solution
            self.iterations += solution.iterations
            if move.mode == "retime":
                self.converged, self.message = solution.converged, solution.message
            certificate = self.p.certify(solution.trajectory, move)
            if certificate.valid:
                return solution
            tight = certificate.tightened(tight)
            timing = self.p._fastest(move, tight)
        if move.mode == "retime":
            self.converged, self.message = False, self._broken("retimed", certificate)
        return solution

    def _reshaped(self, retimed: RetimeSolution | None) -> Trajectory | None:
        move, p = self.move, self.p
        free_time = self.objective == "time"
        task = self._task(None if free_time else move.duration)
        lines = self._lines(retimed, task)
        reshaper = p._reshaper(self.objective)
        best, spent = reshaper.search(task, lines, p.settings.starts, p.settings.seed, p._stopped)
        self.iterations += spent
        if best is None and not p._stopped():
            best = self._from_the_fastest(reshaper, task, lines, retimed is not None)
        if best is None:
            self.converged, self.message = False, "no start of the reshaping led to a trajectory within limits"
            return None
        best, trajectory, certificate = self._mended(reshaper, best, task)
        if free_time and move.duration is not None:
            if trajectory.duration > move.duration * (1 + 1e-9):
                raise self._too_short(trajectory.duration, certificate)
            trajectory = trajectory_of(replace(best.curve, duration=move.duration), self.robot.joints)
        if not certificate.valid:
            self.converged, self.message = False, self._broken("reshaped", certificate)
            return None
        if not best.converged:
            self.converged, self.message = False, f"IPOPT stopped with {best.status}"
        return trajectory

    @staticmethod
    def _broken(how: str, certificate: Certificate) -> str:
        worst = certificate.worst
        return (
            f"the {how} move breaks the {worst['limit']} limit of {worst['joint']} at {worst['time']:.4g} s by "
            f"{certificate.violation:.1e} of its bound; kept the best trajectory within limits"
        )

    def _task(self, duration: float | None) -> Task:
        move = self.move
        shortest = self._reference_time()
        if duration is not None:
            durations = (duration, duration)
        else:
            durations = (SHORTEST * shortest, move.max_duration or LONGEST * shortest)
            durations = (min(durations), durations[1])
        v_start, v_goal = move.end_velocities
        via = np.array(move.via).reshape(len(move.via), self.robot.n)
        ends = Ends(np.asarray(move.start), np.asarray(move.goal), v_start, v_goal, via)
        offset = 0.0 if duration is None else self.p.model.constant_power(self.robot.n)
        return Task(ends, self.limits, self.p._values, durations, offset if self.objective == "energy" else 0.0)

    def _reference_time(self) -> float:
        if self.timing is not None and self.timing.path.moves:
            return self.timing.duration
        way = np.abs(self.move.goal - self.move.start)
        shortest = [float((way / limit.bound).max()) ** (1 / limit.order) for limit in self.limits if limit.order]
        return max(2 * max(shortest), 0.1)

    def _lines(self, retimed: RetimeSolution | None, task: Task) -> list[tuple[np.ndarray, np.ndarray, float]]:
        """First guesses: trajectories handed in, the least-energy timing of the first path, TOPP-RA's."""
        known = list(self.warm)
        if self.move.input is not None:
            known.append(self.move.input)
        if retimed is not None:
            known.append(retimed.trajectory)
        elif self.timing is not None:
            known.append(self.timing.trajectory(self.robot.joints))
        lines = [((t.time - t.time[0]) / t.duration, t.position, t.duration) for t in known]
        if not lines:
            u = np.linspace(0, 1, 200)
            way = np.vstack([self.move.start, *self.move.via, self.move.goal])
            s = u**3 * (10 - 15 * u + 6 * u**2) * (len(way) - 1)
            q = np.column_stack([np.interp(s, np.arange(len(way)), way[:, j]) for j in range(self.robot.n)])
            lines.append((u, q, float(np.clip(2 * self._reference_time(), *task.durations))))
        return lines

    def _mended(self, reshaper: Reshaper, best: Outcome, task: Task) -> tuple[Outcome, Trajectory, Certificate]:
        """Tighten the limits that the judge finds broken, and solve again from where we are."""
        limits = self.limits
        for mend in range(MENDS + 1):
            trajectory = trajectory_of(best.curve, self.robot.joints)
            certificate = self.p.certify(trajectory, self.move)
            if certificate.valid or mend == MENDS or self.p._stopped():
                break
            limits = certificate.tightened(limits)
            mended = reshaper.polish(best, replace(task, limits=limits))
            self.iterations += mended.iterations
            best = mended
        return best, trajectory, certificate

    def _from_the_fastest(
        self, reshaper: Reshaper, task: Task, lines: list[tuple[np.ndarray, np.ndarray, float]], fallback: bool
    ) -> Outcome | None:
        """The move started from the fastest one, where the usual starts led nowhere.

        Raises:
            Infeasible: there is no `fallback`, and the fastest move takes longer than is asked for, or breaks a limit
                however slow it is.
        """
        fast = self.p._reshaper("time")
        shortest = self._reference_time()
        free = replace(task, durations=(SHORTEST * shortest, LONGEST * max(shortest, task.durations[1])), offset=0.0)
        longer = [(u, q, 3 * max(shortest, d)) for u, q, d in lines]
        best, spent = fast.search(free, longer, 2, self.p.settings.seed, self.p._stopped)
        self.iterations += spent
        if best is None:
            if fallback or self.p._stopped():
                return None
            worst = self.p.certify(self._slow(lines[0]), self.move).worst
            raise Infeasible(
                f"{worst['joint']}: the {worst['limit']} limit {worst['bound']:.4g} cannot be held even by a slow move "
                f"(value {worst['value']:.4g} at {worst['time']:.4g} s)",
                joint=str(worst["joint"]),
                limit=str(worst["limit"]),
            )
        best, trajectory, certificate = self._mended(fast, best, free)
        if trajectory.duration > task.durations[1] * (1 + 1e-9):
            if fallback:
                return None
            raise self._too_short(trajectory.duration, certificate)
        duration = float(np.clip(trajectory.duration, *task.durations))
        found = reshaper.polish(replace(best, curve=replace(best.curve, duration=duration)), task)
        return found if found.broken <= FEASIBLE else replace(found, curve=replace(best.curve, duration=duration))

    def _too_short(self, shortest: float, certificate: Certificate) -> Infeasible:
        wanted = self.move.duration if self.move.duration is not None else self.move.max_duration
        worst = certificate.worst
        return Infeasible(
            f"a duration of {wanted:.6g} s is too short: the shortest found is {shortest:.6g} s, where the "
            f"{worst['limit']} limit of {worst['joint']} binds at {worst['time']:.4g} s",
            joint=str(worst["joint"]),
            limit=str(worst["limit"]),
            excess=shortest / float(wanted or shortest) - 1,
            shortest_duration=shortest,
        )

    def _slow(self, line: tuple[np.ndarray, np.ndarray, float]) -> Trajectory:
        u, q, duration = line
        t = 20 * duration * u
        v = np.gradient(q, t, axis=0)
        return Trajectory(self.robot.joints, t, q, v, np.gradient(v, t, axis=0))

    def _duration(self, candidates: list[tuple[str, Trajectory]]) -> float:
        if self.move.duration is not None:
            return self.move.duration
        return candidates[0][1].duration if candidates else self._reference_time()

    def _baselines(self, duration: float) -> list[Baseline]:
        trajectories: list[tuple[str, Trajectory]] = []
        if self.timing is not None:
            trajectories.append(("toppra", self.timing.trajectory(self.robot.joints)))
            trajectories.append(("scaled", self.timing.slowed(duration).trajectory(self.robot.joints)))
        if self.move.input is not None:
            trajectories.append(("input", self.move.input))
        return [
            Baseline(name, self.p._scorer.filled(t), self.p.score(t), self.p.certify(t, self.move).violation)
            for name, t in trajectories
        ]

    def _result(
        self,
        candidates: list[tuple[str, Trajectory]],
        retimed: RetimeSolution | None,
        duration: float,
        build: float,
        solve: float,
    ) -> Result:
        baselines = self._baselines(duration)
        if self.objective == "energy":  # a proxy's answer is what it is; it is not exchanged for a better one
            candidates += [(b.name, b.trajectory) for b in baselines]
            candidates += [("warm", t) for t in self.warm]
        judged = self._judged(candidates)
        promised = np.inf if retimed is None or self.move.mode != "reshape" else retimed.energy
        if self.objective == "energy" and promised < min((j[2].total for j in judged), default=np.inf):
            mended = self._retimed(held=True)  # it would be the best but for a limit that it breaks by a hair
            judged += [] if mended is None else self._judged([("retime", mended.trajectory)])
        if not judged:
            raise Infeasible(self.message or "no trajectory within limits was found", limit="duration")
        wanted = self.move.mode if self.objective != "energy" else None
        name, trajectory, energy, certificate = min(
            judged, key=lambda j: (j[0] != wanted, j[2].total) if wanted else (False, j[2].total)
        )
        if abs(trajectory.duration - duration) > 1e-9:
            baselines = self._baselines(trajectory.duration)
        interrupted = self.p._stopped()
        optimality = Optimality("local")
        if name == "retime" and retimed is not None and retimed.lower_bound is not None and self.move.mode == "retime":
            bound = retimed.lower_bound
            gap = 100 * (energy.total - bound) / max(abs(energy.total), 1e-12)
            optimality = Optimality(retimed.kind, bound, gap)
        report = SolverReport(self.p.settings.solver, self.iterations, build, solve, self.p._compiled)
        warnings = list(self.robot.warnings)
        if self.p.model.assumed:
            warnings.append(
                f"{self.robot.name}: electrical values are assumed (those of the Panda); give --model for its own"
            )
        meter = [effect.name for effect in self.p.model.effects if effect.stage == "meter"]
        if meter:
            warnings.append(f"{', '.join(meter)}: of the meter, not of the arm; left out of all energies")
        return Result(
            status="solved" if self.converged and not interrupted else "not_converged",
            robot=self.robot.name,
            mode=self.move.mode,
            chosen=name,
            trajectory=self.p._scorer.filled(trajectory),
            energy=energy,
            baselines=tuple(baselines),
            certificate=certificate,
            optimality=optimality,
            solver=report,
            message="interrupted; the best so far" if interrupted else self.message,
            interrupted=interrupted,
            warnings=tuple(warnings),
        )

    def _judged(self, candidates: list[tuple[str, Trajectory]]) -> list[tuple[str, Trajectory, Energy, Certificate]]:
        """The candidates that answer what is asked within all limits, with energy and certificate."""
        answers = ((name, t, self.p.certify(t, self.move)) for name, t in candidates if self._answers(t))
        return [(name, t, self.p.score(t), certificate) for name, t, certificate in answers if certificate.valid]

    def _answers(self, trajectory: Trajectory) -> bool:
        """Does a trajectory begin, end and last as asked?"""
        move, d = self.move, trajectory.duration
        ends = np.abs(np.stack([trajectory.position[0] - move.start, trajectory.position[-1] - move.goal])).max()
        if ends > 1e-9:
            return False
        v = trajectory.velocity[[0, -1]] - np.stack(move.end_velocities)
        if np.abs(v).max() > 1e-9:
            return False
        if move.duration is not None:
            return bool(abs(d - move.duration) <= 1e-9 * move.duration)
        return move.max_duration is None or d <= move.max_duration * (1 + 1e-9)
