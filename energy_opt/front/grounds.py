"""What an answer rests on, and how far it holds: assumptions, break-even friction, detours, values beyond belief."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from energy_opt.motion import Result
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.robust import SAME, Rival
from energy_opt.motion.trajectory import Trajectory
from energy_opt.motion.travel import detours
from energy_opt.power import PowerModel
from energy_opt.power.assumptions import assumptions
from energy_opt.power.known import has_friction
from energy_opt.power.worth import break_even, until
from energy_opt.robot import Robot

COARSER = 2  # places between two samples: what friction adds is smooth but for the joints' turning points
FAST = 50.0  # [rad/s^2, m/s^2] accelerations beyond are those of no arm of a robot's size


def grounded(result: Result, rivals: Sequence[Rival], robot: Robot) -> Result:
    """The result with what it rests on, and warnings where its values are beyond belief or its model lacks friction.

    Args:
        rivals: the models that it was planned with, the one that it is stated under first.
    """
    scaled = result.baseline("scaled")
    slowed = None if scaled is None or not scaled.valid or result.chosen == "scaled" else scaled.trajectory
    share = break_even_friction(result.trajectory, slowed, rivals[0].model, robot)
    return replace(
        result,
        assumptions=assumptions(robot, [rival.model for rival in rivals]),
        break_even_friction=share,
        travel=tuple(detours(result.trajectory)),
        warnings=(*result.warnings, *_beyond_belief(result, robot), *_frictionless(result, rivals, share)),
    )


def break_even_friction(ours: Trajectory, slowed: Trajectory | None, model: PowerModel, robot: Robot) -> float | None:
    """The share of the effort limits at which dry friction, added to `model`, ends the saving beside `slowed`.

    None where no share below 0.2 does, or where there is no `slowed` or nothing is saved to begin with.
    """
    if slowed is None:
        return None
    both = slowed, ours

    def saved(model: PowerModel) -> float:
        scorer = Scorer(robot, model)
        theirs, own = (scorer.energy_of(scorer.dense(trajectory, COARSER)).total for trajectory in both)
        return theirs - own - SAME * abs(theirs)

    return break_even(saved, model, robot)


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
