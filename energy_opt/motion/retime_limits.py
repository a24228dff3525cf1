"""The limits along a path as a retiming sees them: where they are broken, and the constraints that mend it."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from energy_opt.motion.path_dynamics import PathDynamics, SharedByStructure, has_torque_effects
from energy_opt.motion.retime_grid import Lift, lift
from energy_opt.motion.retime_rows import CurvedRows, LinearRows, Rows, jerk_rows
from energy_opt.motion.retime_terms import torque_terms
from energy_opt.robot import Limits

MARGIN = 3e-7  # share of every bound that is kept free, for what lies between the points
BROKEN = 1e-7  # of a bound: more than this is a violation
NEAR = 0.98  # of a bound: places from here on become constraints together with the broken ones
JERK_NEAR = 0.8  # the same for jerk, which moves farther when it is mended
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
    """Places along the path with their dynamics, and which limits hold there as constraints."""

    def __init__(self, dynamics: PathDynamics, knots: np.ndarray) -> None:
        self.dynamics = dynamics
        self.lift: Lift = lift(knots, dynamics.s)
        shape = dynamics.q.shape
        self.held = {kind: np.zeros(shape, dtype=bool) for kind in KINDS}

    def usage(self, control: np.ndarray, limits: Limits) -> dict[str, np.ndarray]:
        """Signed share of each bound that is used, (M, n) per kind."""
        a, b = self.lift.values(control)
        d = self.dynamics
        return {
            "velocity": d.q1**2 * b[:, None] / limits.velocity**2,
            "acceleration": (d.q1 * a[:, None] + d.q2 * b[:, None]) / limits.acceleration,
            "effort": d.motor_torque(a, b) / limits.effort,
        }


class Jerk:
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
        """Signed share of the bound that is used, (M, n)."""
        z = self.lift.values(control)
        return np.einsum("dmj,dm->mj", self.factors, z) * np.sqrt(np.maximum(z[1], 0))[:, None]


class PathLimits:
    """The limits of one path on one grid; remembers which of them have become constraints."""

    def __init__(self, dynamics: PathDynamics, knots: np.ndarray, limits: Limits, jerk: bool) -> None:
        tight = {kind: getattr(limits, kind) * (1 - MARGIN) for kind in (*KINDS, "jerk")}
        self.limits = limits.replace(**tight)
        self.knots = knots
        self.blocks = [Block(dynamics, knots)]
        limited = jerk and bool(np.isfinite(limits.jerk).any())
        self.jerk = Jerk(dynamics, knots, self.limits) if limited else None

    @property
    def dynamics(self) -> PathDynamics:
        """At the grid's points."""
        return self.blocks[0].dynamics

    @property
    def jerk_held(self) -> bool:
        """Is any limit on jerk a constraint?"""
        return self.jerk is not None and bool(self.jerk.held.any())

    def worst(self, control: np.ndarray) -> Worst:
        """The limit that is used most."""
        out = Worst("velocity", 0, 0.0, -1.0)
        found = [(kind, block.dynamics.s, use) for block in self.blocks for kind, use in self._usage(block, control)]
        if self.jerk is not None:
            found.append(("jerk", self.jerk.s, self.jerk.usage(control)))
        for kind, s, use in found:
            k, j = np.unravel_index(int(np.argmax(np.abs(use))), use.shape)
            if abs(use[k, j]) - 1 > out.excess:
                out = Worst(kind, int(j), float(s[k]), float(abs(use[k, j]) - 1))
        return out

    def _usage(self, block: Block, control: np.ndarray) -> list[tuple[str, np.ndarray]]:
        return list(block.usage(control, self.limits).items())

    def hold(self, control: np.ndarray, *, always: bool = False) -> bool:
        """Make constraints of the limits that `control` breaks and of those near it; True where there were any.

        With `always`, also where nothing is broken.
        """
        usages = [block.usage(control, self.limits) for block in self.blocks]
        broken = always or any(np.abs(use).max() > 1 + BROKEN for usage in usages for use in usage.values())
        if broken:
            for block, usage in zip(self.blocks, usages, strict=True):
                for kind, use in usage.items():
                    block.held[kind] |= _near(np.abs(use))
        elif self.jerk is not None:
            use = np.abs(self.jerk.usage(control))
            broken = bool(use.max() > 1 + BROKEN)
            if broken:
                near = use > JERK_NEAR
                third = len(near) // 3  # both ends and the middle of every interval
                self.jerk.held |= np.tile(near[:third] | near[third : 2 * third] | near[2 * third :], (3, 1))
        return broken

    def refine(self, control: np.ndarray, per_interval: int = 4) -> bool:
        """Look between the grid's points where a limit is close; True where one is broken there (and now held)."""
        block = self.blocks[0]
        active = np.any(
            [np.abs(use).max(axis=1) > 1 - 1e-3 for use in block.usage(control, self.limits).values()], axis=0
        )
        s = block.dynamics.s
        near = active[:-1] | active[1:]
        if not near.any():
            return False
        inner = (np.arange(per_interval) + 0.5) / per_interval
        places = (s[:-1][near, None] + np.diff(s)[near, None] * inner).ravel()
        for other in self.blocks[1:]:
            places = np.setdiff1d(places, other.dynamics.s)
        if not places.size:
            return False
        d = block.dynamics
        extra = Block(PathDynamics(d.robot, d.model, d.path, places), self.knots)
        usage = extra.usage(control, self.limits)
        # the margin is there for what remains here
        if all(np.abs(use).max() <= 1 + MARGIN for use in usage.values()):
            return False
        for kind, use in usage.items():
            extra.held[kind] |= np.abs(use) > 1
        self.blocks.append(extra)
        return True

    def rows(self, unit: float) -> Rows:
        """The limits that are held, for control values in the given unit."""
        linear: list[tuple[Lift, np.ndarray, np.ndarray, np.ndarray]] = []
        curved: list[CurvedRows] = []
        for block in self.blocks:
            d, limits = block.dynamics, self.limits
            k = np.flatnonzero(block.held["velocity"].any(axis=1))
            if k.size:
                zero = np.zeros(k.size)
                linear.append((_part(block.lift, k), zero, unit / d.speed_bound(limits.velocity)[k], zero))
            k, j = np.nonzero(block.held["acceleration"])
            if k.size:
                scale = unit / limits.acceleration[j]
                linear.append((_part(block.lift, k), d.q1[k, j] * scale, d.q2[k, j] * scale, np.zeros(k.size)))
            k, j = np.nonzero(block.held["effort"])
            if k.size and self.affine:
                zero = np.zeros(len(d.s))
                ra, rb, r0 = (x[k, j] / limits.effort[j] for x in d.affine_torque(zero, zero + unit))
                linear.append((_part(block.lift, k), ra * unit, rb * unit, r0))
            elif k.size:
                curved.append(self._torque_rows(block, np.unique(k), unit))
        if self.jerk is not None and self.jerk.held.any():
            k, j = np.nonzero(self.jerk.held)
            curved.append(jerk_rows(_part(self.jerk.lift, k), self.jerk.factors[:, k, j] * unit**1.5))
        if not linear:
            return Rows(None, tuple(curved))
        lifts = [part[0] for part in linear]
        joined = Lift(
            np.concatenate([x.first for x in lifts]), np.concatenate([x.maps for x in lifts], axis=1), lifts[0].count
        )
        ra, rb, r0 = (np.concatenate([part[i] for part in linear]) for i in (1, 2, 3))
        return Rows(LinearRows(joined, ra, rb, r0), tuple(curved))

    @property
    def affine(self) -> bool:
        """Is the motors' torque affine in (a, b)?"""
        d = self.dynamics
        if not has_torque_effects(d.model):
            return True
        one = np.ones(len(d.s)) * d.speed_bound(self.limits.velocity).min()
        ma, mb, m0 = d.affine_torque(0 * one, one)
        for a, b in ((-one, 0.3 * one), (one, 0.7 * one)):
            there = d.motor_torque(a, b)
            if np.abs(ma * a[:, None] + mb * b[:, None] + m0 - there).max() > AFFINE * (1 + np.abs(there).max()):
                return False
        return True

    def _torque_rows(self, block: Block, k: np.ndarray, unit: float) -> CurvedRows:
        """Nonlinear limits on the torque of all joints at the places k."""
        d = block.dynamics
        n = d.robot.n
        value, curvature = torque_terms(SharedByStructure(d.model), n)
        shared = ca.DM(np.append(d.model.values(n), unit))
        z, at, multiplier = ca.SX.sym("z", 2), ca.SX.sym("at", 6 * n + 1), ca.SX.sym("multiplier", n)
        scale = ca.DM(1 / self.limits.effort)
        torque, slope = value(z, at, shared)
        scaled = ca.Function("torque", [z, at], [torque * scale, slope * ca.repmat(scale, 1, 2)])
        bent = ca.Function("torque_curvature", [z, at, multiplier], [curvature(z, at, shared, multiplier * scale)])
        return CurvedRows(_part(block.lift, k), scaled, bent, point_numbers(d, np.zeros(len(d.s)))[:, k])


def point_numbers(d: PathDynamics, time: np.ndarray) -> np.ndarray:
    """What the law is given at each point, (6 n + 1, M); see retime_terms.Law."""
    return np.vstack([d.q.T, d.q1.T, d.q2.T, d.M.T, d.C.T, d.G.T, time])


def _part(whole: Lift, places: np.ndarray) -> Lift:
    return Lift(whole.first[places], whole.maps[:, places], whole.count)


def _near(use: np.ndarray) -> np.ndarray:
    """Places (M, n) near or beyond the bound, and their neighbours."""
    near = use > NEAR
    out = near.copy()
    out[1:] |= near[:-1]
    out[:-1] |= near[1:]
    return out & (use > 0.5)
