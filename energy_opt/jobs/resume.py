"""Answers that are kept while a job is worked on, so that a run that was killed loses at most one leg."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from energy_opt import formats
from energy_opt.errors import EnergyOptError
from energy_opt.files import to_json
from energy_opt.jobs.legs import Leg
from energy_opt.motion.trajectory import Trajectory

FOLDER = ".answers"


class Answers:
    """Trajectories by what decides them: leg, duration, and whatever else `about` says (model, limits, settings)."""

    def __init__(self, out: Path, joints: Sequence[str], about: object, resume: bool) -> None:
        """In `out`; without `resume` what an earlier run left is not looked at."""
        self._folder, self._joints, self._resume = Path(out) / FOLDER, tuple(joints), resume
        self._about = to_json(about)

    def known(self, leg: Leg, duration: float) -> Trajectory | None:
        """The earlier answer; None where there is none that can be read."""
        path = self._path(leg, duration)
        if not self._resume or not path.is_file():
            return None
        try:
            return formats.read_trajectory(path, self._joints)
        except EnergyOptError:
            return None

    def keep(self, leg: Leg, duration: float, trajectory: Trajectory) -> None:
        """Write an answer, whole or not at all."""
        formats.write(trajectory, self._path(leg, duration))

    def forget(self) -> None:
        """Nothing is kept of a job that is done."""
        for path in self._folder.glob("*.csv"):
            path.unlink(missing_ok=True)
        if self._folder.is_dir():
            self._folder.rmdir()

    def _path(self, leg: Leg, duration: float) -> Path:
        what = to_json([leg.points, leg.mode, leg.step.payload, str(leg.step.scene), repr(duration)])
        return self._folder / f"{hashlib.sha256((self._about + what).encode()).hexdigest()[:24]}.csv"
