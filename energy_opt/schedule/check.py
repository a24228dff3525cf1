"""Check of lags and exclusions, recomputed from starts and durations, independent of the program that found them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from energy_opt.schedule.problem import Problem, Run

CLOSE = 1e-6  # [s] tolerance


def keeps(problem: Problem, starts: Sequence[np.ndarray], durations: Sequence[np.ndarray]) -> bool:
    """True if starts and durations [s] of every ring's steps keep all lags and exclusions."""
    cycle = problem.cycle_time
    for lag in problem.lags:
        (a, i), (b, j) = lag.begin, lag.end
        behind = starts[b][j] - starts[a][i]
        if lag.height is None:
            ended = durations[a][i] if lag.begin_ends else 0.0
            most = min(np.inf if lag.most is None else lag.most + ended, np.inf if lag.within is None else lag.within)
            if (behind - ended - lag.length + CLOSE) % cycle > most - ended - lag.length + 2 * CLOSE:
                return False
        elif behind < lag.length - cycle * lag.height - CLOSE:
            return False
    for pair in problem.exclusions:
        (one, one_end), (two, two_end) = (_interval(run, starts, durations) for run in (pair.first, pair.second))
        if (two - one) % cycle < one_end - one + pair.gap - CLOSE:
            return False
        if (one - two) % cycle < two_end - two + pair.gap - CLOSE:
            return False
    return True


def _interval(run: Run, starts: Sequence[np.ndarray], durations: Sequence[np.ndarray]) -> tuple[float, float]:
    begin, lengths = float(starts[run.ring][run.first]), durations[run.ring]
    if run.part is not None:
        return begin + run.part[0] * float(lengths[run.first]), begin + run.part[1] * float(lengths[run.first])
    count = (run.last - run.first) % len(lengths) + 1
    return begin, begin + float(sum(lengths[(run.first + k) % len(lengths)] for k in range(count)))
