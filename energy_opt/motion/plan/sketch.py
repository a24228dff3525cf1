"""A quick guess of a move's answer, by which many goals are compared: one coarse start, looked at as optima are."""

from __future__ import annotations

from collections.abc import Sequence

from energy_opt.errors import Infeasible
from energy_opt.motion.move import Move
from energy_opt.motion.plan.candidates import first_line, least_energy_timing, reference_time, task_of
from energy_opt.motion.plan.context import Context
from energy_opt.motion.plan.making import first_timing
from energy_opt.motion.reshape.search import trajectory_of
from energy_opt.motion.reshape.task import Line
from energy_opt.motion.trajectory import Trajectory

BEYOND = 0.5  # share of a bound: a full search, or another end of the move, may still mend so much


def sketched(context: Context, move: Move, warm: Sequence[Trajectory] = ()) -> Trajectory:
    """A reshaped motion near an optimum, blind to bodies; it may exceed a limit by up to `BEYOND` of its bound.

    Args:
        warm: trajectories to start from besides the first path.

    Raises:
        Infeasible: what the search comes to exceeds a limit by more.
    """
    objective = context.settings.objective
    timing = first_timing(context, move)
    reference = reference_time(context, move, timing)
    task = task_of(context, move, reference, None if objective == "time" else move.duration)
    free = timing is not None and move.duration is None
    best_timing = least_energy_timing(context, move, timing) if free and timing is not None else None
    guess = 2 * reference if best_timing is None else best_timing.trajectory.duration
    lines = [first_line(move, guess), *map(Line.of, warm)]
    reshaper = context.reshaper(objective)
    found = reshaper.optima(task, lines, 1, context.settings.seed, context.stopped)[0][0]
    if found.broken > BEYOND:
        raise Infeasible(f"no motion within the limits was found in {task.durations[1]:.4g} s", limit="duration")
    return trajectory_of(found.curve, context.robot.joints)
