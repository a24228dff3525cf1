"""The search for the motion to record next.

A motion goes there and back between two poses, fast and then slowly, so that speed, direction and load all change.
Random pairs of poses are tried with straight paths; for the best pairs, the optimizer reshapes every leg so that the
rivals' readings differ most. All candidates, also the straight ones, are compared by the smallest rms difference of two
rivals' readings. They must keep all limits by the certificate, torque limits under every rival, and, if there is a
cell, be proven to touch nothing.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from energy_opt.cell.cell import Cell
from energy_opt.errors import Infeasible
from energy_opt.motion.judge.certificate import Certificate, certify
from energy_opt.motion.judge.clearance import clearance_of
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.registry import joint_limits
from energy_opt.motion.reshape.curve import Curve
from energy_opt.motion.reshape.layout import Shape
from energy_opt.motion.reshape.task import Level
from energy_opt.motion.trajectory import Trajectory
from energy_opt.next_motion.legs import Way, contrast_functions, contrast_parameters, joined, reshaped, shortest
from energy_opt.next_motion.rival_models import Rival, nearest, separations
from energy_opt.numerics.bspline import Basis
from energy_opt.power import PowerModel
from energy_opt.robot import Limits, Robot

DRAWN, TRIED = 40, 3  # pairs of poses that are drawn; most that are reshaped, the best ones
WORK = 60_000  # [instructions] fewer pairs are reshaped if a Hessian at a node takes more than a third of this
ROUNDS = 8  # rounds of reshaping, each for the rivals that differ least on the last motion and for limits broken in it
SPAN = 2.0  # [rad] motions stay within this distance of the middle of a joint's range
ACCELERATION, JERK = 12.0, 1500.0  # [rad/s^2], [rad/s^3] limits if an arm's own are higher or unknown
SLOWER = 2.5  # factor on the duration of the slow pass, whose velocity limits are divided by it
DURATIONS = (0.7, 2.5)  # [s] range of a fast leg's duration, longer only if the straight path needs it
COARSE, FINE = 0.08, 0.008  # [s] between readings that are compared: for drawn motions, for the last ones
SAME = 1e-3  # [W] rivals with smaller differences count as equal at the meter
CONTROLS, PACKING = 12, 0.5  # control points of a leg's spline, and packing of its knots


@dataclass(frozen=True)
class NextMotion:
    """A motion to record.

    Attributes: trajectory: with the torque and power that the first rival expects. difference: rms difference [W] of
    the two most similar rivals over it. straight: the same for the best motion that was drawn. certificate: of the
    trajectory, under the first rival.
    """

    trajectory: Trajectory
    difference: float
    straight: float
    certificate: Certificate


def propose(rivals: Sequence[Rival], robot: Robot, seed: int = 0, cell: Cell | None = None) -> NextMotion | None:
    """The best motion found, or None if no motion distinguishes any two of the models.

    Pairs that are equal at the meter in every motion are ignored.

    Args:
        cell: the arm's body and its surroundings; the motion is proven to keep clear of them.

    Raises:
        Infeasible: no drawn motion holds the robot's limits and keeps clear.
    """
    rng = np.random.default_rng(seed)
    shape, limits = Shape(robot.n, Basis(CONTROLS, PACKING)), _search_limits(robot.limits)
    judge = _Judge(rivals, robot, cell)
    drawn = []
    for _ in range(DRAWN):
        poses = rng.uniform(limits.lower, limits.upper, (2, robot.n))
        paths = _paths(poses, shortest(robot, joint_limits(limits), *poses), limits)
        legs = [way.quintic(shape) for way in paths]
        drawn.append((judge.apart(legs, COARSE), paths, legs))
    judge.live = np.max([apart for apart, *_ in drawn], axis=0) >= SAME
    if not judge.live.any():
        return None
    drawn.sort(key=lambda row: -row[0][judge.live].min())
    straight = next((legs for *_, legs in drawn if (judge.torque(legs) <= 1).all() and judge.clear(legs)), None)
    if straight is None:
        clear = "" if cell is None else " and keeps clear"
        raise Infeasible(f"no drawn motion from pose to pose holds the torque limits under all rival models{clear}")
    candidates = [(judge.score(judge.apart(straight, FINE)), straight)]
    functions = contrast_functions(judge.models, robot, judge.torque(straight).argmax(axis=0))
    level, tried = Level(shape, functions), int(np.clip(WORK / functions.curvature.n_instructions(), 1, TRIED))
    for apart, paths, _ in itertools.islice((row for row in drawn if judge.clear(row[2])), tried):
        candidates += _reshaped_legs(level, judge, paths, apart, rng)
    for value, legs in sorted(candidates, key=lambda pair: -pair[0]):
        trajectory = joined(legs, robot.joints)
        certificate = certify(trajectory, judge.scorers[0], joint_limits(robot.limits))
        if certificate.valid and judge.clear(legs):
            return NextMotion(judge.scorers[0].filled(trajectory), value, candidates[0][0], certificate)
    raise Infeasible("no motion from pose to pose holds the robot's limits")


class _Judge:
    """Judges motions; `live` (pairs,) marks the pairs of rivals that some motion distinguishes."""

    def __init__(self, rivals: Sequence[Rival], robot: Robot, cell: Cell | None) -> None:
        self.rivals, self.models = rivals, [rival.model for rival in rivals]
        self.robot, self.cell = robot, cell
        self.scorers = [Scorer(robot, model) for model in self.models]
        self.live = np.zeros(0, dtype=bool)

    def apart(self, legs: Sequence[Curve], step: float) -> np.ndarray:
        """Rms difference [W] of every two rivals over a motion, (pairs,)."""
        return separations(self.rivals, self.robot.body, joined(legs, self.robot.joints), step)

    def nearest(self, legs: Sequence[Curve], pair: int) -> list[PowerModel]:
        """The models; the two of a pair are as similar on a motion as their uncertainty allows."""
        return nearest(self.rivals, self.robot.body, joined(legs, self.robot.joints), COARSE, pair)

    def score(self, apart: np.ndarray) -> float:
        """The smallest difference [W] of the `live` pairs."""
        return float(apart[self.live].min())

    def clear(self, legs: Sequence[Curve]) -> bool:
        """True if a motion is proven to touch nothing."""
        return self.cell is None or clearance_of(self.cell, joined(legs, self.robot.joints)).proven

    def torque(self, legs: Sequence[Curve]) -> np.ndarray:
        """Largest motor torque under each rival, as a share of its limit, (rivals, n)."""
        trajectory = joined(legs, self.robot.joints)
        time = np.arange(0.0, trajectory.duration, FINE)
        q, v, a, _ = trajectory.sample(time)
        drives = (scorer.drive(q, v, a, time)[0] for scorer in self.scorers)
        return np.array([np.abs(tau).max(axis=0) for tau in drives]) / self.robot.limits.effort


def _reshaped_legs(
    level: Level, judge: _Judge, paths: Sequence[Way], apart: np.ndarray, rng: np.random.Generator
) -> list[tuple[float, list[Curve]]]:
    """Reshape all legs; return the motions within torque limits and their scores. `apart` weighs the pairs."""
    found: list[tuple[float, list[Curve]]] = []
    legs = [way.quintic(level.shape) for way in paths]
    for bend in (rng, *(None,) * (ROUNDS - 1)):
        least = judge.score(apart)
        weights = judge.live * least**2 / np.maximum(apart, SAME) ** 4  # largest weight for the pairs that differ least
        models = judge.nearest(legs, int(np.argmin(np.where(judge.live, apart, np.inf))))
        parameters = contrast_parameters(models, judge.robot.n, weights)
        legs = [reshaped(level, way, leg, parameters, bend) for way, leg in zip(paths, legs, strict=True)]
        apart, torque = judge.apart(legs, FINE), judge.torque(legs).max(axis=0)
        if (torque <= 1).all():
            found.append((judge.score(apart), legs))
        less = 1 / np.maximum(1.0, 1 + 1.5 * (torque - 1))
        paths = [replace(way, limits=way.limits.replace(effort=way.limits.effort * less)) for way in paths]
    return found


def _search_limits(limits: Limits) -> Limits:
    """Limits of the search: finite ones, in the middle of every joint's range."""
    lower, upper = limits.ranges
    middle, half = (lower + upper) / 2, np.minimum(0.45 * (upper - lower), SPAN)
    return limits.replace(
        lower=middle - half,
        upper=middle + half,
        acceleration=np.minimum(limits.acceleration, ACCELERATION),
        jerk=np.minimum(limits.jerk, JERK),
    )


def _paths(poses: np.ndarray, fast: float, limits: Limits) -> list[Way]:
    """Legs there and back in `fast` [s], then slowly."""
    crawling = limits.replace(velocity=limits.velocity / SLOWER)
    there, back = (poses[0], poses[1]), (poses[1], poses[0])
    return [
        Way(*ends, k * fast, (k * DURATIONS[0], k * max(fast, DURATIONS[1])), within)
        for k, within in ((1.0, limits), (SLOWER, crawling))
        for ends in (there, back)
    ]
