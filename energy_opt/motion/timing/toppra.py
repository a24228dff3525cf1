"""Minimum-time timing of a path by reachability analysis (TOPP-RA). The only module that imports toppra.

The grid's points serve as Greville points of the timing's B-spline, and TOPP-RA's squared speeds as its control values:
at every knot (the middle of a grid interval) speed and path acceleration are then TOPP-RA's own. What the library
returns is not believed but checked on a dense grid; where a limit is broken by more than 1e-7 it is tightened there and
solved again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.path import JointPath
from energy_opt.motion.timing.law import Timing, greville
from energy_opt.motion.timing.path_dynamics import CRAWL, PathDynamics, check_path, has_torque_effects, points_of
from energy_opt.power import PowerModel
from energy_opt.robot import Limits, Robot

INTERVALS = 200
TOLERANCE = 1e-7  # of a bound: less than this is no violation
ROUNDS = 8
CHECKS_PER_INTERVAL = 5


@dataclass(frozen=True)
class _Tightening:
    """Factors (M, n), at the grid's points, by which the bounds are taken smaller than they are."""

    velocity: np.ndarray
    acceleration: np.ndarray
    effort: np.ndarray

    def after(self, excess: dict[str, np.ndarray], s: np.ndarray, grid: np.ndarray) -> _Tightening:
        """Smaller around the places `s` where a limit was broken, by a little more than it was."""
        interval = np.clip(np.searchsorted(grid, s, side="right") - 1, 0, len(grid) - 2)
        changed = {}
        for kind in ("velocity", "acceleration", "effort"):
            worst = np.zeros((len(grid) - 1, excess[kind].shape[1]))
            np.maximum.at(worst, interval, excess[kind])
            padded = np.concatenate([worst[:1], worst[:1], worst, worst[-1:], worst[-1:]])
            around = np.maximum.reduce([padded[j : j + len(grid)] for j in range(4)])
            changed[kind] = getattr(self, kind) / (1 + 1.2 * around)
        return _Tightening(**changed)


def fastest(
    robot: Robot,
    model: PowerModel,
    path: JointPath,
    *,
    grid: int | np.ndarray = INTERVALS,
    start_speed: float = 0.0,
    end_speed: float = 0.0,
    limits: Limits | None = None,
    jerk: bool = True,
) -> Timing:
    """The fastest timing within velocity, acceleration and torque limits (torque with every torque effect of `model`).

    TOPP-RA knows no jerk: where the robot has jerk limits (and `jerk` is not False) and the result breaks them, coarser
    grids, which switch more gently, and an even slowing down are tried, and the fastest that holds them is returned.

    Args:
        grid: number of grid intervals, or the knots of the timing (grid points lie between them and at both ends).
        start_speed, end_speed: path speed at both ends, 1/s.
        limits: in place of the robot's own.

    Raises:
        Infeasible: names joint, limit, path position and excess, where that is known before solving; else the place
            where TOPP-RA gave up.
    """
    bounds = robot.limits if limits is None else limits
    knots = np.linspace(0, 1, grid) if isinstance(grid, int) else np.asarray(grid, dtype=float)
    count = CHECKS_PER_INTERVAL * (len(knots) - 1) + 1
    dense = PathDynamics(robot, model, path, points_of(path, count))
    check_path(robot, dense, bounds)
    if not path.moves:
        return Timing(path, np.array([0.0, 0.5, 1.0]), np.zeros(4))
    timing = _without_jerk(robot, model, path, knots, (start_speed, end_speed), bounds, dense)
    if not jerk or not np.isfinite(bounds.jerk).any():
        return timing
    return _with_jerk(robot, model, path, knots, (start_speed, end_speed), bounds, dense, timing)


def _with_jerk(
    robot: Robot,
    model: PowerModel,
    path: JointPath,
    knots: np.ndarray,
    ends: tuple[float, float],
    bounds: Limits,
    dense: PathDynamics,
    timing: Timing,
) -> Timing:
    """The fastest of: the timing slowed until jerk holds, and the same on coarser grids."""
    best: Timing | None = None
    for coarser in (1, 2, 4, 8):
        if coarser > 1:
            if len(knots) // coarser < 10:
                break
            try:
                picked = np.append(knots[:-1:coarser], 1.0)
                timing = _without_jerk(robot, model, path, picked, ends, bounds, dense)
            except Infeasible:
                break
        factor = max(1.0, float((dense.excess(timing, bounds)["jerk"].max() + 1) ** (1 / 3)))
        if factor > 1 and any(ends):
            continue  # the end speeds are given: they cannot be slowed
        slowed = timing.slowed(timing.duration * factor * (1 + TOLERANCE)) if factor > 1 else timing
        if best is None or slowed.duration < best.duration:
            best = slowed
        if factor == 1:
            break
    if best is None:
        excess = dense.excess(timing, bounds)["jerk"]
        k, j = np.unravel_index(int(np.argmax(excess)), excess.shape)
        raise Infeasible(
            f"{robot.joints[j]}: the jerk limit {bounds.jerk[j]:.4g} rad/s^3 does not hold with the given end speeds "
            f"at path position {dense.s[k]:.3f}",
            joint=robot.joints[j],
            limit="jerk",
            position=float(dense.s[k]),
            excess=float(excess[k, j]),
        )
    return best


def _without_jerk(
    robot: Robot,
    model: PowerModel,
    path: JointPath,
    knots: np.ndarray,
    ends: tuple[float, float],
    bounds: Limits,
    dense: PathDynamics,
) -> Timing:
    """TOPP-RA, checked and solved again with tighter bounds until the check passes."""
    points = greville(knots)
    at = PathDynamics(robot, model, path, points)
    one = np.ones_like(at.q)
    tight = _Tightening(one, one, one)
    a, b = np.zeros(len(points)), at.speed_bound(bounds.velocity)
    timing: Timing | None = None
    for _ in range(ROUNDS):
        timing = _solve(robot, at, knots, ends, bounds, tight, at.affine_torque(a, b))
        excess = dense.excess(timing, bounds, jerk=False)
        if max(float(e.max()) for e in excess.values()) <= TOLERANCE:
            return timing
        tight = tight.after(excess, dense.s, points)
        if has_torque_effects(model):
            b, a, _ = timing.speed(points)
            b = np.maximum(b, CRAWL)
    assert timing is not None
    return _slowed_until_inside(robot, timing, dense, bounds, ends)


def _slowed_until_inside(
    robot: Robot, timing: Timing, dense: PathDynamics, bounds: Limits, ends: tuple[float, float]
) -> Timing:
    """Even slowing brings torque towards what holding takes, and all else to zero."""
    factor = 1.0
    while not any(ends) and factor < 50:
        factor *= 1.01
        slower = timing.slowed(timing.duration * factor)
        if max(float(e.max()) for e in dense.excess(slower, bounds, jerk=False).values()) <= TOLERANCE:
            return slower
    worst = dense.excess(timing, bounds, jerk=False)
    kind = max(worst, key=lambda name: float(worst[name].max()))
    k, j = np.unravel_index(int(np.argmax(worst[kind])), worst[kind].shape)
    raise Infeasible(
        f"{robot.joints[j]}: the {kind} limit cannot be held at path position {dense.s[k]:.3f}",
        joint=robot.joints[j],
        limit=kind,
        position=float(dense.s[k]),
        excess=float(worst[kind][k, j]),
    )


def _solve(
    robot: Robot,
    at: PathDynamics,
    knots: np.ndarray,
    ends: tuple[float, float],
    bounds: Limits,
    tight: _Tightening,
    torque: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> Timing:
    """One run of TOPP-RA on the grid at.s, the Greville points of `knots`."""
    from toppra.algorithm import TOPPRA

    rows = _Rows.of(at, bounds, tight, torque)
    # in the unit of time in which squared speeds are of order one: the library's tolerances are absolute
    unit = float(min(rows.speed.max(), max(ends) ** 2 if any(ends) else np.inf, rows.typical()))
    algorithm = TOPPRA([_constraint(rows, unit)], _Interval(robot.n), gridpoints=at.s, solver_wrapper="seidel")
    speeds = [end / np.sqrt(unit) for end in ends]
    algorithm.compute_parameterization(*speeds)
    data = algorithm.problem_data
    if data.sd_vec is None or np.isnan(data.sd_vec).any():
        sets = None if data.K is None else np.asarray(data.K) * unit
        raise _failure(robot, rows, at.s, ends, sets)
    control = unit * data.sd_vec**2
    control[1:-1] = np.maximum(control[1:-1], 1e-9 * control.max())
    control[[0, -1]] = np.square(ends)
    return Timing(at.path, knots, control)


@dataclass(frozen=True)
class _Rows:
    """Limits on the grid as |ra a + rb b + r0| <= 1, (M, m) each; and b <= speed (M,)."""

    ra: np.ndarray
    rb: np.ndarray
    r0: np.ndarray
    speed: np.ndarray
    names: tuple[tuple[int, str], ...]  # (m,) joint and kind

    @classmethod
    def of(
        cls,
        at: PathDynamics,
        bounds: Limits,
        tight: _Tightening,
        torque: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> _Rows:
        accelerating, lifting = np.isfinite(bounds.acceleration), np.isfinite(bounds.effort)
        a, e = bounds.acceleration[accelerating], bounds.effort[lifting]
        zero = np.zeros((len(at.s), a.size))
        parts = zip((at.q1, at.q2, zero), torque, strict=True)
        ra, rb, r0 = (np.hstack([x if x is zero else x[:, accelerating] / a, y[:, lifting] / e]) for x, y in parts)
        names = [(int(j), "acceleration") for j in np.flatnonzero(accelerating)]
        names += [(int(j), "effort") for j in np.flatnonzero(lifting)]
        bound = np.hstack([tight.acceleration[:, accelerating], tight.effort[:, lifting]])
        speed = at.speed_bound(bounds.velocity * tight.velocity)
        return cls(ra / bound, rb / bound, r0 / bound, speed, tuple(names))

    def typical(self) -> float:
        """A squared path speed that the path accelerations within the limits reach."""
        return float(1 / max(np.abs(self.ra).max(initial=0.0), 1e-12))


class _Interval:
    """All that the library needs to know of a path whose constraints are given as numbers."""

    path_interval = (0.0, 1.0)

    def __init__(self, dof: int) -> None:
        self.dof = dof


def _constraint(rows: _Rows, unit: float) -> Any:
    """The rows as the library's linear constraint, held at both ends of every grid interval."""
    from toppra.constraint import DiscretizationType, LinearConstraint
    from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate

    class Given(LinearConstraint):
        def __init__(self) -> None:
            super().__init__()
            self.set_discretization_type(DiscretizationType.Interpolation)
            self.identical = True

        def compute_constraint_params(self, path: Any, gridpoints: np.ndarray) -> tuple[Any, ...]:
            count = rows.ra.shape[1]
            both = np.vstack([np.eye(count), -np.eye(count)])
            limit = np.ones(2 * count)
            speed = np.stack([np.zeros_like(rows.speed), rows.speed / unit], axis=1)
            linear = (rows.ra * unit, rows.rb * unit, rows.r0, both, limit)
            a, b, c, f, g, _, _ = canlinear_colloc_to_interpolate(*linear, None, None, gridpoints, identical=True)
            return a, b, c, f, g, None, speed

    return Given()


def _failure(
    robot: Robot, rows: _Rows, s: np.ndarray, ends: tuple[float, float], sets: np.ndarray | None
) -> Infeasible:
    """Where and on which limit the reachability analysis gave up."""
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
    joint, limit, excess = _tightest(robot, rows, k, b)
    return Infeasible(
        f"{robot.joints[joint]}: {text}: the {limit} limit stands in the way",
        joint=robot.joints[joint],
        limit=limit,
        position=float(s[k]),
        excess=excess,
    )


def _tightest(robot: Robot, rows: _Rows, k: int, b: float) -> tuple[int, str, float]:
    """The limit that binds most at grid point k and squared speed b: joint, kind, excess there."""
    if b > rows.speed[k]:
        speeds = np.sqrt(b / rows.speed[k])
        return int(np.argmin(robot.limits.velocity)), "velocity", float(speeds - 1)
    slope, rest = rows.ra[k], rows.rb[k] * b + rows.r0[k]
    with np.errstate(divide="ignore"):
        ends = np.stack([(1 - rest) / slope, (-1 - rest) / slope])
    steep = np.abs(slope) > 1e-12
    upper = np.where(steep, ends.max(axis=0), np.inf)  # largest path acceleration that each row allows
    row = int(np.argmin(upper))
    a = float(upper[row])
    value = np.abs(slope * a + rest if np.isfinite(a) else rest) - 1
    worst = int(np.argmax(value)) if value.max() > 1e-9 else row
    joint, kind = rows.names[worst]
    return joint, kind, float(max(value[worst], 0.0))
