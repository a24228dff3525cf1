"""Warnings of a plan under several models: limits that it, or a baseline, holds under one of them only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from energy_opt.motion.judge.certificate import ALLOWED, certify
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.limits.joint import Effort
from energy_opt.motion.result import Baseline, Result
from energy_opt.motion.trajectory import Trajectory
from energy_opt.robot import Robot


def effort_warnings(
    robot: Robot, trajectory: Trajectory, scorers: Sequence[tuple[str, Scorer]], limits: Sequence[Limit]
) -> list[str]:
    """Warnings for models (name and scorer) under which a motor's torque exceeds its limit; the plan's model first."""
    found = _overloads(robot, trajectory, scorers[1:], limits)
    return [f"{said}; the plan holds it under {scorers[0][0]!r}" for _, said in found]


def without_overloads(
    robot: Robot, result: Result, scorers: Sequence[tuple[str, Scorer]], limits: Sequence[Limit]
) -> Result:
    """A result that holds the torque limits under all models, beside baselines that are valid only if they do so.

    Args:
        scorers: of the models (name and scorer) that the baselines' limits were not checked under.
    """

    def held(baseline: Baseline) -> Baseline:
        found = _overloads(robot, baseline.trajectory, scorers, limits) if baseline.valid else []
        if not found:
            return baseline
        excess, said = max(found)
        said = f"{baseline.name} is not valid: {said}; the plan holds it under that model"
        return replace(baseline, max_violation=excess, valid=False, remark=said)

    return replace(result, baselines=tuple(held(baseline) for baseline in result.baselines))


def _overloads(
    robot: Robot, trajectory: Trajectory, scorers: Sequence[tuple[str, Scorer]], limits: Sequence[Limit]
) -> list[tuple[float, str]]:
    """The models under which a motor's torque exceeds its limit: by which share of it, and in words."""
    held, out = [limit for limit in limits if isinstance(limit, Effort)], []
    for name, scorer in scorers:
        found = certify(trajectory, scorer, held)
        if found.violation > ALLOWED:
            worst, unit = found.worst, robot.unit("effort", str(found.worst["joint"]))
            said = (
                f"under {name!r} {worst['joint']} takes {worst['value']:.4g} {unit} at {worst['time']:.3f} s"
                f", above its limit of {worst['bound']:.4g} {unit}"
            )
            out.append((found.violation, said))
    return out


def power_warnings(trajectory: Trajectory, scorers: Sequence[tuple[str, Scorer]], limit: float | None) -> list[str]:
    """Warnings for models (name and scorer), or corners of assumed friction, whose peak power exceeds `limit` [W]."""
    if limit is None:
        return []
    peaks = [(name, certify(trajectory, scorer, ()).peak_power) for name, scorer in scorers]
    return [
        f"under {name!r} power reaches {peak:.5g} W; the plan holds the limit of {limit:g} W under its own models "
        "only: measure friction with `diagnose`, or give a lower limit"
        for name, peak in peaks
        if peak > limit * (1 + ALLOWED)
    ]
