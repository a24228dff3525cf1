"""The output of `tradeoff`: the front as a table, as a document and as a picture.

A front under several models is stated under the first, and at no point costs more than the evenly slowed move. Its
minima are those of the value that is minimised, which each point states, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.errors import Infeasible, at_least
from energy_opt.files import write_json, write_text
from energy_opt.folders import written_whole
from energy_opt.formats import table as rows
from energy_opt.motion import Move, Trajectory
from energy_opt.motion.plan.neighbour import Optimum
from energy_opt.motion.plan.robust import RobustPlanner
from energy_opt.motion.plan.robust_models import judges_of
from energy_opt.motion.plan.robust_rests import rested
from energy_opt.power.per_year import per_year_words
from energy_opt.reports.page import Report
from energy_opt.reports.words import energy_words, least_of
from energy_opt.requests.moves import TradeoffRequest
from energy_opt.results import Document, Found
from energy_opt.robot import Robot
from energy_opt.tradeoffs.fixed_cycle import Cycle
from energy_opt.tradeoffs.front import Front, Point

EXITS = {"solved": 0, "infeasible": 3, "not_converged": 4, "interrupted": 130}  # exit codes by status
COLUMNS = ("duration", "energy_total", "energy_standby", "energy_loss", "status")


def document(front: Front, *, robot: str, joints: tuple[str, ...], mode: str, cycle: Cycle | None) -> dict[str, Any]:
    """The content of tradeoff.json; energies in J, durations in s.

    Args:
        front: the points. robot: its name. joints: their names. mode: of the move.
        cycle: the cycle with the wait, or None.
    """
    least = front.minimum
    out: dict[str, Any] = {
        "status": front.status,
        "robot": robot,
        "joints": list(joints),
        "mode": mode,
        "points": [_point(p) for p in front.points],
        "minimum": None
        if least is None or least.energy is None
        else {"duration": least.duration, **_energies(least), "status": least.status},
        "fastest": None if front.fastest is None else front.fastest.duration,
        "solves": front.solves,
    }
    if front.status == "infeasible":
        shortest = np.nan if front.fastest is None else front.fastest.duration
        out["message"] = (
            f"none of the requested durations is possible; the shortest possible one is {at_least(shortest)} s"
        )
    if cycle is not None:
        best = front.cycle_minimum
        over = None if best is None else _over_cycle(best)
        out["cycle"] = {
            "length": cycle.length,
            "idle_power": cycle.idle_power,
            "minimum": None if best is None or over is None else {"duration": best.duration, **over},
            "at_free_minimum": None if front.minimum is None else _over_cycle(front.minimum),
            "fastest_then_wait": None if front.cycle_fastest is None else _over_cycle(front.cycle_fastest),
        }
    return out


def _energies(point: Point) -> dict[str, float | None]:
    parts = ("total", "standby", "stored", "loss")
    out = {f"energy_{part}": None if point.energy is None else getattr(point.energy, part) for part in parts}
    return out if point.minimised is None else out | {"energy_robust": point.minimised[0]}


def _over_cycle(point: Point) -> dict[str, float] | None:
    """Energy of move and wait; None if the move outlasts the cycle."""
    if point.energy is None or point.waiting is None:
        return None
    out = {
        "energy_total": point.cycle_total,
        "energy_standby": point.energy.standby + point.waiting.standby,
        "energy_holding": point.waiting.holding,
        "energy_loss": point.energy.loss,
        "energy_stored": point.energy.stored,
    }
    return out if point.minimised is None else out | {"energy_robust": point.minimised[1]}


def _point(point: Point) -> dict[str, Any]:
    """A point's record: duration, energies, status, and the energies over the cycle if it has them."""
    out: dict[str, Any] = {"duration": point.duration, **_energies(point), "status": point.status}
    if point.reason:
        out["reason"] = point.reason
    over = _over_cycle(point)
    return {**out, "cycle": over} if over else out


def table(found: Mapping[str, Any]) -> str:
    """The points of a tradeoff.json as CSV; energies of points without a trajectory are left empty."""
    records = [["" if row[name] is None else str(row[name]) for name in COLUMNS] for row in found["points"]]
    return "\n".join(",".join(row) for row in [list(COLUMNS), *records]) + "\n"


@dataclass(frozen=True, repr=False, eq=False)
class Tradeoff(Found):
    """Energy against duration of one move, or of a job over its cycle time: `durations` (P,) [s], `energies` (P,) [J];
    by name, as `["minimum"]`, the values of tradeoff.json.

    Attributes:
        document: returns the content of tradeoff.json. request: what was asked.
        page: the report of the document. words: a short table of it for a terminal.
        front: of a move, its points, from fast to slow; None for a job.
        robot: the arm. move: what was solved.
    """

    document: Document
    request: TradeoffRequest
    page: Callable[[Mapping[str, Any]], Report]
    words: Callable[[Mapping[str, Any]], str]
    robot: Robot
    front: Front | None = None
    move: Move | None = None
    answer = "tradeoff.json"

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return EXITS[self.document()["status"]]

    def text(self, out: Path) -> str:
        """A short table for a terminal, of a front that was saved into `out`."""
        return f"{self.words(self.document())}\nfiles in {out}"

    @property
    def durations(self) -> np.ndarray:
        """(P,) [s]; cycle times of a job."""
        return np.array([row["duration"] for row in self.document()["points"]])

    @property
    def energies(self) -> np.ndarray:
        """Total energy at each duration, (P,) [J]; nan where none was found."""
        return np.array([row["energy_total"] for row in self.document()["points"]], dtype=float)

    def kept(self, out: Path) -> Tradeoff:
        """Write tradeoff.csv, tradeoff.json, plot.png, report.html and trajectories of the optima into a folder."""
        best = {} if self.front is None else {"minimum": self.front.minimum, "cycle_minimum": self.front.cycle_minimum}
        with written_whole(out, self.answer) as aside:
            write_text(aside / "tradeoff.csv", table(self.document()))
            for name, point in best.items():
                if point is not None and point.trajectory is not None:
                    rows.write(point.trajectory, aside / f"trajectory_{name}.csv")
            self.page(self.document()).write(aside / "report.html", aside / "plot.png")
            write_json(aside / self.answer, self.document())
        return self

    def __repr__(self) -> str:
        found = self.document()
        least, what = found["minimum"], energy_words(found)
        best = "" if least is None else f", least {what} {least_of(found, least):.4g} J at {least['duration']:.4g} s"
        return f"Tradeoff({self.document()['robot']!r}, {len(self.document()['points'])} points{best})"

    def _repr_html_(self) -> str:
        records = zip(self.durations, self.energies, strict=True)
        cells = "".join(f"<tr><td>{d:.4g}</td><td>{e:.6g}</td></tr>" for d, e in records)
        return f"<table><tr><th>duration [s]</th><th>energy [J]</th></tr>{cells}</table>"


def motions_of(front: Front) -> dict[float, Trajectory]:
    """The trajectories of a front's points by duration [s]."""
    return {p.duration: p.trajectory for p in front.points if p.trajectory is not None}


def text(found: Mapping[str, Any]) -> str:
    """The content of a move's tradeoff.json as a short table for a terminal."""
    lines = [f"{'duration [s]':>12} {'total [J]':>11} {'standby':>11} {'loss':>11} {'stored':>11}  status"]
    for p in found["points"]:
        numbers = [p[f"energy_{part}"] for part in ("total", "standby", "loss", "stored")]
        cells = " ".join(f"{x:11.4f}" if x is not None and math.isfinite(x) else f"{'-':>11}" for x in numbers)
        lines.append(f"{p['duration']:12.4f} {cells}  {p['status']}{': ' + p['reason'] if 'reason' in p else ''}")
    if found["fastest"] is not None:
        lines.append(f"fastest: {found['fastest']:.4f} s")
    if least := found["minimum"]:
        energy, under = least_of(found, least), ""
        if "robust" in found:
            under = f" ({least['energy_total']:.4f} J under {found['models'][0]['name']}, as in the table)"
        lines.append(f"minimum {energy_words(found)}: {energy:.4f} J at {least['duration']:.4f} s{under}")
    cycle = found.get("cycle", {})
    best, fastest = cycle.get("minimum"), cycle.get("fastest_then_wait")
    if best:
        whole = best["duration"] >= cycle["length"] * (1 - 1e-6)
        how = f"a move of {best['duration']:.4f} s, " + ("no wait" if whole else "then a wait")
        energy, of = least_of(found, best), f" ({energy_words(found)})" if "robust" in found else ""
        line = f"in a {cycle['length']:g} s cycle: {how}: {energy:.1f} J{of}"
        if fastest:
            saved = 100 * (1 - energy / least_of(found, fastest))
            line += f"; fastest move, then a wait: {least_of(found, fastest):.1f} J ({saved:.1f} % is saved)"
        lines.append(line)
    if "per_year" in found:
        lines.append(per_year_words(found["per_year"], found["request"]["cycles_per_year"]))
    return "\n".join(lines)


def stated(robust: RobustPlanner, move: Move, front: Front, cycle: Cycle | None) -> Front:
    """A front computed for the mean of several models, stated under the first of them.

    A point that costs more than the evenly slowed move under any model, or at a corner of assumed friction, or that
    exceeds a torque limit under any model, is solved again as in `optimize`.

    Args:
        robust: its `planner` computed the front.
        cycle: the cycle under the first model, if any.
    """
    planner = robust.planner
    judges = [judge.model for _, judge in judges_of(robust.rivals, planner.robot)]
    cycles = [] if cycle is None else [cycle.under(model) for model in judges]
    several = len(robust.rivals if robust.kind == "mean" else judges) > 1
    timed, _, _ = planner.first_path(replace(move, duration=None, max_duration=None))
    fastest = planner.timing(timed)
    known: dict[int, Optimum] = {}

    def held(optimum: Optimum) -> Optimum:
        trajectory = optimum.trajectory
        in_time, slowed = replace(move, duration=trajectory.duration, max_duration=None), None
        if trajectory.duration >= fastest.duration:
            even = fastest.slowed(trajectory.duration).trajectory(planner.robot.joints)
            slowed = even if planner.certify(even, timed).valid else None
        if robust.overloads(trajectory) or (slowed is not None and robust.costs_more(trajectory, slowed)):
            try:
                result = robust.solve(in_time, [trajectory])
                return Optimum(result.trajectory, result.energy, result.status == "solved")
            except Infeasible:  # no room for another motion in so short a time: the point is kept
                pass
        elif optimum.chosen == "reshape":
            under = robust.totals, robust.value, robust.overloads
            trajectory = rested(planner, in_time, trajectory, robust.totals(slowed), *under, planner.stopped)
        return replace(optimum, trajectory=robust.first.filled(trajectory), energy=robust.first.energy(trajectory))

    def under_first(point: Point | None) -> Point | None:
        if point is None or point.optimum is None:
            return point
        if id(point.optimum) not in known:  # several points may share one optimum
            known[id(point.optimum)] = held(point.optimum)
        optimum = known[id(point.optimum)]
        totals, waiting, minimised = robust.totals(optimum.trajectory), None, None
        waits = np.zeros(len(totals))
        if cycle is not None and point.waiting is not None:
            waiting = cycle.waiting(point.duration)
            waits = np.array([one.waiting(point.duration).total for one in cycles])
        if several:
            minimised = robust.value(totals), robust.value(totals + waits)
        return replace(point, optimum=optimum, waiting=waiting, minimised=minimised)

    points = [found for point in front.points if (found := under_first(point)) is not None]
    optima = front.minimum, front.fastest, front.cycle_minimum, front.cycle_fastest
    minimum, quickest, in_cycle, at_once = map(under_first, optima)
    # points solved again may take less than the minima: the least is taken among points within the torque limits under
    # all models, if there are any
    solved = [p for p in (*points, minimum, quickest) if p is not None and p.status == "solved"]
    solved = [p for p in solved if p.trajectory is not None and not robust.overloads(p.trajectory)] or solved
    if minimum is not None and minimum.status == "solved":
        minimum = min(solved, key=lambda point: point.minimised[0] if point.minimised else point.total)
    if in_cycle is not None and in_cycle.status == "solved":
        known_in_cycle = [in_cycle, *(point for point in solved if point.waiting is not None)]
        in_cycle = min(known_in_cycle, key=lambda point: point.minimised[1] if point.minimised else point.cycle_total)
    best = replace(front, points=points, minimum=minimum, fastest=quickest)
    return replace(best, cycle_minimum=in_cycle, cycle_fastest=at_once)
