"""Power models that are known by name."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

from energy_opt.effects import Regeneration, SigmoidFriction
from energy_opt.errors import BadInput, near
from energy_opt.power.model import PowerModel, load_model, source_method_1, source_method_2

# Friction as published for whole arms: a [N m], k [s/rad] and c [rad/s] of each joint.
PUBLISHED = {
    # Gaz et al., IEEE RA-L 4(4), 2019, table of friction parameters of the Franka Emika Panda
    "panda": SigmoidFriction(
        a=[0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489],
        k=[5.1181, 9.0657, 10.136, 5.5903, 8.3469, 17.133, 10.336],
        c=[0.039533, 0.025882, -0.04607, 0.036194, 0.026226, -0.021047, 0.0035526],
    )
}


def careful(robot: str) -> PowerModel:
    """The source paper's Method 2 with published friction, where there is any, and no regeneration."""
    model = source_method_2(robot).replaced(Regeneration(efficiency=0.0))
    return model.replaced(PUBLISHED[robot]) if robot in PUBLISHED else model


# Each is made for a robot's name.
NAMED: dict[str, Callable[[str], PowerModel]] = {
    "source-method-1": source_method_1,
    "source-method-2": source_method_2,
    "careful": careful,
}


def is_named(word: str) -> bool:
    """Is there a model of that name? Underscores are taken for dashes."""
    return word.replace("_", "-") in NAMED


def named_model(word: str, robot: str) -> PowerModel:
    """The model of that name for the robot of a name; check with `is_named` first."""
    return NAMED[word.replace("_", "-")](robot)


def model_of(word: str | PathLike[str], robot: str) -> PowerModel:
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
