"""Which models a plan is to hold under, and what models that were not planned with make of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

from energy_opt.errors import BadInput
from energy_opt.front.given import DEFAULT, AnyModel, AnyPayload, model_from, payload_from
from energy_opt.motion import Result
from energy_opt.motion.judge.energy import Scorer
from energy_opt.motion.plan.robust import Kind, Rival, row_of
from energy_opt.power.named import is_named, named_model
from energy_opt.robot import Robot

CAREFUL = "careful"
KINDS = ("mean", "worst")


def rivals_from(
    models: Sequence[AnyModel], robust: str | None, robot: Robot, payload: AnyPayload | None = None
) -> tuple[list[Rival], Kind | None]:
    """The models to plan under, the one that results are stated under first, and how; None: under the first alone.

    Without any model: the source paper's Method 2 and the careful one, in the mean.

    Raises:
        BadInput: a model that is none, or `robust` that is neither "mean" nor "worst".
    """
    if robust is not None and robust not in KINDS:
        raise BadInput(f"--robust {robust}; expected mean or worst")
    names: list[AnyModel] = list(models) or [DEFAULT, CAREFUL]
    rivals = []
    for number, given in enumerate(names, start=1):
        model = model_from(given, robot)
        if payload is not None:
            model = model.replaced(payload_from(payload))
        rivals.append(Rival(_name(given, number), model))
    if len(rivals) == 1 and robust is None:
        return rivals, None
    return rivals, cast(Kind, robust or "mean")


def _name(given: AnyModel, number: int) -> str:
    if isinstance(given, str) and is_named(given):
        return given.replace("_", "-")
    return f"model {number}" if given is None or not isinstance(given, str) else given


def compared(result: Result, rivals: Sequence[Rival], robot: Robot) -> Result:
    """The result with what models that were not planned with make of it, and a warning where it is dear under one.

    These are the model itself and, where that is one of the source paper's, which knows no friction, the careful one.
    """
    if result.models:
        return result
    payload = rivals[0].model.get("payload")
    judges = list(rivals)
    if rivals[0].name.startswith("source-method"):
        careful = named_model(CAREFUL, robot.name)
        judges.append(Rival(CAREFUL, careful if payload is None else careful.replaced(payload)))
    slowed = result.baseline("scaled")
    rows: list[dict[str, Any]] = []
    warnings = list(result.warnings)
    for rival in judges:
        scorer = Scorer(robot, rival.model)
        beside = None if slowed is None or not slowed.valid else scorer.energy(slowed.trajectory)
        row = row_of(rival.name, scorer.energy(result.trajectory), beside)
        rows.append(row)
        joules = row["saving_joules"]
        if isinstance(joules, float) and joules < 0 and rival is not judges[0]:
            warnings.append(
                f"under the model {rival.name!r} this move takes {-joules:.3g} J more than the same move slowed "
                "evenly; plan with --robust mean, or with a model that was calibrated"
            )
    return replace(result, models=tuple(rows), warnings=tuple(warnings))
