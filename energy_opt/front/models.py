"""The models of a plan, its energies under other models, and its assumed values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from energy_opt.arguments import expect
from energy_opt.errors import BadInput
from energy_opt.front.desk import Desk
from energy_opt.front.given import DEFAULT, model_from, of_another_arm, of_another_load, on_arm, several
from energy_opt.motion import Result, Trajectory
from energy_opt.motion.judge.energy import COARSER, Scorer
from energy_opt.motion.plan.robust_models import SAME, Rival, record_of
from energy_opt.motion.plan.robust_weights import Kind
from energy_opt.motion.travel import detours
from energy_opt.power import PowerModel
from energy_opt.power.assumptions import ELECTRICAL, assumptions, break_even, until
from energy_opt.power.known import has_friction, is_named
from energy_opt.power.variants import draws_of
from energy_opt.robot import Robot

if TYPE_CHECKING:
    from energy_opt.requests.groups import AnyModel

NEGLIGIBLE = 1e-6  # share of an energy: messages do not state smaller differences
FAST = 50.0  # [rad/s^2, m/s^2] larger accelerations are implausible for an arm


def grounded(result: Result, rivals: Sequence[Rival], robot: Robot) -> Result:
    """The result with assumed values, and warnings on implausible values and on models without friction.

    Args:
        result: the plan. rivals: the models that it was planned with; results are stated under the first. robot: the
            arm.
    """
    scaled = result.baseline("scaled")
    slowed = None if scaled is None or not scaled.valid or result.chosen == "scaled" else scaled.trajectory
    share = break_even_friction(result.trajectory, slowed, rivals[0].model, robot)
    result = replace(result, assumptions=assumptions(robot, [rival.model for rival in rivals]))
    more = (*_beyond_belief(result, rivals[0].model, robot), *_frictionless(result, rivals, share))
    return replace(
        result,
        break_even_friction=share,
        travel=tuple(detours(result.trajectory)),
        warnings=(*result.warnings, *more),
    )


def break_even_friction(ours: Trajectory, slowed: Trajectory | None, model: PowerModel, robot: Robot) -> float | None:
    """The share of the effort limits at which dry friction, added to `model`, ends the saving against `slowed`.

    Args:
        ours: the plan. slowed: the evenly slowed motion; None if there is no valid one. model: without the added
            friction. robot: the arm.

    Returns:
        None if no share below 0.2 ends it, if there is no `slowed`, or if nothing is saved without added friction.
    """
    if slowed is None:
        return None
    both = slowed, ours

    def saved(model: PowerModel) -> float:
        scorer = Scorer(robot, model)
        theirs, own = (scorer.energy_of(scorer.dense(trajectory, COARSER)).total for trajectory in both)
        return theirs - own - SAME * abs(theirs)

    return break_even(saved, model, robot)


def _beyond_belief(result: Result, model: PowerModel, robot: Robot) -> list[str]:
    """Warnings on accelerations and power that are implausible for the arm."""
    out, most = [], np.abs(result.trajectory.sample_denser(10)[2]).max(axis=0)
    for joint, value, source in zip(robot.joints, most.tolist(), robot.sources["acceleration"], strict=True):
        if value > FAST:
            out.append(
                f"{joint}: the acceleration reaches {value:.4g} {robot.unit('acceleration', joint)} "
                f"({'no limit is known' if source == 'assumed' else 'within the limit given'}); few arms do more than "
                f"{FAST:g}: give --limits with the arm's own"
            )
    peak, rated = result.certificate.peak_power - model.constant_power(robot.n), robot.rated.power
    if peak > rated:
        assumed = any(row.what == ELECTRICAL and row.source == "assumed" for row in result.assumptions)
        whose = "the assumed" if assumed else "the model's"
        out.append(
            f"power without standby reaches {peak:.4g} W; the arm's drives give no more than {rated:.4g} W (the sum of "
            f"effort times velocity limits): {whose} electrical values are not this arm's; give --model"
        )
    return out


def _frictionless(result: Result, rivals: Sequence[Rival], share: float | None) -> list[str]:
    """Warning if no model that the move was planned with has friction."""
    saving = None if result.saving is None else result.saving.joules
    if any(has_friction(rival.model) for rival in rivals) or not saving or saving <= 0:
        return []
    name = rivals[0].name
    return [f"the model {name!r} has no friction: {until(share)}; give a model with friction, or plan under several"]


CAREFUL = "careful"
PLANNED, JUDGED = 6, 40  # draws of a model's values: for planning, and for judging the saving
KINDS = ("mean", "worst")
DRAW = "draw "  # prefix of a draw's name, before its number


def members(rivals: Sequence[Rival]) -> list[PowerModel]:
    """The models themselves, without draws of their parameters."""
    return [rival.model for rival in rivals if not rival.name.startswith(DRAW)]


def rivals_from(
    models: Sequence[AnyModel], robust: str | None, robot: Robot, *, request: Any = None
) -> tuple[list[Rival], Kind | None]:
    """The models to plan under, and how to combine them.

    Without any model: the source paper's Method 2 and the careful model, combined by their mean. With one model and
    `robust`: the model, draws from its covariance, and the rivals of its file.

    Args:
        models: names, files, documents or models. robust: "mean", "worst" or None. robot: the arm. request: states
            the payload and the tilt of the base in all models.

    Returns:
        The models; results are stated under the first. And "mean", "worst", or None to plan under the first alone.

    Raises:
        BadInput: something that is no model, or another word for `robust`.
    """
    expect(robust, str | None, "--robust")
    if robust is not None and robust not in KINDS:
        raise BadInput(f"--robust {robust}; expected mean or worst")
    names: list[Any] = list(models) or [DEFAULT, CAREFUL]
    rivals = []
    for number, given in enumerate(names, start=1):
        model, name = model_from(given, robot), _name(given, number)
        used = on_arm(model, request, robot)
        said = (of_another_arm(name, model, robot), of_another_load(name, model, used))
        rivals.append(Rival(name, used, tuple(filter(None, said))))
    if len(rivals) == 1 and robust is None:
        return rivals, None
    if len(rivals) == 1:  # a plan that holds under the uncertainty of the model's own data
        rivals += [*_drawn(rivals[0], PLANNED), *_explaining(rivals[0])]
    return rivals, cast(Kind, robust or "mean")


def rivals_of(request: Any, robot: Robot, desk: Desk | None = None) -> tuple[list[Rival], Kind | None]:
    """The models that a request plans under, with its payload, and with gravity along -z of the scene.

    Args:
        request: model, robust, payload and base. robot: the arm. desk: takes the models' remarks.

    Raises:
        BadInput: as `rivals_from`; or the base is tilted, and a model states another tilt.
    """
    rivals, kind = rivals_from(several(request.model), getattr(request, "robust", None), robot, request=request)
    for said in (remark for rival in rivals for remark in rival.remarks):
        if desk is not None:
            desk.say(f"warning: {said}")
    return rivals, kind


def _drawn(rival: Rival, count: int) -> list[Rival]:
    """Models drawn from a model's covariance; none where it has none."""
    return [Rival(f"{DRAW}{k}", model) for k, model in enumerate(draws_of(rival.model, count), start=1)]


def _explaining(rival: Rival) -> list[Rival]:
    """Other models that explain the same data as well, by the model's file."""
    uncertainty = rival.model.uncertainty
    return [
        Rival(f"rival {k}", model) for k, model in enumerate(() if uncertainty is None else uncertainty.rivals, start=1)
    ]


def _interval(result: Result, rival: Rival, robot: Robot) -> dict[str, list[float]]:
    """95 % intervals of the saving over draws from a model's covariance; empty without draws or without a saving."""
    slowed = result.baseline("scaled")
    if slowed is None or not slowed.valid:
        return {}
    savings = []
    for drawn in _drawn(rival, JUDGED):
        scorer = Scorer(robot, drawn.model)
        ours, theirs = (scorer.energy_of(scorer.dense(t, COARSER)) for t in (result.trajectory, slowed.trajectory))
        savings.append((theirs.total - ours.total, 100 * (theirs.loss - ours.loss) / max(theirs.loss, 1e-12)))
    if not savings:
        return {}
    joules, percent = np.percentile(np.array(savings), [2.5, 97.5], axis=0).T.tolist()
    return {"saving_interval": percent, "saving_joules_interval": joules}


def _name(given: AnyModel, number: int) -> str:
    """Name of a model in results."""
    if isinstance(given, str) and is_named(given):
        return given.replace("_", "-")
    if isinstance(given, Mapping) and given.get("name"):
        return str(given["name"])
    return fspath(given) if isinstance(given, (str, PathLike)) else f"model {number}"


def with_careful(rivals: Sequence[Rival], robot: Robot) -> list[Rival]:
    """The models, and the careful one if the first is one of the source paper's, which have no friction."""
    if not rivals[0].name.startswith("source-method"):
        return list(rivals)
    careful = model_from(CAREFUL, robot)
    for name in ("payload", "base_tilt"):  # of the move, not of the model
        effect = rivals[0].model.get(name)
        careful = careful if effect is None else careful.replaced(effect)
    return [*rivals, Rival(CAREFUL, careful)]


def said(records: Sequence[Mapping[str, Any]], what: str) -> list[str]:
    """Sentences on a plan's energy under models that it was not planned with; `what` names the plan.

    Args:
        records: name, total [J] and saving_joules against the evenly slowed one; the first is of the plan's own model.
    """
    out = []
    for row in records[1:]:
        joules = row["saving_joules"]
        text = f"planned under {records[0]['name']} alone, without friction; under {row['name']} {what} takes "
        text += f"{row['total']:.5g} J"
        if joules is not None and abs(joules) <= NEGLIGIBLE * abs(row["total"]):
            text += ", as much as the evenly slowed one"
        elif joules is not None:
            text += f", {abs(joules):.3g} J {'less' if joules >= 0 else 'more'} than the evenly slowed one"
            text += "" if joules >= 0 else "; plan with a model that was calibrated"
        out.append(text)
    return out


def compared(result: Result, rivals: Sequence[Rival], robot: Robot) -> Result:
    """The result with its energies under further models, and with assumed values and warnings (see `grounded`).

    Further models are: the careful one, if the first is one of the source paper's, which have no friction; and the
    rivals of the first model's file. If the model has a covariance, the saving gets an interval. If the move costs more
    than the evenly slowed one under a further model, a warning says so.

    Args:
        result: the plan. rivals: the models that it was planned with. robot: the arm.
    """
    if result.models:
        first, *others = result.models
        return grounded(
            replace(result, models=({**first, **_interval(result, rivals[0], robot)}, *others)), rivals, robot
        )
    scaled = result.baseline("scaled")
    slowed = None if scaled is None or not scaled.valid else scaled.trajectory
    judges = [*with_careful(rivals, robot), *_explaining(rivals[0])]
    records = records_under(judges, result.trajectory, slowed, robot)
    warnings = [
        f"under the model {row['name']!r} this move takes {-row['saving_joules']:.3g} J more than the evenly "
        "slowed one; plan with --robust mean, or with a model that was calibrated"
        for row in records[1:]
        if (row["saving_joules"] or 0.0) < -NEGLIGIBLE * abs(row["total"])
    ]
    models = ({**records[0], **_interval(result, judges[0], robot)}, *records[1:])
    return grounded(replace(result, models=models, warnings=(*result.warnings, *warnings)), rivals[:1], robot)


def records_under(
    judges: Sequence[Rival], ours: Trajectory, slowed: Trajectory | None, robot: Robot
) -> list[dict[str, Any]]:
    """A record of `Result.models` for every judge: its energies of a motion and of the evenly slowed one, if any."""
    scorers = [(judge.name, Scorer(robot, judge.model)) for judge in judges]
    return [record_of(name, s.energy(ours), None if slowed is None else s.energy(slowed)) for name, s in scorers]
