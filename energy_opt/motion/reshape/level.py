"""Reshaping at one level of detail: IPOPT on a program whose rows grow where a solve broke a limit."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from energy_opt.motion.limits.base import Limit, box_of, values_of
from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.reshape.evaluation import OpenGoal
from energy_opt.motion.reshape.frame import Frame
from energy_opt.motion.reshape.layout import Ends, Pattern, Shape
from energy_opt.motion.reshape.model import Model
from energy_opt.motion.reshape.nlp import ReshapeProgram
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.numerics import ipopt
from energy_opt.numerics.batch import Batch

BROKEN = 1e-7  # share beyond a bound at which a limit becomes a row
NEAR = 0.97  # share of a bound from which a limit joins the rows when others do
ROUNDS = 10
NEAR_OPTIMUM = 1e-5  # first barrier parameter, and distance from bounds, of rounds but the first


class Level:
    """All programs of one shape."""

    def __init__(self, shape: Shape, nodes: NodeFunctions) -> None:
        self.shape, self.pattern, self._nodes = shape, Pattern(shape), nodes
        self._value = Batch(nodes.value, len(shape.grid[0]))

    @cached_property
    def frame(self) -> Frame:
        """Banded matrices of the shape."""
        return Frame(self.shape)

    def model(
        self, ends: Ends, limits: Sequence[Limit], parameters: np.ndarray, durations: tuple[float, float],
        offset: float, width: float = 1.0, goal: OpenGoal | None = None,
    ) -> Model:  # fmt: skip
        """The problem for sequential quadratic programming."""
        return Model(self.frame, self._nodes, ends, limits, parameters, durations, offset, width, goal)

    def shares(
        self, curve: Curve, parameters: np.ndarray, limits: Sequence[Limit], width: float = 1.0
    ) -> tuple[float, dict[int, np.ndarray]]:
        """Cost, and the share of its bound that each limit's every row uses, (sites or nodes, columns) by number."""
        s = self.shape
        u, w = s.grid
        q = [m @ curve.points for m in s.matrices[:3]]
        z = np.hstack([*q, np.full((len(u), 1), curve.duration)])
        rate, limited = self._value(z, u[:, None], np.concatenate([parameters, values_of(limits, width)]))
        shares, used = {}, 0
        for number, limit in enumerate(limits):
            if limit.order:
                moved = s.sites[limit.order - 1] @ curve.points
                shares[number] = np.abs(moved) / curve.duration**limit.order / limit.bound
            if limit.scale.size:
                values = limited[:, used : used + limit.scale.size]
                shares[number] = (values if limit.one_sided else np.abs(values)) / limit.scale
                used += limit.scale.size
        return float(w @ rate[:, 0]), shares

    def standing(self, q: np.ndarray, duration: float, parameters: np.ndarray, limits: Sequence[Limit]) -> np.ndarray:
        """What standing at each of q (M, n) costs, by the second (M,)."""
        count, rates = len(self.shape.grid[0]), []
        values, z = np.concatenate([parameters, values_of(limits)]), np.zeros((count, 3 * self.shape.joints + 1))
        z[:, -1] = duration
        for first in range(0, len(q), count):
            block = q[first : first + count]
            z[: len(block), : self.shape.joints] = block
            rates.append(self._value(z, np.full((count, 1), 0.5), values)[0][: len(block), 0] / duration)
        return np.concatenate(rates)

    def excess(self, curve: Curve, parameters: np.ndarray, limits: Sequence[Limit]) -> tuple[float, float]:
        """Cost, and the worst excess over a limit; planes between bodies aside, as they are no limit of their own."""
        cost, shares = self.shares(curve, parameters, limits)
        placed = [limit.excess_at(self.shape.matrices[0] @ curve.points) for limit in limits]
        return cost, max([float(share.max()) - 1 for share in shares.values()] + placed)

    def solve(
        self,
        guess: Curve,
        ends: Ends,
        limits: Sequence[Limit],
        parameters: np.ndarray,
        durations: tuple[float, float],
        *,
        tolerance: float = 1e-6,
        rows: np.ndarray | None = None,
        offset: float = 0.0,
        options: dict[str, object] | None = None,
        rounds: int = ROUNDS,
    ) -> Outcome:
        """Minimise from `guess`; `durations` bounds T (equal: fixed).

        `offset` is what the objective costs per second whatever the path; it only serves scaling.
        """
        s = self.shape
        cost, shares = self.shares(guess, parameters, limits)
        active = {number: share > NEAR for number, share in shares.items()}
        if rows is not None:
            for number, held in active.items():
                _, site, column = rows[rows[:, 0] == number].T
                held[site, column] = True
        scale = 1 / max(abs(cost - offset * guess.duration), 0.01 * abs(cost), 1e-6)
        inner = guess.points[s.pinned : s.basis.controls - s.pinned]
        x = np.concatenate([inner.ravel(), [guess.duration], guess.via_u])
        lower, upper = box_of(limits, s.joints)
        box = (
            np.concatenate([np.tile(lower, len(inner)), [durations[0]], np.zeros(s.vias)]),
            np.concatenate([np.tile(upper, len(inner)), [durations[1]], np.ones(s.vias)]),
        )
        iterations, fixed = 0, durations[0] == durations[1]
        values, curve = np.concatenate([parameters, values_of(limits)]), guess
        for turn in range(rounds):
            chosen = np.vstack([np.insert(np.argwhere(held), 0, k, axis=1) for k, held in active.items()])
            places = [found for limit in limits if (found := limit.places(curve.position)) is not None]
            program = ReshapeProgram(self.pattern, self._nodes, ends, limits, chosen, values, scale, fixed, places)
            chosen_options = {"tol": tolerance, "max_iter": 150, **(options or {})}
            if turn:  # it begins at the optimum of the round before
                chosen_options |= {"mu_init": NEAR_OPTIMUM, "bound_push": NEAR_OPTIMUM, "bound_frac": NEAR_OPTIMUM}
            answer = ipopt.solve(program, x, box, program.row_bounds, chosen_options)
            iterations += answer.iterations
            x = answer.x
            curve = Curve(s, program.points(x), float(x[program.pattern.time]), x[program.pattern.time + 1 :])
            cost, shares = self.shares(curve, parameters, limits)
            broken = max([float(share.max()) - 1 for share in shares.values()] + [program.broken_places(x)])
            new = {k: (share > 1 + BROKEN) & ~active[k] for k, share in shares.items()}
            if not any(block.any() for block in new.values()) or answer.status == "User_Requested_Stop":
                break
            for k, held in active.items():
                held |= shares[k] > NEAR
                # The peak between two rows moves to their neighbours next: take them along.
                held[1:] |= new[k][:-1]
                held[:-1] |= new[k][1:]
        return Outcome(curve, cost, broken, answer.success, answer.status, iterations, chosen)
