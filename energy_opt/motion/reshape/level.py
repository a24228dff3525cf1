"""Reshaping at one level of detail: IPOPT on a program whose rows grow where a solve broke a limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.motion.reshape.layout import Ends, Pattern, Shape
from energy_opt.motion.reshape.nlp import Program
from energy_opt.motion.reshape.nodes import NodeFunctions
from energy_opt.numerics import ipopt
from energy_opt.numerics.batch import Batch
from energy_opt.robot import Limits

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

    def derivatives(self, u: np.ndarray) -> list[np.ndarray]:
        """Position, velocity, acceleration and jerk (M, n) at t = u T."""
        return [self.shape.basis.matrix(u, k) @ self.points / self.duration**k for k in range(4)]


@dataclass(frozen=True)
class Outcome:
    """What a solve came to; `cost` is the objective's (J for energy), `broken` the worst excess at a node."""

    curve: Curve
    cost: float
    broken: float
    converged: bool
    status: str
    iterations: int
    rows: np.ndarray
    multipliers: tuple[np.ndarray, np.ndarray] | None


class Level:
    """All programs of one shape."""

    def __init__(self, shape: Shape, nodes: NodeFunctions) -> None:
        self.shape, self.pattern, self._nodes = shape, Pattern(shape), nodes
        self._value = Batch(nodes.value, len(shape.grid[0]))

    def shares(self, curve: Curve, parameters: np.ndarray, bounds: np.ndarray) -> tuple[float, list[np.ndarray]]:
        """Cost, and velocity, acceleration, jerk (at sites) and motor torque (at nodes) as shares of their bounds."""
        s = self.shape
        u, w = s.grid
        q = [m @ curve.points for m in s.matrices[:3]]
        z = np.hstack([*q, np.full((len(u), 1), curve.duration)])
        rate, tau = self._value(z, u[:, None], parameters)
        moved = [np.abs(s.sites[k] @ curve.points) / curve.duration ** (k + 1) / bounds[k] for k in range(3)]
        return float(w @ rate[:, 0]), [*moved, np.abs(tau) / bounds[3]]

    def solve(
        self,
        guess: Curve,
        ends: Ends,
        limits: Limits,
        parameters: np.ndarray,
        durations: tuple[float, float],
        *,
        tolerance: float = 1e-6,
        rows: np.ndarray | None = None,
        offset: float = 0.0,
        options: dict[str, object] | None = None,
        rounds: int = ROUNDS,
        multipliers: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> Outcome:
        """Minimise from `guess`; `durations` bounds T (equal: fixed).

        `multipliers` (of bounds, of `rows`) of a neighbouring problem make it a warm start.

        `offset` is what the objective costs per second whatever the path; it only serves the scaling.
        """
        s = self.shape
        bounds = np.stack([limits.velocity, limits.acceleration, limits.jerk, limits.effort])
        active = [np.zeros((len(m), s.joints), dtype=bool) for m in (*s.sites, s.grid[0])]
        if rows is not None:
            for kind, site, joint in rows:
                active[kind - 1][site, joint] = True
        cost, shares = self.shares(guess, parameters, bounds)
        for k in range(4):
            active[k] |= shares[k] > NEAR
        scale = 1 / max(abs(cost - offset * guess.duration), 0.01 * abs(cost), 1e-6)
        inner = guess.points[s.pinned : s.basis.controls - s.pinned]
        x = np.concatenate([inner.ravel(), [guess.duration], guess.via_u])
        box = (
            np.concatenate([np.tile(limits.lower, s.free), [durations[0]], np.zeros(s.vias)]),
            np.concatenate([np.tile(limits.upper, s.free), [durations[1]], np.ones(s.vias)]),
        )
        iterations, warm, fixed = 0, multipliers, durations[0] == durations[1]
        before = np.zeros((0, 3), dtype=int) if rows is None else rows
        for _ in range(rounds):
            chosen = np.vstack([np.insert(np.argwhere(active[k]), 0, k + 1, axis=1) for k in range(4)])
            program = Program(self.pattern, self._nodes, ends, chosen, bounds, parameters, scale, fixed)
            one = np.concatenate([np.ones(len(chosen)), np.zeros(s.joints * s.vias)])
            chosen_options = {"tol": tolerance, "max_iter": 150, **(options or {})}
            if warm is not None:
                known = {tuple(row): value for row, value in zip(before.tolist(), warm[1], strict=False)}
                lam = np.array([known.get(tuple(row), 0.0) for row in chosen.tolist()])
                warm = warm[0], np.concatenate([lam, warm[1][len(before) :]])
                chosen_options.pop("mu_init", None)
            answer = ipopt.solve(program, x, box, (-one, one), chosen_options, warm)
            warm, before = (answer.bound_multipliers, answer.row_multipliers), chosen
            iterations += answer.iterations
            x = answer.x
            curve = Curve(s, program.points(x), float(x[program.pattern.time]), x[program.pattern.time + 1 :])
            cost, shares = self.shares(curve, parameters, bounds)
            broken = max(float(share.max()) for share in shares) - 1
            new = [(shares[k] > 1 + BROKEN) & ~active[k] for k in range(4)]
            if not any(block.any() for block in new) or answer.status == "User_Requested_Stop":
                break
            for k in range(4):
                active[k] |= shares[k] > NEAR
                # The peak between two rows moves to their neighbours next: take them along.
                active[k][1:] |= new[k][:-1]
                active[k][:-1] |= new[k][1:]
        return Outcome(curve, cost, broken, answer.success, answer.status, iterations, chosen, warm)


def fitted(
    shape: Shape, u: np.ndarray, q: np.ndarray, ends: Ends, duration: float, via_u: np.ndarray | None = None
) -> Curve:
    """The curve of `shape` closest to positions q (M, n) at u (M,), with the ends as they must be."""
    zero = None if shape.free_acceleration else np.zeros(shape.joints)
    head = shape.basis.ends(ends.start, ends.v_start * duration, zero, False)
    tail = shape.basis.ends(ends.goal, ends.v_goal * duration, zero, True)
    places = np.zeros(0) if via_u is None else via_u
    return Curve(shape, shape.basis.fit(u, q, head, tail), duration, places)


def refined(curve: Curve, shape: Shape, ends: Ends) -> Curve:
    """The same curve with the control points of another shape."""
    u = np.linspace(0, 1, 6 * shape.basis.controls)
    return fitted(shape, u, curve.shape.basis.matrix(u) @ curve.points, ends, curve.duration, curve.via_u)
