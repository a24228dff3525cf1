"""The cheapest of many goals: all branches are looked at, the most promising are solved, freedom that is left is used.

reach       every joint goal that the poses and goals allow
estimate    what the straight move to each is likely to cost; goals that touch something are dropped
solve       the most promising, no two of them near each other
refine      where the pose leaves freedom, steps along it from the best, each a solve from the best known motion
compare     the goal nearest to the start, at the duration of the answer: that is the saving to state
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.cell.cell import Cell, Contact
from energy_opt.errors import BadInput, Infeasible
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.move import Move
from energy_opt.motion.result import Result
from energy_opt.motion.trajectory import Trajectory
from energy_opt.poses.estimate import estimate, fastest, shortest
from energy_opt.poses.inverse import ToolKinematics, reach, solve
from energy_opt.poses.pose import Pose

SOLVED = 4  # goals that are solved before refining, at most
HOPE = 2.0  # a goal is solved if its estimate, less this many of the largest gain so far, is below the best energy
EQUAL = 1e-5  # relative: goals with estimates nearer than this differ by a joint that costs nothing
WORTH = 1e-3  # of the loss: a step along the freedom that saves less ends refining
APART = 0.35  # [rad, m] distance of goals that are solved both
LISTED = 40  # goals that an answer lists
REFINED = 4  # solves along the freedom that is left
STEP = 0.25  # [rad, m] of the first of them
FLAT = 1e-6  # singular values of the pose's Jacobian below this share leave a direction free

Solve = Callable[[Move, Sequence[Trajectory]], Result]


@dataclass(frozen=True)
class Candidate:
    """A joint goal that was looked at.

    Attributes:
        goal: (n,) [rad, m]; estimate: [J] of the straight move; energy: [J] as solved, None where it was not.
        status: "solved" and so on as results have it, "looked_at", "colliding", "too_fast" or "infeasible".
    """

    goal: np.ndarray
    estimate: float
    energy: float | None = None
    status: str = "looked_at"

    def document(self) -> dict[str, object]:
        """As it is in result.json."""
        return {"goal": self.goal, "estimate": self.estimate, "energy": self.energy, "status": self.status}


@dataclass(frozen=True)
class Chosen:
    """The cheapest goal and its motion.

    Attributes:
        move: with that goal; result: its motion.
        candidates: the answer's first, then by energy and estimate.
        nearest: the goal nearest to the start; nearest_result: its motion at the answer's duration, None where it has
            none.
        solves: how many moves were solved.
    """

    move: Move
    result: Result
    candidates: tuple[Candidate, ...]
    nearest: np.ndarray
    nearest_result: Result | None
    solves: int

    def document(self) -> dict[str, object]:
        """`candidates` and `nearest` of result.json; energies in J, those of several models in the mean."""
        near, best = self.nearest_result, self.result
        saved = None if near is None else price(near) - price(best)
        return {
            "candidates": [candidate.document() for candidate in self.candidates],
            "nearest": {
                "goal": self.nearest,
                "energy": None if near is None else price(near),
                "loss": None if near is None else near.energy.loss,
                "duration": best.trajectory.duration,
                "saving_joules": saved,
                "saving_loss_percent": None
                if near is None or near.energy.loss <= 0
                else 100 * (1 - best.energy.loss / near.energy.loss),
            },
        }


def price(result: Result) -> float:
    """What goals are compared by [J]: the energy, of several models in the mean."""
    totals = [float(str(model["total"])) for model in result.models]
    return float(np.mean(totals)) if totals else result.energy.total


class Chooser:
    """Chooses among goals for one robot.

    Args:
        scorers: of the models that are planned under.
        cell: what goals must keep clear of; None for nothing.
        solver: solves a move, given motions to start from.
    """

    def __init__(
        self, tool: ToolKinematics, scorers: Sequence[Scorer], cell: Cell | None, solver: Solve, seed: int = 0
    ) -> None:
        self.tool, self.scorers, self.seed = tool, list(scorers), seed
        self.cell = cell if cell is not None and cell.checks else None
        self._solver = solver
        self.solves = 0

    def choose(self, move: Move, goals: Sequence[Pose | np.ndarray]) -> Chosen:
        """The cheapest motion from the move's start to any of the goals.

        Args:
            move: its goal is ignored.
            goals: poses of the tool, or joint positions (n,).

        Raises:
            Infeasible: no goal can be reached, or none without touching something, or none in the time.
        """
        if not goals:
            raise BadInput("--goal is missing; give --goal or --goal-pose")
        found = self._candidates(move, goals)
        order = np.argsort([c.estimate if c.status == "looked_at" else np.inf for c in found])
        pending = [found[k] for k in order if found[k].status == "looked_at"]
        solved: list[tuple[Candidate, Result]] = []
        failures: list[Infeasible] = []
        tried: list[Candidate] = []
        for candidate in pending:
            if len(solved) >= SOLVED:
                break
            energies = [c.energy or np.inf for c, _ in solved]
            gain = max((c.estimate - e for (c, _), e in zip(solved, energies, strict=True)), default=np.inf)
            if candidate.estimate - HOPE * max(gain, 0.0) > min(energies, default=np.inf):
                break
            if any(_alike(candidate, other) for other in tried):
                continue
            tried.append(candidate)
            outcome = self._solved(move, candidate)
            if isinstance(outcome, Infeasible):
                failures.append(outcome)
            else:
                solved.append(outcome)
        if not solved:
            raise failures[0] if failures else self._none(move, goals, found)
        best = min(solved, key=lambda item: _rank(item[1]))
        for pose in goals:
            if isinstance(pose, Pose):
                best = self._refined(move, pose, best, solved)
        nearest = min((c for c in found if c.status == "looked_at"), key=lambda c: self._distance(move, c.goal))
        answer = self._compared(move, nearest, best, solved)
        others = sorted((c for c, _ in solved if c is not best[0]), key=lambda c: c.energy or np.inf)
        rest = [c for c in found if not any(np.array_equal(c.goal, x.goal) for x, _ in solved)]
        rest.sort(key=lambda c: (c.status != "looked_at", c.estimate))
        listed = (best[0], *others, *rest)[:LISTED]
        return Chosen(replace(move, goal=best[0].goal), best[1], listed, nearest.goal, answer, self.solves)

    def _candidates(self, move: Move, goals: Sequence[Pose | np.ndarray]) -> list[Candidate]:
        out: list[Candidate] = []
        for goal in goals:
            rows = np.atleast_2d(goal) if isinstance(goal, np.ndarray) else self._reached(goal, move)
            for q in rows:
                cost = estimate(self.scorers, move.start, q, move.duration, move.max_duration)
                out.append(Candidate(q, cost.energy, status="looked_at" if cost.possible else "too_fast"))
        # the distance check is dear: it goes in order of the estimate, until enough free ones are known
        free = 0
        for k in np.argsort([c.estimate for c in out]).tolist():
            if self.cell is None or out[k].status != "looked_at":
                continue
            if free >= 6 * SOLVED and len(out) > 12 * SOLVED:
                out[k] = replace(out[k], status="not_looked_at")
            elif self.cell.touching(out[k].goal) is None:
                free += 1
            else:
                out[k] = replace(out[k], status="colliding")
        return out

    def _reached(self, pose: Pose, move: Move) -> np.ndarray:
        found = reach(self.tool, pose, seed=self.seed, near=move.start)
        if len(found.positions):
            return found.positions
        held = f"; {found.blocked} is at its limit there" if found.blocked else ""
        raise Infeasible(
            f"{pose.name}: no joint positions reach it; the nearest that can be reached is "
            f"{1e3 * found.distance:.3g} mm and {np.degrees(found.angle):.3g} deg away{held}",
            joint=found.blocked or None,
            limit="pose",
        )

    def _solved(
        self, move: Move, candidate: Candidate, warm: Sequence[Trajectory] = ()
    ) -> tuple[Candidate, Result] | Infeasible:
        self.solves += 1
        try:
            result = self._solver(replace(move, goal=candidate.goal), warm)
        except Infeasible as error:
            return error
        return replace(candidate, energy=price(result), status=result.status), result

    def _refined(
        self, move: Move, pose: Pose, best: tuple[Candidate, Result], solved: list[tuple[Candidate, Result]]
    ) -> tuple[Candidate, Result]:
        """Steps along the directions that the pose leaves free, while they save."""
        if not pose.free and len(move.start) <= 6:
            return best
        step, left = STEP, REFINED
        while left > 0 and step > 0.02:
            directions = self._free(pose, best[0].goal)
            if not len(directions):
                return best
            # the cheapest few of the ways to step, by the estimate's change
            trials = [best[0].goal + sign * step * d for d in directions for sign in (1.0, -1.0)]
            q, error = solve(self.tool, pose, np.clip(trials, *self._range()))
            q = q[error < pose.tolerance[0]]
            if not len(q):
                return best
            costs = [estimate(self.scorers, move.start, x, best[1].trajectory.duration, None) for x in q]
            if max(abs(cost.energy - best[0].estimate) for cost in costs) < EQUAL * abs(best[0].estimate):
                return best  # the freedom that is left costs nothing
            better = None
            for k in np.argsort([cost.energy for cost in costs])[:2].tolist():
                if left <= 0 or not costs[k].possible:
                    continue
                if self.cell is not None and self.cell.touching(q[k]) is not None:
                    continue
                left -= 1
                outcome = self._solved(move, Candidate(q[k], costs[k].energy), [best[1].trajectory])
                if isinstance(outcome, Infeasible):
                    continue
                solved.append(outcome)
                if _rank(outcome[1]) < _rank(best[1]):
                    better = outcome
                    break
            if better is None:
                step /= 2.5
                continue
            gain, best = price(best[1]) - price(better[1]), better
            if gain < WORTH * best[1].energy.loss:
                break
        return best

    def _free(self, pose: Pose, q: np.ndarray) -> np.ndarray:
        """Unit directions (K, n) along which the pose's error stays zero."""
        n = len(q)
        steps = np.vstack([q, q + 1e-6 * np.eye(n)])
        e = self.tool.missed(pose, steps).both
        jacobian = (e[1:] - e[0]).T / 1e-6
        _, s, vt = np.linalg.svd(jacobian)
        rank = int(np.sum(s > FLAT * max(s.max(), 1e-12) + 1e-5))
        return vt[rank:]

    def _range(self) -> tuple[np.ndarray, np.ndarray]:
        limits = self.tool.robot.limits
        return limits.lower, limits.upper

    def _distance(self, move: Move, goal: np.ndarray) -> float:
        return shortest(self.tool.robot, move.start, goal)

    def _compared(
        self, move: Move, nearest: Candidate, best: tuple[Candidate, Result], solved: list[tuple[Candidate, Result]]
    ) -> Result | None:
        """The motion to the nearest goal, at the duration of the answer."""
        if np.array_equal(nearest.goal, best[0].goal):
            return best[1]
        duration = best[1].trajectory.duration
        for candidate, result in solved:
            same = abs(result.trajectory.duration / duration - 1) < 1e-9
            if same and np.array_equal(candidate.goal, nearest.goal):
                return result
        at = replace(move, duration=duration, max_duration=None)
        outcome = self._solved(at, nearest)
        if isinstance(outcome, Infeasible):
            return None
        if move.duration is not None:
            solved.append(outcome)
        return outcome[1]

    def _none(self, move: Move, goals: Sequence[Pose | np.ndarray], found: Sequence[Candidate]) -> Infeasible:
        name = next((goal.name for goal in goals if isinstance(goal, Pose)), "--goal")
        touching = [c for c in found if c.status == "colliding"]
        if touching and self.cell is not None:
            contact: Contact | None = self.cell.touching(touching[0].goal)
            text = f"{name}: every joint position that reaches it touches something; {contact}"
            return Infeasible(text, limit="clearance")
        if not found:
            return Infeasible(f"{name}: no joint positions reach it", limit="pose")
        least = min(fastest(self.tool.robot, move.start, c.goal) for c in found)
        return Infeasible(
            f"{name}: no goal is reached in {move.duration or move.max_duration or 0.0:.4g} s; "
            f"the nearest takes {least:.4g} s at least",
            limit="duration",
            shortest_duration=least,
        )


def _alike(one: Candidate, two: Candidate) -> bool:
    """Are two goals near each other, or do their moves cost the same?"""
    near = bool(np.abs(one.goal - two.goal).max() < APART)
    return near or abs(one.estimate - two.estimate) < EQUAL * abs(two.estimate)


def _rank(result: Result) -> tuple[bool, float]:
    return result.status != "solved", price(result)
