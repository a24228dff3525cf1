"""Moves smaller than an encoder's resolution, which are answered without a search."""

from __future__ import annotations

import numpy as np

from energy_opt.errors import Infeasible, at_least
from energy_opt.motion.move import Move
from energy_opt.motion.plan.candidates import SAMPLES, Candidate
from energy_opt.motion.plan.context import Context
from energy_opt.motion.timing.spline_timing import Timing
from energy_opt.motion.trajectory import Trajectory

RESOLUTION = 2e-5  # [rad, m] resolution of an 18-bit encoder: smaller moves are not searched
BRIEFEST = 0.01  # [s] shortest duration of such a move: in less, the rounding of positions alone breaks a jerk limit


def below_resolution(move: Move) -> bool:
    """True if the move, from rest to rest, is smaller than an encoder's resolution, so that no search is needed."""
    if move.via or np.any(move.end_velocities) or np.abs(move.goal - move.start).max() >= RESOLUTION:
        return False
    knots = np.linspace(0.0, 1.0, SAMPLES)
    return move.path is None or bool(np.abs(move.path(knots) - move.start).max() < RESOLUTION)


def without_search(context: Context, move: Move, timing: Timing) -> Candidate:
    """The minimum-time timing, slowed evenly to the wanted duration, without a search.

    Raises:
        Infeasible: the wanted duration is below the minimum time.
    """
    wanted = max(1.001 * timing.duration, BRIEFEST) if move.duration is None else move.duration
    longest = wanted if move.max_duration is None else move.max_duration
    if timing.path.moves and timing.duration > min(wanted, longest) * (1 + 1e-9):
        raise Infeasible(
            f"a duration of {min(wanted, longest):.6g} s is too short: the shortest on this path is "
            f"{at_least(timing.duration)} s",
            limit="duration",
            shortest_duration=timing.duration,
        )
    duration = min(wanted, longest)
    trajectory = timing.slowed(duration).trajectory(context.robot.joints)
    if timing.path.moves and not context.judge(trajectory).within.valid:  # rounding of many samples in a short time
        trajectory = _single_cubic(context, move, duration)
    return Candidate(
        trajectory,
        message=f"no joint moves by {RESOLUTION:g} rad, which no encoder tells from standing: "
        "answered by the minimum-time timing, or by one polynomial, without a search",
    )


def _single_cubic(context: Context, move: Move, duration: float) -> Trajectory:
    """The straight line from rest to rest as one cubic polynomial in three samples."""
    u, displacement = np.array([[0.0], [0.5], [1.0]]), move.goal - move.start
    q = move.start + u**2 * (3 - 2 * u) * displacement
    v = 6 * u * (1 - u) * displacement / duration
    a = 6 * (1 - 2 * u) * displacement / duration**2
    q[-1] = move.goal
    return Trajectory(context.robot.joints, u[:, 0] * duration, q, v, a).on_nanoseconds()
