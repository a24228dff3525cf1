"""Further optima, found without bodies, from which a move that keeps clear may start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from energy_opt.errors import Infeasible
from energy_opt.motion.initial_paths.find import SAME
from energy_opt.motion.move import Move
from energy_opt.motion.plan.candidates import Candidate, reshaped
from energy_opt.motion.plan.context import Context
from energy_opt.motion.reshape.curve import Curve, Outcome
from energy_opt.motion.retime.solve import RetimeSolution
from energy_opt.motion.timing.spline_timing import Timing

LOOKED = 40  # points at which curves are compared
WIDER = 3  # most further seeds to look for optima without bodies, if initial paths are asked for


def wider_optima(
    context: Context, move: Move, timing: Timing | None, retimed: Callable[[], RetimeSolution | None], free: Candidate
) -> Candidate:  # fmt: skip
    """The best candidate found without bodies from several seeds, with the different optima of all of them.

    Args:
        timing, retimed: see `candidates.reshaped`.
        free: the candidate of the usual seed; returned if none of them has an outcome.
    """
    found, settings = [free], context.settings
    for k in range(1, 1 + min(settings.initial_paths or 0, WIDER)):
        if context.stopped():
            break
        try:
            other = replace(context, settings=replace(settings, seed=settings.seed + k))
            found.append(reshaped(other, move, timing, retimed))
        except Infeasible:
            continue
    good = [candidate for candidate in found if candidate.outcome is not None]
    if not good:
        return free
    best = min(good, key=lambda candidate: candidate.outcome.cost if candidate.outcome is not None else np.inf)
    optima: list[Outcome] = []
    for optimum in sorted(
        (optimum for candidate in found for optimum in candidate.optima), key=lambda optimum: optimum.cost
    ):
        if not any(alike(optimum.curve, other.curve) for other in optima):
            optima.append(optimum)
    return replace(best, optima=tuple(optima), iterations=sum(candidate.iterations for candidate in found))


def alike(a: Curve, b: Curve) -> bool:
    """True if two curves differ as little as paths that count as the same (`SAME`)."""
    u = np.linspace(0, 1, LOOKED)
    return bool(np.abs(a.position(u) - b.position(u)).max() < SAME)
