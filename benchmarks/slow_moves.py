"""Slow moves: what rest at one end is worth beside creeping all the time.

    python benchmarks/slow_moves.py [--moves 6] [--seed 1] [--arms panda ur5e] [--out numbers.json]

Seeded moves in 2.5, 6 and 15 times the shortest duration of their straight paths are reshaped twice, with the model
`careful` and with the default models: by the planner as it is, and without a rest (`motion/plan/resting.py`). Gains are
shares of the mean loss. A further move of a ur5e ends upright, where its joints bear little. Processor times are of the
same run. Exit code 1 where rest costs energy.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from common import finish, table

import energy_opt as eo
from energy_opt.batches.tables import random_moves
from energy_opt.errors import Infeasible
from energy_opt.motion.plan import single

FACTORS = (2.5, 6.0, 15.0)  # of the shortest duration
UPRIGHT = [0.5, -0.3, 0.4, -0.3, -1.2, 0.5], [1.2, -1.5708, 0.05, -1.5708, -1.2, 0.0]  # of a ur5e
MODELS: dict[str, Any] = {"careful": "careful", "default": None}


def solved(robot: eo.Robot, model: Any, start: np.ndarray, goal: np.ndarray, duration: float) -> tuple[Any, ...]:
    """Energy and loss [J] of a move, whether it rests, and processor time [s]."""
    begin = time.process_time()
    result = eo.optimize(robot, model, start=start, goal=goal, duration=duration)
    robust = result.robust
    total = result.energy.total if robust is None else robust["total"]
    loss = result.energy.loss if robust is None else float(np.mean([row["loss"] for row in result.models]))
    return total, loss, "rests" in result.message, time.process_time() - begin


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit code 1 where a move with rest takes more energy."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=6, metavar="N", help="moves of each arm (6)")
    parser.add_argument("--seed", type=int, default=1, help="of the moves (1)")
    parser.add_argument("--arms", nargs="+", default=["panda", "ur5e"], help="robots (panda ur5e)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write the numbers")
    args = parser.parse_args(words)
    rows, numbers, worse = [], {}, False
    for name in (*args.arms, "ur5e, upright"):
        robot, ends = eo.load_robot(name.partition(",")[0]), []
        drawn = [(move.start, move.goal) for move in random_moves(robot, 3 * args.moves, args.seed)]
        for first, last in [UPRIGHT] if "upright" in name else drawn:
            try:
                least = eo.optimize(robot, start=first, goal=last, mode="retime", objective="time").duration
            except Infeasible:
                continue
            ends.append((np.array(first), np.array(last), least))
            if len(ends) == args.moves:
                break
        for (label, model), factor in ((m, f) for m in MODELS.items() for f in FACTORS):
            found = []
            for start, goal, least in ends:
                given = robot, model, start, goal, round(factor * least, 3)
                with patch.object(single, "rested", lambda context, move, timing, result, solve: result):
                    without = solved(*given)
                found.append((solved(*given), without))
            gains = [100 * (b[0] - a[0]) / b[1] for a, b in found]
            worse |= min(gains) < -1e-6
            rests, seconds = sum(a[2] for a, _ in found), [sum(x[3] for x in each) for each in zip(*found, strict=True)]
            cells = f"{np.mean(gains):.2f}", f"{np.max(gains):.1f}", f"{seconds[0] / seconds[1]:.2f}"
            rows.append((name, label, factor, f"{rests} of {len(found)}", *cells))
            numbers[f"{name}, {label}, {factor:g}"] = {"gains_percent": gains, "rests": rests, "seconds": seconds}
    print(table(["arm", "models", "times", "rest", "less loss [%]", "at best", "time"], rows))
    return finish(numbers, {"rest never costs energy": not worse}, args.out)


if __name__ == "__main__":
    sys.exit(main())
