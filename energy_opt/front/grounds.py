"""What an answer rests on, and how far it holds: assumptions, break-even friction, detours, values beyond belief."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.effects import CoulombFriction
from energy_opt.motion import Result
from energy_opt.motion.judge.energy import Energy, Scorer
from energy_opt.motion.plan.robust import SAME, Rival
from energy_opt.motion.trajectory import Trajectory
from energy_opt.power import PowerModel
from energy_opt.power.assumptions import assumptions
from energy_opt.power.known import has_friction
from energy_opt.robot import Robot

MOST_FRICTION = 0.2  # share of the effort limits up to which a break-even is looked for; arms have 0.01 to 0.06
TRIALS = 8  # shares that are tried before the first one that breaks even is narrowed down
CLOSE = 1e-5  # of the effort limits: how closely
COARSER = 2  # places between two rows: what friction adds is smooth but for the joints' turning points
DETOUR = 1.5  # times what start to goal needs, from which a joint's travel is named
SMALLEST = 1e-3  # [rad, m] less than this further is no detour
FAST = 50.0  # [rad/s^2, m/s^2] accelerations beyond are those of no arm of a robot's size


def grounded(result: Result, rivals: Sequence[Rival], robot: Robot) -> Result:
    """The result with what it rests on, and warnings where its values are beyond belief or its model lacks friction.

    Args:
        rivals: the models that it was planned with, the one that it is stated under first.
    """
    share = break_even_friction(result, rivals[0].model, robot)
    return replace(
        result,
        assumptions=assumptions(robot, [rival.model for rival in rivals]),
        break_even_friction=share,
        travel=tuple(detours(result.trajectory)),
        warnings=(*result.warnings, *_beyond_belief(result, robot), *_frictionless(result, rivals, share)),
    )


def break_even_friction(result: Result, model: PowerModel, robot: Robot) -> float | None:
    """The share of the effort limits at which dry friction, added to `model`, ends the saving beside "scaled".

    None where no share below 0.2 does, or where there is no valid "scaled" or nothing is saved to begin with.
    """
    slowed = result.baseline("scaled")
    if slowed is None or not slowed.valid or result.chosen == "scaled":
        return None
    own = model.get("coulomb_friction")
    held = np.zeros(robot.n) if own is None else np.broadcast_to(own.values["tau_c"], robot.n)
    ours, theirs = result.trajectory, slowed.trajectory

    def saved(share: float) -> float:
        scorer = Scorer(robot, model.replaced(CoulombFriction(tau_c=held + share * robot.rated.effort)))
        energies = [_energy(scorer, trajectory) for trajectory in (theirs, ours)]
        return energies[0].total - energies[1].total - SAME * abs(energies[0].total)

    if saved(0.0) <= 0:
        return None
    low = 0.0
    for high in np.linspace(0, MOST_FRICTION, TRIALS + 1)[1:].tolist():
        if saved(high) <= 0:
            while high - low > CLOSE:
                middle = (low + high) / 2
                low, high = (middle, high) if saved(middle) > 0 else (low, middle)
            return float(low)
        low = high
    return None


def _energy(scorer: Scorer, trajectory: Trajectory) -> Energy:
    return scorer.energy_of(scorer.dense(trajectory, COARSER))


def detours(trajectory: Trajectory) -> list[dict[str, object]]:
    """The joints that go more than 1.5 times as far as from their start to their goal: joint, path, straight [rad, m].

    The way of a joint is that of its quintic between rows, read at ten places of each.
    """
    q = trajectory.sample_denser(10)[0]
    path, straight = np.abs(np.diff(q, axis=0)).sum(axis=0), np.abs(q[-1] - q[0])
    return [
        {"joint": joint, "path": float(path[j]), "straight": float(straight[j])}
        for j, joint in enumerate(trajectory.joints)
        if path[j] > DETOUR * straight[j] + SMALLEST
    ]


def _beyond_belief(result: Result, robot: Robot) -> list[str]:
    """Accelerations and power that no such arm has."""
    out, most = [], np.abs(result.trajectory.sample_denser(10)[2]).max(axis=0)
    for joint, value, source in zip(robot.joints, most.tolist(), robot.sources["acceleration"], strict=True):
        if value > FAST:
            out.append(
                f"{joint}: the acceleration reaches {value:.4g} {robot.unit('acceleration', joint)} "
                f"({'no limit is known' if source == 'assumed' else 'within the limit given'}); few arms do more than "
                f"{FAST:g}: give --limits with the arm's own"
            )
    peak, rated = result.certificate.peak_power, robot.rated.power
    if peak > rated:
        out.append(
            f"power reaches {peak:.4g} W; the arm's drives give no more than {rated:.4g} W (the sum of effort times "
            "velocity limits): the model's electrical values are not this arm's; give --model"
        )
    return out


def _frictionless(result: Result, rivals: Sequence[Rival], share: float | None) -> list[str]:
    """What to say where no model that the move was planned with has friction."""
    saving = (result.saving or {}).get("joules")
    if any(has_friction(rival.model) for rival in rivals) or not saving or saving <= 0:
        return []
    name = rivals[0].name
    return [f"the model {name!r} has no friction: {until(share)}; give a model with friction, or plan under several"]


def until(share: float | None) -> str:
    """Up to what dry friction a plan saves, in words."""
    if share is None:
        return f"the plan saves at any dry friction up to {100 * MOST_FRICTION:g} % of the effort limits"
    return f"the plan saves as long as dry friction is below {100 * share:.2g} % of the effort limits"
