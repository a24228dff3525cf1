"""Minimum-time timing of a path by reachability analysis (TOPP-RA). The only module that imports toppra.

The grid's points are the Greville points of the timing's B-spline, and TOPP-RA's squared speeds its control values: at
every knot (the middle of a grid interval) speed and path acceleration are then TOPP-RA's own. The library's result is
checked on a dense grid; where a limit is broken by more than 1e-7, it is tightened and the problem solved again.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.limits.along import Tightening
from energy_opt.motion.limits.base import Limit, Linear
from energy_opt.motion.limits.early_check import check_path
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.path import JointPath
from energy_opt.motion.path_dynamics import CRAWL, PathDynamics, has_torque_effects, points_of
from energy_opt.motion.timing.slowing import SLOWEST, TOLERANCE, broken, not_held, slowing, uses
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.numerics.bspline import greville
from energy_opt.power import PowerModel
from energy_opt.robot import Robot

INTERVALS = 200  # of the grid
ROUNDS = 8
SLOWER = 0.1, 0.01, 1e-3, 0.0  # shares of the largest squared speeds at which tangents to friction are tried
CHECKS_PER_INTERVAL = 5
GAIN = 1e-3  # relative: smaller gains of a minimum time end the iteration


def fastest(robot: Robot, model: PowerModel, path: JointPath, *, limits: Sequence[Limit] | None = None) -> Timing:
    """The fastest timing of a path within limits (torque with every torque effect of `model`).

    It begins and ends with the path's speeds there.

    TOPP-RA supports limits that are linear in path acceleration and squared speed, or that a tangent replaces. If the
    result breaks others, such as jerk, coarser grids, which switch more gently, and even slowing are tried, and the
    fastest valid timing is returned.

    Args:
        limits: in place of the robot's own.

    Raises:
        Infeasible: names joint, limit, path position and excess if known before solving; else the place where TOPP-RA
            gave up.
    """
    held = joint_limits(robot.limits) if limits is None else tuple(limits)
    knots = np.linspace(0, 1, INTERVALS)  # of the timing; grid points lie between them and at both ends
    count = CHECKS_PER_INTERVAL * (len(knots) - 1) + 1
    dense = PathDynamics(robot, model, path, points_of(path, count))
    check_path(held, dense)
    if not path.moves:
        return Timing(path, np.array([0.0, 0.5, 1.0]), np.zeros(4))
    ends = path.start_speed, path.end_speed
    timing = _checked_toppra(knots, ends, held, dense)
    middle, one = dense.at(np.array([0.5])), np.ones(1)
    rest = [limit for limit in held if limit.local or limit.tangent(middle, one, one) is None]
    return _slowed_or_coarser(knots, ends, held, rest, dense, timing)


def _slowed_or_coarser(
    knots: np.ndarray, ends: tuple[float, float], limits: Sequence[Limit], rest: Sequence[Limit], dense: PathDynamics,
    timing: Timing,
) -> Timing:  # fmt: skip
    """The fastest of: the timing slowed until the `rest` of the limits hold too, and the same on coarser grids."""
    best: Timing | None = None
    for coarser in (1, 2, 4, 8):
        if coarser > 1:
            if len(knots) // coarser < 10:
                break
            try:
                picked = np.append(knots[:-1:coarser], 1.0)
                timing = _checked_toppra(picked, ends, limits, dense)
            except Infeasible:
                break
        factor = slowing(rest, dense, timing)
        if factor > 1 and any(ends):
            continue  # given end speeds cannot be slowed
        slowed = timing.slowed(timing.duration * factor * (1 + TOLERANCE)) if factor > 1 else timing
        best = slowed if best is None or slowed.duration < best.duration else best
        if factor >= SLOWEST and any(broken(limit, dense, slowed) for limit in rest if not limit.order):
            raise not_held(rest, dense, slowed, f"does not hold even {SLOWEST:g} times slower")
        if factor == 1:
            break
        if all(limit.local for limit in rest if broken(limit, dense, timing)):
            return _repeated_with_tangents(ends, limits, dense, best)
    if best is None:
        raise not_held(rest, dense, timing, "does not hold with the given end speeds")
    return best


def _repeated_with_tangents(
    ends: tuple[float, float], limits: Sequence[Limit], dense: PathDynamics, best: Timing
) -> Timing:
    """TOPP-RA, repeated with tangents at the fastest timing so far that is inside all limits."""
    at, timing = dense.at(greville(best.knots)), best
    for _ in range(ROUNDS):
        b, a, _ = timing.speed(at.s)
        lines = [(limit, limit.tangent(at, a, np.maximum(b, CRAWL))) for limit in limits]
        try:
            found = _solve(at, best.knots, ends, lines, Tightening())
        except Infeasible:
            break
        factor = slowing(limits, dense, found)
        timing = found.slowed(found.duration * factor * (1 + TOLERANCE)) if factor > 1 else found
        if timing.duration > best.duration * (1 - GAIN):
            break
        best = timing
    return best


def _checked_toppra(
    knots: np.ndarray, ends: tuple[float, float], limits: Sequence[Limit], dense: PathDynamics
) -> Timing:
    """TOPP-RA, checked and solved again with tighter bounds until the check passes."""
    points = greville(knots)
    at = dense.at(points)
    a, b = np.zeros(len(points)), _fastest_speed(limits, at)
    lines = [(limit, None if limit.local else limit.tangent(at, a, b)) for limit in limits]
    known = [limit for limit, line in lines if line is not None]
    tight, refused, timing = Tightening(), 0, None
    for _ in range(ROUNDS):
        try:
            timing = _solve(at, knots, ends, lines, tight)
        except Infeasible:  # a tangent to friction at a high speed may overstate it at low speeds
            if timing is not None:
                break
            if not has_torque_effects(at.model) or refused == len(SLOWER):
                raise
            lines = [(limit, limit.tangent(at, a, np.maximum(SLOWER[refused] * b, CRAWL))) for limit in known]
            refused += 1
            continue
        found = uses(known, dense, timing)
        if max(use.worst[0] for use in found) <= 1 + TOLERANCE:
            return timing
        tight = tight.after(found, dense.s, points)
        if has_torque_effects(at.model):
            b, a, _ = timing.speed(points)
            b = np.maximum(b, CRAWL)
            lines = [(limit, limit.tangent(at, a, b)) for limit in known]
    assert timing is not None
    return _slowed_until_inside(timing, dense, known, ends)


def _fastest_speed(limits: Sequence[Limit], at: PathDynamics) -> np.ndarray:
    """Largest squared path speed (M,) under the limits of speed alone."""
    fastest = np.full(len(at.s), np.inf)
    for limit in limits:
        line = limit.linear(at, 1.0)
        if line is not None and line.of_speed:
            fastest = np.minimum(fastest, line.fastest)
    return fastest


def _slowed_until_inside(
    timing: Timing, dense: PathDynamics, limits: Sequence[Limit], ends: tuple[float, float]
) -> Timing:
    """The timing slowed evenly: torque falls towards the holding torque, all other limited values towards zero."""
    factor = 1.0 if any(ends) else slowing(limits, dense, timing)
    if 1 < factor < SLOWEST:
        return timing.slowed(timing.duration * factor * (1 + TOLERANCE))
    raise not_held(limits, dense, timing, "cannot be held")


class _LazyModule(ModuleType):
    """A module that is imported when one of its attributes is used."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or sys.modules.get(self.__name__) is self:
            raise AttributeError(name)
        return getattr(importlib.import_module(self.__name__), name)


@cache
def _without_pyplot() -> None:
    """Import toppra but defer matplotlib, which only its inspection plots need. Saves 0.4 s of CPU."""
    absent = [name for name in ("matplotlib", "matplotlib.pyplot") if name not in sys.modules]
    sys.modules.update({name: _LazyModule(name) for name in absent})
    try:
        importlib.import_module("toppra.algorithm")
    finally:
        for name in absent:
            del sys.modules[name]


def _solve(
    at: PathDynamics, knots: np.ndarray, ends: tuple[float, float], tangents: Sequence[tuple[Limit, Linear | None]],
    tight: Tightening,
) -> Timing:  # fmt: skip
    """One run of TOPP-RA on the grid at.s, the Greville points of `knots`."""
    _without_pyplot()
    from toppra.algorithm import TOPPRA

    lines = [(limit, line, tight.of(limit)) for limit, line in tangents if line is not None]
    held = _Constraints.of(at.robot.joints, lines)
    # the unit of time scales squared speeds to order one, as the library's tolerances are absolute
    unit = float(min(held.speed.max(), max(ends) ** 2 if any(ends) else np.inf, held.typical()))
    algorithm = TOPPRA([_constraint(held, unit)], _Interval(at.robot.n), gridpoints=at.s, solver_wrapper="seidel")
    speeds = [end / np.sqrt(unit) for end in ends]
    algorithm.compute_parameterization(*speeds)
    data = algorithm.problem_data
    if data.sd_vec is None or np.isnan(data.sd_vec).any():
        sets = None if data.K is None else np.asarray(data.K) * unit
        raise _failure(held, at.s, ends, sets)
    control = unit * data.sd_vec**2
    control[1:-1] = np.maximum(control[1:-1], 1e-9 * control.max())
    control[[0, -1]] = np.square(ends)
    return Timing(at.path, knots, control)


@dataclass(frozen=True)
class _Constraints:
    """Limits on the grid as |ra a + rb b + r0| <= 1, (M, m) each; and b <= speed (M,)."""

    ra: np.ndarray
    rb: np.ndarray
    r0: np.ndarray
    speed: np.ndarray
    names: tuple[tuple[str, str], ...]  # (m,) joint and limit
    fastest: tuple[tuple[str, str], ...]  # (M,) joint and limit that bound the speed

    @classmethod
    def of(cls, joints: tuple[str, ...], lines: Sequence[tuple[Limit, Linear, np.ndarray | float]]) -> _Constraints:
        parts: list[list[np.ndarray]] = []
        names: list[tuple[str, str]] = []
        speeds: list[np.ndarray] = []
        of_speeds: list[tuple[str, str]] = []
        for limit, line, factor in lines:
            owners = [(limit.where(joints, j), limit.name) for j in range(line.ra.shape[1])]
            if line.of_speed:
                square = factor**2 if limit.squared else factor
                speeds.append(1 / np.maximum(line.rb / square, 1e-24))
                of_speeds += owners
                continue
            bounded = np.abs(np.stack([line.ra, line.rb, line.r0])).max(axis=(0, 1)) > 0
            parts.append([(x / factor)[:, bounded] for x in (line.ra, line.rb, line.r0)])
            names += [owner for owner, some in zip(owners, bounded, strict=True) if some]
        ra, rb, r0 = (np.hstack(block) for block in zip(*parts, strict=True))
        speed = np.hstack(speeds)
        first = speed.argmin(axis=1)
        tightest = tuple(of_speeds[j] for j in first)
        return cls(ra, rb, r0, speed[np.arange(len(first)), first], tuple(names), tightest)

    def typical(self) -> float:
        """A squared path speed that the path accelerations within the limits reach."""
        return float(1 / max(np.abs(self.ra).max(initial=0.0), 1e-12))


class _Interval:
    """The attributes that the library needs of a path whose constraints are given as numbers."""

    path_interval = (0.0, 1.0)

    def __init__(self, dof: int) -> None:
        self.dof = dof


def _constraint(held: _Constraints, unit: float) -> Any:
    """The constraints as the library's linear constraint, held at both ends of every grid interval."""
    from toppra.constraint import DiscretizationType, LinearConstraint
    from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate

    class Given(LinearConstraint):
        def __init__(self) -> None:
            super().__init__()
            self.set_discretization_type(DiscretizationType.Interpolation)
            self.identical = True

        def compute_constraint_params(self, path: Any, gridpoints: np.ndarray) -> tuple[Any, ...]:
            count = held.ra.shape[1]
            both = np.vstack([np.eye(count), -np.eye(count)])
            limit = np.ones(2 * count)
            speed = np.stack([np.zeros_like(held.speed), held.speed / unit], axis=1)
            linear = (held.ra * unit, held.rb * unit, held.r0, both, limit)
            a, b, c, f, g, _, _ = canlinear_colloc_to_interpolate(*linear, None, None, gridpoints, identical=True)
            return a, b, c, f, g, None, speed

    return Given()


def _failure(held: _Constraints, s: np.ndarray, ends: tuple[float, float], sets: np.ndarray | None) -> Infeasible:
    """The error where and on which limit the reachability analysis failed."""
    lost = np.flatnonzero(np.isnan(sets).any(axis=1)) if sets is not None else np.zeros(0, dtype=int)
    if lost.size or sets is None:
        k, b = int(lost.max()) if lost.size else 0, float(ends[1] ** 2)
        text = f"no speed at path position {s[k]:.3f} leads to the goal with path speed {ends[1]:.4g} 1/s"
    else:
        k, b = 0, float(ends[0] ** 2)
        text = (
            f"the start's path speed {ends[0]:.4g} 1/s is not among those that lead to the goal, "
            f"{np.sqrt(max(sets[0, 0], 0)):.4g} to {np.sqrt(max(sets[0, 1], 0)):.4g} 1/s"
        )
    joint, limit, excess = _tightest(held, k, b)
    return Infeasible(
        f"{joint}: {text}: the {limit} limit prevents it",
        joint=joint,
        limit=limit,
        position=float(s[k]),
        excess=excess,
    )


def _tightest(held: _Constraints, k: int, b: float) -> tuple[str, str, float]:
    """The limit that binds most at grid point k and squared speed b: joint, kind, excess there."""
    if b > held.speed[k]:
        return (*held.fastest[k], float(np.sqrt(b / held.speed[k]) - 1))
    slope, rest = held.ra[k], held.rb[k] * b + held.r0[k]
    with np.errstate(divide="ignore"):
        ends = np.stack([(1 - rest) / slope, (-1 - rest) / slope])
    steep = np.abs(slope) > 1e-12
    upper = np.where(steep, ends.max(axis=0), np.inf)  # largest path acceleration that each constraint allows
    row = int(np.argmin(upper))
    a = float(upper[row])
    value = np.abs(slope * a + rest if np.isfinite(a) else rest) - 1
    worst = int(np.argmax(value)) if value.max() > 1e-9 else row
    joint, kind = held.names[worst]
    return joint, kind, float(max(value[worst], 0.0))
