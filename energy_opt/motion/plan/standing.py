"""Rest instead of creeping: under dry friction, a joint takes least energy at rest, and moves in a part of the time.

At rest, dry friction bears a part of the load; while a joint creeps against its load, the motor bears the load and the
friction. A curve of few parameters never leaves a joint exactly at rest, and the friction smoothed for the solver makes
creeping nearly free. So a motion is also judged with joints that rest, make their move in a part of the time, and rest
again. Joints that end where they began, and hardly left it, rest all the time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from energy_opt.effects.parameter import RESTING_SPEED
from energy_opt.motion.judge.energy import COARSER, Scorer
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.joint import Acceleration, Jerk, Velocity
from energy_opt.motion.plan.context import Context, Judged
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel

# [rad/s] a joint that is never faster is also tried at rest: five times the width of the smoothed friction
CREEPING = 0.05
INSTANTS = 40  # at which resting is compared with creeping
BARELY = 1e-6  # [rad/s] a speed that is no rest, at which the other effects of speed are negligible
WORTH = 1e-2  # share of the loss: a joint that could save less by resting is not tried
LENGTHS, LONGER, PLACES = 5, 1.6, 4  # windows that are tried first: lengths, their ratio, and places of each
TRIES = 3  # windows that are judged for one joint, each longer by this ratio, until one is valid
ROOM = 1.01  # a window's peaks stay below the limits by this factor: files are read between their samples, too
COARSE, INNER = 60, 12  # steps of the motion, and of a window, by which energies are estimated
FINEST = 2  # samples: smallest change of a window's bounds
CHANGES = ((-1, -1), (1, 1), (-1, 0), (1, 0), (0, -1), (0, 1), (-1, 1), (1, -1))  # of both bounds

Window = tuple[int, int]  # the samples at which a joint begins and ends its move


def creeping(trajectory: Trajectory) -> np.ndarray:
    """(n,) True for joints that end where they began, move, and are never faster than `CREEPING`."""
    peak = np.abs(trajectory.velocity).max(axis=0)
    stays = np.abs(trajectory.position[-1] - trajectory.position[0]) < 1e-9
    return np.asarray(stays & (peak > 0) & (peak < CREEPING))


def with_rests(context: Context, judged: Judged) -> Judged:
    """The motion, or a valid one of less energy in which joints rest before and after their moves.

    Under several models only joints that creep all the time rest here. Others may take more energy under one of the
    models: they rest at the end of a plan (`robust_rests`), where this is checked.
    """
    best = judged
    if not holds(context.model) or np.abs(judged.trajectory.velocity[[0, -1]]).max() > RESTING_SPEED:
        return best

    def accepted(motion: Trajectory) -> bool:
        nonlocal best
        found = context.judge(motion)
        better = found.energy.total < best.energy.total and found.certificate.valid
        best = found if better else best
        return better

    which = creeping(best.trajectory)
    if which.any():
        q, v, a = (x.copy() for x in _states(best.trajectory))
        q[:, which], v[:, which], a[:, which] = q[0, which], 0.0, 0.0
        accepted(replace(best.trajectory, position=q, velocity=v, acceleration=a))
    if len(context.model.weighted) == 1:
        let_rest(context.scorer, context.limits, best.trajectory, best.energy.loss, accepted, context.stopped)
    return best


def let_rest(
    scorer: Scorer, limits: Sequence[Limit], motion: Trajectory, loss: float, accepted: Callable[[Trajectory], bool],
    stopped: Callable[[], bool],
) -> None:  # fmt: skip
    """Let single joints of a motion rest before and after their moves, one after the other, while it is `accepted`.

    Args:
        scorer: estimates energies. limits: of the joints. loss: of the motion [J].
        accepted: judges a changed motion, and keeps it if it is better.
    """
    worth = _worth(scorer, motion)
    for joint in np.argsort(-worth).tolist():
        if worth[joint] < WORTH * loss or stopped():
            break
        least = _shortest(limits, motion, joint)
        for longer in LONGER ** np.arange(TRIES):
            window = _cheapest(scorer, motion, joint, least * longer)
            changed = None if window is None else _within(motion, joint, window)
            if changed is None or accepted(changed):
                motion = motion if changed is None else changed
                break


def holds(model: PowerModel) -> bool:
    """Does the model have an effect that may hold a joint at rest?"""
    return any(e.stage == "torque" and e.dissipates for e in model.effects)


def _states(trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return trajectory.position, trajectory.velocity, trajectory.acceleration


def _worth(scorer: Scorer, trajectory: Trajectory) -> np.ndarray:
    """Energy (n,) [J] that each joint would save at most if it rested nearly all the time, beside the others.

    At some instants, the power with the joint at rest is compared with that of creeping in the joint's direction.
    """
    n, t = len(trajectory.joints), np.linspace(trajectory.time[0], trajectory.time[-1], INSTANTS)
    q, v, a = (np.tile(x, (2 * n, 1, 1)) for x in trajectory.sample(t)[:3])
    each = np.arange(n)
    v[each, :, each], v[n + each, :, each] = 0.0, BARELY * np.sign(v[0].T)
    a[each, :, each] = a[n + each, :, each] = 0.0
    q, v, a = (x.reshape(-1, n) for x in (q, v, a))
    resting, creeps = scorer.momentary(q, v, a, np.tile(t - t[0], 2 * n)).reshape(2, n, INSTANTS)
    return np.asarray((creeps - resting).clip(min=0).mean(axis=1) * trajectory.duration)


def _within(trajectory: Trajectory, joint: int, window: Window, at: np.ndarray | slice = slice(None)) -> Trajectory:
    """The trajectory's samples `at`, with one joint that makes its move in a window, as a quintic, and rests else."""
    time = trajectory.time[at]
    q, v, a = (x[at].copy() for x in _states(trajectory))
    begin, end = trajectory.time[list(window)]
    first, last = trajectory.position[[0, -1], joint]
    s, span, change = np.clip((time - begin) / (end - begin), 0.0, 1.0), end - begin, last - first
    q[:, joint] = np.where(s < 1, first + change * s**3 * (10 - 15 * s + 6 * s * s), last)
    v[:, joint] = change / span * 30 * s**2 * (1 - s) ** 2
    a[:, joint] = change / span**2 * 60 * s * (1 - s) * (1 - 2 * s)
    return Trajectory(trajectory.joints, time, q, v, a)


def _shortest(limits: Sequence[Limit], trajectory: Trajectory, joint: int) -> float:
    """The least time [s] of a quintic from a joint's start to its goal within the joint's limits, or some samples.

    Over a distance of 1 in a time of 1, a quintic at rest at its ends has a peak speed of 15 / 8, a peak acceleration
    of 10 / sqrt(3), and a peak jerk of 60.
    """
    distance = ROOM * abs(float(np.diff(trajectory.position[[0, -1], joint])[0]))
    peaks: dict[type[Limit], tuple[float, int]] = {
        Velocity: (15 / 8, 1),
        Acceleration: (10 / 3**0.5, 2),
        Jerk: (60.0, 3),
    }
    bounds = [(*peaks[type(limit)], float(limit.bound[joint])) for limit in limits if type(limit) in peaks]
    times = [(peak * distance / bound) ** (1 / order) for peak, order, bound in bounds]
    return float(max(*times, FINEST * (trajectory.time[1] - trajectory.time[0])))


def _cheapest(scorer: Scorer, trajectory: Trajectory, joint: int, least: float) -> Window | None:
    """The window of one joint's move, of at least `least` [s], that takes least energy by estimates on a coarse grid.

    None if none takes less than the motion as it is.
    """
    time, count = trajectory.time - trajectory.time[0], len(trajectory.time) - 1
    coarse = np.unique(np.linspace(0, count, COARSE + 1).round().astype(int))
    if least > time[-1]:
        return None
    known: dict[Window, float] = {}

    def energy(window: Window) -> float:
        if window not in known:
            at = np.union1d(coarse, np.linspace(*window, INNER + 1).round().astype(int))
            known[window] = scorer.energy(_within(trajectory, joint, window, at), COARSER).total
        return known[window]

    lengths = np.unique(np.minimum(least * LONGER ** np.arange(LENGTHS), time[-1]))
    begins = np.concatenate([(time[-1] - length) * np.linspace(0, 1, PLACES) for length in lengths])
    ends = begins + np.repeat(lengths, PLACES)
    first = np.searchsorted(time, begins, side="right") - 1
    pairs = np.stack([first, np.searchsorted(time, ends - 1e-9).clip(max=count)], axis=1)
    best, step = min(map(tuple, pairs.tolist()), key=energy), count // 8
    while step >= FINEST:
        near = ((best[0] + step * b, best[1] + step * e) for b, e in CHANGES)
        fitting = [w for w in near if 0 <= w[0] < w[1] <= count and time[w[1]] - time[w[0]] >= least]
        found = min([best, *fitting], key=energy)
        best, step = (best, step // 2) if found == best else (found, step)
    usual = Trajectory(trajectory.joints, trajectory.time[coarse], *(x[coarse] for x in _states(trajectory)))
    return best if energy(best) < scorer.energy(usual, COARSER).total else None
