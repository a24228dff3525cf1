"""The mixed-integer linear program of a cell, with convex curves as the maximum of tangents.

Variables: a start s of every step; a duration d and an energy e of every move, with e >= E(t) + E'(t) (d - t) at every
tangent t; for every mode m of a wait a binary z_m and a duration d_m with z_m l_m <= d_m <= z_m u, and sum z_m = 1; for
every zone and free lag an integer number of cycles h. Constraints: s_{i+1} = s_i + d_i; the first step of a ring
follows the last one cycle later; lags; of two runs that exclude each other one ends before the other begins:

    end_1 + gap <= start_2 + C h,    end_2 + gap <= start_1 + C (1 - h).

Blocks of a group lie between its begin and its end, whose distance is the sum of their durations; for two of them a
binary y decides which comes first:

    end_1 <= start_2 + C (1 - y),    end_2 <= start_1 + C y.

Tangents lie below a convex curve, so the program's optimum is a lower bound of the schedule's energy.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations

import highspy
import numpy as np
from highspy.highs import highs_linear_expression as Terms

from energy_opt.schedule.problem import Group, Move, Problem, Run, possible

FEASIBLE = 1e-9  # tolerance of HiGHS on constraints and integers: times are accurate to a nanosecond


@dataclass(frozen=True)
class Solution:
    """The result of HiGHS.

    Attributes:
        x: (variables,) values; None without a solution.
        bound: lower bound of all solutions [J].
        impossible: True if it was proven that there is no solution.
    """

    x: np.ndarray | None
    bound: float
    impossible: bool


@dataclass
class Program:
    """The program of a problem; tangents can be added between solves.

    Attributes:
        cost, lower, upper, integer: of every variable.
        start, duration, energy: those of (ring, step), as terms of the variables.
        choice: (z, d) of every mode of a wait.
    """

    problem: Problem
    cost: list[float] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    integer: list[int] = field(default_factory=list)
    constraints: list[Terms] = field(default_factory=list)
    start: dict[tuple[int, int], Terms] = field(default_factory=dict)
    duration: dict[tuple[int, int], Terms] = field(default_factory=dict)
    energy: dict[tuple[int, int], Terms] = field(default_factory=dict)
    choice: dict[tuple[int, int], list[tuple[Terms, Terms]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._steps()
        self._lags()
        self._exclusions()

    def solve(self, seconds: float, gap: float) -> Solution:
        """Solve the present program with HiGHS, within `seconds` [s], to a relative `gap`."""
        # the base, as Highs itself prints a banner to standard output when it is made (1.16)
        solver = highspy.Highs.__mro__[1]()
        solver.setOptionValue("output_flag", False)
        solver.setOptionValue("time_limit", max(seconds, 0.1))
        solver.setOptionValue("mip_rel_gap", gap)
        solver.setOptionValue("mip_feasibility_tolerance", FEASIBLE)
        solver.setOptionValue("primal_feasibility_tolerance", FEASIBLE)
        count = len(self.cost)
        solver.addVars(count, np.array(self.lower), np.array(self.upper))
        solver.changeColsCost(count, np.arange(count, dtype=np.int32), np.array(self.cost))
        whole = np.flatnonzero(self.integer).astype(np.int32)
        kinds = np.full(len(whole), highspy.HighsVarType.kInteger)
        if np.any(np.array(self.lower)[whole] < np.array(self.upper)[whole]):
            solver.changeColsIntegrality(len(whole), whole, kinds)
        begins = np.cumsum([0] + [len(row.idxs) for row in self.constraints])
        columns = np.array([j for row in self.constraints for j in row.idxs], dtype=np.int32)
        values = np.array([c for row in self.constraints for c in row.vals])
        low, high = np.array([row.bounds for row in self.constraints], dtype=float).T.copy()
        solver.addRows(len(low), low, high, len(columns), begins[:-1].astype(np.int32), columns, values)
        solver.run()
        info = solver.getInfo()
        if info.primal_solution_status != highspy.SolutionStatus.kSolutionStatusFeasible:
            known = highspy.HighsModelStatus
            impossible = solver.getModelStatus() in (known.kInfeasible, known.kUnboundedOrInfeasible)
            return Solution(None, np.inf, impossible)
        mixed = bool(solver.getLp().integrality_)
        bound = info.mip_dual_bound if mixed else info.objective_function_value
        return Solution(np.array(solver.getSolution().col_value), float(bound), False)

    def add_tangent(self, at: tuple[int, int], duration: float) -> None:
        """Bound the energy of a move from below by the tangent of its curve at `duration` [s]."""
        move = self.problem.rings[at[0]].steps[at[1]]
        assert isinstance(move, Move)
        value, slope = move.curve.value(duration), move.curve.slope(duration)
        self._require(self.energy[at] - slope * self.duration[at] >= value - slope * duration)

    def _require(self, constraint: Terms) -> None:
        """Add a constraint."""
        self.constraints.append(constraint.simplify())

    def _variable(self, lower: float, upper: float, cost: float = 0.0, integer: bool = False) -> Terms:
        """Add a variable with bounds and cost."""
        self.cost.append(cost)
        self.lower.append(lower)
        self.upper.append(upper)
        self.integer.append(int(integer))
        out = Terms()
        out.idxs, out.vals = [len(self.cost) - 1], [1.0]
        return out

    def _steps(self) -> None:
        """Add the start, duration, energy and mode of every step."""
        cycle = self.problem.cycle_time
        far = self._latest_start
        for r, ring in enumerate(self.problem.rings):
            for k, step in enumerate(ring.steps):
                at = (r, k)
                # the cycle begins with the first step of the first robot
                fixed = r == 0 and k == 0 and not any(group.blocks[0][0] == 0 for group in ring.groups)
                self.start[at] = self._variable(0.0 if fixed else -far, 0.0 if fixed else far)
                if isinstance(step, Move):
                    self.duration[at] = self._variable(step.least, min(step.most, cycle))
                    self.energy[at] = self._variable(-np.inf, np.inf, cost=1.0)
                    for duration in step.curve.breaks(step.least, min(step.most, cycle)):
                        self.add_tangent(at, float(duration))
                    continue
                self.choice[at] = []
                for mode in step.modes:
                    least, most = max(step.least, mode.shortest), min(step.most, cycle)
                    possible = least <= most
                    z = self._variable(0, float(possible), mode.fixed, integer=True)
                    d = self._variable(0, most if possible else 0.0, mode.power)
                    self._require(d - least * z >= 0)
                    self._require(d - most * z <= 0)
                    self.choice[at].append((z, d))
                self._require(sum((z for z, _ in self.choice[at]), Terms()) == 1)
                self.duration[at] = sum((d for _, d in self.choice[at]), Terms())
            follows = {k: self.start[r, (k + 1) % len(ring.steps)] for k in range(len(ring.steps))}
            begins = {group.blocks[0][0]: self._begin(r, group) for group in ring.groups}
            for group in ring.groups:
                for _, last in group.blocks:
                    del follows[last]
            for group in ring.groups:
                self._group(r, group, follows, begins)
            for k, next_start in follows.items():
                length = cycle if k == len(ring.steps) - 1 else 0.0  # start + duration = next start (+ one cycle)
                self._require(self.start[r, k] + self.duration[r, k] - next_start == length)

    def _begin(self, r: int, group: Group) -> Terms:
        """The variable of a group's begin; fixed at 0 if the first robot's cycle begins with it."""
        far = self._latest_start
        fixed = 0.0 if r == 0 and group.blocks[0][0] == 0 else far
        return self._variable(-fixed, fixed)

    def _group(self, r: int, group: Group, follows: dict[int, Terms], begins: dict[int, Terms]) -> None:
        """Add the blocks of a group between its begin and its end.

        Args:
            follows: by step, the variable of the time at which its successor begins; the step before the group is
                added.
            begins: the variable of the begin of every group of the ring, by its first step.
        """
        cycle, count = self.problem.cycle_time, len(self.problem.rings[r].steps)
        first, last = group.blocks[0][0], group.blocks[-1][1]
        begin = begins[first]
        blocks = [self._run(Run(r, *block)) for block in group.blocks]
        spent = sum(end - start for start, end in blocks)
        known = set(group.before)
        if last - first + 1 == count:  # a ring has no first block: it begins with the first possible one
            root = possible(group, range(len(blocks)))[0]
            known |= {(root, j) for j in range(len(blocks)) if j != root}
            self._require(spent == cycle)
        else:
            after = (last + 1) % count
            wraps = cycle if after == 0 else 0.0
            self._require(begins.get(after, self.start[r, after]) - begin - spent == -wraps)
            if (first - 1) % count in follows:  # else it is the end of another group
                follows[(first - 1) % count] = begin
        for start, end in blocks:
            self._require(start - begin >= 0)
            self._require(begin + spent - end >= 0)
        for i, j in combinations(range(len(blocks)), 2):
            y = self._variable(float((i, j) in known), float((j, i) not in known), integer=True)
            (start_i, end_i), (start_j, end_j) = blocks[i], blocks[j]
            self._require(start_j - end_i - cycle * y >= -cycle)
            self._require(start_i - end_j + cycle * y >= 0)

    @cached_property
    def _latest_start(self) -> float:
        """Bound of all starts [s], large enough for lags over several cycles."""
        cycle = self.problem.cycle_time
        fixed = ((lag.length, lag.height) for lag in self.problem.lags if lag.height is not None)
        return cycle * (len(self.problem.rings) + 1) + sum(abs(length - cycle * height) for length, height in fixed)

    def _cycles(self) -> Terms:
        """Add a whole number of cycles."""
        most = 2 * np.ceil(self._latest_start / self.problem.cycle_time) + 2
        return self._variable(-most, most, integer=True)

    def _lags(self) -> None:
        """Add the constraints of all time lags; a lag without a height gets a number of cycles."""
        cycle = self.problem.cycle_time
        for lag in self.problem.lags:
            behind = self.start[lag.end] - self.start[lag.begin]
            height: float = lag.height or 0
            if lag.height is None:
                behind += cycle * self._cycles()
                height = np.floor(lag.length / cycle)  # whole cycles within the lag itself
            if lag.within is not None:
                self._require(behind <= lag.within - cycle * height)
            if lag.begin_ends:
                behind = behind - self.duration[lag.begin]
            most = np.inf if lag.most is None else lag.most - cycle * height
            self._require(behind == [lag.length - cycle * height, most])

    def _exclusions(self) -> None:
        """Add the constraints that two runs never overlap: one ends before the other begins, in some cycle."""
        cycle = self.problem.cycle_time
        for pair in self.problem.exclusions:
            cycles = self._cycles()
            (begin_1, end_1), (begin_2, end_2) = map(self._run, (pair.first, pair.second))
            # end_1 + gap <= begin_2 + C h and end_2 + gap <= begin_1 + C (1 - h)
            for begin, end, sign, length in (begin_2, end_1, 1.0, 0.0), (begin_1, end_2, -1.0, cycle):
                self._require(begin - end + sign * cycle * cycles >= pair.gap - length)

    def _run(self, run: Run) -> tuple[Terms, Terms]:
        """Begin and end of a run (the end in the same cycle as the begin)."""
        start = self.start[run.ring, run.first]
        if run.part is not None:
            length = self.duration[run.ring, run.first]
            return start + run.part[0] * length, start + run.part[1] * length
        count = len(self.problem.rings[run.ring].steps)
        steps = ((run.first + k) % count for k in range((run.last - run.first) % count + 1))
        return start, start + sum(self.duration[run.ring, step] for step in steps)
