"""Power models that are known by name."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

from energy_opt.errors import BadInput, near
from energy_opt.power.model import PowerModel, load_model, source_method_1, source_method_2

# Each is made for a robot's name.
NAMED: dict[str, Callable[[str], PowerModel]] = {
    "source-method-1": source_method_1,
    "source-method-2": source_method_2,
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
