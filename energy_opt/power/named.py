"""Power models that are known by name."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

from energy_opt.effects import Regeneration, Standby
from energy_opt.errors import BadInput, near
from energy_opt.power.known import by_name, electrical, friction
from energy_opt.power.model import PowerModel, load_model
from energy_opt.robot import Robot

MEAN_OVERHEAD = 92.3  # [W] of the eight static poses of Method 1, on a Panda


def source_method_1(robot: Robot | str = "panda") -> PowerModel:
    """Method 1 of Petrichenko et al. 2024 (arXiv 2411.03194): R = 0, the mean overhead of eight static poses.

    Of other arms than the Panda the overhead is what `known.electrical` has for standby.
    """
    arm = _arm(robot)
    standby = Standby(power=MEAN_OVERHEAD) if arm.name == "panda" else electrical(arm)[0].effect
    return PowerModel(arm.name, (standby,))


def source_method_2(robot: Robot | str = "panda") -> PowerModel:
    """Method 2 of the same paper: least squares of static power over |gravity torque|^2, Franka Panda.

    Of other arms standby and copper loss are what `known.electrical` has.
    """
    arm = _arm(robot)
    return PowerModel(arm.name, tuple(known.effect for known in electrical(arm)))


def careful(robot: Robot | str) -> PowerModel:
    """The source paper's Method 2 with friction, published or assumed, and no regeneration."""
    arm = _arm(robot)
    model = source_method_2(arm).replaced(Regeneration(efficiency=0.0))
    for known in friction(arm):
        model = model.replaced(known.effect)
    return model


def _arm(robot: Robot | str) -> Robot:
    return by_name(robot) if isinstance(robot, str) else robot


# Each is made for a robot.
NAMED: dict[str, Callable[[Robot | str], PowerModel]] = {
    "source-method-1": source_method_1,
    "source-method-2": source_method_2,
    "careful": careful,
}


def is_named(word: str) -> bool:
    """Is there a model of that name? Underscores are taken for dashes."""
    return word.replace("_", "-") in NAMED


def named_model(word: str, robot: Robot | str) -> PowerModel:
    """The model of that name for a robot, or the robot of a name; check with `is_named` first."""
    return NAMED[word.replace("_", "-")](robot)


def model_of(word: str | PathLike[str], robot: Robot | str) -> PowerModel:
    """The model of a name, or of a model file.

    Raises:
        BadInput: neither; says which names there are.
    """
    if is_named(str(word)):
        return named_model(str(word), robot)
    if not Path(word).is_file() and not Path(word).suffix:
        hint = near(str(word).replace("_", "-"), NAMED)
        raise BadInput(f"--model {word}: neither a model file nor a name{hint}: {', '.join(NAMED)}")
    return load_model(Path(word))
