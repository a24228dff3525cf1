"""A solved move with what it was asked for: it prints in five lines and saves what the command writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from os import PathLike
from pathlib import Path
from typing import Any

from energy_opt.cell.cell import Cell
from energy_opt.motion import Result
from energy_opt.power.per_year import PerYear, per_year_words
from energy_opt.robot import Robot

UNCHECKED = "self-collision is off: whether the arm touches itself was not checked"
FORMAT = "energy-opt/result/1"


@dataclass(frozen=True, repr=False, kw_only=True)
class Answer(Result):
    """A result that knows its robot and the request that it answers, and so can be saved.

    Attributes:
        arm: the robot.
        cell: the arm's body and what stood around it; None where nothing was kept clear of.
        worth: how often the move is made in a year, where that was asked for.
        goals: where the goal is a set, the candidates that were looked at, the nearest one, and by what the ends miss
            their poses.
        request: start, goal, path, payload, model, limits, scene, seed, version, command, as result.json has them.
    """

    arm: Robot
    request: Mapping[str, Any] = field(default_factory=dict)
    cell: Cell | None = None
    worth: PerYear | None = None
    goals: Mapping[str, Any] = field(default_factory=dict)

    @property
    def per_year(self) -> dict[str, float | None] | None:
        """What the saving is worth in a year; None where that was not asked for."""
        saving = self.saving
        return None if self.worth is None else self.worth.of(None if saving is None else saving["joules"])

    @property
    def year(self) -> str:
        """The same in words; empty where that was not asked for."""
        found = self.per_year
        return "" if self.worth is None or found is None else per_year_words(found, self.worth.cycles_per_year)

    def document(self) -> dict[str, object]:
        """result.json."""
        worth = {} if self.worth is None else {"per_year": self.per_year}
        return {"format": FORMAT, **super().document(), **worth, **self.goals, "request": self.request}

    def save(self, out: str | PathLike[str]) -> Path:
        """Write result.json, trajectory.csv, trajectory.yaml, plot.png and report.html into the folder `out`."""
        from energy_opt.front.output import write

        write(self, self.arm, self.document(), Path(out), self.cell)
        return Path(out)


def answer_of(
    result: Result, robot: Robot, request: Mapping[str, Any], cell: Cell | None = None, worth: PerYear | None = None
) -> Answer:
    """The result with its robot, request and cell, and what it is to be worth in a year."""
    known = {f.name: getattr(result, f.name) for f in fields(Result)}
    if not (request.get("cell") or {}).get("self_collision", True):
        known["warnings"] = (*result.warnings, UNCHECKED)
    return Answer(**known, arm=robot, request=request, cell=cell, worth=worth)
