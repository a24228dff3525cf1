"""The verb `import`: a lab's logs as a measured set."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from energy_opt.errors import BadInput
from energy_opt.files import plain
from energy_opt.formats.bags import is_bag
from energy_opt.front.desk import Desk, verb
from energy_opt.front.given import robot_of
from energy_opt.front.recordings import unpack
from energy_opt.measured.columns import ByHand
from energy_opt.measured.importing import Imported, import_files
from energy_opt.requests.verbs import ImportRequest
from energy_opt.results import Found


@dataclass(frozen=True, repr=False)
class Set(Found):
    """A measured set that was written, with its folder and its sources.

    Attributes:
        out: the folder. imported: its robot, runs, guesses and remarks. request: what was asked.
    """

    out: Path
    imported: Imported
    request: ImportRequest

    def document(self) -> dict[str, Any]:
        """Set, robot, log, guesses, remarks and runs."""
        found = self.imported
        return {
            "set": str(self.out), "robot": found.robot.name, "log": plain(found.log), "guesses": list(found.words),
            "remarks": list(found.remarks),
            "runs": [
                {"file": r.file, "kind": r.kind, "rows": len(r.time), "readings": len(r.power), "meter": r.meter}
                for r in found.runs
            ],
        }  # fmt: skip

    def __repr__(self) -> str:
        return f"Set({str(self.out)!r}, {self.imported.robot.name!r}, {len(self.imported.runs)} runs)"


def run(request: ImportRequest, desk: Desk) -> Set:
    """Convert a lab's logs to a measured set; columns and units are guessed and reported.

    Raises:
        BadInput: no robot has these columns, or a file is at fault.
    """
    if request.lock and request.robot is None:
        raise BadInput("--lock needs --robot: the robot that is found by its columns has no other joints")
    robot, out = None if request.robot is None else robot_of(request), Path(request.out)
    pairs = {word: word.partition("=") for word in request.joint}
    for word, parts in pairs.items():
        if not all(parts):
            raise BadInput(f"--joint {word}: JOINT=COLUMN")
    hand = ByHand(request.time, request.power, {joint: column for joint, _, column in pairs.values()})
    with tempfile.TemporaryDirectory(prefix="energy-opt-") as folder:
        files: list[Path] = []
        for file in map(Path, request.files):
            tables, notes = unpack(file, Path(folder)) if is_bag(file) else ([file], [])
            files += tables
            if notes:
                desk.say("\n".join(notes))
        with desk.showing() as show:
            show("columns, clocks and robot of each file")
            try:
                found = import_files(files, out, robot, desk.force or request.force, hand)
            except BadInput as error:  # the folder will be gone
                raise BadInput(str(error).replace(f"{Path(folder)}/", "made of the bag, ")) from None
    motions = sum(run.kind == "motion" for run in found.runs)
    readings = sum(len(run.power) for run in found.runs)
    what = f"{len(found.runs)} run(s), {motions} of them motions, {readings} readings of power"
    desk.say("\n".join([*found.words, *(f"note: {remark}" for remark in found.remarks), f"written: {out}: {what}"]))
    return Set(out, found, request)


import_logs = verb(ImportRequest, run)
