"""What compiled node functions save, and from how many moves on that is worth the time of the compiler.

    python benchmarks/compiled.py [--robots panda ur5e]

One move of each robot in 2 s, under the source paper's model and under the default models, by instructions in C (as
`auto` without a cache) and with functions that were compiled before. Each is the quickest of three. Times are CPU
times. Exit code 1 if compiling pays within FEW moves under the default models: then it should not wait to be asked for.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
import time
from collections.abc import Sequence

from common import finish, table

import energy_opt as eo
from energy_opt.power import source_method_2

FEW = 100
ENDS = {
    "panda": ([0, -0.785, 0, -2.356, 0, 1.571, 0.785], [0.9, 0.35, 0.2, -1.9, 0, 2.2, 0.9]),
    "ur5e": ([0, -1.5, 1.2, -1, 0.3, 0], [1.2, -0.9, 0.7, -1.6, -0.6, 0.8]),
}


def seconds(robot: eo.Robot, model: eo.PowerModel | None, policy: str, repeats: int = 3) -> float:
    """CPU time of the quickest of some solves."""
    start, goal = ENDS[robot.name]
    taken = []
    for _ in range(repeats):
        begin = time.process_time()
        eo.optimize(robot, model, start=start, goal=goal, duration=2.0, compile=policy)
        taken.append(time.process_time() - begin)
    return min(taken)


def compiled(robot: eo.Robot, model: eo.PowerModel | None) -> tuple[float, float]:
    """CPU time of the compiler, for a cache that is empty, and then of a solve."""
    with tempfile.TemporaryDirectory() as cache:
        os.environ["ENERGY_OPT_CACHE"] = cache
        begin = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        seconds(robot, model, "always", 1)
        return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - begin, seconds(robot, model, "always")


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", default=list(ENDS), choices=list(ENDS))
    rows, checks = [], {}
    for name in parser.parse_args(words).robots:
        robot = eo.load_robot(name)
        for kind, model in (("source paper", source_method_2(name)), ("default models", None)):
            once, after = compiled(robot, model)
            before = seconds(robot, model, "never")
            moves = once / max(before - after, 1e-3)
            rows.append((name, kind, before, after, once, moves))
            if model is None:
                checks[f"{name}: compiling pays from {moves:.0f} moves on, not within {FEW}"] = moves > FEW
    print(table(("robot", "model", "instructions s", "compiled s", "compiler s", "pays from"), rows))
    return finish({"rows": rows}, checks, None)


if __name__ == "__main__":
    sys.exit(main())
