"""A move of an arm in a cell: its known energies over the duration, and where to optimize next."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from energy_opt.jobs.cycle import Answer
from energy_opt.jobs.legs import Leg
from energy_opt.motion.timing.law import Timing
from energy_opt.schedule import Hull
from energy_opt.schedule.curves import SAME


@dataclass
class ArmMove:
    """A motion from rest to rest, by duration.

    Attributes:
        place: index of its step in the robot's table; leg, timing: its first path and that path's fastest timing.
        answers: best known trajectories by duration [s].
        tried: durations [s] at which it was optimized.
    """

    place: int
    leg: Leg
    timing: Timing
    shortest: float
    longest: float
    answers: dict[float, Answer] = field(default_factory=dict)
    slowed: dict[float, Answer] = field(default_factory=dict)
    tried: set[float] = field(default_factory=set)

    def was_tried(self, duration: float) -> bool:
        """True if it was optimized at a duration [s]."""
        return any(abs(duration / tried - 1) < SAME for tried in self.tried)

    def beside(self, duration: float, worth: float) -> list[float]:
        """Durations [s] between a known one and its neighbours at which more than `worth` [J] may be saved.

        Energy is convex over the duration: between two optimized durations it lies above the lines through their
        neighbours, if these are optimized too.
        """
        hull = Hull.of([(d, answer.energy.total) for d, answer in self.answers.items()])
        d, e = hull.durations, hull.energies
        known = [self.was_tried(at) for at in d.tolist()]
        chosen = int(np.argmin(np.abs(d - duration)))
        out = []
        for k in range(max(chosen - 1, 0), min(chosen + 1, len(d) - 1)):  # between d[k] and d[k + 1]
            middle = float(np.sqrt(d[k] * d[k + 1]))
            least = -np.inf
            for one, two in ((k, k - 1), (k + 1, k + 2)):
                if 0 <= two < len(d) and known[one] and known[two]:
                    least = max(least, e[one] + (middle - d[one]) * (e[one] - e[two]) / (d[one] - d[two]))
            if hull.value(middle) - least > worth:
                out.append(middle)
        return out


def nearest(known: dict[float, Any], duration: float) -> float:
    """The key of `known` nearest to a duration [s]."""
    return min(known, key=lambda d: abs(d - duration))
