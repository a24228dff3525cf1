"""Sequential quadratic programming on a reshaping problem, with a trust region and an l1 merit function.

Each linearisation is one banded quadratic program (see `numerics.quadratic`). A step is taken if the merit, cost plus
price times the sum of excesses, falls; excesses up to a small share of a bound are free, so that steps along curved
limits are not cut short (the Maratos effect). After a failed step, constraints linearised at its end join the program
until the next one: a second-order correction.

A program whose constraints cannot all be met in the trust region, or that saves nothing, is solved again with relaxed
ones: free excesses need not shrink, and larger ones only down to what is free. So program and merit count the same
excesses. Without this, steps that only reduce free excesses promise much and win nothing, and the trust region shrinks
until the search ends far from an optimum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from energy_opt.motion.reshape.evaluation import Point
from energy_opt.motion.reshape.model import Model
from energy_opt.numerics.quadratic import LEAST_DAMPING, minimise

# last barrier parameter of quadratic programs, at most, and as a share of the tolerance
BARRIER, CLOSER = 1e-6, 0.01
PRICE = 30.0  # price of a constraint's excess in a quadratic program, whose cost is of order one
BOLD, FAIR = 0.7, 0.3  # ratios of actual to expected decrease: above BOLD the trust region grows, below FAIR it shrinks
LEAST_TRUST = 2e-4  # [rad] smallest trust region
UNMET = 1e-3  # a quadratic program has not met its constraints if its sum of excesses is larger
ACCEPTED = 1e-3  # least such ratio at which a step is taken
SHALLOW = 0.12  # largest excess of a numeric constraint at which the constraints at a failed step's end are added
SADDLE = 0.003  # factor of the tolerance if the model is not convex: near a saddle little decrease is expected
STALLED = 1e-4  # share of the cost: converged if no step is taken and the expected decrease is less
HEAVY = 30.0  # damping above which Hessians of nodes and places are made convex one by one, as at kinks of dry friction
LAST, LITTLE = 10, 1e-3  # converged if the last LAST steps saved less than the share LITTLE of the cost
KINKED = 8  # most failed steps from one point at kinks
# If a failed step's worst excess is above twice the one before plus FAR, |d2q/du2| of further steps is at most BEND
# times the trust region: zigzags of control points change accelerations much, which limits of the tool, linearised,
# hide. On 24 moves with a limit of the tool's acceleration this takes 2 % less energy in the mean, 33 % less at best
# and 0.3 % more at worst (`benchmarks/tool_limits.py`).
BEND, FAR = 400.0, 1.0
TRIES = 5  # most failed steps from one point otherwise, unless it is within all limits and more than LITTLE is expected


@dataclass
class Descent:
    """The state of a search.

    Attributes:
        keys, multipliers: (R,) of the last program's constraints.
        damping: multiple of `Model.mass` in the last Hessian.
        trust: [rad, m] largest move of control points in the next step.
        iterations: programs whose step was tried. steps: those of the interior-point method in all programs.
        convex: Hessians of nodes and places are made convex one by one.
        smooth: second derivatives of steps are bounded.
    """

    point: Point
    keys: np.ndarray
    multipliers: np.ndarray
    damping: float = 0.0
    trust: float = 0.0
    iterations: int = 0
    steps: int = 0
    convex: bool = False
    smooth: bool = False
    converged: bool = False


def begin(point: Point) -> Descent:
    """A search before its first step."""
    return Descent(point, np.zeros(0, dtype=np.int64), np.zeros(0))


def descend(
    model: Model, now: Descent, iterations: int, trust: float, *, tolerance: float = 1e-4, give: float = 1e-6,
    slack: float = 0.0, most: float = 0.8, stopped: Callable[[], bool] = lambda: False,
) -> Descent:  # fmt: skip
    """Continue a search from its state, which is changed in place and returned.

    Args:
        iterations: most steps to try.
        trust: [rad, m] largest move of control points in the first step; most: in any step.
        tolerance: share of the cost; the search ends if the expected decrease is less.
        give: share of a bound by which limits may be exceeded without a penalty; slack: the same of numeric
            constraints, in their own unit.
        stopped: True ends the search before the next linearisation.
    """
    point = now.point
    price, barrier = 3.0, min(BARRIER, CLOSER * tolerance)
    broken = model.broken(point, give, slack)
    now.converged, costs = False, [np.inf]
    for _ in range(iterations):
        if stopped():
            break
        known = model.multipliers(point, now.keys, now.multipliers)
        hessian, gradient = model.hessian(point, known, now.convex), model.gradient(point)
        within = model.linear_constraints(point).joined(model.other_constraints(point, trust))
        within = within.joined(model.order_constraints(point))
        near = within.joined(model.via_constraints(point))
        constraints, failed = near, 0
        # try less than before; the program adds what convexity needs
        damping = now.damping / 3 if now.damping > 2 * LEAST_DAMPING else 0.0
        while True:
            bounds = box(model, point, trust)
            try:
                held = model.smooth_steps(constraints, point, BEND * trust) if now.smooth else constraints
                allowed = model.relaxed(held, give, slack)
                other = allowed is not held
                found = minimise(hessian, gradient, bounds, held, PRICE, model.mass, damping, barrier, trying=other)
                least = tolerance * max(abs(point.cost), 0.02)
                if other and (found.broken > UNMET or found.saved < least):
                    # it needs about the damping of the first one
                    found = minimise(hessian, gradient, bounds, allowed, PRICE, model.mass, found.damping, barrier)
            except np.linalg.LinAlgError:  # no damping makes the program convex, because numbers overflowed
                return now
            now.steps += found.steps
            if found.damping > HEAVY and not now.convex:
                now.convex, damping = True, 0.0
                hessian = model.hessian(point, known, convex=True)
                continue
            # what the merit is expected to save: cost, and the excesses that the program does not leave
            predicted = found.saved
            elastic = found.broken if found.broken > UNMET else 0.0
            if elastic > broken and constraints is not near:  # constraints at both ends of a step contradict each other
                constraints = near
                continue
            # an l1 merit is exact if its price is above every multiplier
            most_price = float(np.abs(found.multipliers).max(initial=0.0))
            price = max(0.5 * price, 2 * most_price, 1.0) if not elastic else PRICE
            predicted += price * (broken - elastic)
            step = float(np.abs(found.d[: model.shape.size]).max(initial=0.0))
            points, duration, via_u = model.moved(point, found.d)
            # onto the via points, or towards them if the trust region leaves the step short of them
            for onto in (model.passing(points, via_u), points)[: 2 if elastic and model.shape.vias else 1]:
                trial = model.at(onto, duration, via_u, 2 * step)
                trial_broken = model.broken(trial, give, slack)
                won = point.cost - trial.cost + price * (broken - trial_broken)
                ratio = won / max(predicted, 1e-12)
                now.iterations += 1
                good = ratio > ACCEPTED or abs(predicted) < 1e-9
                if good:
                    break
            if good:
                point, broken = trial, trial_broken
                now.keys, now.multipliers, now.damping = constraints.keys, found.multipliers, found.damping
                now.point = point
                costs.append(point.cost + price * broken)
                if ratio > BOLD and step > 0.9 * trust:
                    trust = min(2 * trust, most)
                elif ratio < FAIR:
                    trust = max(0.7 * step, LEAST_TRUST)
                break
            # the step failed: a second-order correction, or a smaller trust region
            failed += 1
            damping, corrected = found.damping, constraints is not near
            now.smooth |= model.excess(trial) > max(2 * model.excess(point), 0.0) + FAR
            again = model.other_constraints(trial, step) if model.deepest(trial) < SHALLOW else None
            if again is not None and (again.count or model.shape.vias):
                # via points only as linearised at the step's end: at two linearisations at once, they leave no step
                again = again.joined(model.via_constraints(trial))
                s, ahead = model.shape, found.d.copy()
                ahead[: s.size] += (trial.points - points)[s.pinned : len(points) - s.pinned].ravel()
                constraints = within.joined(again.moved(ahead))
            # the excess of a corrected program is that of both ends: a small decrease does not mean that it converged
            tries = KINKED if now.convex or now.smooth else TRIES
            worth = not broken and predicted > LITTLE * max(abs(point.cost), 0.02)  # shorter steps along tight limits
            full = failed == 1 and again is not None and again.count and trial_broken > broken
            trust = min(step, trust) * (1.0 if full else 0.5)
            if (failed > tries and not worth) or trust < LEAST_TRUST or (predicted < least and not corrected):
                break
        now.trust = trust
        if abs(predicted) < tolerance * (SADDLE if found.damping else 1.0) * max(abs(point.cost), 0.02):
            now.converged = True
            break
        if not good:
            now.converged = abs(predicted) < STALLED * max(abs(point.cost), 0.02)
            break
    before = costs[-LAST:][0]
    now.converged |= broken <= give and before - costs[-1] < LITTLE * max(abs(point.cost), 0.02)
    return now


def box(model: Model, point: Point, trust: float) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest step (N + k,), of which neither excludes the step 0.

    Args:
        trust: r [rad, m]: control points, and ends along their directions, move by at most r, T by the share min(r,
            0.5) of itself, and the via points' times u by 0.3 min(r, 0.5).
    """
    s = model.shape
    inner = point.points[s.pinned : len(point.points) - s.pinned]
    low = np.maximum(model.box[0] - inner, -trust).ravel()
    high = np.minimum(model.box[1] - inner, trust).ravel()
    if not model.border:
        return np.minimum(low, 0.0), np.maximum(high, 0.0)
    edge_low, edge_high = [], []
    if not model.fixed:
        most = min(trust, 0.5) * point.duration
        edge_low.append(max(model.durations[0] - point.duration, -most))
        edge_high.append(min(model.durations[1] - point.duration, most))
    edge_low += [-trust] * len(point.along)
    edge_high += [trust] * len(point.along)
    for u in point.via_u:
        edge_low.append(max(-u, -0.3 * min(trust, 0.5)))
        edge_high.append(min(1 - u, 0.3 * min(trust, 0.5)))
    low, high = np.concatenate([low, edge_low]), np.concatenate([high, edge_high])
    return np.minimum(low, 0.0), np.maximum(high, 0.0)
