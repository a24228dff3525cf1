"""The verb `passport`: the electrical passport of an arm, from its models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import as_loaded, named_robot, of_another_arm, robot_of, several
from energy_opt.passports.sheet import Passport
from energy_opt.passports.sheet import passport as passport_of
from energy_opt.power.model import model_from_document
from energy_opt.requests.option import plain
from energy_opt.requests.verbs import PassportRequest
from energy_opt.robot import Robot


def run(request: PassportRequest, desk: Desk) -> Passport:
    """The electrical passport of one model of an arm, or of several side by side.

    Raises:
        BadInput: a file is at fault, a name or a robot is not known, or lists do not fit the robot.
    """
    models: Any = request.models
    given: list[Any] = several(models)
    if len(given) == 1 and isinstance(given[0], Robot) and request.robot is None:
        request = replace(request, **as_loaded(given[0], given[0]))
    given = [named_robot(one) if isinstance(one, Robot) else one for one in given]
    models = [model_from_document(dict(one), "model") if isinstance(one, Mapping) else one for one in given]
    named = None if request.robot is None else robot_of(request)
    found = passport_of(models, named, request.limits, request.locked or None)
    states = [arm.model.to_document() for arm in found.arms]
    robot = request.robot if request.robot is None else str(getattr(request.robot, "name", request.robot))
    document = desk.take(Passport.answer, replace(request, models=tuple(given), robot=robot), contents=plain(states))
    result = desk.keep(replace(found, request=document))
    for arm in found.arms:
        if said := of_another_arm(arm.label, arm.model, arm.robot):
            desk.say(f"warning: {said}")
    desk.say(str(result) + ("" if desk.out is None else f"\nwritten: {desk.out}"))
    return result


passport = verb(PassportRequest, run)
