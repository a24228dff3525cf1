"""Arms in one cycle: moves, schedule and proof between the arms, repeated until they are consistent.

arrange      every move slowed evenly; candidates: orders of steps and poses to wait in, ranked by their energy
price        every move of a candidate optimized at a few durations
schedule     durations, modes and starts of least energy on the lower hull of known energies
refine       optimize every move at its scheduled duration; repeated while the cycle's energy changes by 0.1 %
prove        every two arms, for the whole cycle and for lateness; if two touch, the times at which their steps
             may not meet become a constraint, and scheduling is repeated with the known durations; if there is no
             such schedule, one of the two moves is led around the moving other arm
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.jobs.cycle import Answer
from energy_opt.schedule import UNDECIDED, Exclusion, Run, Schedule, solve
from energy_opt.workcell.arm import SOLVED, Arm
from energy_opt.workcell.around import Other, move_around
from energy_opt.workcell.between import Between, TwoArms, conflicting_parts, prove_apart
from energy_opt.workcell.motion import ArmMove, Part, PeriodicMotion, nearest
from energy_opt.workcell.stage import SECONDS, Candidate, Levers, Stage, with_lever

SETTLED = 1e-3  # relative change of the cycle's energy that ends refining
REFINED = 6  # most schedules whose durations are optimized
AROUND = 6  # most moves that are led around others
LONGER = (1.1, 1.25, 1.5, 2.0, 3.0)  # multiples of the cycle time to try if it is too short
SHIFTED = 30  # most schedules to try until no two arms touch


@dataclass(frozen=True)
class Planned:
    """A cell's plan.

    Attributes:
        schedule: with durations at which every move is solved.
        clearance: of every two arms.
        motions: of every arm over its cycle; None for a robot with only curves.
        around: moves that go around another arm, as `robot.step`.
    """

    schedule: Schedule
    clearance: tuple[Between, ...]
    motions: tuple[PeriodicMotion | None, ...]
    around: tuple[str, ...] = ()

    def parts_at(self, between: Between) -> list[Part]:
        """The parts of the two robots that run at the time of a distance between them."""
        time = between.time or 0.0
        both = zip(between.robots, (time, time + between.late), strict=True)
        return [motion.part_at(at) for r, at in both if (motion := self.motions[r]) is not None]


class Planning(Stage):
    """The schedule and motions of a cell with arms; arguments are those of `Stage`."""

    @cached_property
    def _pairs_of_arms(self) -> dict[tuple[int, int], TwoArms]:
        """Every two arms that both have a body, by their robots' numbers."""
        out = {}
        for (a, one), (b, two) in combinations(enumerate(self.arms), 2):
            if one is None or two is None or one.cell is None or two.cell is None:
                continue
            arms = TwoArms(one.cell, two.cell)
            if not len(arms.bodies.pairs):
                continue
            out[a, b] = arms
            if one.request.clearance is None:
                both = product(*(zip(arm.job.steps, arm.table.step, strict=True) for arm in (one, two)))
                ends = [
                    np.concatenate([first.goal, second.goal])
                    for (first, here), (second, there) in both
                    if first.stop and second.stop and (here.zone is None or here.zone != there.zone)
                ]
                out[a, b] = arms.at_rest_in(np.array(ends)) if ends else arms
        return out

    def _price(self) -> None:
        """Optimize every move at the first durations."""
        moves = [(arm, move) for arm in self.arms if arm is not None for move in arm.moves]
        for k, (arm, move) in enumerate(moves):
            self.progress(f"{arm.name}: {move.leg.name}", 0.2 + 0.3 * k / max(len(moves), 1))
            for factor in SOLVED:
                if not self.stopped():
                    arm.optimize(move, min(move.shortest * factor, move.longest))

    def plan(self, candidates: Sequence[Candidate]) -> tuple[Planned, Levers]:
        """The plan of least energy in which no two arms touch, and the levers of its arrangement.

        Candidates are estimated by evenly slowed moves. Here each is scheduled with optimized ones; they are planned in
        the order of these energies, until none of the others takes less than a plan.

        Raises:
            Infeasible: no schedule keeps cycle time, lags, zones and the arms apart; names the two steps.
        """
        faults: list[Infeasible] = []
        priced: list[tuple[Schedule, Candidate]] = []
        for candidate in candidates:
            self.arms = candidate.arms
            try:
                self._price()
                priced.append((self._refined(), candidate))
            except Infeasible as error:
                faults.append(error)
        best: tuple[bool, float, Planned, Levers, tuple[Arm | None, ...]] | None = None
        for schedule, candidate in sorted(priced, key=lambda pair: pair[0].energy):
            if best is not None and (not best[0], schedule.energy) >= (True, best[1]):
                break
            self.arms, self.exclusions = candidate.arms, {}
            try:
                found = self._planned(schedule)
            except Infeasible as error:
                faults.append(error)
                continue
            touching = any(between.verdict != "proven" for between in found.clearance)
            if best is None or (touching, found.schedule.energy) < best[:2]:
                best = touching, found.schedule.energy, found, candidate.levers, self.arms
        if best is None:
            raise faults[-1]
        self.arms = best[-1]
        return best[2], with_lever(best[3], "paths", best[2].schedule)

    def slower(self, r: int, name: str, duration: float) -> Planned | None:
        """The plan in which a robot's step takes longer; None if there is none.

        Args:
            r: index of the robot. name: of the step. duration: [s] that it takes at least.
        """
        before = self.arms, dict(self.exclusions), dict(self.least)
        step = next(step for step in self.problem(True).rings[r].steps if step.name == name)
        if duration <= step.most:
            self.least[r, name] = duration
            with suppress(Infeasible):
                found = self._planned(self._refined())
                if all(between.verdict == "proven" for between in found.clearance):
                    return found
        self.arms, self.exclusions, self.least = before
        return None

    def _planned(self, schedule: Schedule) -> Planned:
        """The plan of a schedule; where arms touch, their times are kept apart and scheduling is repeated."""
        for _ in range(SHIFTED):
            found = self.proved(schedule)
            touching = [between for between in found.clearance if between.verdict != "proven"]
            if not touching or self.stopped():
                return found
            self.progress("times that keep the arms apart", 0.9)
            before = dict(self.exclusions)
            for between in touching:
                self._keep_apart(between, found)
            if self.exclusions == before:
                return found
            try:
                schedule = self._scheduled(self._durations(schedule))
            except Infeasible:
                try:
                    schedule = self._refined()
                except Infeasible:
                    wanted, self.exclusions = self.exclusions, before
                    around = self._led_around(found)
                    if around is None:
                        raise self._collision(found, touching[0], wanted) from None
                    return around
        return found

    def _led_around(self, found: Planned) -> Planned | None:
        """The plan with moves around other arms in their motion; None if none was found."""
        around: list[str] = []
        self.arms = tuple(None if arm is None else arm.own_answers() for arm in self.arms)
        for turn in range(AROUND):
            touching = [between for between in found.clearance if between.verdict != "proven"]
            if not touching or self.stopped():
                return replace(found, around=tuple(around)) if not touching else None
            self.progress("paths around other arms", 0.9)
            name = self._reshape_around(touching[0], found, turn)
            if name is None:
                return None
            around.append(name)
            found = self.proved(self._priced(found.schedule))
        return None

    def _reshape_around(self, between: Between, found: Planned, turn: int) -> str | None:
        """Lead one of two touching moves around all other arms; its name, or None if neither is possible."""
        both = list(zip(between.robots, found.parts_at(between), strict=True))
        for r, part in both if turn % 2 == 0 else reversed(both):
            arm = self.arms[r]
            move = next((m for m in arm.moves if arm.names[m.place] == part.name), None) if arm else None
            if arm is None or move is None:
                continue
            others: list[Other] = []
            for k, (other, moves) in enumerate(zip(self.arms, found.motions, strict=True)):
                pair = self._pairs_of_arms.get((min(r, k), max(r, k)))
                if pair is not None and other is not None and other.cell is not None and moves is not None:
                    others.append((other.cell, moves, pair.clearance if r < k else pair.clearance.T))
            answer = move_around(arm, move, part.start, part.duration, others, self.cell.jitter, turn)
            if answer is not None:
                move.answers[nearest(move.answers, part.duration)] = answer
                return f"{arm.name}.{part.name}"
        return None

    def stated(self, schedule: Schedule) -> Schedule:
        """A schedule with its energies under the first of several models."""
        return self._priced(schedule.stated, lambda arm, move, answer: arm.scoring.stated(move.leg.step, answer))

    def _priced(
        self,
        schedule: Schedule,
        energy_of: Callable[[Arm, ArmMove, Answer], float] = lambda arm, move, answer: answer.energy.total,
    ) -> Schedule:
        """A schedule with the moves' present energies."""
        energies = [energy.copy() for energy in schedule.energies]
        for r, (arm, ring) in enumerate(zip(self.arms, schedule.problem.rings, strict=True)):
            names = [step.name for step in ring.steps]
            if arm is None:
                continue
            for move in arm.moves:
                k = names.index(arm.names[move.place])
                energies[r][k] = energy_of(arm, move, move.answers[nearest(move.answers, schedule.durations[r][k])])
        return replace(schedule, energies=tuple(energies))

    def _scheduled(self, hold: Sequence[dict[int, float]] | None = None) -> Schedule:
        """The schedule in the present state, to a gap of 1e-5; `hold` fixes durations [s] by step."""
        return solve(self.problem(True, hold), seconds=SECONDS, gap=1e-5)

    def _refined(self) -> Schedule:
        """A schedule whose moves are all optimized at their scheduled durations."""
        for k in range(REFINED):
            self.progress("schedule", 0.5 + 0.4 * k / REFINED)
            schedule = self._scheduled()
            if not self._optimize(schedule):
                break
        return self._scheduled(self._durations(schedule))

    def _optimize(self, schedule: Schedule) -> bool:
        """Optimize every move at its scheduled duration; True if anything was done.

        If it already is, optimize between this duration and its neighbours where that may save more than its share of
        `SETTLED`.
        """
        durations = self._durations(schedule)
        moves = [
            (arm, m, durations[r][m.place]) for r, arm in enumerate(self.arms) if arm is not None for m in arm.moves
        ]
        worth = SETTLED * abs(schedule.energy) / max(len(moves), 1)
        done = False
        for arm, move, duration in moves:
            for at in move.beside(duration, worth) if move.was_tried(duration) else [duration]:
                if not self.stopped():
                    done |= arm.optimize(move, at)
        return done

    def _durations(self, schedule: Schedule) -> list[dict[int, float]]:
        """Durations of the arms' moves, by step; none of a robot with only curves."""
        out: list[dict[int, float]] = []
        for arm, ring, lengths in zip(self.arms, schedule.problem.rings, schedule.durations, strict=True):
            by_name = dict(zip((step.name for step in ring.steps), lengths.tolist(), strict=True))
            out.append({m.place: by_name[arm.names[m.place]] for m in arm.moves} if arm is not None else {})
        return out

    def proved(self, schedule: Schedule) -> Planned:
        """A schedule with its motions and the proof between every two arms."""
        motions = tuple(
            None if arm is None else PeriodicMotion(arm.parts(ring, starts, lengths), self.cell.cycle_time)
            for arm, ring, starts, lengths in zip(
                self.arms, schedule.problem.rings, schedule.starts, schedule.durations, strict=True
            )
        )
        clearance = []
        for (a, b), arms in self._pairs_of_arms.items():
            self.progress(f"proof: {self.cell.robot[a].name} and {self.cell.robot[b].name}", 0.9)
            one, two = motions[a], motions[b]
            assert one is not None and two is not None
            clearance.append(prove_apart(arms, (a, b), one, two, self.cell.jitter))
        return Planned(schedule, tuple(clearance), motions)

    def _keep_apart(self, between: Between, found: Planned) -> None:
        """Add the times at which the two touching steps may not meet."""
        a, b = between.robots
        rings, parts = found.schedule.problem.rings, found.parts_at(between)
        i, j = ([s.name for s in rings[r].steps].index(part.name) for r, part in zip((a, b), parts, strict=True))
        runs = conflicting_parts(self._pairs_of_arms[a, b], parts[0], parts[1])
        key = (a, i, b, j)
        known = self.exclusions.get(key)
        first, second = (Run(r, k, k, part) for r, k, part in zip((a, b), (i, j), runs, strict=True))
        if known is not None:
            first, second = _union_of_runs(known.first, first), _union_of_runs(known.second, second)
            if (first, second) == (known.first, known.second):  # it did not suffice: exclude the whole steps
                first, second = Run(a, i, i), Run(b, j, j)
        self.exclusions[key] = Exclusion(first, second, 2 * self.cell.jitter)

    def _collision(
        self, found: Planned, between: Between, wanted: dict[tuple[int, int, int, int], Exclusion]
    ) -> Infeasible:
        """The error that neither times nor paths keep two arms apart, with the steps, the time, and a remedy."""
        time, names = between.time or 0.0, [self.cell.robot[r].name for r in between.robots]
        steps = [part.name for part in found.parts_at(between)]
        bodies = "" if between.pair is None else f" ({between.pair[0]} and {between.pair[1]})"
        self.exclusions = wanted
        problem = self.problem(True)
        poses = "other poses, or a larger distance of the bases, may help"
        help_ = f"nor does a cycle of {LONGER[-1] * self.cell.cycle_time:.4g} s; {poses}"
        for longer in LONGER:
            cycle, seconds = longer * self.cell.cycle_time, SECONDS / len(LONGER)
            try:
                solve(replace(problem, cycle_time=cycle), seconds=seconds)
            except Infeasible as error:
                if error.limit == UNDECIDED:
                    help_ = f"for a longer cycle no schedule was found in {seconds:g} s; {poses}"
                continue
            help_ = f'with `zone = "{names[0]}-{names[1]}"` in both steps and cycle_time = {cycle:.4g} it works'
            break
        near, asked = between.min_distance or 0.0, between.wanted or 0.0
        touch = f"touch at {time:.4g} s{bodies}"
        if near > 0:
            touch = (
                f"come as near as {1e3 * near:.2g} mm at {time:.4g} s{bodies}; they are to keep {1e3 * asked:.2g} mm"
            )
        return Infeasible(
            f"{names[0]}, step {steps[0]}, and {names[1]}, step {steps[1]}, {touch}; neither "
            f"other times nor a path around the other arm keep them apart: {help_}",
            limit="clearance",
            time=time,
        )


def _union_of_runs(one: Run, two: Run) -> Run:
    """A run that covers both; a whole step if one of them is."""
    if one.part is None or two.part is None:
        return Run(one.ring, one.first, one.last)
    part = min(one.part[0], two.part[0]), max(one.part[1], two.part[1])
    return Run(one.ring, one.first, one.last, part)
