"""Reshaping at one level of detail: IPOPT on a program whose rows grow where a solve broke a limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.motion.limits.base import Limit, box_of, values_of
from energy_opt.motion.reshape.layout import Ends, Pattern, Shape
from energy_opt.motion.reshape.nlp import ReshapeProgram
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.numerics import ipopt
from energy_opt.numerics.batch import Batch

BROKEN = 1e-7  # share beyond a bound at which a limit becomes a row
NEAR = 0.97  # share of a bound from which a limit joins the rows when others do
ROUNDS = 10


@dataclass(frozen=True)
class Curve:
    """A move as control points (controls, n) over u in [0, 1], its duration [s] and the via points' times u."""

    shape: Shape
    points: np.ndarray
    duration: float
    via_u: np.ndarray

    def position(self, u: np.ndarray) -> np.ndarray:
        """Positions (M, n) at u (M,)."""
        return self.shape.basis.matrix(u) @ self.points

    def derivatives(self, u: np.ndarray) -> list[np.ndarray]:
        """Position, velocity, acceleration and jerk (M, n) at t = u T."""
        return [self.shape.basis.matrix(u, k) @ self.points / self.duration**k for k in range(4)]


@dataclass(frozen=True)
class Multipliers:
    """Of the bounds on the unknowns, and of rows that are named by `keys` (R, 3) (see ReshapeProgram.keys)."""

    bounds: np.ndarray
    keys: np.ndarray
    rows: np.ndarray

    def of(self, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Those of the bounds, and of other rows; of rows that are new, none."""
        known = dict(zip(map(tuple, self.keys.tolist()), self.rows.tolist(), strict=True))
        return self.bounds, np.array([known.get(tuple(key), 0.0) for key in keys.tolist()])


@dataclass(frozen=True)
class Outcome:
    """What a solve came to; `cost` is the objective's (J for energy), `broken` the worst excess at a node.

    `rows` (R, 3) number what was held: limit, site or node, joint or column.
    """

    curve: Curve
    cost: float
    broken: float
    converged: bool
    status: str
    iterations: int
    rows: np.ndarray
    multipliers: Multipliers


class Level:
    """All programs of one shape."""

    def __init__(self, shape: Shape, nodes: NodeFunctions) -> None:
        self.shape, self.pattern, self._nodes = shape, Pattern(shape), nodes
        self._value = Batch(nodes.value, len(shape.grid[0]))

    def shares(
        self, curve: Curve, parameters: np.ndarray, limits: Sequence[Limit]
    ) -> tuple[float, dict[int, np.ndarray]]:
        """Cost, and the share of its bound that each limit's every row uses, (sites or nodes, columns) by number."""
        s = self.shape
        u, w = s.grid
        q = [m @ curve.points for m in s.matrices[:3]]
        z = np.hstack([*q, np.full((len(u), 1), curve.duration)])
        rate, limited = self._value(z, u[:, None], np.concatenate([parameters, values_of(limits)]))
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
        multipliers: Multipliers | None = None,
        reach: float = np.inf,
    ) -> Outcome:
        """Minimise from `guess`; `durations` bounds T (equal: fixed).

        `multipliers` of a neighbouring problem make it a warm start. `reach` [rad] is how far control points may go
        from where they are. `offset` is what the objective costs per second whatever the path; it only serves scaling.
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
            np.concatenate([np.maximum(lower, inner - reach).ravel(), [durations[0]], np.zeros(s.vias)]),
            np.concatenate([np.minimum(upper, inner + reach).ravel(), [durations[1]], np.ones(s.vias)]),
        )
        iterations, known, fixed = 0, multipliers, durations[0] == durations[1]
        values, curve = np.concatenate([parameters, values_of(limits)]), guess
        for _ in range(rounds):
            chosen = np.vstack([np.insert(np.argwhere(held), 0, k, axis=1) for k, held in active.items()])
            asked = ((k, limit.places(curve.position)) for k, limit in enumerate(limits))
            places = [(k, found) for k, found in asked if found is not None]
            program = ReshapeProgram(self.pattern, self._nodes, ends, limits, chosen, values, scale, fixed, places)
            chosen_options = {"tol": tolerance, "max_iter": 150, **(options or {})}
            warm = None
            if known is not None:
                warm = known.of(program.keys)
                chosen_options.pop("mu_init", None)
            answer = ipopt.solve(program, x, box, program.row_bounds, chosen_options, warm)
            known = Multipliers(answer.bound_multipliers, program.keys, answer.row_multipliers)
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
        assert known is not None
        return Outcome(curve, cost, broken, answer.success, answer.status, iterations, chosen, known)


def fitted(
    shape: Shape, u: np.ndarray, q: np.ndarray, ends: Ends, duration: float, via_u: np.ndarray | None = None
) -> Curve:
    """The curve of `shape` closest to positions q (M, n) at u (M,), with the ends as they must be."""
    zero = None if shape.free_acceleration else np.zeros(shape.joints)
    head = shape.basis.ends(ends.start, ends.v_start * duration, zero, False)
    tail = shape.basis.ends(ends.goal, ends.v_goal * duration, zero, True)
    places = np.zeros(0) if via_u is None else via_u
    return Curve(shape, shape.basis.fit(u, q, head, tail), duration, places)


def between(a: Curve, b: Curve, share: float) -> Curve:
    """The curve at a share of the straight way from one to another of the same shape."""
    mixed = [(1 - share) * x + share * y for x, y in ((a.points, b.points), (a.via_u, b.via_u))]
    return Curve(a.shape, mixed[0], (1 - share) * a.duration + share * b.duration, mixed[1])


def refined(curve: Curve, shape: Shape, ends: Ends) -> Curve:
    """The same curve with the control points of another shape."""
    u = np.linspace(0, 1, 6 * shape.basis.controls)
    return fitted(shape, u, curve.shape.basis.matrix(u) @ curve.points, ends, curve.duration, curve.via_u)
