"""The answer of a search for a placement: the placements considered, and all its files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.files import plain, write_json
from energy_opt.jobs.cycle import Plan
from energy_opt.jobs.output import write as write_job
from energy_opt.jobs.posed import Ends
from energy_opt.jobs.run import JobResult
from energy_opt.reports.page import Report


@dataclass(frozen=True)
class Rough:
    """A rough cycle at a placement x, y, z, yaw (4,): positions at its ends, motions, and energy [J].

    Without motions, and of infinite energy, if none was found.
    """

    point: np.ndarray
    ends: Ends
    plan: Plan | None
    energy: float


@dataclass(frozen=True)
class Looked:
    """A placement considered: pose (6,), estimate or energy [J] (nan: a pose is out of reach), and its kind."""

    place: tuple[float, ...]
    energy: float
    kind: str

    def document(self, what: str) -> dict[str, Any]:
        """Its record in place.json."""
        return {what: list(self.place), "energy_total": self.energy if np.isfinite(self.energy) else None,
                "kind": self.kind}  # fmt: skip


@dataclass(frozen=True)
class Placement:
    """The cheapest placement of the base, or of a fixture.

    Attributes:
        place: its x, y, z [m], roll, pitch, yaw [rad] in the scene's frame; result: the job solved there.
        given, given_result: the pose that was given, and the job there; None if it cannot be done there.
        looked_at: estimates all over the box; path: the placements at which the job was solved, in order.
        warnings: notes for the reader.
    """

    place: tuple[float, ...]
    result: JobResult
    given: tuple[float, ...]
    given_result: JobResult | None
    looked_at: tuple[Looked, ...]
    path: tuple[Looked, ...]
    warnings: tuple[str, ...]
    fixture: str | None = None

    @property
    def what(self) -> str:
        """Key of the placed pose in place.json."""
        return "base" if self.fixture is None else "pose"

    @property
    def solved(self) -> bool:
        """Is the job at the answer solved, proven clear and within all limits?"""
        return self.result.solved

    def document(self) -> dict[str, Any]:
        """The content of place.json without the request; energies in J."""
        here, there = self.result.energy, None if self.given_result is None else self.given_result.energy
        saving = None if there is None else {"joules": there - here, "percent": 100 * (1 - here / there)}
        choice = self.result.choice
        return {
            "format": "energy-opt/place-result/1",
            "status": "solved" if self.solved else "not_converged",
            "robot": self.result.job.robot.name,
            **({} if self.fixture is None else {"fixture": self.fixture}),
            self.what: list(self.place),
            "energy_total": here,
            "given": {self.what: list(self.given), "energy_total": there},
            "saving": saving,
            "goals": [] if choice is None else [{"step": k + 1, "goal": q} for k, q in choice.ends.items()],
            "path": [at.document(self.what) for at in self.path],
            "looked_at": [at.document(self.what) for at in self.looked_at],
            "solves": len(self.path),
            "warnings": list(self.warnings),
        }


def write(placement: Placement, request: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """Write place.json, map.png, report.html and the job's folder.

    Args:
        placement: the answer. request: its document. out: the folder.

    Returns:
        The content of place.json.
    """
    from energy_opt.reports.plots import plot_placements, png

    found = {**placement.document(), "request": plain(request)}
    (Path(out) / "job").mkdir()
    write_job(placement.result, request, Path(out) / "job")
    looked = placement.looked_at
    places = np.array([at.place[:2] for at in looked]).reshape(-1, 2)
    solved = [at for at in placement.path if np.isfinite(at.energy) and at.kind in ("seed", "step")]
    solved = [
        at for at in solved if at.kind == "step" or at.energy == min(s.energy for s in solved if s.kind == "seed")
    ]
    energies = np.array([at.energy for at in looked])
    path = [at.place[:2] for at in solved if at.place != placement.place]
    given = placement.given[0], placement.given[1]
    figure = plot_placements(places[:, 0], places[:, 1], energies, [*path, placement.place[:2]], given)  # type: ignore[list-item]
    picture = png(figure)
    (Path(out) / "map.png").write_bytes(picture)
    what = placement.fixture or "base"
    report = Report(f"{found['robot']}: the cheapest place of the {what}").headline(headline(found))
    report.warning(*found["warnings"])
    report.picture(picture, f"Estimates of the cycle's energy over x and y of the {what}, and the path of the search")
    records = [[at.kind, *at.place, at.document("")["energy_total"]] for at in placement.path]
    report.section("Placements at which the job was solved").table(
        ["", "x [m]", "y [m]", "z [m]", "roll [rad]", "pitch [rad]", "yaw [rad]", "energy [J]"], records
    )
    report.section("The job at the answer").text("Its own report is job/report.html.").command(request)
    report.write(Path(out) / "report.html")
    write_json(Path(out) / "place.json", found)
    return found


def headline(found: Mapping[str, Any]) -> str:
    """A summary in one sentence."""
    what = found.get("fixture")
    x, y, z, _, _, yaw = found["base" if what is None else "pose"]
    at = f"{what or 'Base'} at x {x:.4g} m, y {y:.4g} m, z {z:.4g} m, yaw {yaw:.4g} rad"
    models = [model["name"] for model in (found["request"].get("robust") or {}).get("models", ())]
    mean = f" in the mean of {' and '.join(models)}" if models else ""
    words = f"{at}: {found['energy_total']:.4g} J a cycle{mean}"
    if found["saving"] is None:
        return words + "; the job is not possible at the given place."
    given, percent = found["given"]["energy_total"], found["saving"]["percent"]
    return words + f", {percent:.3g} % less than the {given:.4g} J at the given place."
