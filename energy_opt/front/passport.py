"""The verb `passport`: an arm's electrical passport from its models; several side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import several
from energy_opt.passports import Passport
from energy_opt.passports import passport as passport_of
from energy_opt.power.model import model_from_document
from energy_opt.requests.option import plain
from energy_opt.requests.verbs import PassportRequest

ANSWER = "passport.json"


def model_list(given: Any) -> list[Any]:
    """Models one by one; documents of models as models."""
    return [
        model_from_document(dict(model), "model") if isinstance(model, Mapping) else model for model in several(given)
    ]


def run(request: PassportRequest, desk: Desk) -> Passport:
    """The electrical passport of one model of an arm, or of several side by side.

    Raises:
        BadInput: a file is at fault, a name or a robot is not known, or lists do not fit the robot.
    """
    found = passport_of(model_list(request.models), request.robot, request.limits)
    states = [arm.model.to_document() for arm in found.arms]
    robot = request.robot if request.robot is None else str(getattr(request.robot, "name", request.robot))
    document = replace(request, robot=robot).document() | {"contents": states}
    result = replace(found, request=desk.stamped(plain(document)))
    desk.take(ANSWER, result.request)
    desk.keep(result)
    desk.say(str(result) + ("" if desk.out is None else f"\nwritten: {desk.out}"))
    return result


passport = verb(PassportRequest, run)
