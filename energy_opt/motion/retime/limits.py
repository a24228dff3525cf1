"""The limits of a retiming along its path: where they are broken, and the constraints added there.

A path has hundreds of points with many limited values at each, of which few bind. So a solve begins without most of
them; where its answer breaks a limit, or comes near, constraints are added, and it is solved again. The largest excess
between points is covered by a small margin at all bounds, or by tighter bounds at the points beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from energy_opt.motion.limits.base import Functions, Limit, Linear
from energy_opt.motion.path_dynamics import PathDynamics
from energy_opt.motion.retime.nlp import CurvedConstraints, LinearConstraints, PathConstraints
from energy_opt.motion.retime.points import Symbolic
from energy_opt.motion.retime.quadrature import Lift, kept_lift, lift
from energy_opt.motion.retime.sums import NARROW, point_numbers
from energy_opt.power.structure import SharedByStructure

MARGIN = 5e-7  # share of every bound that is kept free, for excesses between the points
BROKEN = 1e-7  # share of a bound: a larger excess is a violation
# excess of a held constraint that counts as stuck; factor of the excess by which its bound is then reduced
STUCK, OVER = 1e-6, 1.2
NEAR = 0.9  # share of a bound from which places become constraints together with the broken ones
WIDE = 0.8  # the same for a joint's limit that is broken somewhere: tightening it changes the motion nearby
PIECE_NEAR = 0.8  # the same for limits such as jerk, where tightening has more effect
FAR = 1.5  # times the bound: jerk beyond this is limited along the whole path
BESIDE = 4  # neighbouring points added on both sides
CLOSE = 1 - 1e-3  # share of a bound from which places between the grid's points are checked
TIGHTER = (
    0.5  # least share by which a bound is tightened in a round: at a strong bend, an excess may be many times the bound
)
EVEN = 1e-12  # relative: a limit that varies by less along the path counts as constant


@dataclass(frozen=True)
class Worst:
    """The worst violation: limit, column of it, path position, and excess as a fraction of the bound."""

    limit: Limit
    column: int
    position: float
    excess: float


class AtPoints:
    """A limit on path acceleration and squared speed at the grid's M points: where it is held, and how much tighter.

    `held`, `tight`, `reserve` and `times` are (M, m), for the limit's m values at each point.
    Symbolic constraints are also tightened by `reserve`, because their smoothed law may be below the exact one. `times`
    counts how often this was needed: at kinks the exact law follows a reduction only in part, so each one is larger.
    """

    def __init__(self, limit: Limit, d: PathDynamics, shape: tuple[int, ...], typical: float) -> None:
        self.limit = limit
        self.held = np.zeros(shape, dtype=bool)
        self.tight, self.reserve = np.ones(shape), np.ones(shape)
        self.times = np.zeros(shape, dtype=int)
        self.line = line = limit.linear(d, typical)
        # constant limits: of a speed, by bounds of control values; of an acceleration, linear between knots
        self.bounds_speed = line is not None and line.of_speed and _is_constant(line.rb)
        self.bounds_slope = line is not None and not (line.rb.any() or line.r0.any()) and _is_constant(line.ra)

    def tightest(self, line: Linear) -> np.ndarray:
        """The columns (M, m) to hold: if the limit is only |ra a| <= 1, the steepest column represents the others."""
        if not self.bounds_slope:
            return self.held
        slope = np.abs(line.ra) / self.tight
        out = np.zeros_like(self.held)
        out[np.arange(len(slope)), slope.argmax(axis=1)] = self.held.any(axis=1)
        return out


def _is_constant(x: np.ndarray) -> bool:
    return bool(np.ptp(x, axis=0).max() <= EVEN * np.abs(x).max())


class OnPieces:
    """A limit that needs w = da/ds, such as jerk, at both ends and in the middle of every interval of the timing."""

    def __init__(self, limit: Limit, s: np.ndarray, at: Lift, functions: Callable[..., Functions]) -> None:
        self.limit, self.s, self.lift, self.functions = limit, s, at, functions
        shape = len(s), limit.bound.size
        self.held = np.zeros(shape, dtype=bool)
        self._everywhere = tuple(x.ravel() for x in np.indices(shape))
        self._all = functions(*self._everywhere, 1.0)

    def use(self, control: np.ndarray) -> np.ndarray:
        """Used share of the bound, (M, m)."""
        z = self.lift.values(control)
        z[1] = np.maximum(z[1], 0.0)
        return np.abs(self._all.value(z[:, self._everywhere[0]])).reshape(self.held.shape)


class PathLimits:
    """The limits of one path on one grid; keeps track of those that have become constraints."""

    def __init__(self, dynamics: PathDynamics, knots: np.ndarray, limits: Sequence[Limit], typical: float) -> None:
        """Sort the limits by what they need, and find constant bounds.

        Args:
            dynamics: at the grid's points. knots: (N + 1,) of the timing.
            typical: a typical squared path speed [1/s^2], at which torque is tested for being affine.
        """
        self.dynamics, self.knots = dynamics, knots
        self.lift: Lift = kept_lift(knots, dynamics.s)
        s, none = dynamics.s, np.zeros(len(dynamics.s))
        nearest = np.abs(s - knots[np.searchsorted((knots[1:] + knots[:-1]) / 2, s)])
        self.at_knot = (nearest < 1e-9) | (s < knots[1]) | (s > knots[-2])
        self.at_points: list[AtPoints] = []
        self.on_pieces: list[OnPieces] = []
        inside = 1e-9 * np.diff(knots)
        pieces = np.concatenate([knots[:-1] + inside, (knots[1:] + knots[:-1]) / 2, knots[1:] - inside])
        for limit in (limit.scaled(1 - MARGIN) for limit in limits):
            share = limit.use(dynamics, none, none)
            functions = limit.functions(dynamics.path, pieces)
            if share is not None:
                self.at_points.append(AtPoints(limit, dynamics, share.shape, typical))
            elif functions is not None:
                at = lift(knots, pieces, "abw", np.tile(np.arange(len(knots) - 1), 3))
                self.on_pieces.append(OnPieces(limit, pieces, at, functions))
        lines = [(held, held.line) for held in self.at_points if held.line is not None]
        self.speed_bound = np.min([line.fastest for _, line in lines if line.of_speed], axis=0)
        self.even_bound = min((float(line.fastest.min()) for held, line in lines if held.bounds_speed), default=np.inf)
        # if |ra a| <= 1 is constant along the path: the largest path acceleration that all such limits allow
        steepest = max((float(np.abs(line.ra[0]).max()) for held, line in lines if held.bounds_slope), default=0.0)
        self.steepest = 1 / steepest if steepest > 0 else np.inf
        self._last: tuple[np.ndarray, list[np.ndarray]] | None = None

    def _uses(self, control: np.ndarray) -> list[np.ndarray]:
        """Used share of each bound at the grid's points, (M, m) per limit; the last result is cached."""
        if self._last is None or not np.array_equal(self._last[0], control):
            self._last = control.copy(), self._used(self.dynamics, self.lift, control)
        return self._last[1]

    def _used(self, d: PathDynamics, at: Lift, control: np.ndarray) -> list[np.ndarray]:
        a, b = at.values(control)
        found = [held.limit.use(d, a, b) for held in self.at_points]
        return [share for share in found if share is not None]

    def _found(self, control: np.ndarray) -> list[tuple[Limit, np.ndarray, np.ndarray]]:
        """Every limit, the path positions (M,) where it is looked at, and the used share (M, m) of its bound there."""
        uses = zip(self.at_points, self._uses(control), strict=True)
        found = [(held.limit, self.dynamics.s, use) for held, use in uses]
        return found + [(piece.limit, piece.s, piece.use(control)) for piece in self.on_pieces]

    def worst(self, control: np.ndarray, name: str | None = None) -> Worst:
        """The limit whose bound is used most by control values (N + 2,) [1/s^2]; only those of a `name`, if given."""
        found = [one for one in self._found(control) if name in (None, one[0].name)]
        limit, s, use = max(found, key=lambda one: float(one[2].max()))
        k, j = np.unravel_index(int(np.argmax(use)), use.shape)
        return Worst(limit, int(j), float(s[k]), float(use[k, j] - 1))

    def longest(self, control: np.ndarray, s: np.ndarray) -> str:
        """The limit that control values come near for the longest time; s (K,): path positions at even times."""

        def lasting(places: np.ndarray, use: np.ndarray) -> int:
            order = np.argsort(places)
            return int((np.interp(s, places[order], use.max(axis=1)[order]) > NEAR).sum())

        return max(self._found(control), key=lambda one: lasting(*one[1:]))[0].name

    def add_broken(self, control: np.ndarray, *, always: bool = False) -> bool:
        """Make constraints of the limits that `control` breaks and of those near them; True if there were any.

        With `always`, also if nothing is broken; else `control` is the solution under the present constraints.
        """
        shares = [use / held.tight for held, use in zip(self.at_points, self._uses(control), strict=True)]
        broken = [use.max(axis=0) > 1 + BROKEN for use in shares]
        if always or any(columns.any() for columns in broken):
            for held, use, columns in zip(self.at_points, shares, broken, strict=True):
                if held.bounds_speed:
                    continue
                if not always:
                    stuck = held.held & (use > 1 + STUCK)
                    held.times[stuck] += 1
                    held.reserve[stuck] *= 1 - OVER * held.times[stuck] * (use[stuck] - 1)
                near = _near_bound(use, np.where(columns, WIDE, NEAR))
                if held.bounds_slope:
                    near &= self.at_knot[:, None] | (use > 1 + BROKEN)
                held.held |= near
            return True
        found = [self._hold_piece(piece, piece.use(control)) for piece in self.on_pieces]
        return any(found)

    @staticmethod
    def _hold_piece(piece: OnPieces, use: np.ndarray) -> bool:
        if use.max() <= 1 + BROKEN:
            return False
        near = use > PIECE_NEAR
        if use.max() > FAR:  # tightening it changes that joint's whole motion
            near[:, np.argmax(use.max(axis=0))] = True
        third = len(near) // 3  # both ends and the middle of every interval
        piece.held |= np.tile(near[:third] | near[third : 2 * third] | near[2 * third :], (3, 1))
        return True

    def refine(self, control: np.ndarray) -> bool:
        """Check between the grid's points, and at both ends, where a limit is close.

        A limit that is broken there is tightened at the neighbouring points; True if there was any.
        """
        d = self.dynamics
        edges = np.concatenate([[0.0], d.s, [1.0]])
        inner = np.array([0.0, 1 / 3, 2 / 3])
        close = np.zeros(len(edges), dtype=bool)
        close[[0, -1]] = True
        # speeds bounded by control values cannot exceed the largest of these
        for held, use in zip(self.at_points, self._uses(control), strict=True):
            if not held.bounds_speed:
                close[1:-1] |= use.max(axis=1) > CLOSE
        intervals = np.flatnonzero(close[:-1] | close[1:])
        share_of = np.where(intervals[:, None] == len(d.s), 1 - inner, inner)
        places = (edges[intervals, None] + np.diff(edges)[intervals, None] * share_of).ravel()
        between = d.at(places)
        broken = False
        for held, use in zip(self.at_points, self._used(between, lift(self.knots, places), control), strict=True):
            if held.bounds_speed:
                continue
            excess = use.reshape(len(intervals), len(inner), -1).max(axis=1) - 1
            k, j = np.nonzero(excess > 0.9 * MARGIN)  # the margin covers the rest
            if not k.size:
                continue
            broken = True
            factor = np.ones(held.tight.shape)
            for side in (-1, 0):
                place = (np.clip(intervals[k] + side, 0, len(d.s) - 1), j)
                held.held[place] = True
                np.minimum.at(factor, place, np.maximum(1 - 1.5 * excess[k, j], TIGHTER))
            held.tight *= factor
        return broken

    def slack_controls(self, control: np.ndarray) -> np.ndarray:
        """The control values (N + 2,) that may change slightly: inner ones with no limit near its bound."""
        out = np.ones(len(control), dtype=bool)
        out[[0, -1]] = False
        found = [(self.lift, use) for use in self._uses(control)]
        found += [(piece.lift, piece.use(control)) for piece in self.on_pieces]
        for at, use in found:
            out[at.touched[use.max(axis=1) > NEAR]] = False
        return out

    def constraints(self, unit: float) -> PathConstraints:
        """The held limits as constraints of the program, for control values in the given unit [1/s^2]."""
        places: list[np.ndarray] = []
        parts: list[tuple[np.ndarray, ...]] = []
        curved: list[CurvedConstraints] = []
        for held in self.at_points:
            if not held.held.any():
                continue
            line = held.limit.linear(self.dynamics, unit)
            if line is None:
                curved.append(self._symbolic(held, unit))
                continue
            k, j = np.nonzero(held.tightest(line))
            tight = held.tight[k, j]
            places.append(k)
            of_unit = (line.ra[k, j] * unit, line.rb[k, j] * unit, line.r0[k, j])
            parts.append((*(x / tight for x in of_unit), 1 / (tight * (1 - MARGIN) ** 2)))
        for piece in self.on_pieces:
            if piece.held.any():
                k, j = np.nonzero(piece.held)
                curved.append(CurvedConstraints(piece.lift.part(k), piece.functions(k, j, unit), 1))
        if not places:
            return PathConstraints(None, tuple(curved))
        where = np.concatenate(places)
        ra, rb, r0, allowed = (np.concatenate([part[i] for part in parts]) for i in range(4))
        return PathConstraints(LinearConstraints(self.lift.part(where), ra, rb, r0, allowed), tuple(curved))

    def _symbolic(self, held: AtPoints, unit: float) -> CurvedConstraints:
        """A limit that is not linear: all its columns at every place where one is held."""
        d, limit, k = self.dynamics, held.limit, np.unique(np.nonzero(held.held)[0])
        shared = np.concatenate([d.model.values(d.robot.n), [unit, NARROW], limit.values])
        numbers = point_numbers(d, np.zeros(len(d.s)))[:, k]
        scale = 1 / (limit.scale * held.tight[k] * held.reserve[k])
        functions = Symbolic.of(SharedByStructure.on(d.robot, d.model), d.robot.n, limit, numbers, shared, scale)
        return CurvedConstraints(self.lift.part(k), functions, limit.scale.size, limit.one_sided)


def _near_bound(use: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Places (M, n) where more than `share` (n,) of the bound is used, and their neighbours."""
    near = use > share
    out = near.copy()
    for step in range(1, BESIDE + 1):
        out[step:] |= near[:-step]
        out[:-step] |= near[step:]
    return out & (use > 0.5)
