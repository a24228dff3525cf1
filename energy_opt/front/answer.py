"""A solved move with what it was asked for: it prints in five lines and saves what the command writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from energy_opt.cell.cell import Cell
from energy_opt.folders import written_whole
from energy_opt.formats.output import Written
from energy_opt.found import Found
from energy_opt.motion import Move, Result
from energy_opt.power.worth import per_year_words
from energy_opt.requests.moves import OptimizeRequest
from energy_opt.robot import Robot

UNCHECKED = "self-collision is off: whether the arm touches itself was not checked"
FORMAT = "energy-opt/result/1"
ANSWER = "result.json"


@dataclass(frozen=True, repr=False, kw_only=True)
class Answer(Result, Found):
    """A result that knows its robot and the request that it answers, and so can be saved.

    Attributes:
        arm: the robot.
        move: what was solved; where the goal is a set, its ends are those that were chosen.
        request: what was asked, with what its words and files came to; `run` repeats it.
        stamp: version, and the command line where there was one.
        cell: the arm's body and what stood around it; None where nothing was kept clear of.
        goals: where the goal is a set, the candidates that were looked at, the nearest one, and by what the ends miss
            their poses.
        controllers: writes the files that `--write` and `--as` ask for into a folder.
        files: those that were written, read back and judged.
    """

    arm: Robot
    move: Move
    request: OptimizeRequest
    stamp: Mapping[str, Any] = field(default_factory=dict)
    cell: Cell | None = None
    goals: Mapping[str, Any] = field(default_factory=dict)
    controllers: Callable[[Result, Path], list[Written]] | None = None
    files: tuple[Written, ...] = ()

    @property
    def per_year(self) -> dict[str, float | None] | None:
        """What the saving is worth in a year; None where that was not asked for."""
        saving, worth = self.saving, self.request.worth
        return None if worth is None else worth.of(None if saving is None else saving["joules"])

    @property
    def year(self) -> str:
        """The same in words; empty where that was not asked for."""
        found = self.per_year
        return "" if found is None else per_year_words(found, self.request.cycles_per_year or 0.0)

    @property
    def exit_code(self) -> int:
        """Of the command line."""
        if self.interrupted:
            return 130
        return 0 if self.status == "solved" and all(row.valid for row in self.files) else 4

    def document(self) -> dict[str, object]:
        """result.json."""
        worth = {} if self.request.worth is None else {"per_year": self.per_year}
        request = {**self.request.document(), **self.stamp}
        return {"format": FORMAT, **super().document(), **worth, **self.goals, "request": request}

    def text(self, out: Path) -> str:
        """The short table for a terminal, of an answer that was saved into `out`."""
        from energy_opt.front.output import table

        return table(self, out, self.arm, self.year)

    def kept(self, out: Path) -> Answer:
        """Write result.json, trajectory.csv, trajectory.yaml, plot.png and report.html into the folder `out`.

        Beside them the files for controllers that the request asks for.
        """
        from energy_opt.front.output import put

        with written_whole(out, ANSWER) as aside:
            files = () if self.controllers is None else tuple(self.controllers(self, aside))
            found = replace(self, files=files, written=tuple(row.document() for row in files))
            put(found, self.arm, found.document(), aside, self.cell)
        return found


def answer_of(result: Result, **known: Any) -> Answer:
    """The result as an answer; `known` are the further fields of that.

    Where the arm's own body was not kept clear of, a warning says so.
    """
    of_result = {f.name: getattr(result, f.name) for f in fields(Result)}
    if known["request"].self_collision is False:
        of_result["warnings"] = (*result.warnings, UNCHECKED)
    return Answer(**{**of_result, **known})
