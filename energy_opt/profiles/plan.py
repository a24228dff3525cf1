"""The standard moves with the least energy for a move, and the share of a free trajectory's saving that they keep.

Planes keep them clear of the arm's own body and its cell, with more distance after a failed proof.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from energy_opt.cell.planes import Near
from energy_opt.errors import BadInput, Infeasible, at_least
from energy_opt.motion import Move, Planner, Result, Trajectory
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.judge.energy import Energy
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.clearance import ClearanceConstraints
from energy_opt.motion.reshape.clear import REACH, Margins, Places
from energy_opt.motion.reshape.nodes import NodeFunctions, node_functions
from energy_opt.motion.trajectory import Filled
from energy_opt.numerics import ipopt
from energy_opt.numerics.compile import compiled
from energy_opt.power.structure import size_of
from energy_opt.profiles.chain import Chain
from energy_opt.profiles.profile_program import SHARP, Program

MOST_VIAS = 5
MORE = 2  # further via points to try if moves cost more than the evenly slowed move
TURNS = 5  # most solves after the judge found a violation
VIA_REACH = 0.3  # [rad] largest move of via points while the planes between bodies are fixed
ROUNDS = 6  # most solves with numeric constraints, renewed where the last one ended
SETTLED = 1e-4  # [rad, s] change of all unknowns between rounds at which these solves end
LONGEST = 10.0  # longest free duration, as a multiple of the reference's
OPTIONS: dict[str, object] = {"max_iter": 150, "tol": 1e-6, "mu_init": 1e-2}
RAMP, RISE = 0.8, 0.25  # first guess: ramps as a share of the shortest span, rises as a share of ramps
# first guesses: exponent of the via points' times, and factor of their distance from the straight line
SKEW, OUT = 1.7, 1.5


@dataclass(frozen=True)
class StandardMoves:
    """Standard moves that answer a move.

    Attributes:
        kind: "s-curve" if a jerk limit is known, else "trapezoid".
        chain: corners, spans and ramps.
        trajectory: the motion, blends included, with effort and power; energy and certificate are its own.
        kept: share of the continuous optimum's saving of loss against "scaled" that these moves keep, 1 = all;
            None if the optimum saves nothing.
    """

    kind: str
    chain: Chain
    trajectory: Filled
    energy: Energy
    certificate: Certificate
    kept: float | None

    @property
    def vias(self) -> int:
        """Number of via points."""
        return len(self.chain.corners) - 2

    def document(self) -> dict[str, object]:
        """Its record in result.json."""
        return {
            "kind": self.kind,
            "vias": self.vias,
            "kept_percent": None if self.kept is None else 100 * self.kept,
            "loss": self.energy.loss,
        }


class MovesPlanner:
    """Finds standard moves of one planner's robot and model; built functions are shared by all moves."""

    def __init__(self, planner: Planner) -> None:
        self.p, self.robot = planner, planner.robot
        self._functions: dict[str, NodeFunctions] = {}
        self.smooth = bool(np.isfinite(planner.robot.limits.jerk).any())

    def solve(self, move: Move, reference: Result, vias: int, least: int = 0) -> StandardMoves:
        """The moves with the least energy through `least` to `vias` via points, in the time of `reference`.

        Args:
            reference: the continuous optimum of the same move, also the source of starts. If cheaper moves are found,
                the optimum is solved again from them, to compute the share that they keep.

        Raises:
            BadInput: the move prescribes a path, via points, or ends in motion, which standard moves cannot follow.
            Infeasible: no standard moves take that time; gives their shortest duration.
        """
        self._check(move, vias)
        duration = reference.trajectory.duration
        found: list[tuple[Chain, Trajectory, Energy, Certificate]] = []
        broken: list[Certificate] = []
        guess: Chain | None = None
        for count in range(least, vias + 1):
            answers = []
            for start in self._starts(move, reference, count, guess):
                chain, certificate = self.repaired(start, move, (duration, duration), "energy")
                trajectory = chain.trajectory(self.robot.joints)
                if certificate.valid:
                    answers.append((chain, trajectory, self.p.score(trajectory), certificate))
                else:
                    broken.append(certificate)
            if answers:
                best = min(answers, key=lambda answer: answer[2].total)
                guess = best[0]
                found.append(best)
        if not found:
            raise self._too_short_error(move, reference, vias, broken)
        chain, trajectory, energy, certificate = min(found, key=lambda answer: answer[2].total)
        kept = self._kept_saving(move, reference, trajectory, energy)
        kind = "s-curve" if self.smooth else "trapezoid"
        return StandardMoves(kind, chain, self.p.scorer.filled(trajectory), energy, certificate, kept)

    def _kept_saving(self, move: Move, reference: Result, trajectory: Trajectory, energy: Energy) -> float | None:
        """The share of the best known trajectory's saving that moves keep, under the planner's model.

        If the moves are cheaper than that trajectory, it is solved again from them; it never costs more than the moves.
        """
        baseline = reference.baseline("scaled")
        if baseline is None or not baseline.valid:
            return None
        least, scaled = self.p.score(reference.trajectory).loss, self.p.score(baseline.trajectory).loss
        if energy.loss < least:
            least = min(energy.loss, self.p.score(self.p.solve(move, [trajectory]).trajectory).loss)
        saved = scaled - least
        return (scaled - energy.loss) / saved if saved > 1e-9 * max(scaled, 1e-9) else None

    def _check(self, move: Move, vias: int) -> None:
        """Refuse moves that standard moves cannot replace.

        Raises:
            BadInput: states why.
        """
        if not 0 <= vias <= MOST_VIAS:
            raise BadInput(f"--vias {vias}: expected 0 to {MOST_VIAS}")
        if move.via:
            raise BadInput("--as moves chooses its own via points; leave --via out")
        if move.path is not None and (move.mode == "retime" or move.input is None):
            raise BadInput("--as moves cannot follow a given path; give --start and --goal")
        if move.mode == "retime" and vias:
            raise BadInput("--as moves with --mode retime keeps the straight line; leave --vias out")
        if any(np.any(v) for v in move.end_velocities):
            raise BadInput("--as moves: standard moves begin and end at rest; this move does not")
        if not np.any(np.abs(move.goal - move.start) > 1e-9):
            raise BadInput("--as moves: start and goal are the same")

    def _starts(self, move: Move, reference: Result, count: int, before: Chain | None) -> list[Chain]:
        """First guesses with `count` via points.

        On the straight line; on the continuous optimum, evenly in time; early and late, farther out than the optimum;
        and on the previous answer.
        """
        t, line = reference.trajectory, np.stack([move.start, move.goal])

        def straight(time: np.ndarray) -> np.ndarray:
            return line[0] + (line[1] - line[0]) * (time / t.duration)[:, None]

        def optimum(time: np.ndarray) -> np.ndarray:
            return t.sample(t.time[0] + time)[0]

        def further(time: np.ndarray) -> np.ndarray:
            return straight(time) + OUT * (optimum(time) - straight(time))

        curves = [(1.0, straight)]
        if count:
            curves += [(1.0, optimum), (SKEW, further), (1 / SKEW, further)]
            if before is not None and len(before.corners) > 2:
                known = before.trajectory(self.robot.joints)
                curves.append((1.0, lambda time: known.sample(time)[0]))
        out = []
        limits = self.robot.limits
        for skew, curve in curves:
            shares = np.diff((np.arange(count + 2) / (count + 1)) ** skew)
            ramp = RAMP * shares.min() * t.duration / (1 + RAMP * shares.min())
            spans = shares * (t.duration - ramp)
            q = np.clip(curve(ramp / 2 + np.cumsum(spans)[:-1]), limits.lower, limits.upper)
            rises = np.full(count + 2, RISE * ramp if self.smooth else SHARP)
            out.append(Chain(np.vstack([line[0], q, line[1]]), spans, np.full(count + 2, ramp), rises))
        return out

    def repaired(
        self, chain: Chain, move: Move, durations: tuple[float, float], objective: str
    ) -> tuple[Chain, Certificate]:
        """Solve from `chain`, and again with what the judge finds broken.

        Slightly broken limits are tightened; after a contact, constraints keep the bodies apart.
        """
        limits, places, margins = self.p.limits(move), None, None
        for turn in range(TURNS):
            all_ = list(limits)
            if places is not None and margins is not None:
                all_.append(ClearanceConstraints(self._near_bodies, places.u, margins.at(places), REACH))
            chain, converged = self._solved(chain, move, durations, objective, all_)
            certificate = self.p.certify(chain.trajectory(self.robot.joints), move)
            proof = certificate.clearance
            if certificate.valid or turn == TURNS - 1:
                break
            if proof is not None and not proof.proven:
                assert self.p.cell is not None
                margins = margins or Margins(self.p.cell, np.stack([move.start, move.goal]), self._near_bodies)
                places = places or Places.evenly(len(margins.wanted))
                places.learn(proof, chain.duration)
            elif not converged:
                break
            else:
                limits = certificate.tightened(limits)
        return chain, certificate

    def _solved(
        self, chain: Chain, move: Move, durations: tuple[float, float], objective: str, limits: Sequence[Limit]
    ) -> tuple[Chain, bool]:
        """Solve from `chain`; with numeric constraints, repeated until these are renewed where the solve ends."""
        ends = np.asarray(move.start, dtype=float), np.asarray(move.goal, dtype=float)
        vias, values = len(chain.corners) - 2, self.p.model.values(self.robot.n)
        for _ in range(ROUNDS):
            nodes = self._nodes(objective)
            program = Program(vias, self.smooth, nodes, ends, limits, values, durations, chain, VIA_REACH)
            x = program.unknowns(chain)
            program.scale = 1 / max(abs(program.cost(x) - self._overhead(durations, objective)), 1e-6)
            answer = ipopt.solve(program, x, program.box, program.row_bounds, OPTIONS)
            chain = program.chain(answer.x)
            if not program.placed or np.abs(answer.x - x).max() < SETTLED:
                break
        if durations[0] == durations[1]:
            chain = chain.lasting(durations[0])  # make the duration exact
        return chain, answer.success

    @cached_property
    def _near_bodies(self) -> Near:
        """Measures distances between the bodies of the cell, for all moves."""
        assert self.p.cell is not None
        return Near(self.p.cell.bodies)

    def _overhead(self, durations: tuple[float, float], objective: str) -> float:
        """Energy [J] of a fixed duration that is the same for all moves; used only for scaling."""
        standby = self.p.model.get("standby")
        if objective != "energy" or durations[0] != durations[1] or standby is None:
            return 0.0
        return float(standby.values["power"][0]) * durations[0]

    def _nodes(self, objective: str) -> NodeFunctions:
        """Functions of the nodes for an objective, built once."""
        if objective not in self._functions:
            settings = self.p.settings
            built = node_functions(
                self.p.model, self.robot.body, self.p.limits(), objective, settings.dynamics, size_of(self.robot)
            )
            self._functions[objective] = NodeFunctions(*compiled(built.as_list(), settings.compile)[0])
        return self._functions[objective]

    def _too_short_error(self, move: Move, reference: Result, vias: int, broken: list[Certificate]) -> Infeasible:
        """The error, with the shortest duration that standard moves need."""
        duration = reference.trajectory.duration
        nearest = min(broken, key=lambda c: max(c.violation, 0.0))
        worst, touched = nearest.worst, nearest.within_limits and nearest.clearance is not None
        shortest = None
        for start in [] if touched else self._starts(move, reference, vias, None):
            longer = start.lasting(3 * duration)
            chain, certificate = self.repaired(longer, move, (0.2 * duration, LONGEST * duration), "time")
            if certificate.valid and (shortest is None or chain.duration < shortest):
                shortest = chain.duration
        ask = "" if shortest is None else f"; the shortest found that do take {at_least(shortest)} s"
        why = f"the {worst['limit']} limit of {worst['joint']} is broken at {worst['time']:.4g} s{ask}"
        if touched:
            why = f"{nearest.clearance}; more via points may find a way"
        return Infeasible(
            f"no standard moves with at most {vias} via points take {duration:.6g} s within the limits: {why}",
            joint=None if touched else str(worst["joint"]),
            limit="clearance" if touched else str(worst["limit"]),
            shortest_duration=shortest,
        )


def as_result(reference: Result, moves: StandardMoves) -> Result:
    """The standard moves in place of the continuous optimum; baselines, model and status are the same."""
    return replace(
        reference,
        chosen="moves",
        trajectory=moves.trajectory,
        energy=moves.energy,
        certificate=moves.certificate,
        optimality=replace(reference.optimality, kind="local", lower_bound=None, gap_percent=None),
        moves=moves.document(),
        models=(),  # those of the free trajectory do not apply to these moves
    )
