"""The answer of a search for a placement, and the placements considered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from energy_opt.jobs.cycle import Plan
from energy_opt.jobs.posed import Ends
from energy_opt.jobs.run import JobResult


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
