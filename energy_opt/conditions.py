"""Conditions on a move, as objects: `eo.optimize(..., conditions=[eo.conditions.MaxPower(400), MyLimit()])`.

Each class below has an option of the command line with the same meaning. Your own limit is a subclass of `Limit` with a
name, a unit and one formula; it also states whether it binds each joint or the whole arm (docs/extending.md).
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any, ClassVar

from energy_opt.arguments import check_fields, expect
from energy_opt.errors import BadInput, one_line_of, shown
from energy_opt.files import path_of
from energy_opt.motion.limits.base import State
from energy_opt.motion.limits.own import OwnLimit as Limit
from energy_opt.motion.move import Settings

__all__ = [
    "Condition", "KeepLine", "KeepOrientation", "KeepUpright", "Limit", "MaxPower", "State", "ToolAcceleration",
    "ToolSpeed", "Tube", "load_file", "options_and_limits",
]  # fmt: skip


@dataclass(frozen=True)
class Condition:
    """Base of conditions that the command line has as options, too.

    Attributes:
        option: name, in a request, of the option with the same meaning; its value is the condition's only field.
        word: the condition's word for `--keep`; empty for other options.
    """

    option: ClassVar[str] = "keep"
    word: ClassVar[str] = ""

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            BadInput: a field is no number, or outside of the range that a verb accepts.
        """
        try:
            check_fields(self)
            Settings(**self.options())
        except BadInput as fault:
            raise BadInput(f"{type(self).__name__}: {fault}") from None

    def options(self) -> dict[str, Any]:
        """The values of the equivalent options, by their names in a request."""
        (value,) = vars(self).values()
        return {self.option: (f"{self.word}:{value:g}",) if self.word else value}


@dataclass(frozen=True)
class MaxPower(Condition):
    """The arm's electrical power stays at or below `watts` [W]; power that flows back is not bounded."""

    option = "max_power"
    watts: float


@dataclass(frozen=True)
class ToolSpeed(Condition):
    """The tool's origin moves at most this fast [m/s]."""

    option = "tool_speed"
    metres_per_second: float


@dataclass(frozen=True)
class ToolAcceleration(Condition):
    """The tool's origin accelerates at most this much [m/s^2]."""

    option = "tool_acceleration"
    metres_per_second2: float


@dataclass(frozen=True)
class KeepUpright(Condition):
    """The tool's axis that points up most at the start stays within `degrees` of the upward vertical.

    The axis is x, y or z of the tool's frame, or the opposite of one. Rotations about it are free.
    """

    word = "upright"
    degrees: float = 5.0


@dataclass(frozen=True)
class KeepOrientation(Condition):
    """The tool's orientation stays within a rotation of `degrees` from its orientation at the start."""

    word = "orientation"
    degrees: float = 2.0


@dataclass(frozen=True)
class KeepLine(Condition):
    """The tool's origin stays within `millimetres` of the straight segment between its start and its goal."""

    word = "line"
    millimetres: float = 1.0


@dataclass(frozen=True)
class Tube(Condition):
    """Every joint stays within `radians`, or the tool's origin within `metres`, of the nearest point of the path.

    The path is the given one, or the straight line in joint space. One of the two bounds is given.
    """

    radians: float | None = None
    metres: float | None = None

    def options(self) -> dict[str, Any]:
        """`--tube`.

        Raises:
            BadInput: neither, or both, are given.
        """
        if (self.radians is None) == (self.metres is None):
            raise BadInput("expected radians (of every joint) or metres (of the tool)")
        return {"tube": f"{self.radians:g}rad" if self.radians is not None else f"{self.metres:g}m"}


def options_and_limits(given: Sequence[Any]) -> tuple[dict[str, Any], tuple[Limit, ...]]:
    """Divide conditions into options of a request and the user's own limits.

    Args:
        given: conditions, limits, and names of files that define them.

    Raises:
        BadInput: an item is none of these, a condition is given twice, or a file defines none.
    """
    expect(given, Sequence, "--conditions")
    options: dict[str, Any] = {}
    limits: list[Limit] = []
    for condition in given:
        if isinstance(condition, (str, PathLike)):
            more, own = options_and_limits(load_file(condition))
        elif isinstance(condition, Condition):
            more, own = condition.options(), ()
        elif isinstance(condition, Limit):
            more, own = {}, (condition,)
        else:
            kind = f", as {condition.__name__}(...)" if isinstance(condition, type) else ""
            raise BadInput(
                f"--conditions {shown(condition)}: expected a condition, a limit{kind}, or a file that defines them"
            )
        for name, value in more.items():
            if name in options and name != "keep":
                raise BadInput(f"{type(condition).__name__} is given twice")
            options[name] = (*options.get("keep", ()), *value) if name == "keep" else value
        limits += own
    return options, tuple(limits)


def load_file(file: str | PathLike[str]) -> list[Any]:
    """The conditions that a Python file defines: its list `conditions`, else one of each of its limits.

    Raises:
        BadInput: there is no such file, it cannot be run, or it defines none.
    """
    path = path_of(file, "--conditions")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if not path.is_file() or spec is None or spec.loader is None:
        known = "" if path.suffix == ".py" else "; a request repeats own limits only if FILE.py defines them"
        raise BadInput(f"--conditions {path}: no such Python file{known}")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        found = getattr(module, "conditions", None)
        if found is None:
            kinds = [kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, Limit)]
            found = [kind() for kind in kinds if kind.__module__ == module.__name__]
    except (Exception, SystemExit) as fault:
        raise BadInput(f"--conditions {path}: {one_line_of(fault, str(path))}") from None
    if not isinstance(found, (list, tuple)):
        raise BadInput(f"--conditions {path}: conditions = {shown(found)}; expected a list")
    if not found:
        raise BadInput(f"--conditions {path}: defines no condition; expected a list `conditions`, or a class of Limit")
    return list(found)
