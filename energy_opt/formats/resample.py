"""Trajectories at a given rate, and the motion that a controller makes from the samples.

A controller that receives positions, velocities and accelerations runs the quintic between two points, as ROS 2's
joint_trajectory_controller does. From positions and velocities it runs the cubic. The files of this package contain all
three. So a resampled trajectory consists of the written samples with quintics between them, and is judged as such.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.formats.waypoints import Samples
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.limits.base import Violation
from energy_opt.motion.trajectory import Trajectory, whole
from energy_opt.robot import Limits

# [Hz] usual rates, which are proposed
RATES = (10, 20, 25, 40, 50, 100, 125, 200, 250, 400, 500, 800, 1000, 2000, 4000)
FASTEST = 10_000.0  # [Hz] largest rate
LEAST_STEP = 0.1  # a last step that is shorter than this share of the others is merged with the one before
SLOWER = 1.05  # largest factor on the duration: beyond it, another rate is better
TRIALS = 12  # most slower motions that are tried

Judge = Callable[[Trajectory], Certificate]


@dataclass(frozen=True)
class Sampled:
    """A trajectory as it is written.

    Attributes:
        trajectory: slowed if that was needed. rate: [Hz]; None: the judged samples. why: the limit that the requested
            rate would have broken; empty if it breaks none.
    """

    trajectory: Trajectory
    rate: float | None
    why: str = ""


def check_rate(rate: float) -> None:
    """Raise BadInput where a rate [Hz] is not above zero, or beyond 10 kHz."""
    if not 0 < rate <= FASTEST:
        raise BadInput(f"--rate {rate:g}: expected samples per second, above 0 and at most {FASTEST:g}")


def resampled(trajectory: Trajectory, rate: float) -> Trajectory:
    """The curve at multiples of 1 / rate [s] from 0 on (to the nanosecond), and exactly at its end.

    Raises:
        BadInput: the rate is not above zero, or beyond 10 kHz.
    """
    check_rate(rate)
    duration = float(whole(trajectory.duration))
    count = max(1, int(np.ceil(duration * rate - LEAST_STEP)))
    time = np.append(whole(np.arange(count) / rate), duration)
    q, v, a, _ = trajectory.sample(np.minimum(trajectory.time[0] + time, trajectory.time[-1]))
    q[-1], v[-1], a[-1] = trajectory.position[-1], trajectory.velocity[-1], trajectory.acceleration[-1]
    return Trajectory(trajectory.joints, time, q, v, a)


def fitted(trajectory: Trajectory, rate: float, judge: Judge) -> Sampled:
    """The trajectory at a rate at which the controller's motion keeps all limits.

    If the samples at `rate` break a limit, the motion is slowed evenly, by 5 % at most. If this does not suffice, the
    lowest usual rate above it without a violation is taken, or else the judged samples.

    Args:
        trajectory: the motion. rate: [Hz] requested. judge: gives the certificate of a trajectory.
    """
    certificate = judge(resampled(trajectory, rate))
    if certificate.valid:
        return Sampled(resampled(trajectory, rate), rate)
    why = broken(certificate, rate)
    slower = slowed_until(trajectory, judge, lambda slow: resampled(slow, rate))
    if slower is not None:
        return Sampled(slower, rate, why)
    better = lowest(trajectory, judge, above=rate)
    return Sampled(trajectory if better is None else resampled(trajectory, better), better, why)


def slowed_until(
    trajectory: Trajectory, judge: Judge, prepared: Callable[[Trajectory], Trajectory]
) -> Trajectory | None:
    """The prepared trajectory, slowed as little as possible so that it keeps all limits.

    Slowing by a factor f divides velocities by f and accelerations by f^2, so the next factor follows from the
    violation.

    Args:
        trajectory: the motion. judge: gives a certificate. prepared: turns a motion into what is written.

    Returns:
        None if 5 % does not suffice, if only the clearance is broken, or if the motion begins or ends in motion.
    """
    if np.abs(trajectory.velocity[[0, -1]]).max() > 1e-9:
        return None
    factor = 1.0
    for _ in range(TRIALS):
        out = prepared(trajectory if factor == 1.0 else trajectory.slowed(factor * trajectory.duration))
        certificate = judge(out)
        if certificate.valid:
            return out
        if certificate.within_limits:  # slowing does not increase the clearance
            return None
        factor *= 1 + float(np.clip(0.6 * certificate.violation, 2e-6, 0.02))
        if factor > SLOWER:
            return None
    return None


def broken(certificate: Certificate, rate: float) -> str:
    """Which limit the samples at a rate would break, in words."""
    worst = certificate.worst
    if certificate.within_limits:
        return f"at {rate:g} Hz: {certificate.clearance}"
    value, bound = compared(worst)
    return (
        f"with quintics between samples at {rate:g} Hz the {worst['limit']} of {worst['joint']} would come to "
        f"{value} at {worst['time']:.4g} s, beyond its bound {bound}"
    )


def compared(worst: Mapping[str, Any]) -> tuple[str, str]:
    """The `value` of a limit and its `bound` as text; with the excess where six digits do not show it."""
    value, bound = worst["value"], worst["bound"]
    words = f"{value:.6g}", f"{bound:.6g}"
    excess = abs(value / bound) - 1 if bound else 0.0
    if words[0].lstrip("-") == words[1].lstrip("-") and 0 < excess < np.inf:
        return words[0], f"{words[1]}, exceeded by {excess:.2g} of it"
    return words


def lowest(trajectory: Trajectory, judge: Judge, above: float = 0.0) -> float | None:
    """The lowest of the usual rates [Hz] at which the samples stay within all limits; None if none of them does.

    At that rate, the samples also show the motion: velocities and accelerations fit together, as readers check.

    Args:
        trajectory: to be sampled. judge: of the samples. above: [Hz] rates up to this one are left out.
    """

    def is_good(t: Trajectory) -> bool:
        try:
            Samples("", t.joints, t.position, t.time, t.velocity, t.acceleration).trajectory()
        except BadInput:
            return False
        return judge(t).valid

    return next((rate for rate in RATES if rate > above and is_good(resampled(trajectory, rate))), None)


REST = 3  # steps of rest before and after the motion in the differences
KINDS = ("velocity", "acceleration", "jerk")


def on_steps(trajectory: Trajectory, rate: float, limits: Limits | None = None) -> Trajectory:
    """The trajectory at a controller's steps, slowed by less than one step so that it ends on a step.

    A controller that differentiates positions sees a jump if the motion begins with an acceleration. With `limits`,
    positions are averaged over as many steps as the jerk limit needs. A mean of positions raises no velocity,
    acceleration or jerk; the motion takes these steps longer.

    Args:
        trajectory: the motion. rate: [Hz]. limits: of the arm; None: nothing is averaged.
    """
    steps = max(1, math.ceil(trajectory.duration * rate - 1e-6))
    slowed = trajectory.slowed(steps / rate)
    q = slowed.sample(np.minimum(slowed.time[0] + np.arange(steps + 1) / rate, slowed.time[-1]))[0]
    q[[0, -1]] = trajectory.position[[0, -1]]
    if limits is not None:
        ends = np.abs(trajectory.acceleration[[0, -1]]).max(axis=0)
        if (ends * rate > limits.jerk).any():
            shares = limits.acceleration * rate / limits.jerk
            width = math.ceil(float(shares[np.isfinite(shares)].max()) - 1e-9)
            # the mean of `width` positions, at rest before and after
            padded = np.concatenate([np.repeat(q[:1], width - 1, axis=0), q, np.repeat(q[-1:], width - 1, axis=0)])
            base = padded[width - 1 :]
            q = np.asarray(base + sum(padded[k : k + len(base)] - base for k in range(width)) / width)
    return of_steps(trajectory.joints, q, rate)


def of_steps(joints: tuple[str, ...], q: np.ndarray, rate: float) -> Trajectory:
    """Positions (N, n) at steps of `rate` [Hz] as a trajectory.

    Velocity and acceleration are differences over two steps; the arm is at rest up to the first and from the last on.
    """
    padded = np.concatenate([q[:1], q, q[-1:]])
    v = (padded[2:] - padded[:-2]) * rate / 2
    v[[0, -1]] = 0.0
    a = (padded[2:] - 2 * q + padded[:-2]) * rate**2
    return Trajectory(joints, whole(np.arange(len(q)) / rate), q, v, a)


def worst_steps(trajectory: Trajectory, rate: float, limits: Limits) -> tuple[Violation, ...]:
    """The differences from step to step that use the limits of velocity, acceleration and jerk most.

    The first, second and third differences of the positions, times rate, rate^2 and rate^3, are velocity, acceleration
    and jerk as a controller computes them. The arm is at rest before and after.

    Args:
        trajectory: positions at steps. rate: [Hz]. limits: of the arm.
    """
    q = trajectory.position
    padded = np.concatenate([np.repeat(q[:1], REST, axis=0), q, np.repeat(q[-1:], REST, axis=0)])
    found = []
    for order, kind in enumerate(KINDS, start=1):
        values, bound = np.diff(padded, order, axis=0) * rate**order, getattr(limits, kind)
        excess = np.abs(values) / bound - 1
        k, j = (int(i) for i in np.unravel_index(int(np.argmax(excess)), excess.shape))
        at = min(max((k - REST) / rate, 0.0), trajectory.duration)
        found.append(
            Violation(kind, float(excess[k, j]), trajectory.joints[j], at, float(values[k, j]), float(bound[j]))
        )
    return tuple(found)
