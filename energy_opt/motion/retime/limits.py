"""The limits along a path as a retiming sees them: where they are broken, and the constraints that mend it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from energy_opt.motion.retime.points import Jerk, Torque
from energy_opt.motion.retime.quadrature import Lift, kept_lift, lift
from energy_opt.motion.retime.rows import CurvedRows, LinearRows, Rows
from energy_opt.motion.retime.terms import BLURS
from energy_opt.motion.timing.path_dynamics import PathDynamics, SharedByStructure, has_torque_effects
from energy_opt.robot import Limits

MARGIN = 5e-7  # share of every bound that is kept free, for what lies between the points
BROKEN = 1e-7  # of a bound: more than this is a violation
NEAR = 0.9  # of a bound: places from here on become constraints together with the broken ones
WIDE = 0.8  # the same for a joint's limit that is broken somewhere: mending it moves what is beside it
JERK_NEAR = 0.8  # the same for jerk, which moves farther when it is mended
FAR = 1.5  # times its bound: jerk that is so far beyond it is limited all along the path
BESIDE = 4  # so many points on both sides are taken along
CLOSE = 1 - 1e-3  # of a bound: from here on the places between the grid's points are looked at
AFFINE = 1e-9  # relative: torque that deviates less from its tangent is affine
KINDS = ("velocity", "acceleration", "effort")


@dataclass(frozen=True)
class Worst:
    """The worst violation: kind of limit, joint, path position, and excess as a fraction of the bound."""

    limit: str
    joint: int
    position: float
    excess: float


class Block:
    """Places along the path with their dynamics, which limits hold there as constraints, and how much tighter."""

    def __init__(self, dynamics: PathDynamics, knots: np.ndarray) -> None:
        self.dynamics = dynamics
        self.lift: Lift = kept_lift(knots, dynamics.s)
        shape = dynamics.q.shape
        self.held = {kind: np.zeros(shape, dtype=bool) for kind in KINDS}
        self.tight = {kind: np.ones(shape) for kind in KINDS}
        self._last: tuple[np.ndarray, dict[str, np.ndarray]] | None = None

    def usage(self, control: np.ndarray, limits: Limits) -> dict[str, np.ndarray]:
        """Share of each bound that is used, (M, n) per kind; that of velocity squared. The last answer is kept."""
        if self._last is None or not np.array_equal(self._last[0], control):
            self._last = control.copy(), usage(self.dynamics, self.lift, control, limits)
        return self._last[1]


def usage(d: PathDynamics, at: Lift, control: np.ndarray, limits: Limits) -> dict[str, np.ndarray]:
    """Share of each bound that is used at the places of `d` and `at`, (M, n) per kind; that of velocity squared."""
    a, b = at.values(control)
    return {
        "velocity": d.q1**2 * b[:, None] / limits.velocity**2,
        "acceleration": np.abs(d.q1 * a[:, None] + d.q2 * b[:, None]) / limits.acceleration,
        "effort": np.abs(d.motor_torque(a, b)) / limits.effort,
    }


class JerkLimits:
    """Jerk at both ends and in the middle of every interval of the timing."""

    def __init__(self, dynamics: PathDynamics, knots: np.ndarray, limits: Limits) -> None:
        count = len(knots) - 1
        inside = 1e-9 * np.diff(knots)
        s = np.concatenate([knots[:-1] + inside, (knots[1:] + knots[:-1]) / 2, knots[1:] - inside])
        piece = np.tile(np.arange(count), 3)
        path = dynamics.path
        self.s = s
        self.lift = lift(knots, s, "abw", piece)
        # (3, M, n): jerk is (k0 a + k1 b + k2 w) sqrt(b), in units of the bound
        self.factors = np.stack([3 * path(s, 2), path(s, 3), path(s, 1)]) / limits.jerk
        self.held = np.zeros(self.factors.shape[1:], dtype=bool)

    def usage(self, control: np.ndarray) -> np.ndarray:
        """Share of the bound that is used, (M, n)."""
        z = self.lift.values(control)
        return np.abs(np.einsum("dmj,dm->mj", self.factors, z)) * np.sqrt(np.maximum(z[1], 0))[:, None]


class PathLimits:
    """The limits of one path on one grid; remembers which of them have become constraints."""

    def __init__(self, dynamics: PathDynamics, knots: np.ndarray, limits: Limits, jerk: bool) -> None:
        tight = {kind: getattr(limits, kind) * (1 - MARGIN) for kind in (*KINDS, "jerk")}
        self.limits = limits.replace(**tight)
        self.knots = knots
        self.grid = Block(dynamics, knots)
        s = dynamics.s
        nearest = np.abs(s - knots[np.searchsorted((knots[1:] + knots[:-1]) / 2, s)])
        self.at_knot = (nearest < 1e-9) | (s < knots[1]) | (s > knots[-2])
        # where the velocity limits allow the same speed everywhere, bounds of the control values stand for them
        self.even = bool(np.ptp(dynamics.q1, axis=0).max() <= 1e-12 * np.abs(dynamics.q1).max())
        limited = jerk and bool(np.isfinite(limits.jerk).any())
        self.jerk = JerkLimits(dynamics, knots, self.limits) if limited else None

    def worst(self, control: np.ndarray) -> Worst:
        """The limit that is used most."""
        out = Worst("velocity", 0, 0.0, -1.0)
        s = self.grid.dynamics.s
        found = [(kind, s, use) for kind, use in self.grid.usage(control, self.limits).items()]
        if self.jerk is not None:
            found.append(("jerk", self.jerk.s, self.jerk.usage(control)))
        for kind, s, use in found:
            k, j = np.unravel_index(int(np.argmax(use)), use.shape)
            if use[k, j] - 1 > out.excess:
                out = Worst(kind, int(j), float(s[k]), float(use[k, j] - 1))
        return out

    def hold(self, control: np.ndarray, *, always: bool = False) -> bool:
        """Make constraints of the limits that `control` breaks and of those near it; True where there were any.

        With `always`, also where nothing is broken.
        """
        grid = self.grid
        shares = {kind: use / grid.tight[kind] for kind, use in grid.usage(control, self.limits).items()}
        broken = {kind: use.max(axis=0) > 1 + BROKEN for kind, use in shares.items()}
        if always or any(joints.any() for joints in broken.values()):
            for kind, use in shares.items():
                if kind == "velocity" and self.even:
                    continue
                near = _near(use, np.where(broken[kind], WIDE, NEAR))
                if kind == "acceleration" and self.even:  # on a straight path it is linear between knots
                    near &= self.at_knot[:, None] | (use > 1 + BROKEN)
                grid.held[kind] |= near
            return True
        if self.jerk is None:
            return False
        use = self.jerk.usage(control)
        if use.max() <= 1 + BROKEN:
            return False
        near = use > JERK_NEAR
        if use.max() > FAR:  # mending it will move the whole course of that joint
            near[:, np.argmax(use.max(axis=0))] = True
        third = len(near) // 3  # both ends and the middle of every interval
        self.jerk.held |= np.tile(near[:third] | near[third : 2 * third] | near[2 * third :], (3, 1))
        return True

    def refine(self, control: np.ndarray) -> bool:
        """Look between the grid's points, and at both ends, where a limit is close.

        Where it is broken there, it is tightened at the points beside; True where there was any.
        """
        grid, d = self.grid, self.grid.dynamics
        edges = np.concatenate([[0.0], d.s, [1.0]])
        inner = np.array([0.0, 1 / 3, 2 / 3])
        shares = grid.usage(control, self.limits)
        # on a straight path no speed is above the largest control value, and these are within the velocity limits
        kinds = [kind for kind in KINDS if not (self.even and kind == "velocity")]
        close = np.zeros(len(edges), dtype=bool)
        close[[0, -1]] = True
        for kind in kinds:
            close[1:-1] |= shares[kind].max(axis=1) > CLOSE
        intervals = np.flatnonzero(close[:-1] | close[1:])
        share_of = np.where(intervals[:, None] == len(d.s), 1 - inner, inner)
        places = (edges[intervals, None] + np.diff(edges)[intervals, None] * share_of).ravel()
        between = PathDynamics(d.robot, d.model, d.path, places)
        there = usage(between, lift(self.knots, places), control, self.limits)
        broken = False
        for kind in kinds:
            excess = there[kind].reshape(len(intervals), len(inner), -1).max(axis=1) - 1
            k, j = np.nonzero(excess > 0.9 * MARGIN)  # the margin is there for what remains
            broken |= bool(k.size)
            if not k.size:
                continue
            factor = np.ones(grid.tight[kind].shape)
            for side in (-1, 0):
                place = (np.clip(intervals[k] + side, 0, len(d.s) - 1), j)
                grid.held[kind][place] = True
                np.minimum.at(factor, place, 1 - 1.5 * excess[k, j])
            grid.tight[kind] *= factor
        return broken

    def loose(self, control: np.ndarray) -> np.ndarray:
        """Which control values (N + 2,) may change a little: those inside that meet no limit anywhere near."""
        out = np.ones(len(control), dtype=bool)
        out[[0, -1]] = False
        found = [(self.grid.lift, use) for use in self.grid.usage(control, self.limits).values()]
        if self.jerk is not None:
            found.append((self.jerk.lift, self.jerk.usage(control)))
        for at, use in found:
            out[at.touched[use.max(axis=1) > NEAR]] = False
        return out

    def rows(self, unit: float) -> Rows:
        """The limits that are held, for control values in the given unit."""
        grid, d, limits = self.grid, self.grid.dynamics, self.limits
        places: list[np.ndarray] = []
        parts: list[tuple[np.ndarray, ...]] = []

        def add(kind: str, k: np.ndarray, j: np.ndarray, *linear: np.ndarray) -> None:
            tight = grid.tight[kind][k, j]
            places.append(k)
            parts.append((*(x / tight for x in linear), 1 / (tight * (1 - MARGIN) ** 2)))

        k, j = np.nonzero(grid.held["velocity"])
        zero = np.zeros(k.size)
        add("velocity", k, j, zero, unit * (d.q1[k, j] / limits.velocity[j]) ** 2, zero)
        k, j = np.nonzero(self._accelerations())
        scale = unit / limits.acceleration[j]
        add("acceleration", k, j, d.q1[k, j] * scale, d.q2[k, j] * scale, np.zeros(k.size))
        curved: list[CurvedRows] = []
        k, j = np.nonzero(grid.held["effort"])
        if k.size and self.affine:
            none = np.zeros(len(d.s))
            ra, rb, r0 = (x[k, j] / limits.effort[j] for x in d.affine_torque(none, none + unit))
            add("effort", k, j, ra * unit, rb * unit, r0)
        elif k.size:
            curved.append(self._torque_rows(np.unique(k), unit))
        if self.jerk is not None and self.jerk.held.any():
            k, j = np.nonzero(self.jerk.held)
            functions = Jerk(self.jerk.factors[:, k, j] * unit**1.5)
            curved.append(CurvedRows(self.jerk.lift.part(k), functions, 1))
        where = np.concatenate(places)
        if not where.size:
            return Rows(None, tuple(curved))
        ra, rb, r0, allowed = (np.concatenate([part[i] for part in parts]) for i in range(4))
        return Rows(LinearRows(grid.lift.part(where), ra, rb, r0, allowed), tuple(curved))

    def _accelerations(self) -> np.ndarray:
        """Which accelerations (M, n) to hold: on a straight path, |q'_j a| <= bound_j is one bound of |a|."""
        held = self.grid.held["acceleration"]
        if not self.even:
            return held
        slope = np.abs(self.grid.dynamics.q1) / (self.limits.acceleration * self.grid.tight["acceleration"])
        tightest = np.zeros_like(held)
        tightest[np.arange(len(held)), slope.argmax(axis=1)] = held.any(axis=1)
        return tightest

    @property
    def affine(self) -> bool:
        """Is the motors' torque affine in (a, b)?"""
        d = self.grid.dynamics
        if not has_torque_effects(d.model):
            return True
        one = np.ones(len(d.s)) * d.speed_bound(self.limits.velocity).min()
        ma, mb, m0 = d.affine_torque(0 * one, one)
        for a, b in ((-one, 0.3 * one), (one, 0.7 * one)):
            there = d.motor_torque(a, b)
            if np.abs(ma * a[:, None] + mb * b[:, None] + m0 - there).max() > AFFINE * (1 + np.abs(there).max()):
                return False
        return True

    def _torque_rows(self, k: np.ndarray, unit: float) -> CurvedRows:
        """Nonlinear limits on the torque of all joints at the places k."""
        d = self.grid.dynamics
        n = d.robot.n
        shared = np.append(d.model.values(n), [unit, BLURS[-1]])
        numbers = point_numbers(d, np.zeros(len(d.s)))[:, k]
        scale = 1 / (self.limits.effort * self.grid.tight["effort"][k])
        return CurvedRows(self.grid.lift.part(k), Torque.of(SharedByStructure(d.model), numbers, shared, scale), n)


def point_numbers(d: PathDynamics, time: np.ndarray) -> np.ndarray:
    """What the law is given at each point, (6 n + 1, M); see retime_terms.Law."""
    return np.vstack([d.q.T, d.q1.T, d.q2.T, d.M.T, d.C.T, d.G.T, time])


def _near(use: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Places (M, n) where more than `share` (n,) of the bound is used, and their neighbours."""
    near = use > share
    out = near.copy()
    for step in range(1, BESIDE + 1):
        out[step:] |= near[:-step]
        out[:-step] |= near[step:]
    return out & (use > 0.5)
