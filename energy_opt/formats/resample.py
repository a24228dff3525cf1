"""Trajectories at a rate, and what a controller makes of the samples.

A controller that is given positions, velocities and accelerations runs the quintic between two points, as ROS 2's
joint_trajectory_controller does; given positions and velocities, the cubic. The files here give all three, so a
resampled trajectory is the rows that it writes and the quintics between them, and is judged as such.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from energy_opt.errors import BadInput
from energy_opt.motion.judge.certificate import Certificate
from energy_opt.motion.trajectory import Trajectory

RATES = (10, 20, 25, 40, 50, 100, 125, 200, 250, 400, 500, 800, 1000, 2000, 4000)  # [Hz] that are proposed
FASTEST = 10_000.0  # [Hz]
LEAST_STEP = 0.01  # a last step that is shorter than this share of the others is merged with the one before

Judge = Callable[[Trajectory], Certificate]


def check_rate(rate: float) -> None:
    """Raise BadInput where a rate [Hz] is not above zero, or beyond 10 kHz."""
    if not 0 < rate <= FASTEST:
        raise BadInput(f"--rate {rate:g}: expected samples per second, above 0 and at most {FASTEST:g}")


def resampled(trajectory: Trajectory, rate: float) -> Trajectory:
    """The curve at multiples of 1 / rate [s] from 0 on, and exactly at its end.

    Raises:
        BadInput: the rate is not above zero, or beyond 10 kHz.
    """
    check_rate(rate)
    duration = trajectory.duration
    count = max(0, int(np.ceil(duration * rate - LEAST_STEP)))
    time = np.append(np.arange(count) / rate, duration)
    if len(time) < 2:
        time = np.array([0.0, duration])
    q, v, a, _ = trajectory.sample(trajectory.time[0] + time)
    q[-1], v[-1], a[-1] = trajectory.position[-1], trajectory.velocity[-1], trajectory.acceleration[-1]
    return Trajectory(trajectory.joints, time, q, v, a)


def at_rate(trajectory: Trajectory, rate: float, judge: Judge) -> Trajectory:
    """The trajectory at a rate, where what a controller makes of it stays within all limits.

    Raises:
        BadInput: it does not; says which limit, and the rate that would do.
    """
    out = resampled(trajectory, rate)
    certificate = judge(out)
    if certificate.valid:
        return out
    worst = certificate.worst
    broken = (
        f"--rate {rate:g}: with quintics between so few points the {worst['limit']} of {worst['joint']} comes to "
        f"{worst['value']:.6g} at {worst['time']:.4g} s, beyond its bound {worst['bound']:.6g}"
    )
    better = lowest(trajectory, judge, above=rate)
    if better is not None:
        raise BadInput(f"{broken}; {better:g} Hz would do")
    raise BadInput(
        f"{broken} by {certificate.violation:.1e} of it; no rate up to {RATES[-1]} Hz holds it: leave --rate out, or "
        f"ask for a duration of {_longer(trajectory, certificate):.6g} s"
    )


def lowest(trajectory: Trajectory, judge: Judge, above: float = 0.0) -> float | None:
    """The lowest of the usual rates at which the samples stay within all limits; None where none of them does."""
    return next(
        (rate for rate in RATES if rate > above and judge(resampled(trajectory, rate)).valid),
        None,
    )


def _longer(trajectory: Trajectory, certificate: Certificate) -> float:
    """Duration at which an excess like this one goes, s: velocities fall with it, accelerations with its square."""
    return trajectory.duration * (1 + max(certificate.violation, 1e-3))
