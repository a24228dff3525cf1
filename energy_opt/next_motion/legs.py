"""Legs of a recording: single moves from rest to rest, drawn as quintics and reshaped so that rival models differ.

The cost that the reshaper minimises is the similarity of the rivals. With y_i the reading that model i expects, it is
- sum_{i<k} w_ik mean (y_i - y_k)^2, the mean over the move and the pause after it, so that the duration may be free.
Weights and all models' values are parameters: one build serves every pair of poses, pass and round of a search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import casadi as ca
import numpy as np

from energy_opt.effects import BaseTilt, MeterDelay, MeterFilter, MeterGain, Payload, Signals, Smooth
from energy_opt.motion.limits.base import Limit, box_of, scaled
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.reshape.curve import Curve, fitted
from energy_opt.motion.reshape.layout import Ends, Shape
from energy_opt.motion.reshape.nodes import NodeFunctions, NodeSymbols, derived, symbolic_torque
from energy_opt.motion.reshape.search import trajectory_of
from energy_opt.motion.reshape.task import Level, Task
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel, drive_terms
from energy_opt.power.structure import size_of
from energy_opt.robot import Limits, Robot

PAUSE, PAUSE_SAMPLES = 0.4, 20  # [s]
SPARE = 0.98  # share of every limit used in reshaping: nodes do not see all of a curve
BENT = 24  # random bends that are tried; the best one is reshaped
BEND = 0.5  # standard deviation of a bend's amplitude, over half of a joint's range
WAVES = 4  # most half periods of a bend
ITERATIONS, TRUST, TOLERANCE = 40, 0.4, 1e-3  # of a reshaping: most iterations, first step [rad, m], relative tolerance
SHORTEST = 0.5  # [s]
PEAKS = {1: 1.875, 2: 5.774, 3: 60.0}  # largest value of a quintic's derivatives, per unit of distance and of 1 / T^k


@dataclass(frozen=True)
class Way:
    """A move from pose to pose within limits, at first in `duration` [s], which may change within `durations`."""

    start: np.ndarray
    goal: np.ndarray
    duration: float
    durations: tuple[float, float]
    limits: Limits

    @property
    def ends(self) -> Ends:
        """Start and goal, at rest."""
        rest = np.zeros_like(self.start)
        return Ends(self.start, self.goal, rest, rest, np.zeros((0, len(rest))))

    def quintic(self, shape: Shape) -> Curve:
        """The straight path, as a curve of `shape`."""
        u = np.linspace(0, 1, 8 * shape.basis.controls)
        share = u**3 * (10 - 15 * u + 6 * u**2)
        return fitted(shape, u, self.start + np.outer(share, self.goal - self.start), self.ends, self.duration)


def reshaped(
    level: Level, way: Way, leg: Curve, parameters: np.ndarray, rng: np.random.Generator | None = None
) -> Curve:
    """A leg reshaped to lower the level's cost; `leg` itself if the solver ends outside the limits.

    Args:
        level: the cost and its nodes. way: ends, limits and durations. leg: to begin with.
        parameters: (P,) the models' values. rng: None begins with `leg`, else with the best of some random bends.
    """
    limits = scaled(joint_limits(way.limits), SPARE)
    task = Task(way.ends, limits, parameters, way.durations, 0.0)
    start = leg if rng is None else _bent(level, task, leg, rng)
    outcome = task.descended(task.model(level), start, ITERATIONS, trust=TRUST, tolerance=TOLERANCE)
    return outcome.curve if outcome.broken < 1 / SPARE - 1 else leg


def _bent(level: Level, task: Task, leg: Curve, rng: np.random.Generator) -> Curve:
    """The best of some randomly bent copies of `leg`, each as fast as the limits on motion allow."""
    shape = level.shape
    lower, upper = box_of(task.limits, shape.joints)
    u, half = np.linspace(0, 1, shape.basis.controls), (upper - lower) / 2
    waves = np.stack([np.sin(np.pi * u) * np.sin(k * np.pi * u) for k in range(1, WAVES + 1)])
    best, least = leg, np.inf
    for _ in range(BENT):
        bend = waves.T @ (rng.normal(size=(WAVES, shape.joints)) * half / np.arange(1, WAVES + 1)[:, None])
        bend[: shape.pinned] = bend[-shape.pinned :] = 0
        for size in BEND * 0.6 ** np.arange(8):
            points = np.clip(leg.points + size * bend, lower, upper)
            curve = _fastest(Curve(shape, points, 1.0, leg.via_u), task.limits)
            if curve.duration <= task.durations[1]:
                break
        curve = task.within(curve)
        costs, shares = level.shares(curve.points[None], curve.duration, task)
        value = float(costs[0]) / max(1.0, *(float(share.max()) for share in shares.values())) ** 2
        if value < least:
            best, least = curve, value
    return best


def _fastest(curve: Curve, limits: Sequence[Limit]) -> Curve:
    """The curve in the shortest duration within limits on the derivatives of position."""
    shortest = [
        np.max(np.abs(curve.shape.sites[limit.order - 1] @ curve.points) / limit.bound) ** (1 / limit.order)
        for limit in limits
        if limit.order
    ]
    return replace(curve, duration=float(max(shortest)))


def shortest(robot: Robot, limits: Sequence[Limit], start: np.ndarray, goal: np.ndarray) -> float:
    """Duration [s] of the shortest quintic within the limits on motion and torque, a tenth of them to spare.

    Args:
        robot: for its torques. limits: on motion. start, goal: (n,) [rad, m].
    """
    way = goal - start
    moved = [np.max(PEAKS[k.order] * 1.1 * np.abs(way) / k.bound) ** (1 / k.order) for k in limits if k.order]
    duration = max(SHORTEST, *(float(one) for one in moved))
    x = np.linspace(0, 1, 21)
    share, rate, curve = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - 3 * x + 2 * x**2)
    for _ in range(12):
        q, v, a = start + np.outer(share, way), np.outer(rate, way) / duration, np.outer(curve, way) / duration**2
        if (1.1 * np.abs(robot.body.torque(q, v, a)) <= robot.limits.effort).all():
            break
        duration *= 1.2
    return duration


def joined(legs: Sequence[Curve], joints: tuple[str, ...]) -> Trajectory:
    """One trajectory of legs that follow one another, with a pause after each."""
    n = len(joints)
    time, q, v, a = [np.zeros(1)], [legs[0].points[:1]], [np.zeros((1, n))], [np.zeros((1, n))]
    still = np.zeros((PAUSE_SAMPLES, n))
    for leg in legs:
        t = trajectory_of(leg, joints)
        begin, end = time[-1][-1], time[-1][-1] + t.duration
        time += [begin + t.time[1:], end + PAUSE * np.arange(1, PAUSE_SAMPLES + 1) / PAUSE_SAMPLES]
        q += [t.position[1:], still + t.position[-1]]
        v += [t.velocity[1:], still]
        a += [t.acceleration[1:], still]
    return Trajectory(joints, np.concatenate(time), np.vstack(q), np.vstack(v), np.vstack(a))


HARDLY = 0.005  # [s] smaller differences of lag are ignored


def contrast_functions(models: Sequence[PowerModel], robot: Robot, strongest: np.ndarray) -> NodeFunctions:
    """The node functions of these models; their parameters are those of `contrast_parameters`.

    Args:
        strongest: (n,) index of the model whose motor torque counts at each joint.
    """
    n = robot.n
    x, p = NodeSymbols.of(n), [model.symbols(n) for model in models]
    v, a = x.v, x.a
    torques: dict[tuple[str, ...], ca.SX] = {}
    shown, tau_m = [], []
    for model, own, lag in zip(models, p, _lags(models), strict=True):
        rigid = tuple(repr(model.get(kind.name)) for kind in (Payload, BaseTilt))
        if rigid not in torques:
            torques[rigid] = symbolic_torque(model, robot.body, x.q, v, a, own, "auto")
        terms = drive_terms(model, Signals(x.q, v, a, torques[rigid], x.t), own, Smooth(size=size_of(robot)))
        reading = terms.power
        if lag:  # dP/dt without the term in jerk, which a node does not know
            reading -= lag * ca.jtimes(terms.power, ca.vertcat(x.q, x.q1), ca.vertcat(x.q1, x.q2)) / x.duration
        gain = model.get(MeterGain.name)
        shown.append(reading if gain is None else gain.values["gain"][0] * reading)
        tau_m.append(terms.tau_m)
    pairs = list(combinations(shown, 2))
    weights = ca.SX.sym("w", len(pairs))
    apart = ca.vertcat(*((y - other) ** 2 for y, other in pairs))
    share = x.duration / (x.duration + PAUSE)
    tau = ca.vertcat(*(tau_m[k][joint] for joint, k in enumerate(strongest)))
    return derived(-share * ca.dot(weights, apart), tau, x, ca.vertcat(*p, weights))


def contrast_parameters(models: Sequence[PowerModel], joints: int, weights: np.ndarray) -> np.ndarray:
    """The parameters of `contrast_functions`: all models' values and the pairs' weights (pairs,) [1/W^2]."""
    return np.concatenate([*(model.values(joints) for model in models), weights])


def _lags(models: Sequence[PowerModel]) -> np.ndarray:
    """Lag [s] of each model's meter relative to their mean; zeros if all lags nearly agree.

    A first-order lag counts half: it delays a slow power like a delay of the same time, and a fast one less. Only the
    search uses this approximation; motions are judged by the meter's full law.
    """
    lags = np.zeros(len(models))
    for kind, share in ((MeterDelay, 1.0), (MeterFilter, 0.5)):
        for k, model in enumerate(models):
            held = model.get(kind.name)
            lags[k] += 0.0 if held is None else share * float(held.full(1)[0])
    return np.zeros(len(models)) if np.ptp(lags) < HARDLY else lags - lags.mean()
