"""The summary of a batch: failures, savings, other objectives, times, certificates, machine; as a document, as a table
and as a page.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from energy_opt.batches.records import IDENTITY, TIMES, Row
from energy_opt.motion.result import ROUNDING
from energy_opt.power.per_year import PerYear, per_year_words
from energy_opt.reports.charts import Chart
from energy_opt.reports.page import Report

PACKAGES = ("energy-opt", "casadi", "pin", "toppra", "numpy", "scipy")
WORST = 5  # most records in a list of the worst
DEFECT = 1e-6  # share of a bound: a larger excess is a violation
OF_SAVINGS = ("robot", "mode", "objective", "model", "payload", "timing")  # columns by which savings are grouped


def distribution(values: Iterable[float | None]) -> dict[str, float | int | None]:
    """Count, mean and quantiles of the values that are not None."""
    data = np.array([value for value in values if value is not None], dtype=float)
    names = ("worst", "p10", "median", "p90", "best")
    if data.size == 0:
        return {"count": 0, "mean": None, **dict.fromkeys(names)}
    quantiles = np.quantile(data, [0, 0.1, 0.5, 0.9, 1])
    return {"count": data.size, "mean": float(data.mean()), **dict(zip(names, quantiles.tolist(), strict=True))}


def grouped(records: Iterable[Row], names: Sequence[str]) -> dict[tuple[Any, ...], list[Row]]:
    """Records by the values of some columns, in the order of first appearance."""
    out: dict[tuple[Any, ...], list[Row]] = defaultdict(list)
    for row in records:
        out[tuple(row[name] for name in names)].append(row)
    return dict(out)


def summarize(
    suite: str, records: Sequence[Row], expected: int, run: dict[str, Any], worth: PerYear | None = None
) -> dict[str, Any]:
    """The summary of a batch.

    Args:
        suite: its name. records: in the order of the suite.
        expected: number of moves in the suite; fewer records mean an interrupted batch.
        run: facts about this run (jobs, wall seconds, moves per second).
        worth: runs of all moves of the batch per year, each once.
    """
    solved = [row for row in records if row["status"] == "solved"]
    known = [row for row in solved if row["saving_total_percent"] is not None]
    saved = sum(row["energy_scaled"] - row["energy_total"] for row in known) if known else None
    return {
        "suite": suite,
        "complete": len(records) == expected,
        "moves": expected,
        "status": dict(Counter(row["status"] for row in records)),
        "failures": [
            {name: row[name] for name in (*IDENTITY, "status", "error")} for row in records if row["status"] != "solved"
        ],
        "savings": _savings(solved),
        "proxies": _proxies(solved),
        "times": _times(records),
        "certificates": _certificates(records),
        **({} if worth is None else {"per_year": {**worth.of(saved), "cycles_per_year": worth.cycles_per_year}}),
        "run": run,
        "machine": machine(),
    }


def _savings(solved: Sequence[Row]) -> list[dict[str, Any]]:
    """Distributions of savings [%] and losses [J] by robot, mode, objective, model, payload and timing."""
    return [
        {
            **dict(zip(OF_SAVINGS, key, strict=True)),
            "loss_percent": distribution(row["saving_loss_percent"] for row in group),
            "total_percent": distribution(row["saving_total_percent"] for row in group),
            "loss_joules": sum(row["energy_loss"] for row in group),
        }
        for key, group in grouped(solved, OF_SAVINGS).items()
    ]


def _proxies(solved: Sequence[Row]) -> list[dict[str, Any]]:
    """The additional loss of each other objective over energy itself, on the same move at the same duration."""
    same = [name for name in IDENTITY if name != "objective"]
    best = {tuple(row[name] for name in same): row for row in solved if row["objective"] == "energy"}
    names = ("robot", "mode", "model", "timing", "objective")
    out = []
    for key, group in grouped((row for row in solved if row["objective"] != "energy"), names).items():
        pairs = [(row, other) for row in group if (other := best.get(tuple(row[name] for name in same)))]
        pairs = [(row, other) for row, other in pairs if abs(row["duration"] / other["duration"] - 1) < 1e-6]
        more = [
            100 * (row["energy_loss"] / other["energy_loss"] - 1)
            for row, other in pairs
            if other["energy_loss"] > ROUNDING * abs(other["energy_total"])
        ]
        joules = [row["energy_total"] - other["energy_total"] for row, other in pairs]
        quantiles, of = distribution(more), {"mean": "mean", "median": "median", "most": "best"}
        row = {"pairs": len(pairs), "more_loss_percent": {name: quantiles[which] for name, which in of.items()}}
        row["more_joules_mean"] = float(np.mean(joules)) if joules else None
        out.append({**dict(zip(names, key, strict=True)), **row})
    return out


def _times(records: Sequence[Row]) -> list[dict[str, Any]]:
    """Solve and build times [s] by robot and mode."""
    out = []
    for (robot, mode), group in grouped(records, ("robot", "mode")).items():
        build, solve = ([row[name] for row in group if row[name] is not None] for name in TIMES)
        if not solve:
            continue
        quantiles = distribution(solve)
        out.append(
            {
                "robot": robot,
                "mode": mode,
                "count": len(solve),
                "build_seconds_longest": max(build),
                "solve_seconds_median": quantiles["median"],
                "solve_seconds_p90": quantiles["p90"],
                "solve_seconds_longest": quantiles["best"],
                "solve_seconds_geometric_mean": float(np.exp(np.mean(np.log(np.maximum(solve, 1e-6))))),
            }
        )
    return out


def _certificates(records: Sequence[Row]) -> dict[str, Any]:
    """The number of judged results, the number that violate a limit, and the worst of them."""
    judged = [row for row in records if row["max_violation"] is not None]
    worst = sorted(judged, key=lambda row: -row["max_violation"])[:WORST]
    return {
        "judged": len(judged),
        "violated": sum(row["max_violation"] > DEFECT for row in judged),
        "worst": [{name: row[name] for name in (*IDENTITY, "status", "max_violation")} for row in worst],
    }


def machine() -> dict[str, Any]:
    """The machine and the versions that affect speed and digits."""
    versions: dict[str, str | None] = {}
    for name in PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = None
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "python": platform.python_version(),
        "versions": versions,
    }


def _cpu() -> str:
    """The name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:  # there is no /proc, as in a bare chroot
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())


def table(summary: Mapping[str, Any], out: Path) -> str:
    """The summary as a short table."""
    status = ", ".join(f"{count} {name}" for name, count in sorted(summary["status"].items()))
    lines = [f"{summary['suite']}: {sum(summary['status'].values())} of {summary['moves']} moves: {status or 'none'}"]
    for row in summary["failures"][:10]:
        lines.append(f"  {row['robot']} {row['move']} {row['mode']} {row['timing']}: {row['status']}: {row['error']}")
    if len(summary["failures"]) > 10:
        lines.append(f"  ... and {len(summary['failures']) - 10} more, in report.html")
    if summary["savings"]:
        lines.append("loss saved against the same path at the same duration [%]:")
        titles = " ".join(name for name in OF_SAVINGS if any(row[name] for row in summary["savings"]))
        lines.append(f"  {titles:44s} {'moves':>6} {'mean':>7} {'worst':>7} {'median':>7} {'best':>7}")
    for row in summary["savings"]:
        label = " ".join(str(row[n]) for n in OF_SAVINGS if row[n])
        found = row["loss_percent"]
        numbers = " ".join(
            f"{found[name]:7.2f}" if found[name] is not None else f"{'-':>7}"
            for name in ("mean", "worst", "median", "best")
        )
        lines.append(f"  {label:44s} {found['count']:6d} {numbers}")
    if "per_year" in summary:
        lines.append(per_year_words(summary["per_year"], summary["per_year"]["cycles_per_year"]))
    lines.append(f"{summary['run']['moves_per_second']:.3g} moves/s; results in {out}")
    return "\n".join(lines)


NAMED = IDENTITY[1:]  # the suite is in the title
HEADS = {
    "timing": "timing [s, or x of the fastest]",
    "payload": "payload [kg, m]",
    "count": "moves",
    "build_seconds_longest": "longest build [s]",
    "solve_seconds_median": "solve: median [s]",
    "solve_seconds_p90": "p90 [s]",
    "solve_seconds_longest": "longest [s]",
    "solve_seconds_geometric_mean": "geometric mean [s]",
    "max_violation": "largest violation [share of the bound]",
}
LISTED = 200  # most failures on the page; all are in results.parquet


def write_report(path: Path, records: Sequence[Row], summary: dict[str, Any]) -> None:
    """Write the page.

    Args:
        path: the file. records: of the finished moves. summary: the content of summary.json.
    """
    report = Report(f"Batch {summary['suite']}")
    counts = ", ".join(f"{count} {status}" for status, count in sorted(summary["status"].items()))
    report.headline(f"{len(records)} of {summary['moves']} moves done: {counts or 'none'}.")
    saved = [row["saving_loss_percent"] for row in records if row["saving_loss_percent"] is not None]
    shares = {"of the loss saved, mean": np.mean(saved), "at worst": min(saved), "at best": max(saved)} if saved else {}
    report.numbers({name: f"{share:.3g} %" for name, share in shares.items()})
    if "per_year" in summary:
        report.text(
            f"The batch {per_year_words(summary['per_year'], summary['per_year']['cycles_per_year'])}, each move once."
        )
    if not summary["complete"]:
        report.warning("The batch is not complete; --resume runs the remaining moves.")
    _failures(report, summary["failures"])
    _savings_shown(report, summary["savings"], records)
    if summary["proxies"]:
        report.section("Other objectives against energy")
        report.text("Additional loss if another quantity is minimised, for the same move and duration.")
        columns = _columns(("robot", "mode", "model", "timing", "objective", "pairs"))
        columns |= {f"loss {name} [%]": f"more_loss_percent.{name}" for name in ("mean", "most")}
        report.records(summary["proxies"], columns | {"energy mean [J]": "more_joules_mean"})
    report.section("Times")
    report.text("Building a problem happens once per robot and mode in each worker; solving happens for every move.")
    if summary["times"]:
        report.records(summary["times"], _columns(summary["times"][0]))
    run = summary["run"]
    named = {"processes": "jobs", "scheduler": "scheduler", "moves of this run": "moves", "took [s]": "seconds"}
    report.facts({name: run[key] for name, key in {**named, "moves per second": "moves_per_second"}.items()})
    _certificates_shown(report, summary["certificates"])
    report.section("Machine")
    machine = summary["machine"]
    report.facts({**{k: v for k, v in machine.items() if k != "versions"}, **machine["versions"]})
    report.command(run).write(path)


def _columns(names: Iterable[str]) -> dict[str, str]:
    """Columns of a table of records: their keys by their heads."""
    return {HEADS.get(name, name): name for name in names}


def _failures(report: Report, failures: Sequence[dict[str, Any]]) -> None:
    """The moves that were not solved, with their reasons."""
    report.section("Not solved")
    if not failures:
        report.text("None.")
        return
    report.records(failures[:LISTED], _columns((*NAMED, "status")) | {"reason": "error"})
    if len(failures) > LISTED:
        report.text(f"... and {len(failures) - LISTED} more.")


def _savings_shown(report: Report, savings: Sequence[dict[str, Any]], records: Sequence[Row]) -> None:
    """Savings by robot, mode, objective, model, payload and timing; and charts of savings and times."""
    report.section("Savings at equal duration")
    if not savings:
        report.text("None: no move was solved.")
        return
    report.text("Against the evenly slowed move on the same path, at the same duration.")
    columns = _columns(OF_SAVINGS) | {"moves": "loss_percent.count"}
    columns |= {f"loss {q} [%]": f"loss_percent.{q}" for q in ("mean", "worst", "p10", "median", "p90", "best")}
    report.records(savings, columns | {"total mean [%]": "total_percent.mean"})
    charts = []
    for label, column in (("loss saved [%]", "saving_loss_percent"), ("solve time [s]", "solve_seconds")):
        spread = {}
        for key, group in grouped(records, ("robot", "mode", "objective")).items():
            data = np.array([row[column] for row in group if row[column] is not None])
            if data.size:
                spread[" ".join(key)] = data
        charts.append(Chart(f"{label.capitalize()}: each point is a move", label, "", spread=spread))
    report.charts(*charts)


def _certificates_shown(report: Report, certificates: dict[str, Any]) -> None:
    """The number of judged trajectories, and the largest violations."""
    report.section("Worst certificates")
    report.text(
        f"{certificates['judged']} trajectories judged, {certificates['violated']} beyond a limit. "
        "A violation is a fraction of its bound; at or below zero is inside."
    )
    report.records(certificates["worst"], _columns((*NAMED, "status", "max_violation")))
