"""Moves among things: how many are solved, proven and how fast, beside OMPL, OMPL smoothed, and Drake.

    python benchmarks/cells.py [--problems N] [--part PART ...] [--solve] [--rivals] [--solver sqp] [--keep FILE]

Problems are MotionBenchMaker's, from the folder of shared data beside the checkout, where that is there, and the moves
of benchmarks/suites/cells.toml. Parts are

    paths    first paths from start and goal alone, and the proof of the given ones (the default)
    given    whole answers from a planner's path, and the same without regard to anything, for its time
    further  the same with further initial paths of our own as starts
    ends     whole answers from start and goal alone
    payload  the suite's with one kilogram
    own      20 Panda and 10 ur5 moves with nothing but the own body, and without
    rivals   OMPL, OMPL smoothed, Drake (pip install ompl drake)

--solve is all but the rivals. Every row is printed when it is there; with --keep it is kept too, and a run that was cut
off goes on where it was. Every trajectory, whoever made it, is judged between its samples by the proof of clearance,
and every answer of ours besides by the many poses of dense_judge.py, which knows nothing of the cell's code. Seconds
are CPU times of one thread.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from cells_work import WAYS, Problem, Workers, answered, first_path, judged, own_body, problems, timed
from common import SUITES, cases, finish, table
from drake_rival import Drake
from ompl_rival import plan

from energy_opt.cell.cell import Cell
from energy_opt.cell.request import CellRequest
from energy_opt.motion.initial_paths.room import Room
from energy_opt.motion.path import through
from energy_opt.robot import load_robot

PARTS = ("paths", "given", "further", "ends", "payload", "own", "rivals")
PLANNING = 10.0  # s that a rival's planner has
UNCHANGED = 0.1  # % of loss: so near is the answer that was free to what it was without bodies
NO_COLUMN = ("kind", "message", "loss", "loss_scaled", "work", "work_scaled")

Row = dict[str, Any]
Measured = Iterator[tuple[str, Callable[[], Row]]]


def rivals(problem: Problem, seed: int) -> Row:
    """What OMPL, OMPL smoothed and Drake (from OMPL's path) come to."""
    ends, limits = np.stack([problem.start, problem.goal]), problem.robot.limits
    room = Room(problem.cell, ends)
    lower, upper = np.maximum(limits.lower, -2 * np.pi), np.minimum(limits.upper, 2 * np.pi)
    found = plan(problem.start, problem.goal, lower, upper, room.clear, seed, PLANNING)
    out: Row = {"ompl_seconds": found.seconds}
    for name, points in (("ompl", found.simplified), ("smoothed", found.smoothed)):
        trajectory = None if points is None else timed(problem, through(points))
        out[name], out[f"{name}_depth"] = judged(problem.cell, trajectory)
    first = problem.given or (None if found.simplified is None else through(found.simplified))
    out["drake"], out["drake_depth"] = "none", 0.0
    if first is not None:
        answer = Drake(problem.cell).solve(problem.start, problem.goal, first)
        out["drake"], out["drake_depth"] = judged(problem.cell, answer.trajectory)
        out["drake_seconds"] = answer.seconds
    return out


def measured(part: str, workers: Workers, count: int | None) -> Measured:
    """Names of a part's rows, and what measures each."""
    if part == "own":
        for name, total in SUITES.items():
            robot = load_robot(name)
            planner, cell = workers.of(robot), Cell(robot, CellRequest())
            for case in cases(robot, planner, min(total, count or total)):
                yield f"{name} {case.name}", lambda p=planner, c=case, at=cell: own_body(p, c, at)
        return
    for problem in problems(count):
        robot, given = problem.robot, problem.given
        if part == "paths":
            yield problem.name, lambda p=problem: first_path(p)
        elif part == "rivals":
            yield problem.name, lambda p=problem: rivals(p, workers.seed)
        elif part == "ends" or (part == "payload" and problem.kind == "suite"):
            heavy = part == "payload"
            yield problem.name, lambda p=problem, r=robot, h=heavy: answered(workers.of(r, None, h), p, None)
        elif part == "given" and given is not None:
            yield problem.name, lambda p=problem, r=robot: answered(workers.of(r), p, p.given, plain=True)
        elif part == "further" and given is not None:
            yield problem.name, lambda p=problem, r=robot: answered(workers.of(r, WAYS), p, p.given)


class Kept:
    """Rows by part and name, in a file to which each is added when it is there."""

    def __init__(self, file: Path | None, head: Row) -> None:
        self._file, self.rows = file, {part: {} for part in PARTS}  # type: dict[str, dict[str, Row]]
        if file is None:
            return
        lines = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
        if lines and lines[0] != head:
            raise SystemExit(f"{file} is of another run: {lines[0]}")
        for line in lines[1:]:
            self.rows[line["part"]][line["name"]] = line["row"]
        if not lines:
            self._add(head)

    def take(self, part: str, name: str, row: Row) -> None:
        """Keep a row."""
        self.rows[part][name] = row
        if self._file is not None:
            self._add({"part": part, "name": name, "row": row})

    def _add(self, line: Row) -> None:
        assert self._file is not None
        with self._file.open("a") as stream:
            stream.write(json.dumps(line) + "\n")


def said(row: Row) -> str:
    """A row in one line."""
    words = {key: value for key, value in row.items() if key not in NO_COLUMN and value is not None}
    return ", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in words.items())


def saved(rows: Sequence[Row]) -> tuple[float, float]:
    """Loss saved, %: the mean, and pooled; of what is infeasible nothing is saved."""
    each = [row.get("saved") or 0.0 for row in rows]
    sums = [sum(row[key] for row in rows if row.get("loss_scaled")) for key in ("loss", "loss_scaled")]
    return float(np.mean(each)), 100 * (1 - sums[0] / sums[1])


def of_answers(part: str, rows: list[Row]) -> dict[str, bool]:
    """Print what whole answers of a part come to, and hold it against what must be."""
    solved = [row for row in rows if row["status"] == "solved"]
    seconds = [row["seconds"] for row in rows]
    mean, pooled = saved(rows)
    print(f"{part}: {len(solved)} of {len(rows)} solved; {median(seconds):.2f} s median, {max(seconds):.2f} s worst")
    line = f"  loss saved {mean:.1f} % in the mean, {pooled:.1f} % pooled"
    works = [row for row in rows if row.get("work_scaled")]
    if works:
        share = 1 - sum(row["work"] for row in works) / sum(row["work_scaled"] for row in works)
        line += f"; of sum |tau v| dt {100 * share:.1f} %"
    print(line)
    checks = {}
    ratios = [row["ratio"] for row in rows if "ratio" in row]
    if ratios:
        print(f"  time beside the answer without bodies: {median(ratios):.2f} median, {max(ratios):.2f} worst")
    if part == "given":
        checks["given: 97 % are solved"] = len(solved) >= 0.97 * len(rows)
        checks["given: loss saved 58 % mean, 60 % pooled"] = mean >= 58 and pooled >= 60
        checks["given: at most 8 times the time of the answer without bodies (median)"] = median(ratios) <= 8
    if part == "further":
        checks["further: loss saved 63 % with further paths as starts"] = mean >= 63
    if part == "ends":
        quick = sum(row["seconds"] <= 10 for row in solved)
        checks["ends: 95 % are solved"] = len(solved) >= 0.95 * len(rows)
        checks["ends: 85 % are solved within 10 s"] = quick >= 0.85 * len(rows)
    if part == "own":
        free = [row for row in rows if row["plain_verdict"] == "proven"]
        kept = sum(row["saved"] for row in rows) / sum(row["plain_saved"] for row in rows)
        print(f"  {len(free)} were free without regard to bodies; {100 * kept:.1f} % of the loss saved is kept")
        checks["own: all are solved"] = len(solved) == len(rows)
        checks["own: 93 % of the loss saved is kept"] = kept >= 0.93
        checks["own: unchanged where that was free"] = all(abs(row["change_percent"]) <= UNCHANGED for row in free)
        checks["own: at most twice the time (median)"] = median(ratios) <= 2
    return checks


def of_rivals(rows: list[Row]) -> None:
    """Print what the proof says of others' trajectories."""
    for name in ("ompl", "smoothed", "drake"):
        verdicts, deep = [row[name] for row in rows], max(row[f"{name}_depth"] for row in rows)
        counts = {word: verdicts.count(word) for word in ("proven", "colliding", "undecided", "none")}
        print(
            f"{name}: {counts['proven']} proven, {counts['colliding']} touch (to {deep:.1f} mm), "
            f"{counts['undecided']} nearer than asked for, {counts['none']} without an answer"
        )


def of_paths(rows: list[Row]) -> dict[str, bool]:
    """Print what first paths come to."""
    found = [row for row in rows if row["source"] != "none"]
    seconds, proofs = [row["seconds"] for row in rows], [row["proof_seconds"] for row in rows if row["proof_seconds"]]
    print(f"paths: {len(found)} of {len(rows)}, {median(seconds):.2f} s median, {max(seconds):.2f} s worst")
    checks = {
        "paths: 95 % are found": len(found) >= 0.95 * len(rows),
        "paths: 85 % within 10 s": sum(row["seconds"] <= 10 for row in found) >= 0.85 * len(rows),
        "paths: every one is proven as timed": all(row["verdict"] == "proven" for row in found),
    }
    if proofs:
        print(
            f"proof of a planner's path as timed: {1e3 * median(proofs):.1f} ms median, {1e3 * max(proofs):.1f} worst"
        )
        checks["a free motion is proven within 30 ms (median, planners' paths)"] = median(proofs) <= 0.030
    return checks


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print; 1 where something that must hold does not."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, metavar="N", help="the first N of each kind (all)")
    parser.add_argument("--part", choices=PARTS, action="append", default=[], help="repeatable (paths)")
    parser.add_argument("--solve", action="store_true", help="all parts but rivals")
    parser.add_argument("--rivals", action="store_true", help="that part too")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--solver", choices=("ipopt", "sqp"), default="ipopt", help="of whole answers (ipopt)")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="rows so far, one a line; a run goes on from there")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the numbers as JSON")
    args = parser.parse_args(arguments)
    parts = args.part or list(PARTS[:-1] if args.solve else PARTS[:1])
    parts += ["rivals"] if args.rivals and "rivals" not in parts else []
    kept, workers = Kept(args.keep, {"seed": args.seed}), Workers(args.seed, args.solver)
    shown: dict[str, dict[str, Row]] = {}
    for part in parts:
        shown[part] = {}
        for name, measure in measured(part, workers, args.problems):
            if name not in kept.rows[part]:
                kept.take(part, name, measure())
            shown[part][name] = kept.rows[part][name]
            print(f"{part:>7}  {name}: {said(shown[part][name])}", flush=True)
    checks: dict[str, bool] = {}
    for part in parts:
        rows = shown[part]
        columns = [key for key in dict.fromkeys(k for row in rows.values() for k in row) if key not in NO_COLUMN]
        print(f"\n{part}")
        print(
            table(
                ["problem", *columns], [[name, *(row.get(key, "-") for key in columns)] for name, row in rows.items()]
            )
        )
        real = [row for row in rows.values() if row.get("kind") == "mbm"] or list(rows.values())
        if part == "rivals":
            of_rivals(real)
        elif real:
            checks |= of_paths(real) if part == "paths" else of_answers(part, real)
    ours = [row for part in parts for row in shown[part].values() if row.get("status") == "solved"]
    if ours:
        touching = sum(row["verdict"] != "proven" or row["touching"] > 0 for row in ours)
        print(f"\ncalled solved: {len(ours)}; of these {touching} touch something or are not proven")
        checks["no result called solved touches anything, by proof and by dense poses"] = not touching
    return finish({"rows": shown}, checks, args.out)


if __name__ == "__main__":
    sys.exit(main())
