"""Whether positions and stamps of a log are plausible for an arm: jumps of single samples, speeds, units."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import pairwise

import numpy as np

from energy_opt.numerics.signals import SHORTEST
from energy_opt.numerics.turns import LEFT, TURN, without, wraps
from energy_opt.robot import Robot
from energy_opt.robot.limits import TURNS, look_like_degrees

OUTSIDE = 0.05  # [rad, m] by which positions may be outside the limits
FAR = 1.5  # [rad] outside a limit from which positions are assumed to be degrees
TOO_FAST = 20.0  # multiple of a velocity limit above which the stamps' unit must be wrong
COARSEST = 1.0  # [s] largest step of a motion; with a larger one, the stamps' unit must be wrong
FINEST = 1e-5  # [s] least plausible step
FASTER = 5.0  # multiple of a velocity limit that no joint reaches from one sample to the next and back
JUMP = 0.05  # [rad, m] least change between two samples that may be a damaged row; noise of encoders is far below
CHANGES, REGULAR = 20, 0.95  # least changes of the positions, and their share at regular distances, of a slower source
GLITCH = 30.0  # multiple of the usual power by which no arm's power changes for one reading
LOST, RARE = 0.5, 0.01  # share of the usual power above which both neighbours of a lost reading are; most of these
# What is just below the highest power: a share of its distance from the usual one, and steps of the meter; least levels
# above the usual one; least readings of the highest power, and over those just below it, of a meter that saturates
NEAR, STEPS, COARSE, MANY, TOP = 0.05, 2.5, 20, 20, 3.0
LEAP = 0.5  # [rad, m] the same for a position that stays at the new value
WRAP = 2.0  # multiple of a velocity limit above which a change by about one turn is a wrapped angle


def spikes(time: np.ndarray, position: np.ndarray, robot: Robot) -> np.ndarray:
    """Mask (N,) of single samples whose position is far from both neighbours, which are near each other."""
    out = np.zeros(len(time), dtype=bool)
    step = np.maximum(np.diff(time), np.ptp(time) / (len(time) - 1))[:, None]  # stamps may repeat
    position = continued(time, position, robot)[0]
    change, most = np.diff(position, axis=0), np.maximum(JUMP, FASTER * robot.limits.velocity * step)
    wide = np.abs(change) > most
    back = np.abs(position[2:] - position[:-2]) < JUMP
    out[1:-1] = (wide[:-1] & wide[1:] & back).any(axis=1)
    return out


def continued(time: np.ndarray, position: np.ndarray, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, n) whose angles pass on where they wrap, and which of the changes (N - 1, n) were wraps.

    An angle that wraps stays within one turn. In a longer step, it may wrap unseen: the joint was too slow for the
    change, or the angle goes on from where it was recorded.
    """
    may_wrap = (np.ptp(position, axis=0) < TURN + LEFT) & ~np.array(robot.slides)
    turns = np.where(may_wrap, wraps(time, position), 0.0)
    wrapped, step, seconds = turns != 0, np.diff(position, axis=0), np.diff(time)[:, None]
    unseen = may_wrap & (seconds > SHORTEST) & (np.abs(step) > np.pi)
    moves = np.abs(step) <= robot.limits.velocity * seconds
    total, begin = np.zeros(len(may_wrap)), 0  # turns until the change `begin`
    for k in np.flatnonzero(unseen.any(axis=1)).tolist():
        total += turns[begin:k].sum(axis=0)
        turns[k], begin = np.where(unseen[k], np.where(moves[k], -total, np.rint(step[k] / TURN)), 0.0), k
    return without(turns, position), wrapped


def into_limits(
    position: np.ndarray, robot: Robot, gaps: Sequence[int], recorded: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, n) with angles moved by a turn if all joints are then inside their limits, and which were (n,).

    Each piece between gaps, which follow the samples `gaps`, is moved as a whole. Angles that are moved were `recorded`
    (N, n) from -pi to pi or from 0 to 2 pi, by a recorder that counts within a turn: others may be small degrees.
    """
    low, high = robot.limits.lower - OUTSIDE, robot.limits.upper + OUTSIDE
    out, turning = position.copy(), ~np.array(robot.slides)
    for first, last in pairwise([0, *(k + 1 for k in gaps), len(position)]):
        least, most = (end(position[first:last], axis=0) for end in (np.min, np.max))
        here, above, below = ((least + by > low) & (most + by < high) for by in (0.0, TURN, -TURN))
        angles = recorded[first:last, turning & ~here]
        one_turn = any(((angles > begin - LEFT) & (angles < begin + TURN + LEFT)).all() for begin in (-np.pi, 0.0))
        if one_turn and (here | above | below)[turning].all():
            out[first:last] += TURN * np.where(here | ~turning, 0.0, np.where(above, 1.0, -1.0))
    return out, (out != position).any(axis=0)


def held_samples(position: np.ndarray) -> np.ndarray:
    """Mask (N,) of samples that repeat positions (N, n) of a slower source, which change at every second one or rarer.

    At rest as many samples are left as in motion.
    """
    change = np.flatnonzero(np.append(True, (np.diff(position, axis=0) != 0).any(axis=1)))
    apart = np.diff(change)
    beat = int(np.percentile(apart, 10)) if len(apart) >= CHANGES else 1
    if beat < 2 or np.mean(apart % beat == 0) < REGULAR:
        return np.zeros(len(position), dtype=bool)
    index = np.arange(len(position))
    return np.asarray((index - change[np.searchsorted(change, index, "right") - 1]) % beat > 0)


def update_indices(values: np.ndarray) -> np.ndarray | None:
    """Indices (M,) of new readings of a slower source whose readings are held over several samples; None if not held.

    Held readings are periodic: all distances between changes are multiples of one number of samples. Values of a coarse
    instrument also stay the same for a while, but not periodically.
    """
    change = np.flatnonzero(np.diff(values) != 0) + 1
    if len(change) < 5 or len(change) > len(values) / 3:
        return None
    apart = np.diff(change)
    beat = int(np.percentile(apart, 10))
    if beat < 3:
        return None
    off = np.abs(apart - beat * np.rint(apart / beat))
    return change if float(np.mean(off <= (1 if beat >= 10 else 0))) >= 0.95 else None


def glitches(power: np.ndarray) -> np.ndarray:
    """Mask (N,) of single readings of the power [W] that are far beyond what the meter shows else, as damaged ones.

    A reading of 0 among far larger ones is a lost one, unless others stay at 0: then the arm takes no power there.
    """
    out = np.zeros(len(power), dtype=bool)
    if len(power) < 3:
        return out
    usual = max(float(np.median(np.abs(power))), float(np.ptp(np.quantile(power, (0.02, 0.98)))))
    wide = np.abs(np.diff(power)) > GLITCH * usual
    out[1:-1] = wide[:-1] & wide[1:] & (np.abs(power[2:] - power[:-2]) < usual)
    lost = power == 0
    beside = np.minimum(power[:-2], power[2:]) > LOST * float(np.median(power))
    if lost.mean() < RARE and not (lost[1:] & lost[:-1]).any() and (lost[1:-1] & beside).any():
        out |= lost
    return out


def leaps(time: np.ndarray, position: np.ndarray, robot: Robot) -> np.ndarray:
    """Indices (K,) of samples after which a position (N, n) jumps, faster than any joint can move, or an angle wraps.

    Jumps other than wraps do not count if there are many: then the unit of the stamps is wrong, which `step_fault`
    reports.
    """
    step = np.maximum(np.diff(time), np.ptp(time) / (len(time) - 1))[:, None]
    change, reach = np.abs(np.diff(position, axis=0)), robot.limits.velocity * step
    far = (change > np.maximum(LEAP, TOO_FAST * reach)).any(axis=1)
    if far.sum() >= len(position) / 100:
        far[:] = False
    wrapped = (np.abs(change - TURN) < np.maximum(JUMP, reach)) & (change > WRAP * reach) & ~np.array(robot.slides)
    return np.flatnonzero(far | wrapped.any(axis=1))


def step_fault(time: np.ndarray, position: np.ndarray, kind: str, robot: Robot) -> tuple[int, str, str] | None:
    """Row, joint and message if stamps are too far apart or too close for the motion; None otherwise."""
    step = float(np.median(np.diff(time)))
    moves = float(np.ptp(position, axis=0).max()) > 0.01
    if step > COARSEST and (moves or kind == "motion"):
        return 0, "", f"{step:.4g} s between rows; is the time's unit right (ms, us, ns)?"
    if step < FINEST:
        return 0, "", f"{step:.3g} s between rows; is the time's unit right?"
    speed = np.percentile(np.abs(np.diff(position, axis=0)) / np.diff(time)[:, None], 99, axis=0)
    j = int(np.argmax(speed / robot.limits.velocity))
    if speed[j] > TOO_FAST * robot.limits.velocity[j] and degrees_fault(position, robot) is None:
        unit = robot.unit("velocity", robot.joints[j])
        limit = f"{robot.joints[j]}'s limit of {robot.limits.velocity[j]:.3g}"
        return 0, "", f"speeds of {speed[j]:.3g} {unit}, far above {limit}; is the time's unit right?"
    return None


def are_degrees(position: np.ndarray, robot: Robot) -> bool:
    """Whether positions (N, n) without a stated unit are degrees: far outside the limits, or eight turns and more."""
    return look_like_degrees(robot.limits, position, FAR, robot.slides, TURNS) is not None


def degrees_fault(position: np.ndarray, robot: Robot, converted: Collection[str] = ()) -> tuple[int, str, str] | None:
    """Row, joint and message if positions (N, n) are so far outside the limits that they must be degrees; else None.

    Args:
        converted: the joints whose unit was stated, another than rad: these are no degrees.
    """
    found = look_like_degrees(robot.limits, position, FAR, robot.slides)
    if found is None:
        return None
    row, j = found
    lower, upper = robot.limits.lower, robot.limits.upper
    joint = robot.joints[j]
    outside = f"{position[row, j]:.4g} rad is far outside {joint}'s limits [{lower[j]:.4g}, {upper[j]:.4g}]"
    if joint in converted:
        return row, joint, f"{outside}; is the column another joint's, its zero elsewhere, or the robot another?"
    remedy = (
        'these look like degrees (or the robot is another); give the unit in log.toml ({ column = "...", unit = "deg" '
        f"}}), or by `energy-opt import --joint {joint}=COLUMN:deg`"
    )
    return row, joint, f"{outside}: {remedy}"


def saturated(power: np.ndarray) -> bool:
    """Whether readings of the power (N,) [W] reach the end of the meter's range, beyond which the power is unknown.

    Then far more readings have exactly the highest value than lie just below it; else high readings are rarer than
    others.
    """
    if len(power) < MANY:
        return False
    levels, counts = np.unique(power, return_counts=True)
    usual = float(np.median(power))
    near = max(NEAR * (levels[-1] - usual), STEPS * float(np.diff(levels).min(initial=np.inf)))
    below = int(counts[levels >= levels[-1] - near][:-1].sum())
    return bool((levels > usual).sum() > COARSE and counts[-1] >= max(MANY, RARE * len(power), TOP * below))
