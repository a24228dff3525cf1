"""What can be said of limits before anything is solved: places of a path that no timing can bring inside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.limits.base import Limit
from energy_opt.motion.path_dynamics import PathDynamics

ALLOWED = 1e-9  # of a bound, or of a range


def check_path(limits: Sequence[Limit], d: PathDynamics) -> None:
    """What no timing can mend: positions outside the limits, and what merely holding the arm would take.

    Raises:
        Infeasible: names joint, limit, path position and excess.
    """
    for limit in limits:
        fixed = limit.fixed(d)
        if fixed is None:
            continue
        k, j = np.unravel_index(int(np.argmax(fixed.excess)), fixed.excess.shape)
        if fixed.excess[k, j] <= ALLOWED:
            continue
        s, joint = float(d.s[k]), limit.where(d.robot.joints, int(j))
        place = {0.0: "at the start", 1.0: "at the goal"}.get(s, f"at path position {s:.3f}")
        raise Infeasible(
            f"{joint}: {fixed.text(int(k), int(j))} {place}",
            joint=joint,
            limit=limit.name,
            position=s,
            excess=float(fixed.excess[k, j]),
        )
